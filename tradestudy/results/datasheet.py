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
        long_name="half the width of the central 68.27 % interval of depth from calibration errors alone, which "
        "averaging does not reduce",
        error=f"{SEE_ERROR} of /depth",
    ),
    "temporal_noise": Variable(
        dims=_OVER,
        units="m",
        long_name="half the width of the central 68.27 % interval of depth from noise alone, as repeated "
        "measurements of one pixel show it",
        error=f"{SEE_ERROR} of /depth",
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
        long_name="root-mean-square deviation from a plane fitted to a flat target perpendicular to the axis: "
        "noise alone, because calibration errors shift and tilt the whole plane",
        error=f"{SEE_ERROR} of /depth",
    ),
    "fill_rate": Variable(
        dims=_OVER,
        units="1",
        long_name="fraction of the picture in which depth is measured: the fraction common to the views or "
        "microlenses, times one minus the failed fraction; 0 where the camera is not usable",
        error="that of the failed fraction",
    ),
    "field_width": Variable(
        dims=_OVER,
        units="m",
        long_name="width of the field of view at this distance Z: w Z/b, with the width w of the sensor and the "
        "distance b from lens to sensor",
        error="exact",
    ),
    "field_height": Variable(
        dims=_OVER,
        units="m",
        long_name="height of the field of view at this distance Z: h Z/b, with the height h of the sensor",
        error="exact",
    ),
    "usable": Variable(dims=_OVER, units="1", long_name="whether the camera is usable at this distance", error="exact"),
    "horizontal_field_of_view": Variable(
        dims=("camera",),
        units="rad",
        long_name="full horizontal field of view, 2 atan(w/2b), focused at the middle sheet_distance",
        error="exact",
    ),
    "vertical_field_of_view": Variable(
        dims=("camera",),
        units="rad",
        long_name="full vertical field of view, 2 atan(h/2b), focused at the middle sheet_distance",
        error="exact",
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
