"""Calibration files of other programs: recognised by content, read into imported cameras, and written."""
