"""The one table of what results hold: every variable with its dimensions, unit, symbol and source.

Nothing enters `results.nc` that is not declared here, and nothing is declared without a unit ("1" is a plain number).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

FORMAT_VERSION: Final = 1
PAPER: Final = "Diffraction model of a plenoptic camera for in-situ space exploration"


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One variable of the results.

    Parameters
    ----------
    dims
        Dimensions after those of the study's sweep.
    units
        SI, "1" for a plain number, "" for text.
    long_name
        What it is.
    symbol, reference
        In the equations, and where they stand.
    error
        Where its error estimate is found, or why it is exact.
    """

    dims: tuple[str, ...]
    units: str
    long_name: str
    symbol: str = ""
    reference: str = ""
    error: str = ""


_ROUNDING = "closed form; rounding only, see the condition number of eq. 8"
_SEE_ERROR = "see depth_uncertainty_error"
_EIGHT = f"{PAPER}, eqs. 4 and 8"

DEPTH: Final[Mapping[str, Variable]] = {
    "depth_discrimination": Variable(
        dims=("camera", "distance", "side"),
        units="m",
        long_name="change of true depth that moves the estimator's disparity by the declared step",
        symbol="Δa",
        reference=_EIGHT,
        error=_ROUNDING,
    ),
    "depth_uncertainty": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="half the central 68.27 % interval of one measured depth, noise and calibration",
        symbol="u(a)",
        reference="JCGM 101:2008, 7.7",
        error=_SEE_ERROR,
    ),
    "depth_uncertainty_error": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="estimated numerical error of depth_uncertainty against the exact camera model",
        error="an estimate of an error; NaN where the interval is not bounded",
    ),
    "depth_uncertainty_way": Variable(
        dims=("camera", "distance", "way"),
        units="m",
        long_name="depth uncertainty from noise only, calibration only, and both",
        symbol="u(a)",
        error=_SEE_ERROR,
    ),
    "depth_uncertainty_part": Variable(
        dims=("camera", "distance", "part"),
        units="m",
        long_name="depth uncertainty from one part alone; NaN where a camera has no such part",
        symbol="u_i(a)",
        error=_SEE_ERROR,
    ),
    "depth_quantile": Variable(
        dims=("camera", "distance", "way", "quantile"),
        units="m",
        long_name="quantile of one measured depth; infinite beyond the pole",
        symbol="a_p",
        error=_SEE_ERROR,
    ),
    "failed_fraction": Variable(
        dims=("camera", "distance", "way"),
        units="1",
        long_name="share of measurements that end beyond infinity",
        symbol="P(a = ∞)",
        error="closed form in disparity, below 1e-6",
    ),
    "equivalent_baseline": Variable(
        dims=("camera", "distance"),
        units="m",
        long_name="baseline of the stereo rig of this focal length and disparity error that measures as well",
        symbol="B_eq",
        error=_ROUNDING,
    ),
    "disparity_px": Variable(
        dims=("camera", "distance"),
        units="px",
        long_name="disparity over the estimator's baseline",
        symbol="Δσ",
        reference=_EIGHT,
        error=_ROUNDING,
    ),
    "virtual_depth": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="virtual depth, positive Keplerian, negative Galilean; NaN for a stereo rig",
        symbol="v = a_L/b_L",
        error=_ROUNDING,
    ),
    "usable": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="whether every declared limit holds",
        error="a comparison; ends are in usable_near and usable_far",
    ),
    "limit_value": Variable(
        dims=("camera", "distance", "limit"),
        units="mixed",
        long_name="value that is held against a limit, in the unit of limit_units; NaN where it does not apply",
        error=_ROUNDING,
    ),
    "limit_met": Variable(
        dims=("camera", "distance", "limit"),
        units="1",
        long_name="1 where the limit holds, 0 where it does not, −1 where it does not apply",
        error="a comparison",
    ),
    "limit_bound": Variable(
        dims=("camera", "limit"),
        units="mixed",
        long_name="the bound of a limit; NaN where it does not apply",
        error="declared",
    ),
    "usable_near": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="near end of a usable interval",
        error="bracketed to the last digits",
    ),
    "usable_far": Variable(
        dims=("camera", "interval"),
        units="m",
        long_name="far end of a usable interval",
        error="bracketed to the last digits",
    ),
    "near_limit": Variable(dims=("camera", "interval"), units="", long_name="limit that sets the near end"),
    "far_limit": Variable(dims=("camera", "interval"), units="", long_name="limit that sets the far end"),
}

CAMERAS: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("camera",), units="", long_name="name in figures and tables"),
    "kind": Variable(dims=("camera",), units="", long_name="kind of camera"),
    "family": Variable(dims=("camera",), units="", long_name="plenoptic or stereo"),
    "note": Variable(dims=("camera",), units="", long_name="what a reader should know about it"),
    "property_value": Variable(dims=("property",), units="", long_name="a derived value, with its unit"),
    "property_camera": Variable(dims=("property",), units="", long_name="camera that the value belongs to"),
    "property_name": Variable(dims=("property",), units="", long_name="what the value is"),
}

