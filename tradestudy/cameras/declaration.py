"""The parts of every camera's declaration: lens, sensor, attributes, and the precision of disparity."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.cameras.calibrated_pair import CalibratedCamera
from tradestudy.cameras.calibration_declaration import CalibrationPart
from tradestudy.cameras.camera import Camera
from tradestudy.cameras.depth_camera import DepthCamera, DisparityError, DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.imported import PICTURE_SIZE, Imported, Stated
from tradestudy.cameras.parts import Lens, Sensor, focal_length_of_field_of_view
from tradestudy.cameras.stated_declaration import StatedPart
from tradestudy.declarations.lens_models import AnyLensModel
from tradestudy.declarations.matcher import MatcherPart
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    Count,
    FNumber,
    FocalLengthOrPixels,
    InPixels,
    Length,
    LengthOrInfinity,
    NonNegativeElectrons,
    PixelPitch,
    Pixels,
    PositiveAngle,
    PositiveCount,
    PositiveElectrons,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    QuantityText,
    SystemGain,
    Text,
    quantity,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_model import IDEAL, LensModel

AttributeName = Annotated[str, Field(pattern=r"^[a-z][\w -]*$", max_length=60)]
QuantumEfficiency = Annotated[float, *quantity(units.FRACTION, above=0.0, at_most=1.0)]
PixelCount = Annotated[int, Field(ge=1, le=1_000_000, strict=True)]


class LensPart(Part):
    """The main lens: its focal length or field of view, and its f-number."""

    counts_given: ClassVar[tuple[int, ...]] = (1,)
    """How many of the keys focal_length and field_of_view a lens may have."""

    focal_length: FocalLengthOrPixels | None = Field(
        default=None,
        description="Focal length: a length or, as in calibration files, a number of pixels. Alternatively, give "
        "field_of_view.",
    )
    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Instead of focal_length: full field of view of the lens when it is focused at infinity.",
    )
    across: Literal["width", "diagonal"] = Field(
        default="width",
        validate_default=True,
        description="Whether field_of_view spans the width or the diagonal of the sensor.",
    )
    f_number: FNumber | None = Field(
        default=None, description="F-number: focal length divided by the diameter of the entrance pupil."
    )
    entrance_pupil_diameter: PositiveLength | None = Field(
        default=None, description="Instead of f_number: diameter of the entrance pupil."
    )
    principal_separation: Length = Field(
        default=0.0,
        description="Distance from the first (object-side) to the second principal plane, of either sign. Distances to "
        "objects and to the array or sensor count from these planes, unless a key says otherwise.",
    )
    entrance_pupil: Length | None = Field(
        default=None,
        description="Position of the entrance pupil, counted from the first principal plane, positive towards the "
        "sensor. All distances of a stereo rig or a conventional camera count from it, because it is the centre of "
        "projection; those of a plenoptic camera count from the first principal plane. Default: in that plane, as in a "
        "thin lens, or where exit_pupil places it.",
    )
    exit_pupil: LengthOrInfinity | None = Field(
        default=None,
        description="Position of the exit pupil, counted from the second principal plane, positive towards the sensor; "
        "infinity for a lens that is telecentric in image space. It is the image of the entrance pupil: give one of "
        "them, or both to check them against each other.",
    )
    housing_front: Length | None = Field(
        default=None,
        description="Distance from the first principal plane to the front of the housing, positive towards the scene. "
        "With it, results also give working distances, which count from that front.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        by_diameter = self.entrance_pupil_diameter is not None
        by_number = self.f_number is not None and not (by_diameter and "f_number" not in self.model_fields_set)
        if by_diameter == by_number:
            yield MistakeAt(
                (), "give exactly one of f_number and entrance_pupil_diameter (null removes an inherited one)"
            )
        if (self.focal_length is not None) + (self.field_of_view is not None) not in self.counts_given:
            yield MistakeAt((), "give exactly one of focal_length and field_of_view (null removes an inherited one)")
        if self.field_of_view is None and "across" in self.model_fields_set:
            yield MistakeAt(
                ("across",), "belongs to field_of_view, which is missing; remove it (null removes an inherited one)"
            )
        if self.field_of_view is not None and not self.field_of_view < math.pi:
            yield MistakeAt(("field_of_view",), "a flat sensor sees less than 180°")

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """As for every part, but `across` is an assumption only with a field of view, f_number only if it is used."""
        unused = [("across",)] if self.field_of_view is None else []
        unused += [("f_number",)] if self.entrance_pupil_diameter is not None else []
        yield from (assumption for assumption in super().assumed() if assumption[0] not in unused)

    def lens(self, sensor: Sensor) -> Lens:
        """The lens in SI, with its focal length as given or from the field of view on a sensor."""
        focal_length = self.focal_length
        if isinstance(focal_length, InPixels):
            focal_length = focal_length.pixels * sensor.pixel_pitch
        if focal_length is None:
            assert self.field_of_view is not None  # one of the two is given
            extent = sensor.diagonal if self.across == "diagonal" else sensor.width
            focal_length = focal_length_of_field_of_view(self.field_of_view, extent)
        return self.of_focal_length(focal_length)

    def of_focal_length(self, focal_length: float) -> Lens:
        """The lens in SI with a focal length [m] from elsewhere; the position of one pupil gives that of the other.

        Raises
        ------
        OutOfRangeError
            The exit pupil lies in the rear focal plane, so that the entrance pupil is at infinity.
        """
        number, entrance, leaving = self.f_number, self.entrance_pupil or 0.0, self.exit_pupil
        if self.entrance_pupil_diameter is not None:
            number = focal_length / self.entrance_pupil_diameter
        assert number is not None  # the validator ensures it
        if leaving == focal_length:
            raise OutOfRangeError(
                "exit_pupil in the rear focal plane; lenses that are telecentric in object space are not modelled",
                value=f"{leaving * 1e3:g} mm",
                limit=f"other than the focal length, {focal_length * 1e3:g} mm",
                remedy="correct exit_pupil, or remove it",
            )
        if self.entrance_pupil is None and leaving is not None:
            entrance = leaving / (1.0 - leaving / focal_length) if math.isfinite(leaving) else -focal_length
        return Lens(
            focal_length=focal_length,
            f_number=number,
            principal_separation=self.principal_separation,
            entrance_pupil=entrance,
            stated_exit_pupil=leaving,
            housing_front=self.housing_front,
        )


class ProjectingLensPart(LensPart):
    """The lens of a conventional camera, or of both cameras of a rig; ``geometry`` may determine its focal length."""

    counts_given: ClassVar[tuple[int, ...]] = (0, 1)

    f_number: FNumber | None = Field(
        default="2.8", validate_default=True, description=LensPart.model_fields["f_number"].description
    )


class SensorPart(Part):
    """The sensor, an array of pixels."""

    pixels: tuple[PixelCount, PixelCount] = Field(
        description="Number of columns and number of rows.", examples=[[1280, 800]]
    )
    pixel_pitch: PixelPitch = Field(description="Distance between neighbouring pixel centres.")
    quantum_efficiency: QuantumEfficiency | None = Field(
        default=None,
        description="Quantum efficiency, in electrons per photon (EMVA 1288: η); needed if "
        "scene.picture.light.photons is given.",
    )
    temporal_dark_noise: NonNegativeElectrons | None = Field(
        default=None, description="Dark noise of this sensor (EMVA 1288: σ_d), instead of scene.picture.read_noise."
    )
    saturation_capacity: PositiveElectrons | None = Field(
        default=None, description="Full well of this sensor (EMVA 1288: μ_e.sat), instead of scene.picture.full_well."
    )
    system_gain: SystemGain | None = Field(
        default=None,
        description="System gain (EMVA 1288: K); default: the gain that maps the full well to the largest raw value.",
    )
    relative_exposure: PositiveNumber = Field(
        default=1.0,
        description="Exposure time of this camera, relative to that of scene.picture.light: the camera collects this "
        "many times the light.",
    )

    def sensor(self) -> Sensor:
        """The sensor in SI."""
        return Sensor(
            columns=self.pixels[0],
            rows=self.pixels[1],
            pixel_pitch=self.pixel_pitch,
            quantum_efficiency=self.quantum_efficiency,
            temporal_dark_noise=self.temporal_dark_noise,
            saturation_capacity=self.saturation_capacity,
            system_gain=self.system_gain,
            relative_exposure=self.relative_exposure,
        )


class CalibratedCameraPart(Part):
    """A calibrated camera. In its picture, (0, 0) is the centre of the top left pixel; y points down."""

    focal_length: tuple[PositivePixels, PositivePixels] = Field(description="Horizontal and vertical focal length.")
    principal_point: tuple[Pixels, Pixels] = Field(
        description="Point (x, y) of the picture that the optical axis meets."
    )
    distortion: AnyLensModel | None = Field(
        default=None, description="Lens model of this camera; default: no distortion."
    )

    def lens_model(self) -> LensModel:
        """The lens model in SI."""
        return IDEAL if self.distortion is None else self.distortion.lens_model()

    def values(self, free: tuple[str, ...]) -> tuple[float, ...]:
        """Focal lengths and principal point [px], then the free coefficients of the lens model."""
        coefficients = self.lens_model().coefficients()
        return (*self.focal_length, *self.principal_point, *(coefficients[name] for name in free))

    @property
    def calibrated(self) -> CalibratedCamera:
        """The camera in pixels."""
        return CalibratedCamera(
            focal_lengths=self.focal_length, principal_point=self.principal_point, lens=self.lens_model()
        )


class DisparityPart(Part):
    """The precision with which disparity is measured."""

    disparity_error: PositivePixels | Literal["derived"] = Field(
        description="Standard deviation of one measured disparity. With `derived`, the program computes it: the "
        "Cramér–Rao bound on the error of matching the texture of scene.picture, increased by the errors of `matcher`."
    )
    error_of: Literal["disparity", "coordinate"] = Field(
        default="disparity",
        description="Whether disparity_error is the error of the disparity, or of each of the two image coordinates "
        "whose difference is the disparity (`coordinate`). With `coordinate`, the error of the disparity is √2 times "
        "as large.",
    )
    discrimination_step: PositivePixels = Field(
        default="0.1 px",
        validate_default=True,
        description="Change of disparity that counts as discernible. The depth discrimination is the change of "
        "true depth that causes it.",
    )
    matcher: MatcherPart | None = Field(
        default=None,
        description="By how much the errors of a real matcher exceed the Cramér–Rao bound; only with a derived "
        "disparity_error. Default: the values of scene.picture.matcher.",
    )

    @model_validator(mode="after")
    def _derived_is_of_the_disparity(self) -> Self:
        if self.disparity_error == "derived" and self.error_of == "coordinate":
            raise MistakeAt(("error_of",), "a derived error is that of the disparity; leave error_of out")
        return self

    @model_validator(mode="after")
    def _matcher_adds_to_a_bound(self) -> Self:
        if self.matcher is not None and self.disparity_error != "derived":
            raise MistakeAt(
                ("matcher",),
                "adds to a derived disparity error, but that of this camera is declared; write disparity_error: "
                "derived, or remove matcher (null removes an inherited one)",
            )
        return self

    @property
    def declared_error_px(self) -> float | None:
        """Standard deviation of the disparity [px], for either error_of; None where it is derived."""
        if self.disparity_error == "derived":
            return None
        return self.disparity_error * (math.sqrt(2.0) if self.error_of == "coordinate" else 1.0)

    def error(self, picture_law: DisparityErrorLaw | None) -> DisparityError:
        """The declared disparity error [px], or the law that derives it from the picture.

        Raises
        ------
        OutOfRangeError
            For a derived error without a picture to derive it from.
        """
        declared = self.declared_error_px
        if declared is not None:
            return declared
        if picture_law is None:
            raise OutOfRangeError(
                "a derived disparity error needs the scene's picture",
                remedy="add picture to scene: texture, light, sensor",
            )
        return picture_law


class AttributesPart(Part):
    """Attributes, besides depth, by which the report compares cameras; omitted ones are derived where possible."""

    moving_parts: Count | None = Field(
        default=None, description="Number of moving parts; default: one for each lens with a focus mechanism."
    )
    bits_per_pixel: PositiveCount | None = Field(
        default=None,
        description="Number of bits per pixel of a raw picture, as stored or sent; needed to derive how much raw "
        "data one depth map requires.",
    )
    envelope: tuple[PositiveLength, PositiveLength, PositiveLength] | None = Field(
        default=None, description="Length, width and height of the whole instrument."
    )
    others: dict[AttributeName, Annotated[QuantityText, Field(min_length=1, max_length=200)]] = Field(
        default={},
        description="Further attributes to compare, by name, each as words or as a number with its unit "
        "(`mass: 380 g`). Requirements and trade-offs can use the numbers.",
    )


class CameraDeclaration(Part, ABC):
    """A camera of a study; every kind has a class of its own, which ``kind`` identifies."""

    camera: ClassVar[type[Camera]]
    """The class of the cameras that it declares."""
    reader: ClassVar[DepthReaderOfKind | None] = None
    """Sets up the reader that measures depth in pictures of such a camera; None if there is none."""
    imports: ClassVar[tuple[type, ...]] = ()
    """Types of calibration-file contents that can become such a camera."""

    title: str = Field(
        default="", max_length=80, description="Name in figures and tables; default: the name under `cameras`."
    )
    note: str | None = Field(default=None, max_length=2000, description="Remark on the camera, for the report.")
    stated: StatedPart | None = None
    attributes: AttributesPart = AttributesPart()
    read_as: dict[AttributeName, Text] = Field(
        default={},
        description="How the program read the file of this camera, or its entry of the catalogue. The program writes "
        "this key.",
    )
    kind: str

    @model_validator(mode="after")
    def _size_of_the_calibrated_pictures(self) -> Self:
        """Refuse pictures of another size, in which focal lengths, principal points and distortion would differ."""
        said, sensor = self.read_as.get(PICTURE_SIZE), getattr(self, "sensor", None)
        if said is None or not isinstance(sensor, SensorPart):
            return self
        columns, rows = sensor.pixels
        if not said.endswith(f" {columns} × {rows} px") and said != f"{columns} × {rows} px":
            raise MistakeAt(
                ("sensor", "pixels"),
                f"{columns} × {rows} px is not the size of the calibrated pictures, {said}, for which alone the "
                "focal lengths and principal points of the calibration file hold; remove this key. For scaled "
                "pictures, multiply fx, fy, cx and cy in the file by the scale; for cropped ones, subtract the corner "
                "of the crop from cx and cy; then write the new size in the file",
            )
        return self

    @classmethod
    def stated_by(cls, imported: Imported) -> Iterator[Stated]:
        """The values of such a camera that a calibration file states; its content has one of the types in `imports`."""
        raise NotImplementedError(imported)

    @abstractmethod
    def design(self, picture_law: DisparityErrorLaw | None) -> Camera:
        """The camera in SI.

        Parameters
        ----------
        picture_law
            The law of a derived disparity error; None in a study without a picture.

        Raises
        ------
        OutOfRangeError
            If the parts cannot form a camera.
        """


class DepthCameraDeclaration(CameraDeclaration):
    """A camera that measures depth by triangulation."""

    camera: ClassVar[type[DepthCamera]]

    sensor: SensorPart
    depth: DisparityPart
    calibration: CalibrationPart
    """The calibration part of its kind; see `calibration_part`."""

    @abstractmethod
    def design(self, picture_law: DisparityErrorLaw | None) -> DepthCamera:
        """The camera in SI, without its calibration; see `CameraDeclaration.design`."""


class PlenopticDeclaration(DepthCameraDeclaration):
    """A camera with microlenses."""

    absent: ClassVar[Mapping[str, str]] = {"field_curvature": "none"}

    main_lens: LensPart
    field_curvature: Length = Field(
        default=0.0,
        description="Field curvature, for a flat object: the image distance in the corner of the sensor, minus that on "
        "the axis. Measured depths are corrected for it.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.main_lens.exit_pupil == math.inf and self.main_lens.entrance_pupil is None:
            errors, stability = self.calibration.errors, self.calibration.stability
            for where, part in ((("errors",), errors), (("stability", "ageing"), stability.ageing)):
                if "pupil_distance" in part.given():
                    yield MistakeAt(
                        ("calibration", *where, "pupil_distance"),
                        "the exit pupil lies at infinity; remove this error, or give a finite exit_pupil",
                    )
