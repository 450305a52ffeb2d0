"""The focus of a focused plenoptic camera: one depth of field for each microlens type."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.focus import BlurCriterion, SharpRange, sharp_range
from tradestudy.cameras.parts import Lens, MicrolensArray, require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lateral_resolution import (
    LateralResolution,
    focused_plenoptic_depth_of_field_at_resolution,
    focused_plenoptic_lateral_resolution,
)
from tradestudy.optics.plenoptic_depth_of_field import inverse_focus_virtual_depth, relay_depth_of_field


@dataclass(frozen=True, kw_only=True)
class DepthScaling:
    """Metric depth ``M = a Z² + b Z + c`` of the depth Z by eq. 8, in libpleno's ``PlenopticCamera::mla2obj``.

    Source: https://github.com/comsee-research/libpleno, pleno/geometry/camera/plenoptic.cpp. Valid where M > 0 and
    ``dM/dZ = 2 a Z + b > 0``, which is ``√(b² + 4 a (M − c))``.

    Parameters
    ----------
    quadratic, linear, offset
        a [1/m], b [1], above 0, and c [m].

    Raises
    ------
    OutOfRangeError
        b is not positive, or a or c is not finite.
    """

    quadratic: float = 0.0
    linear: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        require_positive("linear coefficient of the depth scaling", self.linear, "")
        if not (math.isfinite(self.quadratic) and math.isfinite(self.offset)):
            raise OutOfRangeError(
                "coefficients of the depth scaling", value=f"{self.quadratic:g} 1/m, {self.offset:g} m", limit="finite"
            )

    @cached_property
    def is_identity(self) -> bool:
        """Whether depth is not corrected."""
        return (self.quadratic, self.linear, self.offset) == (0.0, 1.0, 0.0)

    @property
    def words(self) -> str:
        """The law with its coefficients in metres."""
        return f"{self.quadratic:g}/m Z² + {self.linear:g} Z + {self.offset:g} m"

    @cached_property
    def farthest(self) -> float:
        """The Z [m] from which on M no longer grows; infinite unless a < 0."""
        return -self.linear / (2.0 * self.quadratic) if self.quadratic < 0.0 else math.inf

    def modelled(self, metric: ArrayLike) -> FloatArray:
        """The Z [m] of metric distances M [m]; 0 where M ≤ c, infinity for infinity.

        Raises
        ------
        OutOfRangeError
            For a finite M that no Z gives, or where ``dM/dZ ≤ 0``.
        """
        m = np.asarray(metric, dtype=np.float64)
        if self.is_identity:
            return m
        a, b, c = self.quadratic, self.linear, self.offset
        beyond_c = np.where(np.isfinite(m), np.maximum(m - c, 0.0), 0.0)
        square = b * b + 4.0 * a * beyond_c
        if np.any(square <= 0.0):
            raise OutOfRangeError(
                "distance of an object beyond the largest depth that the camera's depth.scaling can measure",
                value=f"{np.max(m[square <= 0.0]):g} m",
                limit=f"below {c - b * b / (4.0 * a):g} m, where 2 a Z + b is zero",
                remedy="reduce the distances, or use a scaling that was calibrated for them",
            )
        # This form of the root stays accurate for a small a, and holds for a = 0.
        return np.asarray(np.where(np.isfinite(m), 2.0 * beyond_c / (b + np.sqrt(square)), m))

    def metric(self, modelled: ArrayLike) -> FloatArray:
        """The metric depth M [m] of depths Z [m]: 0 instead of less, and infinity from `farthest` on."""
        z = np.asarray(modelled, dtype=np.float64)
        if self.is_identity:
            return z
        near = np.where(z < self.farthest, z, 0.0)
        m = np.maximum((self.quadratic * near + self.linear) * near + self.offset, 0.0)
        return np.asarray(np.where(np.isnan(z), np.nan, np.where(z < self.farthest, m, np.inf)))

    def slope(self, modelled: ArrayLike) -> FloatArray:
        """``dM/dZ = 2 a Z + b``, the factor by which the scaling multiplies depth uncertainty [1]."""
        z = np.asarray(modelled, dtype=np.float64)
        steepening = 2.0 * self.quadratic * z if self.quadratic else np.zeros_like(z)
        return np.asarray(steepening + self.linear)

    def metric_inverse(self, inverse: FloatArray) -> FloatArray:
        """``1/M = w²/(a + b w + c w²)`` [1/m] of ``w = 1/Z`` [1/m]; NaN where M ≤ 0.

        Where Z is at or beyond `farthest`, or beyond infinity, no depth is measured: 0 or less, falling on with w.
        """
        if self.is_identity:
            return inverse
        least = 1.0 / self.farthest
        w = np.where(inverse > least, inverse, np.nan)
        below = self.quadratic + self.linear * w + self.offset * np.square(w)
        inverse_metric = np.where(below > 0.0, np.square(w) / np.where(below > 0.0, below, 1.0), np.nan)
        return np.asarray(np.where(inverse <= least, (inverse - least) / self.linear, inverse_metric))


NO_SCALING: Final = DepthScaling()


@dataclass(frozen=True, kw_only=True)
class MicrolensTypesFocus:
    """Main lens, array and sensor at fixed distances; each type works on the side of the array on which it focuses.

    An array within the focal length of the main lens has all images of real objects behind it, so types work there.

    Parameters
    ----------
    main_lens, microlenses
        The lens and the array.
    mla_distance
        Distance z from main lens to array [m].
    sample_pitch
        The pixel pitch [m].
    depth_scaling
        Metric distance of each distance at which the design images.
    """

    main_lens: Lens
    microlenses: MicrolensArray
    mla_distance: float
    sample_pitch: float
    depth_scaling: DepthScaling = NO_SCALING

    mechanisms = 0

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_positive("distance from main lens to microlens array", self.mla_distance)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the microlens types."""
        count = self.microlenses.types
        return ("microlenses",) if count == 1 else tuple(f"type {number}" for number in range(1, count + 1))

    @property
    def _inverse_focus(self) -> FloatArray:
        return inverse_focus_virtual_depth(self.microlenses.focal_lengths, self.microlenses.gap)

    @property
    def keplerian(self) -> tuple[bool, ...]:
        """For each type, whether it works on images in front of the array, as pinholes do if some can form there."""
        before = self.mla_distance > self.main_lens.focal_length
        return tuple(
            before and (f == math.inf or bool(f <= self.microlenses.gap)) for f in self.microlenses.focal_lengths
        )

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """Each type's depth of field through the main lens; see `relay_depth_of_field`.

        A microlens is its own stop: the diffraction spot on the sensor is that of the f-number ``b_L/D``.
        """
        array = self.microlenses
        allowance = criterion.allowance(self.sample_pitch, array.gap / array.aperture_diameter)
        parts = [
            relay_depth_of_field(
                inverse,
                blur_diameter=allowance.geometric_diameter,
                microlens_aperture=array.aperture_diameter,
                microlens_gap=array.gap,
                mla_distance=self.mla_distance,
                focal_length=self.main_lens.focal_length,
                keplerian=keplerian,
            )
            for inverse, keplerian in zip(self._inverse_focus, self.keplerian, strict=True)
        ]
        sharp = sharp_range(self.names, parts, allowance.reason)
        near, far = (self.depth_scaling.metric(end) for end in (sharp.slices.near, sharp.slices.far))
        return replace(sharp, slices=replace(sharp.slices, near=near, far=far))

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """See `focused_plenoptic_depth_of_field_at_resolution`.

        Raises
        ------
        OutOfRangeError
            Depth is scaled.
        """
        if not self.depth_scaling.is_identity:
            raise OutOfRangeError(
                "the depth of field at a lateral resolution is not computed for a camera with depth.scaling",
                value=self.depth_scaling.words,
                limit="quadratic 0, linear 1, offset 0",
                remedy="remove lateral_resolution from depth_of_field, or depth.scaling from the camera",
            )
        array = self.microlenses
        parts = [
            focused_plenoptic_depth_of_field_at_resolution(
                resolution,
                mla_distance=self.mla_distance,
                microlens_gap=array.gap,
                focal_length=self.main_lens.focal_length,
                inverse_focus_virtual_depth=inverse,
                microlens_aperture=array.aperture_diameter,
                pixel_pitch=self.sample_pitch,
                pupil_diameter=self.main_lens.pupil_diameter,
                wavelength=wavelength,
                keplerian=keplerian,
                entrance_pupil=self.main_lens.entrance_pupil,
            )
            for inverse, keplerian in zip(self._inverse_focus, self.keplerian, strict=True)
        ]
        return sharp_range(self.names, parts)

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - one, whatever the scene
        """Always one."""
        return 1

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p |v| (a − f)/f``, ``D |1 − v/v₀| (a − f)/f`` of the sharpest type, and the Airy radius [m].

        See `focused_plenoptic_lateral_resolution`; on an object that is not where it is modelled, sizes grow with its
        distance.
        """
        a, f, array = self.depth_scaling.modelled(distance), self.main_lens.focal_length, self.microlenses
        real = a > f
        wider = self._wider(distance, a)
        types = [
            focused_plenoptic_lateral_resolution(
                np.where(real, a, 2.0 * f),
                mla_distance=self.mla_distance,
                microlens_gap=array.gap,
                focal_length=f,
                inverse_focus_virtual_depth=inverse,
                microlens_aperture=array.aperture_diameter,
                pixel_pitch=self.sample_pitch,
                pupil_diameter=self.main_lens.pupil_diameter,
                wavelength=wavelength,
                entrance_pupil=self.main_lens.entrance_pupil,
            )
            for inverse in self._inverse_focus
        ]
        blur = np.min([resolution.blur for resolution in types], axis=0)  # the only part in which types differ
        sampling, diffraction = types[0].sampling, types[0].diffraction
        return LateralResolution(
            sampling=np.where(real, sampling * wider, np.nan),
            blur=np.where(real, blur * wider, np.nan),
            diffraction=np.where(real, diffraction * wider, np.nan),
        )

    def _wider(self, distance: ArrayLike, modelled: FloatArray) -> FloatArray:
        """Ratio of the size of an object to that of the object, where it is modelled, with the same image [1]."""
        if self.depth_scaling.is_identity:
            return np.ones_like(modelled)
        return np.asarray(np.asarray(distance) / np.where(modelled > 0.0, modelled, np.nan))
