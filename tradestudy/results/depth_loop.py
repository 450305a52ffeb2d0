"""/depth_loop: depth measured in pictures of planes, compared with the prediction, over distance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.depth_maps import score_variables
from tradestudy.results.variable import ESTIMATE, EXACT, ROUNDING, Variable

_POINT: Final = ("camera", "distance", "contrast", "electrons")
_CAMERA: Final = ("camera",)
_FIT: Final = "itself a standard error, assuming one independent depth error per matching window"

DEPTH_LOOP: Final[Mapping[str, Variable]] = {
    **score_variables(_POINT),
    "reason": Variable(dims=_POINT, units="", long_name="why no depth was measured; empty where depth was measured"),
    "blur_px": Variable(
        dims=_POINT,
        units="px",
        long_name="diameter of the geometric blur in the compared pictures; NaN where the camera forms no image",
        error=ROUNDING,
    ),
    "over_matcher": Variable(
        dims=_POINT,
        units="1",
        long_name="standard deviation of the depth errors, false matches excluded, each error converted to disparity "
        "and divided by the disparity error that the fitted matcher predicts for the matching window of the point; "
        "NaN where nothing was measured or no matcher was fitted",
        error="see over_matcher_error",
    ),
    "over_matcher_error": Variable(
        dims=_POINT,
        units="1",
        long_name="standard error of over_matcher, from the kurtosis of the same converted and divided depth errors, "
        "without false matches; NaN where over_matcher is NaN",
        error=ESTIMATE,
    ),
    "fitted": Variable(
        dims=("distance",),
        units="1",
        long_name="whether this distance is one of depth_loop.fitted_at, at which the matchers are fitted",
        error=EXACT,
    ),
    "matcher": Variable(
        dims=_CAMERA, units="", long_name="fitted matcher, as a line of a study file, or why none can be fitted"
    ),
    "matcher_factor": Variable(
        dims=_CAMERA,
        units="1",
        long_name="fitted factor of the matcher: its noise relative to the Cramér–Rao bound; NaN where no matcher can "
        "be fitted",
        error="see matcher_factor_error",
    ),
    "matcher_factor_error": Variable(
        dims=_CAMERA, units="1", long_name="error of matcher_factor; NaN where matcher_factor is NaN", error=_FIT
    ),
    "matcher_floor": Variable(
        dims=_CAMERA,
        units="px",
        long_name="fitted floor of the matcher: noise that more light does not reduce; NaN where no matcher can be "
        "fitted",
        error="see matcher_floor_error",
    ),
    "matcher_floor_error": Variable(
        dims=_CAMERA, units="px", long_name="error of matcher_floor; NaN where matcher_floor is NaN", error=_FIT
    ),
    "matcher_false_matches": Variable(
        dims=_CAMERA,
        units="1",
        long_name="fitted fraction of false matches; NaN where no matcher can be fitted",
        error="see matcher_false_matches_error",
    ),
    "matcher_false_matches_error": Variable(
        dims=_CAMERA,
        units="1",
        long_name="error of matcher_false_matches; NaN where matcher_false_matches is NaN",
        error=_FIT,
    ),
}
