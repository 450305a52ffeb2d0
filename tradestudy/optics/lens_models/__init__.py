"""Lens models: from directions to places in the normalised picture and back, one family to a file."""
