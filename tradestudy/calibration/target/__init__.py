"""Calibration of a designed camera from a synthetic target that is shown to it."""
