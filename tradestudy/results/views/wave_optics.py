"""Views of wave optics: conclusions on light spots, Fresnel's law and hard cases, and what figures show of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.light_methods import most_complete
from tradestudy.results.views.groups import group, has
from tradestudy.units import significant


def middle_window(fresnel_validity: xr.Dataset) -> float:
    """The window that figures and findings use, in Airy radii: the middle one."""
    windows = fresnel_validity["window"].values
    return float(windows[(len(windows) - 1) // 2])


def element_title(data: xr.Dataset, element: str) -> str:
    """The title of a lens."""
    return str(data["title"].sel(element=element).item())


def published_place(fresnel_validity: xr.Dataset, element: str) -> float:
    """F-number at which the error of a lens was published; the camera's own where none was."""
    lens = fresnel_validity.sel(element=element)
    published = float(lens["published_f_number"])
    return published if np.isfinite(published) else float(lens["camera_f_number"])


def reference_method(images: xr.Dataset) -> str:
    """The method of ``/images`` with which the others are compared: the most complete one."""
    return most_complete(str(method) for method in images["propagator"].values)


def light_numbers(tree: xr.DataTree) -> list[dict[str, Any]]:
    """Method, stated error and difference from the reference (NaN for the reference) of every picture of the spot."""
    if not has(tree, "images", "image"):
        return []
    data = group(tree, "images")
    reference = reference_method(data)
    return [
        {
            "method": method,
            "reference": reference,
            "difference": float(data["difference"].sel(propagator=method, against=reference))
            if method != reference
            else float("nan"),
            "error": float(data["numerical_error"].sel(propagator=method)),
        }
        for method in map(str, data["propagator"].values)
    ]


def fresnel_numbers(tree: xr.DataTree) -> list[dict[str, Any]]:
    """For every lens and lens phase, the f-number from which Fresnel's law stays within the limit at all wavelengths.

    Zero where it does at every f-number of the study, infinite where it does at none.
    """
    if not has(tree, "fresnel_validity", "limit_f_number"):
        return []
    data = group(tree, "fresnel_validity")
    window = middle_window(data)
    limits = data["limit_f_number"].sel(metric="l1", window=window)
    return [
        {
            "element": element_title(data, str(element)),
            "lens_phase": str(phase),
            "window": window,
            "limit": float(data.attrs["error_limit"]),
            "f_number": float(np.max(limits.sel(element=element, lens_phase=phase).values)),
        }
        for element in data["element"].values
        for phase in data["lens_phase"].values
    ]


def where_fresnel(f_number: float) -> str:
    """From which f-number on Fresnel's law suffices, in words; as in `fresnel_numbers`, which may be 0 or infinite."""
    if f_number == 0.0:
        return "at every f-number tried"
    if math.isinf(f_number):
        return "at no f-number tried"
    return f"from f/{significant(math.ceil(f_number * 10.0) / 10.0)} on"


def hard_case_numbers(tree: xr.DataTree) -> dict[str, int]:
    """Number of hard cases, and how many the program gets right; empty if the study computed none."""
    if not has(tree, "hard_cases", "met"):
        return {}
    met = group(tree, "hard_cases")["met"].values
    return {"cases": int(met.size), "met": int(np.count_nonzero(met))}


def hard_case_words(tree: xr.DataTree) -> str:
    """How many hard cases the program gets right, without a full stop; empty if the study computed none."""
    numbers = hard_case_numbers(tree)
    return f"The program gets {numbers['met']} of {numbers['cases']} hard cases right" if numbers else ""
