"""A stereo rig of two equal cameras."""
