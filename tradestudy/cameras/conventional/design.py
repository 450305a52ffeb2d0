"""A conventional camera: one lens, one sensor, with a fixed focus or a mechanism for focus stacks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibrated_pair import CalibratedCamera
from tradestudy.cameras.camera import Camera, Contradiction, DerivedValue, Properties, lens_contradictions, show
from tradestudy.cameras.depth_measurement import Environment, Errors
from tradestudy.cameras.focus import (
    BlurCriterion,
    SharpRange,
    SingleLensFocus,
    refocusing,
    require_focus,
    require_refocusing,
    sharp_range,
)
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.cameras.single_lens import PictureEdges, SingleLensExposure, properties_of_lens
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import images_needed, plan_focus_stack
from tradestudy.optics.lateral_resolution import LateralResolution, airy_radius
from tradestudy.optics.thin_lens import image_distance
from tradestudy.units import ANGLE, LENGTH, NUMBER

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart


@dataclass(frozen=True, kw_only=True)
class ImageStackFocus:
    """As few images as cover a range of distances, up to a maximum.

    If the maximum is too small, all images are taken and spread evenly, with equal gaps between their slices.

    Parameters
    ----------
    lens
        The lens; focusing moves it as a whole. Distances count from its entrance pupil.
    sample_pitch
        The pixel pitch [m].
    near, far
        Range of the stack [m]; far may be infinite.
    most_images
        Largest number of images in one stack.

    Raises
    ------
    OutOfRangeError
        For an empty range, one that reaches into the focal length, or no images; or the entrance pupil lies in front
        of the front focal point.
    """

    lens: Lens
    sample_pitch: float
    near: float
    far: float
    most_images: int

    mechanisms = 1

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_refocusing(self.lens)
        require_focus(self.near, self.lens)
        if not self.near < self.far:
            raise OutOfRangeError(
                "range of a focus stack",
                value=f"{self.near * 1e3:g} to {self.far * 1e3:g} mm",
                limit="near < far",
                remedy="order the range",
            )
        if self.most_images < 1:
            raise OutOfRangeError("number of images in a focus stack", value=str(self.most_images), limit="at least 1")

    def _planning_blur(self, criterion: BlurCriterion) -> tuple[float, str]:
        """The blur [m] left for defocus at the near end, where diffraction is widest, and the reason if it is zero."""
        thin = self.lens.thin(self.near)
        f_number = image_distance(self.near, thin.focal_length) / thin.pupil_diameter
        allowance = criterion.allowance(self.sample_pitch, f_number)
        return float(allowance.geometric_diameter), allowance.reason

    def focus_distances(self, criterion: BlurCriterion) -> FloatArray:
        """Focus distances of the images [m], nearest first; none if diffraction exceeds the criterion."""
        blur, _ = self._planning_blur(criterion)
        if not blur > 0.0:
            return np.empty(0)
        lens = refocusing(self.lens, blur)
        count = min(images_needed(self.near, self.far, **lens), self.most_images)
        if lens["blur_diameter"] >= self.lens.pupil_diameter:  # everything is sharp at any focus
            return np.array([self.near])
        return plan_focus_stack(self.near, self.far, images=count, **lens).focus_distances

    def _stack(self, focus_distances: FloatArray) -> list[SingleLensFocus]:
        return [
            SingleLensFocus(
                lens=self.lens.thin(float(distance)),
                focus_distance=float(distance),
                sample_pitch=self.sample_pitch,
                name=f"image {number}",
            )
            for number, distance in enumerate(focus_distances, 1)
        ]

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """The slices of the stack, each with the diffraction at its own focus."""
        images = self._stack(self.focus_distances(criterion))
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
            self.lens.front_focus + self.lens.focal_length * (resolution / self.sample_pitch),
            resolution / float(airy_radius(1.0, self.lens.pupil_diameter, wavelength)),
        )
        share = resolution / self.lens.pupil_diameter
        if share >= 1.0 or far <= self.near:  # one focus resolves everything closer, or nothing is resolved
            focus = np.array([max(far, self.near)])
        else:
            stretch = math.log(far / self.near)
            # Rounding must not add an image.
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
        one_pixel = BlurCriterion(blur_px=1.0, measure="none", wavelength=1e-6)  # λ does not enter
        return self._stack(self.focus_distances(one_pixel))

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """Resolution of the best image at each distance, of the stack planned for one pixel of blur [m]."""
        images = [image.lateral_resolution(distance, wavelength) for image in self._sharpest]
        # Images whose diffraction is the same differ in sample and blur, so the best has the smaller of those.
        best = np.argmin([np.maximum(image.sampling, image.blur) for image in images], axis=0)[np.newaxis]
        return LateralResolution(
            **{
                part: np.take_along_axis(np.stack([getattr(image, part) for image in images]), best, axis=0)[0]
                for part in ("sampling", "blur", "diffraction")
            }
        )


# Allows for a thin lens instead of a real one, and for a focus distance rounded to two digits.
_DEPTH_OF_FIELD_TOLERANCE: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class FocusStackPlan:
    """The focus stack of a camera with a focus mechanism.

    Parameters
    ----------
    near, far
        Range of distances to cover [m] from the entrance pupil; far may be infinite.
    most_images
        Largest number of images in one stack.
    time_per_image
        Time from one image to the next, including refocusing [s]; None if unknown.

    Raises
    ------
    OutOfRangeError
        For a time that is not positive.
    """

    near: float
    far: float
    most_images: int
    time_per_image: float | None = None

    def __post_init__(self) -> None:
        if self.time_per_image is not None:
            require_positive("time per image", self.time_per_image, "s")


@dataclass(frozen=True, kw_only=True)
class ConventionalCamera(Camera):
    """A camera without triangulation; a focus stack extends its depth of field.

    Parameters
    ----------
    lens, sensor
        The lens and the sensor.
    focus_distance
        Distance in focus of a single image [m] from the entrance pupil; infinity is allowed.
    stack
        Focus stack instead of a single image; None for a fixed focus.
    calibrated
        Calibrated geometry of its picture, if known; focus, blur and light are those of the lens.

    Raises
    ------
    OutOfRangeError
        The focus is within the focal length, or the stack is impossible; or a stack has a calibrated geometry, which
        holds for one focus setting.
    """

    family: ClassVar[str] = "conventional"

    lens: Lens
    focus_distance: float
    stack: FocusStackPlan | None = None
    calibrated: CalibratedCamera | None = None

    def __post_init__(self) -> None:
        if self.calibrated is not None and self.stack is not None:
            raise OutOfRangeError(
                "a focus stack of a camera with a calibrated geometry, which holds for one focus setting",
                remedy="remove the stack, or remove the geometry (geometry: null) and give lens.focal_length",
            )
        require_focus(self.focus_distance, self.lens)
        _ = self.focus  # checks its arguments

    @property
    def single_image(self) -> SingleLensFocus:
        """The focus of one image at `focus_distance`."""
        return SingleLensFocus(
            lens=self.lens.thin(self.focus_distance),
            focus_distance=self.focus_distance,
            sample_pitch=self.sensor.pixel_pitch,
        )

    @property
    def focus(self) -> SingleLensFocus | ImageStackFocus:
        """The focus of the stack, or of one image if there is no stack."""
        if self.stack is None:
            return self.single_image
        return ImageStackFocus(
            lens=self.lens,
            sample_pitch=self.sensor.pixel_pitch,
            near=self.stack.near,
            far=self.stack.far,
            most_images=self.stack.most_images,
        )

    @property
    def gathering_lens(self) -> Lens:
        """The only lens."""
        return self.lens

    @property
    def makes_depth_map(self) -> bool:
        """Whether it takes a focus stack, from which it computes one."""
        return self.takes_stack

    @property
    def takes_stack(self) -> bool:
        """Whether it takes a focus stack."""
        return self.stack is not None

    @property
    def time_per_image(self) -> float | None:
        """Time from one image of the stack to the next [s]; None if unknown."""
        return None if self.stack is None else self.stack.time_per_image

    def depth_behind_lens(self, nearest: float) -> float:  # noqa: ARG002 - its own focus, whatever the scene
        """Distance from the second principal plane to the sensor [m], at the nearest focus of a stack."""
        focus = self.focus_distance if self.stack is None else min(self.focus_distance, self.stack.near)
        return float(image_distance(focus - self.principal_plane, self.lens.focal_length))

    def exposures(
        self,
        reference_distance: float,  # noqa: ARG002 - its own focus, whatever the scene
        errors: Errors,  # noqa: ARG002 - it has no calibration
        environment: Environment | None,  # noqa: ARG002 - as above
        stop_separation: float,
    ) -> Sequence[SingleLensExposure]:
        """One picture, as calibrated or designed, or the pictures of a stack planned for a blur of one pixel."""
        if (camera := self.calibrated) is not None:
            distances, point = camera.on_sensor(self.sensor)
            return [
                SingleLensExposure(
                    name="image",
                    sensor=self.sensor,
                    lens=self.lens,
                    focus_distance=self.focus_distance,
                    principal_distances=distances,
                    principal_point=point,
                    distortion=camera.lens,
                    stop_separation=stop_separation,
                )
            ]
        focus = {"image": self.focus_distance}
        if isinstance(self.focus, ImageStackFocus):
            focus = {f"image-{k}": distance for k, distance in enumerate(self.focus.sharpest_distances, start=1)}
        return [
            SingleLensExposure(
                name=name,
                sensor=self.sensor,
                lens=self.lens,
                focus_distance=distance,
                stop_separation=stop_separation,
            )
            for name, distance in focus.items()
        ]

    @property
    def fields_of_view(self) -> tuple[float, float]:
        """Angles between opposite edges and corners of the picture [rad], as calibrated, or focused at infinity."""
        sensor = self.sensor
        if self.calibrated is None:
            return self.lens.field_of_view(sensor.width), self.lens.field_of_view(sensor.diagonal)
        return PictureEdges.of(self.calibrated.lens, sensor, *self.calibrated.on_sensor(sensor)).fields_of_view

    def properties(self) -> Properties:
        """Lens, focus and field of view."""
        lens, single = self.lens, self.single_image
        across, diagonal = self.fields_of_view
        views = "focused at infinity" if self.calibrated is None else "as calibrated"
        rows: list[tuple[str, DerivedValue | str]] = [
            ("focal length", DerivedValue(lens.focal_length, LENGTH)),
            ("pupil diameter", DerivedValue(lens.pupil_diameter, LENGTH)),
            (f"focus distance, from the {self.origin}", DerivedValue(self.focus_distance, LENGTH)),
            ("working f-number", DerivedValue(single.working_f_number, NUMBER)),
            (f"horizontal field of view, {views}", DerivedValue(across, ANGLE)),
            (f"diagonal field of view, {views}", DerivedValue(diagonal, ANGLE)),
            *(() if self.calibrated is None else properties_of_lens(self.calibrated.lens, "lens model")),
        ]
        if math.isfinite(self.focus_distance):
            in_focus = single.working_f_number * lens.pupil_diameter
            scale = self.sensor.pixel_pitch * self.focus_distance / in_focus
            rows.insert(3, ("image scale in focus, per pixel", DerivedValue(scale, LENGTH)))
        if lens.housing_front is not None:
            working = self.focus_distance - self.principal_plane - lens.housing_front
            rows.insert(3, ("working distance, from the front of the lens", DerivedValue(working, LENGTH)))
        if self.stack is not None:
            rows += [
                ("most images of the focus stack", DerivedValue(self.stack.most_images, NUMBER)),
                ("near end of the focus stack", DerivedValue(self.stack.near, LENGTH)),
                ("far end of the focus stack", DerivedValue(self.stack.far, LENGTH)),
            ]
        return (*rows, *self.lens_places())

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:  # noqa: ARG002 - it measures no depth
        """Contradictions of the lens, and between the stated depth of field and that of the thin lens.

        Data sheets seldom state their blur criterion, so the message gives the implied one.
        """
        contradictions = lens_contradictions(self.lens, self.sensor, stated, self.fields_of_view)
        if stated is None or stated.depth_of_field is None:
            return contradictions
        one_pixel = BlurCriterion(blur_px=1.0, measure="none", wavelength=1e-6)  # λ does not enter
        extent = self.single_image.sharp_range(one_pixel).extent
        if math.isclose(stated.depth_of_field, extent, rel_tol=_DEPTH_OF_FIELD_TOLERANCE):
            return contradictions
        return [
            *contradictions,
            Contradiction(
                what="depth of field against lens and sensor",
                stated=show(stated.depth_of_field, LENGTH),
                implied=f"{show(extent, LENGTH)} for a blur of one pixel; {show(stated.depth_of_field, LENGTH)} "
                f"implies {stated.depth_of_field / extent:.2g} px",
                used="the blur criteria of the study",
                path=("stated", "depth_of_field"),
            ),
        ]
