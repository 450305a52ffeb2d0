"""Results about depth measured in pictures: how it compares with the true depth and with the prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import ESTIMATE, EXACT, ROUNDING, Variable

_ESTIMATES: Final = {
    "bias": ("m", "median depth error"),
    "spread": ("m", "half the width of the central 68.27 % interval of the depth errors"),
    "own": ("m", "median of the standard deviations of depth due to noise"),
    "predicted": ("m", "median of the predicted depth uncertainties"),
    "relative_bias": ("1", "median of the depth errors, each divided by the predicted depth uncertainty"),
    "relative_spread": (
        "1",
        "half the width of the central 68.27 % interval of the depth errors, each divided by the predicted depth "
        "uncertainty",
    ),
    "within": (
        "1",
        "fraction of the depth errors whose magnitude is at most three times the predicted depth uncertainty",
    ),
    "filled": ("1", "fill rate: number of measured points, divided by the number of seen points"),
    "available": ("1", "number of seen points, divided by the number of points that show a surface"),
    "bias_px": ("px", "median of the depth errors, each converted to disparity"),
    "spread_px": (
        "px",
        "half the width of the central 68.27 % interval of the depth errors, each converted to disparity",
    ),
    "over_bound": (
        "1",
        "half the width of the central 68.27 % interval of the depth errors, each divided by the standard deviation "
        "of depth due to noise",
    ),
    "neighbour_correlation": (
        "1",
        "correlation of the depth errors of neighbouring points in a row of the depth map, each error divided by the "
        "standard deviation of depth due to noise",
    ),
    "window_correlation": (
        "1",
        "correlation of the depth errors of points one matching window apart in a row of the depth map, each error "
        "divided by the standard deviation of depth due to noise",
    ),
}
"""Unit and long name by name; each has a standard error beside it."""
ESTIMATES: Final = tuple(_ESTIMATES)
_UNKNOWN: Final = {
    "predicted": "NaN where nothing was measured or no depth uncertainty is predicted",
    "relative_bias": "NaN where nothing was measured or no depth uncertainty is predicted",
    "relative_spread": "NaN where nothing was measured or no depth uncertainty is predicted",
    "within": "NaN where nothing was measured or no depth uncertainty is predicted",
    "filled": "NaN where no point is seen",
    "available": "NaN where no point shows a surface",
    "bias_px": "NaN where nothing was measured or the camera measures no disparity",
    "spread_px": "NaN where nothing was measured or the camera measures no disparity",
    "neighbour_correlation": "NaN for fewer than three pairs of points",
    "window_correlation": "NaN for fewer than three pairs of points",
}
_COUNTS: Final = {
    "points": "number of points that show a surface",
    "seen": "number of seen points",
    "measured": "number of measured points: seen points with a measured depth",
    "measured_unseen": "number of points that have a measured depth but are not seen",
    "windows": "number of measured points, divided by the number of points in one matching window",
}
COUNTS: Final = tuple(_COUNTS)


def score_variables(dims: tuple[str, ...]) -> dict[str, Variable]:
    """Variables that compare measured with true depth, over the given dimensions."""
    found = {
        f"depth_{name}": Variable(dims=dims, units="1", long_name=words, error=EXACT) for name, words in _COUNTS.items()
    }
    for name, (units, words) in _ESTIMATES.items():
        unknown = _UNKNOWN.get(name, "NaN where nothing was measured")
        found[f"depth_{name}"] = Variable(
            dims=dims, units=units, long_name=f"{words}; {unknown}", error=f"see depth_{name}_error"
        )
        found[f"depth_{name}_error"] = Variable(
            dims=dims,
            units=units,
            long_name=f"standard error of depth_{name}, by a jackknife; may be NaN",
            error=ESTIMATE,
        )
    found["predicted_availability"] = Variable(
        dims=dims,
        units="1",
        long_name="predicted depth_available, at the distance of the plane or, in /pictures, at the median true depth; "
        "NaN where none is predicted",
        error=ROUNDING,
    )
    return found


_MAP: Final = ("mapped_camera", "map_row", "map_column")
_CLASS: Final = ("mapped_camera", "depth_class")
_AS_MAP: Final = "see depth_spread"

DEPTH_MAPS: Final[Mapping[str, Variable]] = {
    **score_variables(("mapped_camera",)),
    "matcher": Variable(
        dims=("mapped_camera",),
        units="",
        long_name="matcher fitted to the depth errors, as a line of a study file, or why none can be fitted",
    ),
    "map_block": Variable(
        dims=("mapped_camera",),
        units="px",
        long_name="side of the square blocks of pixels in map_depth, map_depth_error and map_hidden",
        error=EXACT,
    ),
    "map_depth": Variable(
        dims=_MAP,
        units="m",
        long_name="median measured depth in a block; NaN where nothing was measured",
        error=_AS_MAP,
    ),
    "map_depth_error": Variable(
        dims=_MAP,
        units="m",
        long_name="median depth error in a block; NaN where no seen point was measured",
        error=_AS_MAP,
    ),
    "map_hidden": Variable(
        dims=_MAP,
        units="1",
        long_name="of the points in a block that show a surface, the fraction that are not seen (as defined for "
        "/depth_loop); NaN where no point shows a surface",
        error=EXACT,
    ),
    "map_sharp": Variable(
        dims=_MAP,
        units="1",
        long_name="brightness of the all-in-focus picture, computed from the camera's pictures and the measured depth, "
        "relative to that of a white scene; NaN where the camera computes no such picture, and beyond the edge "
        "of pictures smaller than the largest",
        error="not stored: it comes from the errors of the measured depth and the noise of the pictures",
    ),
    "class_distance": Variable(
        dims=_CLASS,
        units="m",
        long_name="median true depth of the class; NaN where its points fill fewer than two matching windows",
        error="none: the median of exact depths",
    ),
    "class_bias": Variable(
        dims=_CLASS,
        units="m",
        long_name="median depth error of the class; NaN where class_distance is NaN",
        error="see class_bias_error",
    ),
    "class_bias_error": Variable(
        dims=_CLASS,
        units="m",
        long_name="standard error of class_bias, from the number of matching windows; NaN where class_distance is NaN",
        error=ESTIMATE,
    ),
    "class_spread": Variable(
        dims=_CLASS,
        units="m",
        long_name="half the width of the central 68.27 % interval of the depth errors of the class; NaN where "
        "class_distance is NaN",
        error="see class_spread_error",
    ),
    "class_spread_error": Variable(
        dims=_CLASS,
        units="m",
        long_name="standard error of class_spread, from the number of matching windows; NaN where class_distance is "
        "NaN",
        error=ESTIMATE,
    ),
    "class_predicted": Variable(
        dims=_CLASS,
        units="m",
        long_name="median of the predicted depth uncertainties of the class; NaN where class_distance is NaN or none "
        "is predicted",
        error="see depth_uncertainty_error of /depth",
    ),
}
