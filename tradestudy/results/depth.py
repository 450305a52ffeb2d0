"""/depth: every camera that measures depth, over distance; /disparity_causes: what determines its disparity error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results.variable import DECLARED, ESTIMATE, PAPER, ROUNDING, SEE_ERROR, Variable

JUDGED: Final = ("depth_uncertainty", "depth_error_radius")
"""The larger of these variables judges a camera; see `judged_uncertainty`."""
_EIGHT = f"{PAPER}, eqs. 4 and 8"
_MATCHING = "Carter, Proc. IEEE 75, 236 (1987)"

DEPTH: Final[Mapping[str, Variable]] = {
    "depth_discrimination": Variable(
        dims=("camera", "distance", "side"),
        units="m",
        long_name="depth discrimination: change of true depth that changes the disparity by the camera's "
        "depth.discrimination_step; infinite where no finite change does, NaN where the camera forms no image",
        symbol="Δa",
        reference=_EIGHT,
        error=ROUNDING,
    ),
    "depth_uncertainty": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="depth uncertainty from matching noise and calibration errors together; infinite where the "
        "interval of depths has no far end, NaN where the camera does not see the point",
        symbol="u(a)",
        reference="JCGM 101:2008, 7.7",
        error=SEE_ERROR,
    ),
    "depth_uncertainty_error": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="error of depth_uncertainty: the standard error over scrambles or, if the calibration is propagated "
        "linearly, the estimated error of doing so; NaN where depth_uncertainty is infinite or NaN",
        error=ESTIMATE,
    ),
    "depth_uncertainty_by_error_source": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="depth uncertainty from matching noise alone, from calibration errors alone, and from both; "
        "infinite where the interval of depths has no far end, NaN where the camera does not see the "
        "point",
        symbol="u(a)",
        error="see depth_uncertainty_by_error_source_error",
    ),
    "depth_uncertainty_by_error_source_error": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="error of depth_uncertainty_by_error_source, estimated like depth_uncertainty_error; NaN where the "
        "depth uncertainty is infinite or NaN",
        error=ESTIMATE,
    ),
    "depth_error_radius": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="radius about the true distance that contains 68.27 % of all measurements, from matching noise and "
        "calibration errors together; failed measurements count as infinitely wrong; infinite where too many fail, NaN "
        "where the camera does not see the point",
        symbol="r(a)",
        error="see depth_error_radius_error",
    ),
    "depth_error_radius_error": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="error of depth_error_radius, estimated like depth_uncertainty_error; NaN where depth_error_radius "
        "is infinite or NaN",
        error=ESTIMATE,
    ),
    "depth_error_radius_by_error_source": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="depth_error_radius from matching noise alone, from calibration errors alone, and from both; "
        "infinite where too many measurements fail, NaN where the camera does not see the point",
        symbol="r(a)",
        error="see depth_error_radius_by_error_source_error",
    ),
    "depth_error_radius_by_error_source_error": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="error of depth_error_radius_by_error_source, estimated like depth_uncertainty_error; NaN where the "
        "radius is infinite or NaN",
        error=ESTIMATE,
    ),
    "variance_share": Variable(
        dims=("camera", "distance", "part"),
        units="1",
        long_name="fraction of the variance of inverse depth (1/depth) that a group of errors causes; the fractions "
        "of all groups sum to 1; NaN where the camera has no such group or does not see the point",
        symbol="φ_i",
        reference="Owen and Prieur, SIAM/ASA J. Uncertainty Quantification 5 (2017) 986",
        error="not estimated: inverse depth is taken as linear in the errors",
    ),
    "depth_quantile": Variable(
        dims=("camera", "distance", "error_source", "quantile"),
        units="m",
        long_name="quantile of single measurements of depth; infinite where it lies at or beyond infinity, NaN where "
        "the camera does not see the point",
        symbol="a_p",
        error="not stored; depth_uncertainty_by_error_source_error, the error of half the width of the interval of "
        "depths, indicates its size",
    ),
    "failed_fraction": Variable(
        dims=("camera", "distance", "error_source"),
        units="1",
        long_name="fraction of failed measurements: those whose errors push the depth beyond infinity and, unless "
        "error_source is 'calibration', the declared false matches; NaN where the camera does not see the point",
        symbol="P_fail",
        error="see failed_fraction_error",
    ),
    "failed_fraction_error": Variable(
        dims=("camera", "distance", "error_source"),
        units="1",
        long_name="error of failed_fraction, estimated like depth_uncertainty_error; NaN where the camera does not "
        "see the point",
        error=ESTIMATE,
    ),
    "converged": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="whether, with 95 % confidence, the draws determine half the width of every interval of depths, and "
        "the larger of depth_uncertainty and depth_error_radius, to within accuracy.depth_uncertainty; where an "
        "interval has no far end, failed_fraction is judged instead; true where nothing is drawn",
    ),
    "equivalent_baseline": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="equivalent baseline: that of a stereo rig that has the camera's focal length, pixel pitch and "
        "disparity error and, calibration errors aside, measures depth equally well; NaN where the camera forms no "
        "image",
        symbol="B_eq",
        error=ROUNDING,
    ),
    "disparity_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity that the estimator uses, which decreases with distance; for an unfocused plenoptic "
        "camera, 1 px is one microlens; NaN where the camera forms no image",
        symbol="Δσ",
        reference=_EIGHT,
        error=ROUNDING,
    ),
    "disparity_error_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity error: as declared, or derived from scene.picture, including what a declared matcher "
        "adds; for an unfocused plenoptic camera, 1 px is one microlens; NaN where the camera forms no image or the "
        "compared pictures share no texture",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_error",
    ),
    "disparity_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of disparity_error_px; 0 where the disparity error is declared, NaN "
        "where disparity_error_px is NaN",
        error=ESTIMATE,
    ),
    "virtual_depth": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="virtual depth: distance from the microlens array to the image that the main lens forms, divided by "
        "the gap; positive if the image lies in front of the array, negative if behind; NaN for all but focused "
        "plenoptic cameras",
        symbol="v",
        error=ROUNDING,
    ),
    "usable": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="whether the camera is usable: whether every limit that applies holds",
    ),
    "limit_value": Variable(
        dims=("camera", "distance", "limit"),
        units="mixed",
        long_name="value that is compared with limit_bound, in m for 'real_image' (the distance of the object), in "
        "px for 'focus', 'matching', 'disparity_range' and 'last_disparity_step', otherwise a plain number; may be "
        "infinite; NaN where "
        "the limit does not apply or the camera forms no image; 'matching' has further conditions, so it can fail "
        "although this value is within its bound",
        error="for most limits, rounding only; limits on failures and on relative uncertainty also have the error of "
        "the draws, and 'matching' has the numerical error of the Cramér–Rao bound",
    ),
    "limit_met": Variable(
        dims=("camera", "distance", "limit"),
        units="1",
        long_name="1 where the limit holds, 0 where it does not, −1 where it does not apply",
    ),
    "limit_bound": Variable(
        dims=("camera", "limit"),
        units="mixed",
        long_name="bound of the limit, in the unit of limit_value; NaN where the limit does not apply",
        error="none where the bound is declared or fixed by the program ('saturation', 'matching'); rounding only for "
        "'real_image', whose bound is the focal length",
    ),
    "usable_near": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="near end of a usable interval of distances; NaN for indices after the last interval of the camera",
        error="see usable_near_error",
    ),
    "usable_near_error": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="standard error of usable_near over scrambles; 0 where no draws decide the end, infinite where "
        "a scramble has no such end, NaN for indices after the last interval of the camera",
        error=ESTIMATE,
    ),
    "usable_far": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="far end of a usable interval of distances; NaN for indices after the last interval of the camera",
        error="see usable_far_error",
    ),
    "usable_far_error": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="standard error of usable_far over scrambles; 0 where no draws decide the end, infinite where "
        "a scramble has no such end, NaN for indices after the last interval of the camera",
        error=ESTIMATE,
    ),
    "near_limit": Variable(
        dims=("camera", "interval"),
        units="",
        long_name="names of the limits that set usable_near, separated by commas ('matching: CONDITION' names the "
        "condition that is violated); 'range of the study' if scene.distances begins there; empty for indices after "
        "the last interval of the camera",
    ),
    "far_limit": Variable(
        dims=("camera", "interval"),
        units="",
        long_name="names of the limits that set usable_far, separated by commas ('matching: CONDITION' names the "
        "condition that is violated); 'range of the study' if scene.distances ends there; empty for indices after "
        "the last interval of the camera",
    ),
}

_OF_FIELD: Final = (
    "depth_uncertainty", "depth_uncertainty_error", "depth_uncertainty_by_error_source",
    "depth_uncertainty_by_error_source_error", "depth_error_radius", "depth_error_radius_error",
    "depth_error_radius_by_error_source", "depth_error_radius_by_error_source_error", "variance_share",
    "depth_quantile", "failed_fraction", "failed_fraction_error", "converged",
)  # fmt: skip
DEPTH_FIELD: Final[Mapping[str, Variable]] = {
    name: replace(DEPTH[name], dims=("camera", "field", "corner", *DEPTH[name].dims[1:])) for name in _OF_FIELD
}
"""/depth_field: the same variables off the axis, at the declared field positions towards every corner."""

DEPTH_MAP: Final[Mapping[str, Variable]] = {
    "depth_uncertainty": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="depth uncertainty from matching noise and calibration errors together, with inverse depth taken "
        "as linear in the calibration errors; infinite where the interval of depths has no far end, NaN "
        "where a camera of the rig does not see the point",
        symbol="u(a)",
        error=SEE_ERROR,
    ),
    "depth_uncertainty_error": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="error of depth_uncertainty from taking inverse depth as linear in the calibration errors: "
        "depth_uncertainty times the largest of the relative errors that this causes at nine places, namely on the "
        "axis, halfway to every corner of the picture and in every corner; NaN where depth_uncertainty or all nine "
        "errors are NaN",
        error=ESTIMATE,
    ),
    "depth_error_radius": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="radius about the true distance that contains 68.27 % of all measurements, with inverse depth taken "
        "as linear in the calibration errors; failed measurements and declared false matches count as infinitely "
        "wrong; infinite where too many fail, NaN where a camera of the rig does not see the point",
        symbol="r(a)",
        error="see depth_error_radius_error",
    ),
    "depth_error_radius_error": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="error of depth_error_radius, estimated like depth_uncertainty_error; NaN where depth_error_radius "
        "is infinite or NaN",
        error=ESTIMATE,
    ),
}
"""/depth_map: depth uncertainty over the pictures of rigs with lens models."""

DISPARITY_CAUSES: Final[Mapping[str, Variable]] = {
    "matched_window_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="side, in pixels, of the square matching window: the smaller of scene.picture.matching_window and "
        "the largest square on the object that appears in all compared pictures; for an estimator that compares "
        "several pairs of pictures, the side of the window that would give a single pair the same information; 0 where "
        "the pictures share nothing, NaN where the camera forms no image",
        symbol="W",
        error="for a least-squares estimator, the value may be up to 8 % too small; otherwise rounding only",
    ),
    "electrons": Variable(
        dims=("camera", "distance"),
        units="electrons",
        long_name="mean number of electrons in a pixel; NaN where the camera forms no image",
        symbol="n",
        error=ROUNDING,
    ),
    "disparity_error_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="Cramér–Rao bound on the disparity error, without the errors of a declared matcher; infinite "
        "where the compared pictures share no texture (there, disparity_error_px of /depth is NaN), NaN where the "
        "camera forms no image",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_error",
    ),
    "disparity_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of disparity_error_px; NaN where disparity_error_px is not finite",
        error=ESTIMATE,
    ),
    "disparity_error_px_changed": Variable(
        dims=("camera", "distance", "change"),
        units="px",
        long_name="disparity_error_px with one cause changed: without blur, without diffraction, with the light of "
        "brightest_camera, or with ten times the light; infinite where the compared pictures share no texture; NaN "
        "where the camera forms no image; with the light of brightest_camera, also NaN for that camera itself, and for "
        "all cameras where brightest_camera is empty",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_changed_error",
    ),
    "disparity_error_px_changed_error": Variable(
        dims=("camera", "distance", "change"),
        units="px",
        long_name="estimated numerical error of disparity_error_px_changed; NaN where "
        "disparity_error_px_changed is not finite",
        error=ESTIMATE,
    ),
    "matched_error_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity error of the declared matcher: disparity_error_px combined with the errors that the "
        "matcher adds; NaN or infinite where disparity_error_px is NaN or infinite",
        symbol="σ_d",
        error="see matched_error_px_error",
    ),
    "matched_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of matched_error_px, due to that of disparity_error_px; NaN where "
        "matched_error_px is not finite",
        error=ESTIMATE,
    ),
    "matcher": Variable(
        dims=("camera",),
        units="",
        long_name="what the declared matcher adds to the Cramér–Rao bound, in words; empty where none is declared",
    ),
    "false_matches": Variable(
        dims=("camera",),
        units="1",
        long_name="declared fraction of false matches",
        error=DECLARED,
    ),
    "brightest_camera": Variable(
        dims=("distance",),
        units="",
        long_name="of the cameras of this group of results, the one whose pixels collect the most electrons without "
        "saturating; empty where all "
        "saturate or fewer than two form an image",
    ),
}


def judged_uncertainty(depth: xr.Dataset, of: str = "") -> xr.DataArray:
    """What judges cameras: the larger of ``depth_uncertainty`` and ``depth_error_radius``.

    ``of`` is the end of the names of both variables: ``_error``, ``_by_error_source`` or ``_by_error_source_error``.
    """
    compared = of.removesuffix("_error")
    half_width, radius = (depth[name + compared] for name in JUDGED)
    of_half_width, of_radius = (depth[name + of] for name in JUDGED)
    return of_half_width.where(~(radius > half_width), of_radius)


def distances_without_decision(distance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Four of a study's distances [m], from end to end, for tables of studies whose decision declares none."""
    evenly = np.geomspace(distance[0], distance[-1], 4)
    return np.asarray(distance[np.unique(np.abs(np.log(distance[:, None] / evenly)).argmin(axis=0))])
