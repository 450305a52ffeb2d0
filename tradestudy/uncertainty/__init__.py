"""Calibration errors propagated to depth."""
