"""Results about depth measured in pictures: how it compares with the true depth and with the prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import Variable

_JACKKNIFE: Final = "see {}_error: jackknife over 4 × 4 parts of the map"
_ESTIMATE: Final = "itself an estimate, accurate to about 20 %"

# name → unit and long name; each has a standard error beside it
_ESTIMATES: Final = {
    "bias": ("m", "median of measured minus true depth"),
    "spread": ("m", "half the width of the central 68.27 % interval of measured minus true depth"),
    "own": (
        "m",
        "standard deviation of depth that noise causes, to first order, given the texture in a matching "
        "window; median over the windows",
    ),
    "predicted": ("m", "median of the camera's depth uncertainty at the true distances; NaN where none is predicted"),
    "relative_bias": (
        "1",
        "median of the depth errors, each divided by the depth uncertainty predicted at its distance",
    ),
    "relative_spread": (
        "1",
        "half the width of the central 68.27 % interval of the depth errors, each divided by the depth "
        "uncertainty predicted at its distance",
    ),
    "within": ("1", "fraction of the depth errors within three predicted depth uncertainties"),
    "filled": (
        "1",
        "fill rate: points with a measured depth, divided by points that appear in two of the compared pictures",
    ),
    "available": (
        "1",
        "points that appear in two of the compared pictures, divided by all points where the picture shows a surface",
    ),
    "bias_px": ("px", "median of the disparity errors"),
    "spread_px": ("px", "half the width of the central 68.27 % interval of the disparity errors"),
    "over_bound": (
        "1",
        "half the width of the central 68.27 % interval of the depth errors, each divided by the "
        "standard deviation that noise causes given the texture in its matching window",
    ),
    "neighbour_correlation": ("1", "correlation of the depth errors of adjacent points"),
    "window_correlation": ("1", "correlation of the depth errors of points one matching window apart"),
}
ESTIMATES: Final = tuple(_ESTIMATES)
_COUNTS: Final = {
    "points": "number of points where the picture shows a surface within the searched distances",
    "seen": "number of unoccluded points that appear in two of the compared pictures",
    "measured": "number of unoccluded points that appear in two of the compared pictures and have a measured depth",
    "measured_unseen": "number of points with a measured depth that do not appear in two of the compared pictures",
    "windows": "number of non-overlapping matching windows that the measured points fill",
}
COUNTS: Final = tuple(_COUNTS)


def score_variables(dims: tuple[str, ...]) -> dict[str, Variable]:
    """Variables that compare measured with true depth, over the given dimensions."""
    found = {
        f"depth_{name}": Variable(dims=dims, units="1", long_name=words, error="exact")
        for name, words in _COUNTS.items()
    }
    for name, (units, words) in _ESTIMATES.items():
        found[f"depth_{name}"] = Variable(
            dims=dims, units=units, long_name=words, error=_JACKKNIFE.format(f"depth_{name}")
        )
        found[f"depth_{name}_error"] = Variable(
            dims=dims, units=units, long_name=f"standard error of depth_{name}", error=_ESTIMATE
        )
    found["predicted_availability"] = Variable(
        dims=dims,
        units="1",
        long_name="predicted fraction of object points on the axis that appear in two of the compared pictures; NaN "
        "where none is predicted",
        error="closed form",
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
        long_name="matcher fitted to the depth errors, in the notation of study files",
    ),
    "map_block": Variable(
        dims=("mapped_camera",),
        units="px",
        long_name="side of the square blocks of points; each block gives one value of a map",
        error="exact",
    ),
    "map_depth": Variable(
        dims=_MAP,
        units="m",
        long_name="median measured depth in a block; NaN where no point of the block has a measured depth",
        error=_AS_MAP,
    ),
    "map_depth_error": Variable(
        dims=_MAP, units="m", long_name="median of measured minus true depth in a block", error=_AS_MAP
    ),
    "map_hidden": Variable(
        dims=_MAP,
        units="1",
        long_name="fraction of the points in a block that appear in no second picture, although they show a surface",
        error="exact",
    ),
    "map_sharp": Variable(
        dims=_MAP,
        units="1",
        long_name="all-in-focus picture that the camera computes with the measured depth, divided by that of a "
        "white scene; NaN where the camera computes none",
        error="that of the depths used, and the noise of the picture",
    ),
    "class_distance": Variable(
        dims=_CLASS,
        units="m",
        long_name="middle of a class of true depths; all classes have the same number of points",
        error="half the width of the class",
    ),
    "class_bias": Variable(
        dims=_CLASS, units="m", long_name="median depth error of the class", error="see class_bias_error"
    ),
    "class_bias_error": Variable(dims=_CLASS, units="m", long_name="standard error of class_bias", error=_ESTIMATE),
    "class_spread": Variable(
        dims=_CLASS,
        units="m",
        long_name="half the width of the central 68.27 % interval of the depth errors of the class",
        error="see class_spread_error",
    ),
    "class_spread_error": Variable(dims=_CLASS, units="m", long_name="standard error of class_spread", error=_ESTIMATE),
    "class_predicted": Variable(
        dims=_CLASS,
        units="m",
        long_name="predicted depth uncertainty of the class; NaN where none is predicted",
        error="see depth_uncertainty_error of /depth",
    ),
}