DECISION: Final[Mapping[str, Variable]] = {
    "best_camera": Variable(
        dims=("distance", "way"),
        units="",
        long_name="usable camera of lowest depth uncertainty; empty where none is usable",
    ),
    "winner": Variable(
        dims=("reading", "place", "way"),
        units="",
        long_name="of the headline pair, the usable camera of lower depth uncertainty; empty where neither is usable",
    ),
    "more_certain": Variable(
        dims=("reading", "place", "way"),
        units="",
        long_name="of the headline pair, the one of lower depth uncertainty, usable or not",
    ),
    "uncertainty_ratio": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="depth uncertainty of the first camera of the headline pair over that of the second",
        error=_SEE_ERROR,
    ),
    "flips": Variable(
        dims=("reading", "place", "way"),
        units="1",
        long_name="whether the more certain camera differs from the study's reading",
    ),
    "reading_says": Variable(dims=("reading",), units="", long_name="what the reading assumes"),
    "crossover_distance": Variable(
        dims=("reading", "way", "crossing"),
        units="m",
        long_name="distance where the two uncertainties of the headline pair are equal; NaN where there is none",
        error="bracketed to the last digits; its range over readings is the error that matters",
    ),
    "crossover_nearer": Variable(
        dims=("reading", "way", "crossing"), units="", long_name="camera that is more certain nearer than the crossing"
    ),
    "solved_value": Variable(
        dims=("question",),
        units="mixed",
        long_name="value of the varied input that makes two cameras equally certain, in solved_units",
        error="root to 1e-10 relative",
    ),
    "solved_units": Variable(dims=("question",), units="", long_name="SI unit of the solved value"),
    "solved_says": Variable(dims=("question",), units="", long_name="the inverse question"),
    "solved_answer": Variable(dims=("question",), units="", long_name="the answer in words"),
}

CLAIMS: Final[Mapping[str, Variable]] = {
    "value": Variable(
        dims=("claim", "reading"),
        units="mixed",
        long_name="value found under a reading; NaN where not tried",
        error=_SEE_ERROR,
    ),
    "met": Variable(dims=("claim", "reading"), units="1", long_name="1 met, 0 not met, −1 not tried"),
    "value_text": Variable(dims=("claim", "reading"), units="", long_name="value found, with its unit"),
    "says": Variable(dims=("claim",), units="", long_name="the claim in the words of its source"),
    "source": Variable(dims=("claim",), units="", long_name="where it is made"),
    "expected": Variable(dims=("claim",), units="", long_name="expected value or bound"),
    "quantity": Variable(dims=("claim",), units="", long_name="what is computed to answer it"),
    "tolerance_reason": Variable(
        dims=("claim",), units="", long_name="why the expectation and its tolerance follow from the wording"
    ),
    "verdict": Variable(dims=("claim",), units="", long_name="met, not met, or cannot be decided from the paper"),
    "reason": Variable(dims=("claim",), units="", long_name="the verdict's reason"),
}

REQUIREMENTS: Final[Mapping[str, Variable]] = {
    "says": Variable(dims=("requirement",), units="", long_name="the requirement"),
    "met": Variable(dims=("requirement",), units="1", long_name="whether it is met"),
    "camera": Variable(dims=("requirement",), units="", long_name="camera that comes nearest to it"),
    "margin_percent": Variable(
        dims=("requirement",),
        units="percent",
        long_name="bound over worst value, less one; negative when missed",
        error=_SEE_ERROR,
    ),
    "reason": Variable(dims=("requirement",), units="", long_name="the worst value and where it lies"),
}

ASSUMPTIONS: Final[Mapping[str, Variable]] = {
    "value": Variable(dims=("path",), units="", long_name="the value as written"),
    "basis": Variable(dims=("path",), units="", long_name="paper, datasheet, measured, assumed or derived"),
    "note": Variable(dims=("path",), units="", long_name="note"),
    "cameras": Variable(dims=("path",), units="", long_name="cameras that the value belongs to; empty for the study"),
}

CONTRADICTIONS: Final[Mapping[str, Variable]] = {
    "camera": Variable(dims=("contradiction",), units="", long_name="camera"),
    "what": Variable(dims=("contradiction",), units="", long_name="quantity stated twice"),
    "stated": Variable(dims=("contradiction",), units="", long_name="value stated"),
    "implied": Variable(dims=("contradiction",), units="", long_name="value that the other inputs imply"),
    "used": Variable(dims=("contradiction",), units="", long_name="reading that the study uses"),
}

GROUPS: Final[Mapping[str, Mapping[str, Variable]]] = {
    "cameras": CAMERAS,
    "depth": DEPTH,
    "decision": DECISION,
    "claims": CLAIMS,
    "requirements": REQUIREMENTS,
    "assumptions": ASSUMPTIONS,
    "contradictions": CONTRADICTIONS,
}


def dataset(
    group: str,
    values: Mapping[str, Any],
    coordinates: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]],
    *,
    leading: tuple[str, ...] = (),
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Build one group of the results from arrays in the declared order of dimensions.

    Parameters
    ----------
    group
        Name of the group in `GROUPS`.
    values
        One array for each variable; a variable that the study does not ask for is left out.
    coordinates
        Labels along each dimension that has them.
    leading
        Dimensions of the study's sweep, before the declared ones.
    attributes
        Of the group.
    """
    declared = GROUPS[group]
    variables = {}
    for name, value in values.items():
        spec = declared[name]
        attrs = {"units": spec.units, "long_name": spec.long_name}
        attrs |= {key: text for key in ("symbol", "reference", "error") if (text := getattr(spec, key))}
        array = np.asarray(value)
        swept = leading if array.ndim == len(leading) + len(spec.dims) else ()
        variables[name] = (swept + spec.dims, array.astype(object) if array.dtype.kind == "U" else array, attrs)
    coords = {
        name: (np.asarray(labels, dtype=object) if _text(labels) else labels) for name, labels in coordinates.items()
    }
    result = xr.Dataset(variables, coords=coords, attrs=dict(attributes or {}))
    if "distance" in result.coords:
        result["distance"].attrs = {"units": "m", "long_name": "object distance", "symbol": "a"}
    return result


def _text(labels: Sequence[Any] | np.ndarray[Any, Any]) -> bool:
    return len(labels) > 0 and isinstance(labels[0], str)
