"""/depth_loop: depth measured in pictures of planes, compared with the prediction, over distance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.depth_maps import score_variables
from tradestudy.results.variable import Variable

_POINT: Final = ("camera", "distance", "contrast", "electrons")
_CAMERA: Final = ("camera",)
_FIT: Final = "a standard error; the number of independent errors is the number of non-overlapping windows"

DEPTH_LOOP: Final[Mapping[str, Variable]] = {
    **score_variables(_POINT),
    "reason": Variable(dims=_POINT, units="", long_name="why nothing was measured; empty where depth was measured"),
    "blur_px": Variable(
        dims=_POINT, units="px", long_name="geometric blur of the matched picture", error="closed form"
    ),
    "over_matcher": Variable(
        dims=_POINT,
        units="1",
        long_name="standard deviation of the errors of true matches, relative to what the fitted matcher "
        "predicts for their windows",
        error="see over_matcher_error",
    ),
    "over_matcher_error": Variable(
        dims=_POINT, units="1", long_name="standard error of over_matcher", error="from the fourth moment of the errors"
    ),
    "fitted": Variable(
        dims=("distance",),
        units="1",
        long_name="whether the matcher is fitted to the errors at this distance",
        error="exact",
    ),
    "matcher": Variable(
        dims=_CAMERA, units="", long_name="fitted matcher, in the notation of study files, or why there is none"
    ),
    "matcher_factor": Variable(
        dims=_CAMERA,
        units="1",
        long_name="fitted factor: noise of the matcher, relative to the Cramér–Rao bound",
        error="see matcher_factor_error",
    ),
    "matcher_factor_error": Variable(dims=_CAMERA, units="1", long_name="error of matcher_factor", error=_FIT),
    "matcher_floor": Variable(
        dims=_CAMERA,
        units="px",
        long_name="fitted floor: noise that more light does not reduce",
        error="see matcher_floor_error",
    ),
    "matcher_floor_error": Variable(dims=_CAMERA, units="px", long_name="error of matcher_floor", error=_FIT),
    "matcher_false_matches": Variable(
        dims=_CAMERA, units="1", long_name="fitted fraction of false matches", error="see matcher_false_matches_error"
    ),
    "matcher_false_matches_error": Variable(
        dims=_CAMERA, units="1", long_name="error of matcher_false_matches", error=_FIT
    ),
}
