"""The declaration of a conventional camera in a study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.conventional.depth_reading import FocusStackReader
from tradestudy.cameras.conventional.design import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.declaration import CalibratedCameraPart, CameraDeclaration, ProjectingLensPart, SensorPart
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.imported import Imported, ImportedCamera, Stated, camera_stated, conventions_stated
from tradestudy.cameras.parts import Lens
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    DetailSize,
    ObjectDistance,
    ObjectDistanceOrInfinity,
    PositiveCount,
    PositiveDuration,
)
from tradestudy.optics.depth_of_field import object_distance_of_magnification


class ReferenceScalePart(Part):
    """A focus setting that a data sheet states.

    The program derives from it how far the principal plane lies behind the front of the lens.
    """

    working_distance: ObjectDistance = Field(description="Distance from the object to the front of the lens.")
    image_scale: DetailSize = Field(description="Width that one pixel covers on the object, at this focus setting.")


class FocusStackPart(Part):
    """A range of distances throughout which a focus stack must be sharp.

    The program plans as few pictures as suffice for the whole range. If the range needs more than `images` pictures,
    the program plans only `images` pictures, spaced evenly over the corresponding range of image distances (behind the
    lens) on a logarithmic scale; the stack then has gaps.
    """

    increasing = ("start", "stop")

    start: ObjectDistance = Field(alias="from", description="Nearest distance of the range to cover.")
    stop: ObjectDistanceOrInfinity = Field(alias="to", description="Farthest distance of the range to cover.")
    images: PositiveCount = Field(description="Largest number of pictures in one stack.")
    time_per_image: PositiveDuration | None = Field(
        default=None, description="Time from one picture to the next, including refocusing."
    )


class ConventionalFocusPart(Part):
    """Distance at which a conventional camera is focused.

    Give exactly one of `distance`, `image_scale` and `working_distance`, even if you declare a `stack`.
    """

    exactly_one = (("distance", "image_scale", "working_distance"),)

    distance: ObjectDistanceOrInfinity | None = Field(
        default=None,
        description="Distance from the object in focus to the entrance pupil of the lens, which lies in the principal "
        "plane unless the lens says otherwise.",
    )
    image_scale: DetailSize | None = Field(
        default=None, description="Instead of `distance`: width that one pixel covers on an object in focus."
    )
    working_distance: ObjectDistance | None = Field(
        default=None,
        description="Instead of `distance`: distance from the object in focus to the front of the lens; needs "
        "`reference`, or housing_front of the lens.",
    )
    reference: ReferenceScalePart | None = None
    stack: FocusStackPart | None = Field(default=None, description="A focus stack instead of a single picture.")

    def resolved(self, lens: Lens, by_scale: Callable[[float], float]) -> float:
        """Focus distance from the entrance pupil [m], however it is declared; the lens knows where its front is."""
        if self.distance is not None:
            return self.distance
        if self.image_scale is not None:
            return by_scale(self.image_scale)
        assert self.working_distance is not None and lens.housing_front is not None  # noqa: PT018 - the schema's promise, for the type checker
        return self.working_distance + lens.housing_front + lens.entrance_pupil


class ConventionalDeclaration(CameraDeclaration):
    """A conventional camera with fixed focus or with a focus stack.

    The program predicts no depth uncertainty for it.
    """

    camera: ClassVar[type[ConventionalCamera]] = ConventionalCamera
    reader: ClassVar[DepthReaderOfKind | None] = FocusStackReader

    kind: Literal["conventional"]
    imports: ClassVar[tuple[type, ...]] = (ImportedCamera,)

    lens: ProjectingLensPart = Field(default_factory=ProjectingLensPart)
    sensor: SensorPart
    geometry: CalibratedCameraPart | None = Field(
        default=None,
        description="Calibrated geometry of the camera, instead of a focal length: its pictures have this principal "
        "point and lens model.",
    )
    focus: ConventionalFocusPart

    @model_validator(mode="after")
    def _one_focal_length(self) -> Self:
        if self.focus.working_distance is not None and self.focus.reference is None and self.lens.housing_front is None:
            raise MistakeAt(
                ("focus", "working_distance"),
                "is measured from the front of the lens; give a reference (working_distance and image_scale of one "
                "focus setting), or housing_front of the lens",
            )
        if self.focus.reference is not None and self.lens.housing_front is not None:
            raise MistakeAt(("focus", "reference"), "housing_front of the lens says where its front is; remove this")
        given_keys = [key for key in ("focal_length", "field_of_view") if getattr(self.lens, key) is not None]
        if self.geometry is None and not given_keys:
            raise MistakeAt(("lens",), "give exactly one of focal_length and field_of_view")
        if self.geometry is not None and given_keys:
            raise MistakeAt(
                ("lens", given_keys[0]),
                "the calibrated geometry determines it; remove it, or remove the geometry (geometry: null)",
            )
        if self.geometry is not None and self.focus.stack is not None:
            raise MistakeAt(
                ("focus", "stack"),
                "a calibrated geometry holds for one focus setting; remove the stack, or remove the geometry "
                "(geometry: null) and give a focal_length of the lens",
            )
        return self

    @classmethod
    def stated_by(cls, imported: Imported) -> Iterator[Stated]:
        """Geometry and pixels of a single calibrated camera."""
        assert isinstance(imported, ImportedCamera)
        keys = imported.keys
        yield Stated(path=("kind",), value="conventional", key=keys["focal_lengths"], basis="derived")
        yield from camera_stated(("geometry",), imported)
        if imported.pixels is not None:
            yield Stated(path=("sensor", "pixels"), value=list(imported.pixels), key=keys["pixels"])
        yield from conventions_stated(imported.conventions)

    def design(self, picture_law: DisparityErrorLaw | None) -> ConventionalCamera:  # noqa: ARG002 - it measures no disparity
        """The camera in SI, focused by distance, by image scale, or by a data sheet's working distance.

        A calibrated geometry gives the mean of its focal lengths, times the scale of its lens model on the axis.

        The image scale s for a pixel pitch p gives the magnification p/s, and thus the distance a of the principal
        plane. At the reference, this gives the position of that plane behind the front of the lens, which is assumed
        constant. The entrance pupil lies e behind the plane: Z = a + e.
        """
        sensor = self.sensor.sensor()
        geometry = self.geometry
        if geometry is None:
            lens = self.lens.lens(sensor)
        else:
            in_pixels = sum(geometry.focal_length) / 2.0 * geometry.lens_model().scale_on_axis
            focal_length = in_pixels * sensor.pixel_pitch
            lens = self.lens.of_focal_length(focal_length)
        focus = self.focus

        def by_scale(image_scale: float) -> float:
            from_plane = float(object_distance_of_magnification(lens.focal_length, sensor.pixel_pitch / image_scale))
            return from_plane + lens.entrance_pupil

        if focus.reference is not None:
            in_focus = by_scale(focus.reference.image_scale) - lens.entrance_pupil
            lens = replace(lens, housing_front=in_focus - focus.reference.working_distance)
        stack = focus.stack
        return ConventionalCamera(
            lens=lens,
            sensor=sensor,
            focus_distance=focus.resolved(lens, by_scale),
            stack=None
            if stack is None
            else FocusStackPlan(
                near=stack.start, far=stack.stop, most_images=stack.images, time_per_image=stack.time_per_image
            ),
            calibrated=None if geometry is None else geometry.calibrated,
        )
