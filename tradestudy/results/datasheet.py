"""/datasheet: what a depth-camera data sheet states, at a few distances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import SEE_ERROR, Variable

_OVER: Final = ("camera", "sheet_distance")

DATASHEET: Final[Mapping[str, Variable]] = {
    "z_accuracy": Variable(
        dims=_OVER,
        units="m",
        long_name="half the central 68.27 % interval of depth by calibration errors alone: what averaging leaves",
        error=SEE_ERROR,
    ),
    "temporal_noise": Variable(
        dims=_OVER,
        units="m",
        long_name="half the central 68.27 % interval of depth by noise alone: what repeating one pixel shows",
        error=SEE_ERROR,
    ),
    "subpixel_rms": Variable(
        dims=_OVER,
        units="px",
        long_name="standard deviation of one measured disparity",
        error="disparity_error_px_error of /depth",
    ),
    "plane_fit_rms": Variable(
        dims=_OVER,
        units="m",
        long_name="deviation from a plane fitted to a flat target across the axis: noise, as calibration errors shift "
        "and tilt the plane as a whole",
        error=SEE_ERROR,
    ),
    "fill_rate": Variable(
        dims=_OVER,
        units="1",
        long_name="share of the picture with a depth: common share of the views or microlenses, times one less the "
        "failed fraction; 0 where the camera is not usable",
        error="that of the failed fraction",
    ),
    "field_width": Variable(
        dims=_OVER,
        units="m",
        long_name="width of what the sensor sees, w Z/b with b from lens to sensor",
        error="exact",
    ),
    "field_height": Variable(dims=_OVER, units="m", long_name="its height", error="exact"),
    "usable": Variable(dims=_OVER, units="1", long_name="whether the camera is usable there", error="exact"),
    "horizontal_field_of_view": Variable(
        dims=("camera",), units="rad", long_name="2 atan(w/2b), focused at the middle distance", error="exact"
    ),
    "vertical_field_of_view": Variable(
        dims=("camera",), units="rad", long_name="2 atan(h/2b), likewise", error="exact"
    ),
    "near_limit": Variable(
        dims=("camera",),
        units="m",
        long_name="nearest usable distance of the study; NaN where there is none",
        error="usable_near_error of /depth",
    ),
    "far_limit": Variable(
        dims=("camera",),
        units="m",
        long_name="farthest usable distance of the study; NaN where there is none",
        error="usable_far_error of /depth",
    ),
}
