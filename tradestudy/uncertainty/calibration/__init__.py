"""Calibration as inference: from corners seen by cameras to joint draws of the parameters."""
