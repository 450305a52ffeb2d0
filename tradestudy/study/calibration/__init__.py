"""Calibration errors of a study: sources and exact models, posteriors, propagation, sensitivity, decisions."""
