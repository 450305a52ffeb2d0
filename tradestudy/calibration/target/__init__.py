"""Calibration of a designed camera from a simulated target."""
