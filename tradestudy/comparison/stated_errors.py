"""Errors of results: those stored beside them, and what the applied models leave out."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results import JUDGED
from tradestudy.results.views.groups import FloatArray, group, has

# As in decisions: by chance, over eight scrambles, one difference in a thousand exceeds this many standard errors.
SURE: Final = 5.4
ROUNDING: Final = 1e-9
"""Relative change of a value that another machine or library may cause."""
_CLOSED_FORM: Final = ("rounding", "exact")
_FROM_DRAWS: Final = "standard error"
_DRAWN_OR_LINEAR: Final = "depth_uncertainty_error"


def error_name(data: xr.Dataset, name: str) -> str | None:
    """The variable that contains the error of another; empty for rounding alone, None if no number states the error."""
    if f"{name}_error" in data:
        return f"{name}_error"
    says = str(data[name].attrs.get("error", ""))
    named: list[str] = [word for word in re.findall(r"\w+", says) if word in data and word != name]
    if named:
        return named[0]
    return "" if any(word in says for word in _CLOSED_FORM) else None


def stated_error(tree: xr.DataTree, name: str, variable: str) -> xr.DataArray | None:
    """The error of each value of a variable, in its unit; None if no number states it.

    Standard errors count `SURE` times, measured and estimated errors once; the change due to everything that the
    applied models leave out is added where the run knows it. As in decisions, an error that could not be estimated
    counts as zero.
    """
    data = group(tree, name)
    error_variable = error_name(data, variable)
    if error_variable is None:
        return None
    values = abs(data[variable].astype(float))
    known = values.where(np.isfinite(values), 0.0)
    # Far below the largest value, numbers differ by rounding alone.
    error = ROUNDING * xr.ones_like(known) * (known.max() if known.size else 0.0)
    if error_variable:
        stored = data[error_variable].astype(float).fillna(0.0)
        stored = stored.max([dim for dim in stored.dims if dim not in values.dims])  # if it has more dimensions
        error = error + stored * _standard_errors(tree, data, error_variable)
    return error + _left_out(tree, data, variable) * known


def _standard_errors(tree: xr.DataTree, data: xr.Dataset, error_variable: str) -> xr.DataArray | float:
    """Factor by which a stored error counts; by camera where it depends on how the depth errors were propagated."""
    says = str(data[error_variable].attrs.get("long_name", ""))
    if error_variable != _DRAWN_OR_LINEAR and _DRAWN_OR_LINEAR not in says:
        return SURE if _FROM_DRAWS in says else 1.0
    keys = data["camera"].values
    counts = [standard_errors(tree, str(key)) for key in keys]
    return xr.DataArray(counts, coords={"camera": keys}, dims="camera")


def standard_errors(tree: xr.DataTree, camera: str) -> float:
    """Factor by which the error of a depth uncertainty counts: `SURE` if draws give it, 1 if a linear model does."""
    if not has(tree, "effects", "problem_of", "slot", "model", "chosen"):
        return SURE
    effects = group(tree, "effects")
    drawn = (effects["slot"] == "calibration") & (effects["model"] == "exact") & (effects["chosen"] == 1)
    return SURE if camera in effects["problem_of"].values[drawn.values] else 1.0


def _left_out(tree: xr.DataTree, data: xr.Dataset, variable: str) -> xr.DataArray | float:
    if "camera" not in data[variable].dims:
        return 0.0
    keys = data["camera"].values
    shares = [left_out_share(tree, str(key), variable) for key in keys]
    return xr.DataArray(shares, coords={"camera": keys}, dims="camera")


def left_out_share(tree: xr.DataTree, camera: str, quantity: str) -> float:
    """Relative change of a camera's quantity due to everything that its models leave out; 0 where it is unknown."""
    if not has(tree, "effects", "joint_change"):
        return 0.0
    changes = group(tree, "effects")["joint_change"]
    quantity = JUDGED[0] if quantity in JUDGED else quantity  # the plan knows the change of the larger of them
    if camera not in changes["problem"].values or quantity not in changes["quantity"].values:
        return 0.0
    return float(np.nan_to_num(changes.sel(problem=camera, quantity=quantity).item()))


def beyond(values: tuple[FloatArray, FloatArray], errors: tuple[FloatArray, FloatArray]) -> np.ndarray:
    """Where two arrays differ by more than both errors; a value known in only one of them differs."""
    first, other = values
    alike = (first == other) | (np.isnan(first) & np.isnan(other))
    with np.errstate(invalid="ignore"):  # ∞ − ∞, which counts as equal
        apart = np.abs(other - first) > np.hypot(*errors)
    known = np.isfinite(first) & np.isfinite(other)
    return np.asarray(~alike & np.where(known, apart, True))
