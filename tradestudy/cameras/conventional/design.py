"""A conventional camera: one lens, one sensor, with a fixed focus or a mechanism for focus stacks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from tradestudy.cameras.calibrated_pair import CalibratedCamera
from tradestudy.cameras.camera import Camera, Properties
from tradestudy.cameras.contradictions import Contradiction, lens_contradictions, show
from tradestudy.cameras.conventional.focus_stack import ImageStackFocus
from tradestudy.cameras.depth_measurement import Errors
from tradestudy.cameras.environment import Environment
from tradestudy.cameras.focus import BlurCriterion, SingleLensFocus
from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.cameras.picture_field import edge_angle, properties_of
from tradestudy.cameras.single_lens_exposure import SingleLensExposure
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.thin_lens import image_distance
from tradestudy.units import ANGLE, LENGTH, NUMBER, pretty

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart

# Allows for a thin lens instead of a real one, and for a focus distance rounded to two digits.
_DEPTH_OF_FIELD_TOLERANCE: Final = 0.1


@dataclass(frozen=True, kw_only=True)
class FocusStackPlan:
    """The focus stack of a camera with a focus mechanism.

    Parameters
    ----------
    near, far
        Range of distances to cover [m] from the principal plane; far may be infinite.
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
        Distance in focus of a single image [m] from the principal plane; infinity is allowed.
    stack
        Focus stack instead of a single image; None for a fixed focus.
    front_to_principal_plane
        Distance of the principal plane behind the front of the lens [m], from which data sheets measure working
        distances; None if unknown.
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
    front_to_principal_plane: float | None = None
    calibrated: CalibratedCamera | None = None

    def __post_init__(self) -> None:
        if self.calibrated is not None and self.stack is not None:
            raise OutOfRangeError(
                "a focus stack of a camera with a calibrated geometry, which holds for one focus setting",
                remedy="remove the stack, or remove the geometry (geometry: null) and give lens.focal_length",
            )
        # Both check their arguments.
        _ = self.single_image, self.focus

    @property
    def single_image(self) -> SingleLensFocus:
        """The focus of one image at `focus_distance`."""
        return SingleLensFocus(lens=self.lens, focus_distance=self.focus_distance, sample_pitch=self.sensor.pixel_pitch)

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
        """Whether it takes a focus stack."""
        return self.stack is not None

    @property
    def takes_stack(self) -> bool:
        """Whether it takes a focus stack."""
        return self.stack is not None

    @property
    def time_per_image(self) -> float | None:
        """Time from one image of the stack to the next [s]; None if unknown."""
        return None if self.stack is None else self.stack.time_per_image

    def depth_behind_lens(self, nearest: float) -> float:  # noqa: ARG002 - its own focus, whatever the scene
        """Distance from lens to sensor [m], at the nearest focus of a stack."""
        focus = self.focus_distance if self.stack is None else min(self.focus_distance, self.stack.near)
        return float(image_distance(focus, self.lens.focal_length))

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
        ((cx, cy), (x, y)), lens = self.calibrated.on_sensor(sensor), self.calibrated.lens
        ends = [((side * sensor.width / 2.0 - x) / cx, (side * sensor.height / 2.0 - y) / cy) for side in (-1.0, 1.0)]
        return sum(edge_angle(lens, one, 0.0) for one, _ in ends), sum(edge_angle(lens, *one) for one in ends)

    def properties(self) -> Properties:
        """Lens, focus and field of view."""
        lens, single = self.lens, self.single_image
        across, diagonal = self.fields_of_view
        views = "focused at infinity" if self.calibrated is None else "as calibrated"
        rows = [
            ("focal length", pretty(lens.focal_length, LENGTH, 4)),
            ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
            ("focus distance, from the principal plane", pretty(self.focus_distance, LENGTH, 4)),
            ("working f-number", pretty(single.working_f_number, NUMBER, 4)),
            (f"horizontal field of view, {views}", pretty(across, ANGLE, 4)),
            (f"diagonal field of view, {views}", pretty(diagonal, ANGLE, 4)),
            *(() if self.calibrated is None else properties_of(self.calibrated.lens, "lens model")),
        ]
        if math.isfinite(self.focus_distance):
            in_focus = image_distance(self.focus_distance, self.lens.focal_length)
            scale = self.sensor.pixel_pitch * self.focus_distance / float(in_focus)
            rows.insert(3, ("image scale in focus, per pixel", pretty(scale, LENGTH, 4)))
        if self.front_to_principal_plane is not None:
            working = self.focus_distance - self.front_to_principal_plane
            rows.insert(3, ("working distance, from the front of the lens", pretty(working, LENGTH, 4)))
        if self.stack is not None:
            ends = " to ".join(pretty(end, LENGTH) for end in (self.stack.near, self.stack.far))
            rows.append(("focus stack", f"up to {self.stack.most_images} images, {ends}"))
        return tuple(rows)

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:  # noqa: ARG002 - it measures no depth
        """Contradictions of the lens, and between the stated depth of field and that of the thin lens.

        Data sheets seldom state their blur criterion, so the message gives the implied one.
        """
        found = lens_contradictions(self.lens, self.sensor, stated, self.fields_of_view)
        if stated is None or stated.depth_of_field is None:
            return found
        one_pixel = BlurCriterion(blur_px=1.0, measure="none", wavelength=1e-6)  # λ does not enter
        extent = self.single_image.sharp_range(one_pixel).extent
        if math.isclose(stated.depth_of_field, extent, rel_tol=_DEPTH_OF_FIELD_TOLERANCE):
            return found
        return [
            *found,
            Contradiction(
                what="depth of field against lens and sensor",
                stated=show(stated.depth_of_field, LENGTH),
                implied=f"{show(extent, LENGTH)} for a blur of one pixel; {show(stated.depth_of_field, LENGTH)} "
                f"implies {stated.depth_of_field / extent:.2g} px",
                used="the blur criteria of the study",
                path=("stated", "depth_of_field"),
            ),
        ]
