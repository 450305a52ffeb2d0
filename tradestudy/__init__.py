"""Trade studies of plenoptic cameras against stereo rigs: depth, depth of field, diffraction, calibration."""
