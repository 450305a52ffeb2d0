"""Calibration of a real pair from the corners of a board that both of its cameras saw."""
