"""/depth: every camera that measures depth, over distance; /disparity_causes: what determines its disparity error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
import numpy.typing as npt

from tradestudy.results.variable import PAPER, ROUNDING, SEE_ERROR, Variable

_UNSEEN: Final = "NaN where the camera does not see the point"
DEPTH_ROUNDING: Final = "closed form; rounding only, magnified by the condition number of the paper's eq. 8"
_EIGHT = f"{PAPER}, eqs. 4 and 8"
_MATCHING = "Carter, Proc. IEEE 75, 236 (1987)"

DEPTH: Final[Mapping[str, Variable]] = {
    "depth_discrimination": Variable(
        dims=("camera", "distance", "side"),
        units="m",
        long_name="change of true depth that moves the estimator's disparity by the declared step; "
        "infinite where no finite change does",
        symbol="Δa",
        reference=_EIGHT,
        error=DEPTH_ROUNDING,
    ),
    "depth_uncertainty": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="half the width of the central 68.27 % interval of one measured depth, from noise and calibration; "
        f"infinite where the interval has no far end, {_UNSEEN}",
        symbol="u(a)",
        reference="JCGM 101:2008, 7.7",
        error=SEE_ERROR,
    ),
    "depth_uncertainty_error": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="standard error of depth_uncertainty over scrambles of the draws; with linear propagation, its "
        "difference from a computation with draws",
        error="itself an estimate; NaN where the interval is not bounded",
    ),
    "depth_uncertainty_by_error_source": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="depth uncertainty from noise only, calibration only, and both; "
        f"infinite where the interval has no far end, {_UNSEEN}",
        symbol="u(a)",
        error=SEE_ERROR,
    ),
    "depth_uncertainty_by_error_source_error": Variable(
        dims=("camera", "distance", "error_source"),
        units="m",
        long_name="error of depth_uncertainty_by_error_source, determined like depth_uncertainty_error",
        error="itself an estimate; NaN where the interval is not bounded",
    ),
    "variance_share": Variable(
        dims=("camera", "distance", "part"),
        units="1",
        long_name="share of the variance of inverse depth due to one group of errors (part); the shares of all "
        "groups sum to 1; NaN where a camera has no such group",
        symbol="φ_i",
        reference="Owen and Prieur, SIAM/ASA J. Uncertainty Quantification 5 (2017) 986",
        error="that of the linearisation in inverse depth",
    ),
    "depth_quantile": Variable(
        dims=("camera", "distance", "error_source", "quantile"),
        units="m",
        long_name=f"quantile of one measured depth; infinite where the quantile is at or beyond infinity, {_UNSEEN}",
        symbol="a_p",
        error=SEE_ERROR,
    ),
    "failed_fraction": Variable(
        dims=("camera", "distance", "error_source"),
        units="1",
        long_name="fraction of measurements that fail, because their disparity lies beyond that of infinity or because "
        f"they are among the declared false matches; {_UNSEEN}",
        symbol="P(a = ∞)",
        error="failed_fraction_error",
    ),
    "failed_fraction_error": Variable(
        dims=("camera", "distance", "error_source"),
        units="1",
        long_name=f"error of failed_fraction, determined like depth_uncertainty_error; {_UNSEEN}",
        error="itself an estimate",
    ),
    "converged": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="whether every depth_uncertainty is known to within the tolerance, by a Student t interval; where "
        "the depth interval has no far end, whether failed_fraction is",
        error="none: a comparison",
    ),
    "equivalent_baseline": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="baseline of a stereo rig that measures depth equally well with the same focal length and "
        "disparity error",
        symbol="B_eq",
        error=DEPTH_ROUNDING,
    ),
    "disparity_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity across the estimator's baseline",
        symbol="Δσ",
        reference=_EIGHT,
        error=DEPTH_ROUNDING,
    ),
    "disparity_error_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="standard deviation of one measured disparity: declared, or the matching bound plus what a declared "
        "matcher adds; for the views of an unfocused plenoptic camera, 1 px is one microlens; "
        "NaN where the camera forms no image or its image has no texture left",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_error",
    ),
    "disparity_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of disparity_error_px: quadrature over spatial frequencies, aliasing, "
        "diffraction; 0 where it is declared; NaN where the camera forms no image",
        error="itself an estimate",
    ),
    "virtual_depth": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="virtual depth, positive if Keplerian, negative if Galilean; NaN for a stereo rig",
        symbol="v = a_L/b_L",
        error=DEPTH_ROUNDING,
    ),
    "usable": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="whether the camera is usable: every declared limit holds",
        error="none: a comparison; the ends of intervals are in usable_near and usable_far",
    ),
    "limit_value": Variable(
        dims=("camera", "distance", "limit"),
        units="mixed",
        long_name="value that is compared with a limit, in the unit of limit_units; infinite where the quantity "
        "is infinite; NaN where the limit does not apply",
        error=DEPTH_ROUNDING,
    ),
    "limit_met": Variable(
        dims=("camera", "distance", "limit"),
        units="1",
        long_name="1 where the limit holds, 0 where it does not, −1 where it does not apply",
        error="none: a comparison",
    ),
    "limit_bound": Variable(
        dims=("camera", "limit"),
        units="mixed",
        long_name="bound of a limit; NaN where the limit does not apply",
        error="none: declared",
    ),
    "usable_near": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="near end of a usable interval; NaN where the camera has fewer intervals than another",
        error="usable_near_error",
    ),
    "usable_near_error": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="standard error over scrambles of the draws; 0 where no draws decide the end, infinite where "
        "not every scramble has this end, NaN where a camera has fewer intervals",
        error="itself an estimate",
    ),
    "usable_far": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="far end of a usable interval; NaN where the camera has fewer intervals than another",
        error="usable_far_error",
    ),
    "usable_far_error": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="standard error over scrambles of the draws; 0 where no draws decide the end, infinite where "
        "not every scramble has this end, NaN where a camera has fewer intervals",
        error="itself an estimate",
    ),
    "near_limit": Variable(
        dims=("camera", "interval"), units="", long_name="limit that sets the near end of the usable interval"
    ),
    "far_limit": Variable(
        dims=("camera", "interval"), units="", long_name="limit that sets the far end of the usable interval"
    ),
}

_OF_FIELD: Final = (
    "depth_uncertainty", "depth_uncertainty_error", "depth_uncertainty_by_error_source",
    "depth_uncertainty_by_error_source_error", "variance_share", "depth_quantile", "failed_fraction",
    "failed_fraction_error", "converged",
)  # fmt: skip
DEPTH_FIELD: Final[Mapping[str, Variable]] = {
    name: replace(DEPTH[name], dims=("camera", "field", *DEPTH[name].dims[1:])) for name in _OF_FIELD
}
"""/depth_field: the same variables off the axis, at the declared field positions."""

DEPTH_MAP: Final[Mapping[str, Variable]] = {
    "depth_uncertainty": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="half the width of the central 68.27 % interval of one measured depth over the picture, with "
        "noise exact and calibration linear in inverse depth; down and across are distances from the middle of the "
        "sensor, as fractions of half its height and width; infinite where the interval has no far end, NaN where "
        "only one camera sees the point, or neither",
        symbol="u(a)",
        error=SEE_ERROR,
    ),
    "depth_uncertainty_error": Variable(
        dims=("camera", "distance", "down", "across"),
        units="m",
        long_name="error of depth_uncertainty: the largest error of the linear model at this distance, measured on "
        "the axis, halfway to the corner and in the corner",
        error="itself an estimate; NaN where none is measured",
    ),
}
"""/depth_map: depth uncertainty over the pictures of rigs with lens models."""

DISPARITY_CAUSES: Final[Mapping[str, Variable]] = {
    "matched_window_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="side of the square matching window: the declared window or, if smaller, the largest part of "
        "the object that the compared pictures share; for several pairs, the window of a single pair with the same "
        "information; px as in disparity_error_px; 0 where the pictures share nothing, NaN where the camera forms "
        "no image",
        symbol="W",
        error=ROUNDING + "; up to 8 % too small for least squares",
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
        long_name="standard deviation of one measured disparity: the Cramér–Rao bound of matching with all applied "
        "models; for the views of an unfocused plenoptic camera, 1 px is one microlens; NaN where the camera forms no "
        "image, infinite where its image has no texture left",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_error",
    ),
    "disparity_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of disparity_error_px: quadrature over spatial frequencies, aliasing, "
        "diffraction; NaN where that is not finite",
        error="itself an estimate",
    ),
    "disparity_error_px_changed": Variable(
        dims=("camera", "distance", "change"),
        units="px",
        long_name="disparity_error_px after a single change: everything in focus; no diffraction; as many "
        "electrons as the brightest unsaturated camera has at that distance (NaN for that camera); ten times the "
        "camera's own electrons",
        symbol="σ_d",
        reference=_MATCHING,
        error="see disparity_error_px_changed_error",
    ),
    "disparity_error_px_changed_error": Variable(
        dims=("camera", "distance", "change"),
        units="px",
        long_name="estimated numerical error of disparity_error_px_changed; NaN where that is not finite",
        error="itself an estimate",
    ),
    "matched_error_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity_error_px plus what the declared matcher adds; NaN or infinite where disparity_error_px is",
        symbol="σ_d",
        error="see matched_error_px_error",
    ),
    "matched_error_px_error": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="estimated numerical error of matched_error_px: that of the bound; NaN where that is not finite",
        error="itself an estimate",
    ),
    "matcher": Variable(
        dims=("camera",),
        units="",
        long_name="declared matcher, applied to depth and failed fraction in all groups; empty where matching reaches "
        "the bound",
    ),
    "false_matches": Variable(
        dims=("camera",),
        units="1",
        long_name="declared fraction of false matches, included in failed_fraction in all groups",
        error="none: declared",
    ),
    "brightest_camera": Variable(
        dims=("distance",),
        units="",
        long_name="unsaturated camera with the most electrons among those with a derived disparity error; empty where "
        "there is none",
    ),
}


def distances_without_decision(distance: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Four of a study's distances [m], from end to end, for tables of studies whose decision declares none."""
    evenly = np.geomspace(distance[0], distance[-1], 4)
    return np.asarray(distance[np.unique(np.abs(np.log(distance[:, None] / evenly)).argmin(axis=0))])
