"""Lenses that a mechanism focuses on every object."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.focus.focus import BlurCriterion, SharpRange, sharp_range
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import DepthOfField, DiffractionMeasure, diffraction_diameter, images_needed
from tradestudy.optics.lateral_resolution import LateralResolution, airy_radius
from tradestudy.optics.thin_lens import image_distance


@dataclass(frozen=True, kw_only=True)
class EveryObjectFocus:
    """Unlimited focus, at the cost of a mechanism in each lens and one exposure for each depth of field.

    Parameters
    ----------
    lens
        One of the lenses.
    sample_pitch
        The pixel pitch [m].
    mechanisms
        Number of moving lenses.
    """

    lens: Lens
    sample_pitch: float
    mechanisms: int

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """Everything beyond the focal length, one focus after another, unless diffraction alone exceeds the criterion.

        The diffraction spot at a is ``d∞ b(a)/f`` wide. It meets the criterion from the distance where ``b = f c/d∞``.
        """
        f = self.lens.focal_length
        at_infinity = criterion.allowance(self.sample_pitch, self.lens.f_number)
        if bool(at_infinity.exceeded):
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], at_infinity.reason)
        spot = float(diffraction_diameter(criterion.wavelength, self.lens.f_number, criterion.measure))
        widest = criterion.blur_px * self.sample_pitch
        # b − f = f (c/d∞ − 1) is the largest focus shift that is still sharp.
        near = f + f * spot / (widest - spot) if widest > spot else math.inf
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(near), far=np.asarray(math.inf))])

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """From the focal length to the nearer of ``p (a − f)/f = r`` and ``1.22 λ a/A = r``."""
        f = self.lens.focal_length
        diffraction = resolution / float(airy_radius(1.0, self.lens.pupil_diameter, wavelength))
        far = min(f + f * (resolution / self.sample_pitch), diffraction)
        if far < f:
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], "diffraction is coarser at every distance")
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(f), far=np.asarray(far))])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:
        """Number of depths of field that cover the scene; 0 if diffraction exceeds the criterion at its near end."""
        f = self.lens.focal_length
        if not near > f:
            return 0
        f_number = image_distance(near, f) / self.lens.pupil_diameter
        blur = float(criterion.allowance(self.sample_pitch, f_number).geometric_diameter)
        if not blur > 0.0:
            return 0
        return images_needed(near, far, focal_length=f, pupil_diameter=self.lens.pupil_diameter, blur_diameter=blur)

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p (a − f)/f``, size of a pixel on an object in focus, no blur, and ``1.22 λ a/A`` [m]."""
        a, f = np.asarray(distance, dtype=np.float64), self.lens.focal_length
        real = np.where(a > f, 1.0, np.nan)
        return LateralResolution(
            sampling=np.asarray(real * self.sample_pitch * ((a - f) / f)),
            blur=np.asarray(0.0 * real),
            diffraction=np.asarray(real * airy_radius(a, self.lens.pupil_diameter, wavelength)),
        )

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width ``∝ λ a/A`` [m] of the diffraction spot on an object in focus; on the sensor it is ``∝ λ b/A``."""
        a, f = np.asarray(distance, dtype=np.float64), self.lens.focal_length
        spot = diffraction_diameter(wavelength, 1.0 / self.lens.pupil_diameter, measure)
        return np.asarray(np.where(a > f, spot * a, np.nan))
