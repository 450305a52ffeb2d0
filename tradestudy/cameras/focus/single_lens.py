"""One lens before one sensor, focused at one distance: a conventional camera, or each half of a stereo rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.focus.focus import BlurCriterion, SharpRange, sharp_range
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import DiffractionMeasure, depth_of_field, diffraction_diameter
from tradestudy.optics.lateral_resolution import LateralResolution, depth_of_field_at_resolution, lateral_resolution
from tradestudy.optics.thin_lens import image_distance


def require_focus(focus_distance: float, focal_length: float) -> None:
    """Refuse a focus within the focal length."""
    if not focus_distance > focal_length:
        raise OutOfRangeError(
            "the lens cannot focus that close",
            value=f"{focus_distance * 1e3:g} mm",
            limit=f"beyond the focal length, {focal_length * 1e3:g} mm",
            remedy="increase the focus distance",
        )


@dataclass(frozen=True, kw_only=True)
class SingleLensFocus:
    """A lens with fixed focus.

    Parameters
    ----------
    lens
        The lens.
    focus_distance
        Focus distance a₀ [m] from its principal plane; infinity is allowed.
    sample_pitch
        The pixel pitch [m].
    name
        Name of its only slice.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length or a pitch that is not positive.
    """

    lens: Lens
    focus_distance: float
    sample_pitch: float
    name: str = "one image"

    mechanisms = 0

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_focus(self.focus_distance, self.lens.focal_length)

    @property
    def working_f_number(self) -> float:
        """Working f-number N_w = b₀/A."""
        return float(image_distance(self.focus_distance, self.lens.focal_length)) / self.lens.pupil_diameter

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """The depth of field of the exact thin lens, for the blur that diffraction leaves; see `depth_of_field`."""
        allowance = criterion.allowance(self.sample_pitch, self.working_f_number)
        limits = depth_of_field(
            self.focus_distance, self.lens.focal_length, self.lens.pupil_diameter, allowance.geometric_diameter
        )
        return sharp_range((self.name,), [limits], allowance.reason)

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """From ``a₀ (1 − r/A)`` to the nearest of ``a₀ (1 + r/A)``, ``r b₀/p`` and ``r A/(1.22 λ)``.

        See `depth_of_field_at_resolution`.
        """
        limits = depth_of_field_at_resolution(
            resolution,
            focus_distance=self.focus_distance,
            focal_length=self.lens.focal_length,
            pupil_diameter=self.lens.pupil_diameter,
            sample_pitch=self.sample_pitch,
            wavelength=wavelength,
        )
        return sharp_range((self.name,), [limits])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - one, whatever the scene
        """Always one."""
        return 1

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p a/b₀``, ``A |a − a₀|/a₀`` and ``1.22 λ a/A`` [m]; see `lateral_resolution`."""
        return lateral_resolution(
            distance,
            focus_distance=self.focus_distance,
            focal_length=self.lens.focal_length,
            pupil_diameter=self.lens.pupil_diameter,
            sample_pitch=self.sample_pitch,
            wavelength=wavelength,
        )

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width of the diffraction spot on the sensor, times a/b₀ [m]."""
        b0 = float(image_distance(self.focus_distance, self.lens.focal_length))
        spot = diffraction_diameter(wavelength, self.working_f_number, measure)
        return np.asarray(spot * (np.asarray(distance, dtype=np.float64) / b0))
