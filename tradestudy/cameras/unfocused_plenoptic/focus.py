"""The focus of an unfocused plenoptic camera: the range in which its views are sharp and can be refocused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.focus.focus import BlurCriterion, SharpRange
from tradestudy.cameras.focus.single_lens import SingleLensFocus
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import DiffractionMeasure
from tradestudy.optics.lateral_resolution import LateralResolution


@dataclass(frozen=True, kw_only=True)
class RefocusedViewsFocus:
    """A lens as wide as the pupil of one view, with one lateral sample for each microlens.

    Parameters
    ----------
    main_lens
        The main lens.
    focus_distance
        a₀ [m]: the distance that is imaged onto the array.
    view_pupil_diameter
        Diameter of the part of the pupil that one pixel sees [m].
    microlens_pitch
        The lateral sample [m].
    """

    main_lens: Lens
    focus_distance: float
    view_pupil_diameter: float
    microlens_pitch: float

    mechanisms = 0

    def __post_init__(self) -> None:
        require_positive("pupil of a view", self.view_pupil_diameter)

    @property
    def _view(self) -> SingleLensFocus:
        f = self.main_lens.focal_length
        return SingleLensFocus(
            lens=Lens(focal_length=f, f_number=f / self.view_pupil_diameter),
            focus_distance=self.focus_distance,
            sample_pitch=self.microlens_pitch,
            name="refocused views",
        )

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """Depth of field of one view, with blur and diffraction of its small pupil in microlenses."""
        return self._view.sharp_range(criterion)

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """See `depth_of_field_at_resolution`."""
        return self._view.sharp_range_at_resolution(resolution, wavelength)

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - one, whatever the scene
        """Always one: images are refocused by computation."""
        return 1

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p a/z``, ``B |a − a₀|/a₀`` and ``1.22 λ a/B`` [m], p the microlens pitch and B the pupil of a view."""
        return self._view.lateral_resolution(distance, wavelength)

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width of the diffraction spot of one view's pupil on the array, times a/z [m].

        A refocused image is the sum of the views, and no sharper than each of them.
        """
        return np.asarray(self._view.diffraction_width(distance, wavelength, measure))
