"""Views of wave optics: the window, f-number and method that stand for the others in figures and sentences."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tradestudy.light_methods import most_complete


def middle_window(fresnel_validity: xr.Dataset) -> float:
    """The window that figures and findings use, in Airy radii: the middle one."""
    windows = fresnel_validity["window"].values
    return float(windows[(len(windows) - 1) // 2])


def element_title(data: xr.Dataset, element: str) -> str:
    """The title of a lens."""
    return str(data["title"].sel(element=element).item())


def published_place(fresnel_validity: xr.Dataset, element: str) -> float:
    """F-number at which the error of a lens was published; the camera's own where none was."""
    one = fresnel_validity.sel(element=element)
    published = float(one["published_f_number"])
    return published if np.isfinite(published) else float(one["camera_f_number"])


def reference_method(images: xr.Dataset) -> str:
    """The method of ``/images`` with which the others are compared: the most complete one."""
    return most_complete(str(name) for name in images["propagator"].values)
