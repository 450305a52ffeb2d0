"""Names of what a fit of two pinholes with radial distortion finds."""

from tradestudy.calibration.corners.view_blocks import shared_names
from tradestudy.cameras.calibrated_pair import RADIAL

SHARED_NAMES = shared_names(RADIAL)
