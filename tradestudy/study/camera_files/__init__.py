"""Calibration files of other programs: recognised by content, read into what cameras import, and written."""
