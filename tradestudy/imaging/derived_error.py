"""The disparity error of a camera, derived from its picture at every distance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera, Limit
from tradestudy.imaging.matcher import AT_BOUND, Matcher
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import kirchhoff_points
from tradestudy.imaging.picture import (
    LARGEST_ERROR_PX,
    DerivedDisparityError,
    WeighedPicture,
    disparity_error_px,
    filled_share,
    matching_margin,
    violated_conditions,
)
from tradestudy.optics.arrays import FloatArray

if TYPE_CHECKING:
    from tradestudy.imaging.kirchhoff import LatticePoint

# Results to cache: callers compute depth at the same distances several times, for parts, limits and failures.
_CACHED = 64


@dataclass(frozen=True, kw_only=True)
class PictureDisparityError:
    """A `DisparityErrorLaw`: the Cramér–Rao bound on the error of matching, plus what a real matcher adds.

    It is evaluated at every requested distance; only Kirchhoff's correction to Fresnel is interpolated, between
    defoci. Equal cameras have equal errors. Whether the bound applies depends on the picture, not on the matcher.

    Parameters
    ----------
    settings
        The texture and light of the scene, and the matching window.
    models
        The models of the picture's physics.
    matcher
        What the matcher adds to the bound.
    """

    settings: PictureSettings
    models: PictureModels
    matcher: Matcher = AT_BOUND

    @property
    def false_matches(self) -> float:
        """Fraction of matches that are false."""
        return self.matcher.false_matches

    def error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Disparity error of the matcher [samples] at distances [m]; NaN without a picture, or if it shows no texture.

        Off the axis, light and pupil are those at the angle of the field position instead of the settings' own; blur
        and the estimator's baseline are those on the axis.
        """
        value = self.matcher.error_px(self.at_field(camera, field).bound_px(camera, distance))
        return np.where(np.isinf(value), np.nan, value).reshape(np.shape(distance))

    def numerical_error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Estimated numerical error of `error_px` [samples]; NaN where that is NaN."""
        found = self.at_field(camera, field).derived(camera, distance)
        error = self.matcher.numerical_error_px(found.value, found.error)
        return np.where(np.isfinite(found.value), error, np.nan).reshape(np.shape(distance))

    def at_field(self, camera: DepthCamera, field: float) -> PictureDisparityError:
        """The law at a field position; unchanged on the axis."""
        if field == 0.0:
            return self
        return replace(self, settings=replace(self.settings, field_angle=camera.field_angle(field)))

    def derived(self, camera: DepthCamera, distance: ArrayLike) -> DerivedDisparityError:
        """The bound, its numerical error and its violated conditions, over the distances as a flat array."""
        return disparity_error_px(camera.picture_geometry(np.ravel(distance)), self.settings, self.models)

    def limit(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Where a matcher can reach the bound: all conditions must hold there, not only that on the bound's value."""
        value, shape = self.bound_px(camera, distance), np.shape(distance)
        broken = violated_conditions(camera.picture_geometry(np.ravel(distance)), self.settings, self.models, value)
        met = ~np.any(list(broken.values()), axis=0)
        return Limit(value=value.reshape(shape), bound=LARGEST_ERROR_PX, met=met.reshape(shape))

    def margin(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """Smallest margin of the conditions of `limit`; negative where one is violated, NaN without a picture."""
        found = matching_margin(camera.picture_geometry(np.ravel(distance)), self.settings, self.models)
        return found.reshape(np.shape(distance))

    def broken_conditions(self, camera: DepthCamera, distance: float) -> tuple[str, ...]:
        """Conditions of `limit` that do not hold at a distance [m], in words."""
        return tuple(name for name, where in self.derived(camera, distance).violated.items() if where[0])

    def saturation(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Electrons of the brightest texture relative to the full well: at most 1."""
        share = filled_share(camera.picture_geometry(np.asarray(distance)), self.settings, self.models)
        return Limit(value=share, bound=1.0, met=share <= 1.0)

    def bound_px(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """The bound [samples] as a flat array; NaN without a picture, infinite where it shows no texture."""
        a = np.ascontiguousarray(distance, dtype=np.float64)
        return _bound_px(camera.as_pictured, self.settings, self.models, a.tobytes())

    def picture(self, camera: DepthCamera, distance: FloatArray) -> WeighedPicture:
        """The picture for which `bound_px` computes the bound; other models can share its transfer functions."""
        return _picture(camera.as_pictured, self.settings, np.ascontiguousarray(distance).tobytes())


def at_bound(camera: DepthCamera) -> DepthCamera:
    """The camera with a matcher that reaches the bound; unchanged if its error is declared."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError) or law.matcher == AT_BOUND:
        return camera
    return replace(camera, disparity_error_px=replace(law, matcher=AT_BOUND))


@lru_cache(maxsize=_CACHED)
def _bound_px(camera: DepthCamera, settings: PictureSettings, models: PictureModels, distance: bytes) -> FloatArray:
    found = _picture(camera, settings, distance).bound_px(models)
    found.setflags(write=False)
    return found


@lru_cache(maxsize=4)  # megabytes each
def _picture(camera: DepthCamera, settings: PictureSettings, distance: bytes) -> WeighedPicture:
    return WeighedPicture(geometry=camera.picture_geometry(np.frombuffer(distance)), settings=settings)


def kirchhoff_lattice(cameras: Iterable[DepthCamera], distance: FloatArray) -> tuple[LatticePoint, ...]:
    """Arguments of every `kirchhoff_correction` that derived errors need at distances [m], without duplicates."""
    return tuple(
        dict.fromkeys(
            point
            for camera in cameras
            if isinstance(law := camera.disparity_error_px, PictureDisparityError)
            for point in kirchhoff_points(camera.picture_geometry(distance), law.settings, law.models)
        )
    )
