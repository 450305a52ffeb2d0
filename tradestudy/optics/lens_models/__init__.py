"""Lens models: from directions to positions in the normalised picture and back, one family per file."""
