"""From corners, targets, files and posteriors to the distribution of a camera's parameters."""
