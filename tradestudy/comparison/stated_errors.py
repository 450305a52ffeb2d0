"""How far results may be off: the errors stored beside them, and what the models that acted leave out."""

from __future__ import annotations

import re
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.results.views.groups import FloatArray, group, has

# As decisions have it: one difference in a thousand exceeds as many standard errors by chance, over eight scrambles.
SURE: Final = 5.4
ROUNDING: Final = 1e-9
"""Share of a value by which another machine or library may move it."""
_CLOSED_FORM: Final = ("rounding", "exact")
_FROM_DRAWS: Final = "standard error"
_LINEAR_TOO: Final = "depth_uncertainty_error"


def error_name(data: xr.Dataset, name: str) -> str | None:
    """The variable that holds the error of another; empty for rounding alone, None where no number states it."""
    if f"{name}_error" in data:
        return f"{name}_error"
    says = str(data[name].attrs.get("error", ""))
    named: list[str] = [word for word in re.findall(r"\w+", says) if word in data and word != name]
    if named:
        return named[0]
    return "" if any(word in says for word in _CLOSED_FORM) else None


def stated_error(tree: xr.DataTree, name: str, variable: str) -> xr.DataArray | None:
    """What each value of a variable may be off by, in its unit; None where no number states it.

    Standard errors count `SURE` times, measured and estimated errors once; the change by all that the acting models
    leave out is added where the run knows it. An error that could not be estimated counts as none, as in decisions.
    """
    data = group(tree, name)
    beside = error_name(data, variable)
    if beside is None:
        return None
    values = abs(data[variable].astype(float))
    known = values.where(np.isfinite(values), 0.0)
    # Far below the largest value numbers differ by what they are made of, not by what they mean.
    error = ROUNDING * xr.ones_like(known) * (known.max() if known.size else 0.0)
    if beside:
        stored = data[beside].astype(float).fillna(0.0)
        stored = stored.max([dim for dim in stored.dims if dim not in values.dims])  # where it tells more apart
        error = error + stored * _standard_errors(tree, data, beside)
    return error + _left_out(tree, data, variable) * known


def _standard_errors(tree: xr.DataTree, data: xr.Dataset, beside: str) -> xr.DataArray | float:
    """How often a stored error counts, for each camera where that depends on how its depth was propagated."""
    says = str(data[beside].attrs.get("long_name", ""))
    if beside != _LINEAR_TOO and _LINEAR_TOO not in says:
        return SURE if _FROM_DRAWS in says else 1.0
    keys = data["camera"].values
    counts = [standard_errors(tree, str(key)) for key in keys]
    return xr.DataArray(counts, coords={"camera": keys}, dims="camera")


def standard_errors(tree: xr.DataTree, camera: str) -> float:
    """How often the error of a depth uncertainty counts: a standard error of draws, or the departure of a line."""
    if not has(tree, "effects", "situation", "slot", "model", "chosen"):
        return SURE
    effects = group(tree, "effects")
    drawn = (effects["slot"] == "calibration") & (effects["model"] == "exact") & (effects["chosen"] == 1)
    return SURE if camera in effects["situation"].values[drawn.values] else 1.0


def _left_out(tree: xr.DataTree, data: xr.Dataset, variable: str) -> xr.DataArray | float:
    if "camera" not in data[variable].dims:
        return 0.0
    keys = data["camera"].values
    shares = [left_out_share(tree, str(key), variable) for key in keys]
    return xr.DataArray(shares, coords={"camera": keys}, dims="camera")


def left_out_share(tree: xr.DataTree, camera: str, quantity: str) -> float:
    """Relative change of a quantity of a camera by all that its models leave out together; 0 where nothing says so."""
    if not has(tree, "effects", "joint_change"):
        return 0.0
    changes = group(tree, "effects")["joint_change"]
    if camera not in changes["piece"].values or quantity not in changes["quantity"].values:
        return 0.0
    return float(np.nan_to_num(changes.sel(piece=camera, quantity=quantity).item()))


def beyond(values: tuple[FloatArray, FloatArray], errors: tuple[FloatArray, FloatArray]) -> np.ndarray:
    """Where two arrays differ by more than both may be off by; what is known in one alone differs."""
    first, other = values
    alike = (first == other) | (np.isnan(first) & np.isnan(other))
    with np.errstate(invalid="ignore"):  # infinite less infinite is alike
        apart = np.abs(other - first) > np.hypot(*errors)
    known = np.isfinite(first) & np.isfinite(other)
    return np.asarray(~alike & np.where(known, apart, True))
