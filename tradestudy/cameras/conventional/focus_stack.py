"""A lens that a mechanism refocuses for every image of a stack."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.focus.focus import BlurCriterion, SharpRange, sharp_range
from tradestudy.cameras.focus.single_lens import SingleLensFocus, require_focus
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import DiffractionMeasure, diffraction_diameter, images_needed, plan_focus_stack
from tradestudy.optics.lateral_resolution import LateralResolution, airy_radius
from tradestudy.optics.thin_lens import image_distance


@dataclass(frozen=True, kw_only=True)
class ImageStackFocus:
    """As few images as cover a range of distances, up to a maximum.

    If the maximum is too small, all images are taken and spread evenly, with equal gaps between their slices.

    Parameters
    ----------
    lens
        The lens; focusing moves it as a whole.
    sample_pitch
        The pixel pitch [m].
    near, far
        Range of the stack [m]; far may be infinite.
    most_images
        Largest number of images in one stack.

    Raises
    ------
    OutOfRangeError
        For an empty range, one that reaches into the focal length, or no images.
    """

    lens: Lens
    sample_pitch: float
    near: float
    far: float
    most_images: int

    mechanisms = 1

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_focus(self.near, self.lens.focal_length)
        if not self.near < self.far:
            raise OutOfRangeError(
                "range of a focus stack",
                value=f"{self.near * 1e3:g} to {self.far * 1e3:g} mm",
                limit="near < far",
                remedy="order the range",
            )
        if self.most_images < 1:
            raise OutOfRangeError("number of images in a focus stack", value=str(self.most_images), limit="at least 1")

    def _at(self, focus_distance: float, name: str) -> SingleLensFocus:
        return SingleLensFocus(lens=self.lens, focus_distance=focus_distance, sample_pitch=self.sample_pitch, name=name)

    def _planning_blur(self, criterion: BlurCriterion) -> tuple[float, str]:
        """The blur [m] left for defocus at the near end, where diffraction is widest, and the reason if it is zero."""
        f_number = image_distance(self.near, self.lens.focal_length) / self.lens.pupil_diameter
        allowance = criterion.allowance(self.sample_pitch, f_number)
        return float(allowance.geometric_diameter), allowance.reason

    def focus_distances(self, criterion: BlurCriterion) -> FloatArray:
        """Focus distances of the images [m], nearest first; none if diffraction exceeds the criterion."""
        blur, _ = self._planning_blur(criterion)
        if not blur > 0.0:
            return np.empty(0)
        lens = {"focal_length": self.lens.focal_length, "pupil_diameter": self.lens.pupil_diameter}
        count = min(images_needed(self.near, self.far, **lens, blur_diameter=blur), self.most_images)
        if blur >= self.lens.pupil_diameter:  # everything is sharp at any focus
            return np.array([self.near])
        return plan_focus_stack(self.near, self.far, images=count, **lens, blur_diameter=blur).focus_distances

    def _images(self, criterion: BlurCriterion) -> list[SingleLensFocus]:
        return self._stack(self.focus_distances(criterion))

    def _stack(self, focus_distances: FloatArray) -> list[SingleLensFocus]:
        return [self._at(float(distance), f"image {number}") for number, distance in enumerate(focus_distances, 1)]

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """The slices of the stack, each with the diffraction at its own focus."""
        images = self._images(criterion)
        ranges = [image.sharp_range(criterion).slices for image in images]
        names = tuple(image.name for image in images)
        return sharp_range(names, ranges, self._planning_blur(criterion)[1])

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """The slices of a stack planned for a resolution on the object instead of a blur on the sensor.

        An image focused at a₀ resolves r from ``a₀ (1 − r/A)`` to ``a₀ (1 + r/A)``, a constant ratio, so that
        adjoining slices form a geometric progression.
        """
        # Beyond this distance, a pixel or the Airy radius covers more than the resolution at any focus.
        far = min(
            self.far,
            self.lens.focal_length * (1.0 + resolution / self.sample_pitch),
            resolution / float(airy_radius(1.0, self.lens.pupil_diameter, wavelength)),
        )
        share = resolution / self.lens.pupil_diameter
        if share >= 1.0 or far <= self.near:  # one focus resolves everything closer, or nothing is resolved
            focus = np.array([max(far, self.near)])
        else:
            stretch = math.log(far / self.near)
            needed = math.ceil(stretch / (2.0 * math.atanh(share)) * (1.0 - 1e-12))
            count = min(max(1, needed), self.most_images)
            middles = self.near * np.exp((np.arange(count) + 0.5) * (stretch / count))
            focus = middles / math.sqrt(1.0 - share**2)
        images = self._stack(focus)
        names = tuple(image.name for image in images)
        return sharp_range(names, [image.sharp_range_at_resolution(resolution, wavelength).slices for image in images])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - the stack has its own range
        """Number of images of the stack for its own range."""
        return len(self.focus_distances(criterion))

    @property
    def sharpest_distances(self) -> list[float]:
        """Focus distances of the stack planned for a geometric blur of one pixel [m]."""
        return [image.focus_distance for image in self._sharpest]

    @cached_property
    def _sharpest(self) -> list[SingleLensFocus]:
        """The stack planned for a geometric blur of one pixel, by which resolution is judged."""
        return self._images(BlurCriterion(blur_px=1.0, measure="none", wavelength=1e-6))  # λ does not enter

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """Resolution of the best image at each distance, of the stack planned for one pixel of blur [m]."""
        images = [image.lateral_resolution(distance, wavelength) for image in self._sharpest]
        # Images whose diffraction is the same differ in sample and blur, so the best has the smaller of those.
        best = np.argmin([np.maximum(one.sampling, one.blur) for one in images], axis=0)[np.newaxis]
        return LateralResolution(
            **{
                part: np.take_along_axis(np.stack([getattr(one, part) for one in images]), best, axis=0)[0]
                for part in ("sampling", "blur", "diffraction")
            }
        )

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width of the diffraction spot on the object, ``∝ λ a/A`` [m], the same in every image."""
        spot = diffraction_diameter(wavelength, 1.0 / self.lens.pupil_diameter, measure)
        return np.asarray(spot * np.asarray(distance, dtype=np.float64))
