"""Refocusing an unfocused plenoptic camera by shifting its views against each other, and triangulating with two views.

A pixel under a microlens records rays of one slope. Pixels of the slopes N q apart, relative to the rays from the
middle of the exit pupil, under microlenses t apart, record rays that meet

    z = t/(N q − t/d_A),    q = p_px/f_L,

behind the array, where d_A is the distance from the exit pupil to the array. Views that are shifted by α microlenses
from pixel to pixel have t = N α p. The main lens images the object plane in focus to z, so that its focus shift is
s = s₀ + z, and a = f + f²/s. Source: C. Hahne et al., "Refocusing distance of a standard plenoptic camera", Optics
Express 24 (2016), and "Baseline and triangulation geometry in a standard plenoptic camera", IJCV 126 (2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.optics.arrays import FloatArray, require
from tradestudy.optics.depth_of_field import DepthOfField
from tradestudy.optics.thin_lens import focus_shift, image_distance

_ROUNDING: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class Refocusing:
    """The views of an unfocused plenoptic camera, on the axis and to first order; distances count from H.

    Parameters
    ----------
    focus_distance, focal_length
        a₀ > f, the distance in focus on the array, which may be infinite, and f of the main lens [m].
    entrance_pupil, principal_separation
        Distance e of the entrance pupil behind H, and distance from H to H' [m]; see `Lens`.
    view_slope
        q = p_px/f_L > 0 [1], by which the rays of neighbouring pixels differ.
    microlens_pitch
        p > 0 [m].
    views_across
        M ≥ 2, views in a row through the middle of the pupil.
    pupil_views
        W [1], width of the part of the pupil that all views together use, in widths of the part of one view.
    """

    focus_distance: float
    focal_length: float
    entrance_pupil: float
    principal_separation: float
    view_slope: float
    microlens_pitch: float
    views_across: int
    pupil_views: float

    @cached_property
    def array_distance(self) -> float:
        """z [m] from H' to the array."""
        return float(image_distance(self.focus_distance, self.focal_length))

    @cached_property
    def principal_distance(self) -> float:
        """c = g z − e [m] with g = 1 + e/f: parts of the entrance pupil that belong to a view are c q wide."""
        return self._pupil_ratio * self.array_distance - self.entrance_pupil

    @cached_property
    def pupil_distance(self) -> float:
        """d_A = c/g [m] from the exit pupil to the array; ∞ for a pupil at infinity, negative for one behind it."""
        return self.principal_distance / self._pupil_ratio if self._pupil_ratio else math.inf

    @property
    def _pupil_ratio(self) -> float:
        return 1.0 + self.entrance_pupil / self.focal_length

    def from_pupil(self, distance: ArrayLike) -> FloatArray:
        """Distances [m] counted from the entrance pupil, as in triangulation by PlenoptiSign."""
        return np.asarray(np.asarray(distance) + self.entrance_pupil)

    def from_array(self, distance: ArrayLike) -> FloatArray:
        """Distances [m] counted from the microlens array, as in refocusing by PlenoptiSign."""
        return np.asarray(np.asarray(distance) + self.principal_separation + self.array_distance)

    def distance(self, shift: ArrayLike) -> FloatArray:
        """a [m] that comes into focus when neighbouring views are shifted by α microlenses, of either sign.

        ∞ for shifts that refocus on infinity or beyond; f for shifts of `largest_shift` or more, without a real image.
        """
        travel = np.asarray(shift, dtype=np.float64) * self.microlens_pitch
        return self._object(travel, self.view_slope - travel / self.pupil_distance)

    def shift(self, distance: ArrayLike) -> FloatArray:
        """α [microlenses] that refocuses on a > f [m], the inverse of `distance`: ``α p = q z/(1 + z/d_A)``.

        Raises
        ------
        OutOfRangeError
            For distances that the main lens does not image.
        """
        a = np.asarray(distance, dtype=np.float64)
        behind = focus_shift(a, self.focal_length) - focus_shift(self.focus_distance, self.focal_length)
        scale = 1.0 + behind / self.pupil_distance
        reachable = (a > self.focal_length) & (scale > 0.0)
        require(reachable, "distance to refocus on", a, limit="beyond the front focal point and the entrance pupil")
        return np.asarray(self.view_slope * behind / (scale * self.microlens_pitch))

    @property
    def largest_shift(self) -> float:
        """q d_A/p [microlenses], from which on no shift gives a real image; ∞ for a pupil at or beyond infinity."""
        return self.view_slope * self.pupil_distance / self.microlens_pitch if self.pupil_distance > 0.0 else math.inf

    def ray_limits(self, shift: ArrayLike) -> DepthOfField:
        """Limits [m] where rays from the edges of two pixels through the edges of their microlenses meet.

        As Hahne defines them: pixels of the two outermost views, N = M − 1 apart. The far limit is where rays of inner
        edges of the microlenses and outer edges of the pixels meet, t = (N α − 1) p and slopes (N + 1) q apart; the
        near limit has t = (N α + 1) p and slopes (N − 1) q apart. The pixels remain at N α p/d_A from the axes of their
        microlenses. Empty where the two meet in reverse order, which takes a shift of −1 or less.
        """
        apart, p = self.views_across - 1, self.microlens_pitch
        travel = np.asarray(shift, dtype=np.float64) * apart * p
        turned = travel / self.pupil_distance
        far = self._object(travel - p, (apart + 1) * self.view_slope - turned)
        return _between(self._object(travel + p, (apart - 1) * self.view_slope - turned), far)

    def blur_limits(self, shift: ArrayLike, blur: float) -> DepthOfField:
        """Limits [m] within which a refocused picture blurs by at most c [microlenses]: ``|α' − α| W ≤ c``.

        The sum of all views shows a point that needs the shift α' as a blur of |α' − α| W microlenses.

        Raises
        ------
        OutOfRangeError
            For a blur that is not positive, or reaches beyond the views.
        """
        self.require_blur(blur)
        middle, half = np.asarray(shift, dtype=np.float64), blur / self.pupil_views
        return _between(self.distance(middle + half), self.distance(middle - half))

    def reach(self, blur: float) -> tuple[float, float]:
        """Nearest and farthest distance [m] on which it can refocus: each view blurs by |α| ≤ c microlenses."""
        self.require_blur(blur)
        near, far = self.distance([blur, -blur])
        return float(near), float(far)

    def planes(self, blur: float) -> FloatArray:
        """Shifts of the distinct planes within `reach`: multiples of 1/N, from the nearest to the farthest.

        At these shifts, the outermost views are a whole number of microlenses apart, so that views need no
        interpolation. Planes beyond infinity and without a real image do not count.
        """
        self.require_blur(blur)
        apart, infinity = self.views_across - 1, float(self.shift(math.inf))
        first, last = math.ceil(max(-blur, infinity) * apart - _ROUNDING), math.floor(blur * apart + _ROUNDING)
        shifts = np.arange(last, first - 1, -1) / apart
        return shifts[shifts < self.largest_shift * (1.0 - _ROUNDING)]

    def require_shifts(self, shifts: ArrayLike) -> None:
        """Refuse shifts that are infinite, reach beyond the views, or give no real image."""
        values = np.asarray(shifts, dtype=np.float64)
        most, limit = float(self.views_across), self.largest_shift
        require(
            np.abs(values) < most, "shift between neighbouring views [microlenses]", values,
            limit=f"between −{most:g} and {most:g}, the number of views across the pupil",
            remedy="shift less; a shift of 1 already blurs every view by one microlens", unit="",
        )  # fmt: skip
        require(
            values < limit, "shift between neighbouring views [microlenses]", values,
            limit=f"below {limit:.4g}, which refocuses on the front focal point", remedy="shift less", unit="",
        )  # fmt: skip

    def require_blur(self, blur: float) -> None:
        """Refuse a blur that is not positive, or as wide as shifts that reach beyond the views."""
        require(
            0.0 < blur < self.views_across, "largest blur [microlenses]", np.asarray(blur),
            limit=f"above 0 and below {self.views_across}, the number of views across the pupil",
            remedy="give a smaller blur, such as 1 px", unit="",
        )  # fmt: skip

    def require_pair(self, pixels: ArrayLike) -> None:
        """Refuse pairs of views that the camera does not have."""
        apart, distance = self.views_across - 1, np.abs(np.asarray(pixels, dtype=np.float64))
        require(
            (distance > 0.0) & (distance <= apart), "pixels between two views", distance,
            limit=f"1 to {apart}, one less than the views across the pupil", remedy="compare views of the camera",
            unit="",
        )  # fmt: skip

    def baseline(self, pixels: ArrayLike) -> FloatArray:
        """N c q [m]: distance in the entrance pupil between two views whose pixels are N apart."""
        return np.asarray(np.asarray(pixels) * (self.principal_distance * self.view_slope))

    def triangulate(self, pixels: ArrayLike, disparity: ArrayLike) -> FloatArray:
        """Distance [m] of a point from its disparity [microlenses]; ∞ for the disparity of infinity and beyond."""
        return self.distance(np.asarray(disparity, dtype=np.float64) / np.asarray(pixels))

    def _object(self, travel: FloatArray, opening: FloatArray) -> FloatArray:
        """Object distance [m] of rays that are ``travel`` apart on the array and approach by ``opening`` [1]."""
        f, meet = self.focal_length, opening > 0.0
        behind = np.where(meet, travel / np.where(meet, opening, 1.0), np.copysign(np.inf, travel))
        s = focus_shift(self.focus_distance, f) + behind
        return np.asarray(np.where(s > 0.0, f + f * (f / np.where(s > 0.0, s, 1.0)), np.inf))


def _between(near: FloatArray, far: FloatArray) -> DepthOfField:
    """Two limits; empty where they coincide, at the front focal point or infinity, or are in reverse order."""
    deep = near < far
    reason = "" if np.all(deep) else "no distance in front of the camera is sharp at such a shift"
    return DepthOfField(near=np.where(deep, near, np.nan), far=np.where(deep, far, np.nan), reason=reason)
