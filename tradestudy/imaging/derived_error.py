"""The disparity error of a camera as a law: derived from its picture at every distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera, Limit
from tradestudy.imaging.geometry import picture_geometry
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.picture import (
    LARGEST_ERROR_PX,
    DerivedDisparityError,
    disparity_error_px,
)
from tradestudy.optics.arrays import FloatArray

# What asks for depth at the same distances asks several times in a row, for parts, limits and failures.
_REMEMBERED = 64


@dataclass(frozen=True, kw_only=True)
class PictureDisparityError:
    """The Cramér–Rao bound of matching as the disparity error of a camera: a `DisparityErrorLaw`.

    It is evaluated at every distance asked for (what Kirchhoff adds to Fresnel is interpolated between defoci), and is
    the same for a camera that is equal.

    Parameters
    ----------
    settings
        What is looked at, and how it is matched.
    models
        Which physics counts.
    """

    settings: PictureSettings
    models: PictureModels

    def error_px(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """The bound [samples] at distances [m]; NaN where the camera forms no picture or that shows nothing."""
        value = self.derived(camera, distance).value
        return np.where(np.isinf(value), np.nan, value).reshape(np.shape(distance))

    def numerical_error_px(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """Estimated numerical error of `error_px` [samples]."""
        return self.derived(camera, distance).error.reshape(np.shape(distance))

    def derived(self, camera: DepthCamera, distance: ArrayLike) -> DerivedDisparityError:
        """The bound with its numerical error and the conditions that it breaks, over the distances in one row."""
        a = np.ascontiguousarray(distance, dtype=np.float64)
        return _derived(camera, self.settings, self.models, a.tobytes())

    def limit(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Where a matcher can reach the bound: all of its conditions hold, not only that on the value shown."""
        found, shape = self.derived(camera, distance), np.shape(distance)
        return Limit(value=found.value.reshape(shape), bound=LARGEST_ERROR_PX, met=found.applies.reshape(shape))

    def saturation(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Electrons of the brightest texture over the full well: at most 1."""
        share = self.derived(camera, distance).filled_share.reshape(np.shape(distance))
        return Limit(value=share, bound=1.0, met=share <= 1.0)


@lru_cache(maxsize=_REMEMBERED)
def _derived(
    camera: DepthCamera, settings: PictureSettings, models: PictureModels, distance: bytes
) -> DerivedDisparityError:
    found = disparity_error_px(picture_geometry(camera, np.frombuffer(distance)), settings, models)
    for array in (found.value, found.error, *found.violated.values()):
        array.setflags(write=False)
    return found
