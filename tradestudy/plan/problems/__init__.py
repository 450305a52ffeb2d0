"""The problems of a study that models are chosen for: cameras that measure depth, depth of field, pictures of light."""
