"""/datasheet: what a depth-camera data sheet states, at a few distances."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import EXACT, ROUNDING, Variable

_OVER: Final = ("camera", "sheet_distance")

DATASHEET: Final[Mapping[str, Variable]] = {
    "z_accuracy": Variable(
        dims=_OVER,
        units="m",
        long_name="depth uncertainty from calibration errors and drift, without noise; averaging within a session does "
        "not reduce it; infinite where the interval of depths has no far end, NaN where the camera does not see the "
        "point",
        error="see depth_uncertainty_by_error_source_error of /depth",
    ),
    "temporal_noise": Variable(
        dims=_OVER,
        units="m",
        long_name="spread of repeated measurements at one pixel: the depth uncertainty from matching noise alone, "
        "without pixel locking, because this bias is the same in every measurement; infinite where the interval of "
        "depths has no far end, NaN where the camera does not see the point",
        error="see depth_uncertainty_by_error_source_error of /depth",
    ),
    "subpixel_rms": Variable(
        dims=_OVER,
        units="px",
        long_name="disparity error; NaN where the camera forms no image or does not see the point",
        error="see disparity_error_px_error of /depth",
    ),
    "plane_fit_rms": Variable(
        dims=_OVER,
        units="m",
        long_name="root-mean-square deviation of measured depths from a plane fitted to them, for a flat target "
        "perpendicular to the axis; taken as the depth uncertainty from matching noise alone, which leaves out how "
        "calibration errors bend the plane; infinite or NaN under the same conditions as temporal_noise",
        error="see depth_uncertainty_by_error_source_error of /depth",
    ),
    "fill_rate": Variable(
        dims=_OVER,
        units="1",
        long_name="fraction of the picture in which the camera measures depth: overlap or availability, times 1 − "
        "failed_fraction; 0 where the camera is not usable",
        error="see failed_fraction_error of /depth",
    ),
    "field_width": Variable(
        dims=_OVER,
        units="m",
        long_name="width of the field of view at the distance Z: w Z/b, with the width w of the sensor and the "
        "distance b from lens to sensor; for a lens with a lens model, Z times the sum of the tangents of the angles "
        "between axis and edges, infinite if one reaches 90°",
        error=ROUNDING,
    ),
    "field_height": Variable(
        dims=_OVER,
        units="m",
        long_name="height of the field of view at the distance Z: h Z/b, with the height h of the sensor; see "
        "field_width",
        error=ROUNDING,
    ),
    "usable": Variable(dims=_OVER, units="1", long_name="whether the camera is usable at this distance", error=EXACT),
    "horizontal_field_of_view": Variable(
        dims=("camera",),
        units="rad",
        long_name="full horizontal field of view: 2 atan(w/(2b)), with w and b as in field_width, or that of the "
        "lens model; a camera that refocuses is focused at the middle sheet_distance",
        error=ROUNDING,
    ),
    "vertical_field_of_view": Variable(
        dims=("camera",),
        units="rad",
        long_name="full vertical field of view: 2 atan(h/(2b)), with h and b as in field_height, or that of the "
        "lens model; a camera that refocuses is focused at the middle sheet_distance",
        error=ROUNDING,
    ),
    "near_limit": Variable(
        dims=("camera",),
        units="m",
        long_name="nearest usable distance; NaN if there is none",
        error="see usable_near_error of /depth",
    ),
    "far_limit": Variable(
        dims=("camera",),
        units="m",
        long_name="farthest usable distance; NaN if there is none",
        error="see usable_far_error of /depth",
    ),
}
