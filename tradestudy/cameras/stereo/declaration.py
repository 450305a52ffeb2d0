"""The declaration of a stereo rig in a study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, Self

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from tradestudy.cameras.calibrated_pair import RADIAL, CalibratedPair
from tradestudy.cameras.calibration_declaration import CalibrationPart, PairStabilityPart, calibration_part
from tradestudy.cameras.declaration import (
    CalibratedCameraPart,
    DepthCameraDeclaration,
    DisparityPart,
    PixelCount,
    ProjectingLensPart,
    SensorPart,
)
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.imported import (
    FITTED_LENS,
    NOMINAL_PITCH,
    RIGHT_SIZE,
    Imported,
    ImportedCorners,
    ImportedRig,
    Stated,
    camera_stated,
    conventions_stated,
    size_words,
)
from tradestudy.cameras.single_lens import edge_angle
from tradestudy.cameras.stereo.depth_reading import PairReader
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.declarations.distributions import LengthOrPixelsDistribution
from tradestudy.declarations.lens_models import AnyLensModel, fitted_words
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    Angle,
    Baseline,
    InPixels,
    Length,
    ObjectDistanceOrInfinity,
    PixelPitch,
    PositivePixels,
)
from tradestudy.optics.lens_model import IDEAL

if TYPE_CHECKING:
    StereoCalibration = CalibrationPart
else:
    StereoCalibration = calibration_part(StereoRig, "stereo", PairStabilityPart)


class GeometryPart(Part):
    """Calibrated geometry of two cameras.

    A point at X in the frame of the left camera is at RX + t in that of the right camera. In both frames, x points
    right, y down and z along the optical axis.
    """

    left: CalibratedCameraPart = Field(description="The left camera.")
    right: CalibratedCameraPart = Field(description="The right camera.")
    rotation: tuple[Angle, Angle, Angle] = Field(
        default=(0.0, 0.0, 0.0),
        description="Rotation R as a rotation vector: axis times angle.",
    )
    translation: tuple[Length, Length, Length] = Field(
        description="Translation t: position of the left camera in the frame of the right one; its first component "
        "is about −baseline."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        x, y, z = self.translation
        if not np.hypot(y, z) < -x:
            where = "to the left of" if x > 0.0 else "not beside"
            yield MistakeAt(
                ("translation",),
                f"places the right camera {where} the left one; exchange the cameras, or check the direction of the "
                "transform",
            )

    @property
    def focal_length_px(self) -> float:
        """The `common_focal_length` of both cameras [px]."""
        return self.pair.focal_length

    @property
    def baseline(self) -> float:
        """Distance |t| between the centres of projection [m]."""
        return float(np.linalg.norm(self.translation))

    @property
    def convergence_angle(self) -> float:
        """Angle between the optical axes in the plane of the baseline [rad]; positive if they meet in front."""
        from scipy.spatial.transform import Rotation

        right_axis = Rotation.from_rotvec(self.rotation).as_matrix()[2]  # in the left camera's frame
        return float(np.arctan2(-right_axis[0], right_axis[2]))

    @property
    def pair(self) -> CalibratedPair:
        """The pair in SI; k1 and k2 are free coefficients if both lens models have them."""
        lenses = (self.left.lens_model(), self.right.lens_model())
        free = RADIAL if all({*RADIAL} <= {*lens.coefficient_names()} for lens in lenses) else ()
        parameters = (*self.left.values(free), *self.right.values(free), *self.rotation, *self.translation)
        return CalibratedPair(parameters=parameters, lenses=lenses, free=free)


class RightSensorPart(Part):
    """The pixels of the right camera of an unequal pair."""

    absent: ClassVar[Mapping[str, str]] = {"pixel_pitch": "that of the left camera"}

    pixels: tuple[PixelCount, PixelCount] = Field(
        description="Number of columns and number of rows of the right picture.", examples=[[640, 400]]
    )
    pixel_pitch: PixelPitch | None = Field(
        default=None, description="Distance between neighbouring pixel centres; default: that of the left camera."
    )


_ASSUMED_PITCH: Final = "3 um"
_OF_LENGTH: Final = frozenset(("mean", "half_width", "standard_deviation", "scale", "file"))
"""Keys of a distribution whose values have its unit."""


def stated_by(imported: ImportedRig | ImportedCorners) -> Iterator[Stated]:
    """Every value of a stereo rig from a calibration file, and the conventions by which the file was read."""
    yield Stated(
        path=("kind",),
        value="stereo",
        key=imported.key if isinstance(imported, ImportedCorners) else imported.keys["translation"],
        basis="derived",
    )
    if isinstance(imported, ImportedCorners):
        yield from _of_corners(imported)
        return
    yield from _of_rig(imported)


def _of_rig(rig: ImportedRig) -> Iterator[Stated]:
    from scipy.spatial.transform import Rotation

    for side, camera in (("left", rig.left), ("right", rig.right)):
        yield from camera_stated(("geometry", side), camera)
    turn = Rotation.from_matrix(np.array(rig.rotation)).as_rotvec()
    rotation = [f"{float(angle)!r} rad" for angle in turn]
    yield Stated(path=("geometry", "rotation"), value=rotation, key=rig.keys["rotation"])
    moved = [f"{length!r} m" for length in rig.translation]
    yield Stated(path=("geometry", "translation"), value=moved, key=rig.keys["translation"])
    if (pixels := rig.left.pixels or rig.right.pixels) is not None:
        key = (rig.left if rig.left.pixels else rig.right).keys["pixels"]
        yield Stated(path=("sensor", "pixels"), value=list(pixels), key=key)
        if (right_pixels := rig.right.pixels) not in (None, pixels):
            assert right_pixels is not None
            yield Stated(path=("right_sensor", "pixels"), value=list(right_pixels), key=rig.right.keys["pixels"])
    yield _pitch(rig.keys["translation"])
    yield from conventions_stated(rig.conventions)
    said = [{(entry.name, entry.says) for entry in camera.conventions} for camera in (rig.left, rig.right)]
    shared = said[0] & said[1]
    of_both = tuple(entry for entry in rig.left.conventions if (entry.name, entry.says) in shared)
    yield from conventions_stated(of_both)
    for side, camera in (("left", rig.left), ("right", rig.right)):
        of_side = tuple(entry for entry in camera.conventions if (entry.name, entry.says) not in shared)
        yield from conventions_stated(of_side, f"{side} ")


def _pitch(key: str) -> Stated:
    return Stated(path=("sensor", "pixel_pitch"), value=_ASSUMED_PITCH, key=key, basis="assumed", note=NOMINAL_PITCH)


def _of_corners(corners: ImportedCorners) -> Iterator[Stated]:
    """The design from a fit to the corners; the posterior from the same corners gives the geometry."""
    fitted = "from a fit to the corners"
    focal_length = Stated(
        path=("lenses", "focal_length"),
        value=f"{corners.focal_length!r} px",
        key=corners.key,
        basis="derived",
        note=fitted,
    )
    yield focal_length
    yield Stated(path=("baseline",), value=f"{corners.baseline!r} m", key=corners.key, basis="derived", note=fitted)
    yield Stated(
        path=("depth", "disparity_error"),
        value=f"{corners.noise * 2.0**0.5!r} px",
        key=corners.key,
        basis="assumed",
        note="assumes that matching is as precise as the corner detector: √2 times the fitted noise of one coordinate",
    )
    yield _pitch(corners.key)
    yield Stated(path=("calibration", "corners", "file"), value=corners.file, key=corners.key)
    yield from conventions_stated(corners.conventions)


_NEARLY_PARALLEL: Final = 0.05
"""Convergence, as a fraction of the field of view, up to which the design of a calibrated pair is parallel."""


class StereoDepthPart(DisparityPart):
    """How the rig measures depth."""

    absent: ClassVar[Mapping[str, str]] = {"disparity_range": "unlimited"}

    estimator: Literal["disparity", "midpoint"] = Field(
        default="disparity",
        validate_default=True,
        description="How depth is computed: from the disparity along the baseline (`disparity`), or from the "
        "midpoint of the shortest segment between the two rays (`midpoint`).",
    )
    disparity_range: PositivePixels | None = Field(
        default=None,
        description="Largest disparity that the matcher searches. Objects so near that their disparity exceeds it are "
        "not measured. Default: unlimited.",
    )
    disparity_error: PositivePixels | Literal["derived"] = Field(
        default="0.1 px", validate_default=True, description=DisparityPart.model_fields["disparity_error"].description
    )


class StereoDeclaration(DepthCameraDeclaration):
    """A stereo rig; its two cameras are identical, unless ``geometry`` describes each of them."""

    camera: ClassVar[type[StereoRig]] = StereoRig
    reader: ClassVar[DepthReaderOfKind | None] = PairReader

    absent: ClassVar[Mapping[str, str]] = {"distortion": "none", "right_sensor": "as sensor"}

    kind: Literal["stereo"]
    imports: ClassVar[tuple[type, ...]] = (ImportedRig, ImportedCorners)

    lenses: ProjectingLensPart = Field(default_factory=ProjectingLensPart)
    sensor: SensorPart
    geometry: GeometryPart | None = Field(
        default=None,
        description="Calibrated geometry of the two cameras, instead of focal length and baseline.",
    )
    right_sensor: RightSensorPart | None = Field(
        default=None,
        description="The pixels of the right camera, if they differ from those of the left one, which `sensor` then "
        "describes; only with `geometry`. What else `sensor` says holds for both.",
    )
    baseline: Baseline | None = Field(
        default=None,
        validate_default=True,
        description="Distance between the centres of projection of the two cameras; needed unless `geometry` is given.",
    )
    convergence_distance: ObjectDistanceOrInfinity = Field(
        default="infinity",
        validate_default=True,
        description="Distance at which the optical axes of the two cameras meet; infinity for parallel axes.",
    )
    focus_distance: ObjectDistanceOrInfinity | Literal["autofocus"] = Field(
        default="autofocus",
        validate_default=True,
        description="Distance at which the lenses are focused; with `autofocus`, a mechanism focuses them on every "
        "object.",
    )
    principal_distance: Literal["focal_length", "focused"] = Field(
        default="focal_length",
        description="Distance from lens to sensor that the rig uses to convert disparity to depth: the focal length "
        "(`focal_length`), as in a calibration in pixels, or the image distance of an object at focus_distance "
        "(`focused`).",
    )
    depth: StereoDepthPart = Field(default_factory=StereoDepthPart)
    distortion: AnyLensModel | None = Field(
        default=None,
        description="Lens model of both cameras, known exactly except for the errors under `calibration`; default: "
        "no distortion.",
    )
    calibration: StereoCalibration = Field(default_factory=StereoCalibration)

    @field_validator("baseline")
    @classmethod
    def _baseline_is_given(cls, baseline: float | None, info: ValidationInfo) -> float | None:
        if baseline is None and "geometry" in info.data and info.data["geometry"] is None:
            raise MistakeAt((), "this key is missing; a length is expected, such as 75 mm")
        return baseline

    @model_validator(mode="after")
    def _one_geometry(self) -> Self:
        if mistakes := [*self._mistakes_of_geometry()]:
            raise MistakeAt.several(mistakes)
        return self

    def _mistakes_of_geometry(self) -> Iterator[MistakeAt]:
        has_lens = self.lenses.focal_length is not None or self.lenses.field_of_view is not None
        if self.right_sensor is not None and self.geometry is None:
            yield MistakeAt(
                ("right_sensor",), "needs the focal lengths of both cameras; give them in geometry, or remove this"
            )
        if self.geometry is None:
            if not has_lens:
                yield MistakeAt(("lenses",), "give exactly one of focal_length and field_of_view")
            return
        what = "the geometry of the calibrated pair determines it; remove it, or remove the geometry (geometry: null)"
        if has_lens:
            key = "focal_length" if self.lenses.focal_length is not None else "field_of_view"
            yield MistakeAt(("lenses", key), what)
        if self.baseline is not None:
            yield MistakeAt(("baseline",), what)
        if "convergence_distance" in self.model_fields_set:
            yield MistakeAt(("convergence_distance",), what)
        if self.principal_distance == "focused":
            yield MistakeAt(("principal_distance",), "a calibration in pixels determines it; remove it")

    @model_validator(mode="after")
    def _one_focus(self) -> Self:
        if self.principal_distance == "focused" and self.focus_distance == "autofocus":
            raise MistakeAt(
                ("principal_distance",),
                "lenses that refocus on every object have no fixed distance to the sensor; give a focus_distance, or "
                "use focal_length here",
            )
        return self

    @model_validator(mode="after")
    def _lens_model_of_the_import(self) -> Self:
        fitted, corners = self.read_as.get(FITTED_LENS), self.calibration.corners
        if fitted and corners is not None and (declared := fitted_words(corners.lens_model)) != fitted:
            raise MistakeAt(
                ("calibration", "corners", "lens_model"),
                f"is {declared}, but the focal length, the baseline and the disparity error of this camera come from a "
                f"fit of {fitted}; import the corners with from: in the same camera of the study file that declares "
                "the lens model",
            )
        return self

    @model_validator(mode="after")
    def _one_lens_model(self) -> Self:
        if self.distortion is not None and self.geometry is not None:
            raise MistakeAt(
                ("distortion",), "the geometry of the calibrated pair includes the lens models; remove this"
            )
        if self.distortion is not None and self.lenses.field_of_view is not None:
            raise MistakeAt(("lenses", "field_of_view"), "for lenses with distortion, give a focal_length instead")
        pair = () if self.geometry is None else (self.geometry.left.distortion, self.geometry.right.distortion)
        lenses = (self.distortion, *pair)
        without = [lens.model for lens in lenses if lens and not {*RADIAL} <= {*lens.family.coefficient_names()}]
        fitted = None if self.calibration.corners is None else self.calibration.corners.lens_model
        without += [fitted.model] if fitted and not {*RADIAL} <= {*fitted.fitted} else []
        errors = {"errors": self.calibration.errors, "ageing": self.calibration.stability.ageing}
        radial = [(where, name) for where, part in errors.items() for name in part.given() if "_distortion_k" in name]
        if radial and without:
            where = ("calibration", *(("stability",) if radial[0][0] == "ageing" else ()), *radial[0])
            raise MistakeAt(where, f"the lens model {without[0]} has no k1 and k2 here; remove this error")
        return self

    @model_validator(mode="after")
    def _of_an_unequal_pair(self) -> Self:
        said, right = self.read_as.get(RIGHT_SIZE), self.right_sensor
        size = "" if right is None else size_words(right.pixels)
        # A vertical pair states its size as taken and then as rotated, which counts. With the space, 1640 × 400 does
        # not end like 640 × 400.
        if said and not f" {said}".endswith(f" {size or '?'}"):
            raise MistakeAt(
                ("right_sensor", "pixels"),
                f"{size or 'none'} is not the size of the calibrated right pictures, {said}; remove this key",
            )
        if self.geometry is None or not (right or self.geometry.pair.is_unequal):
            return self
        if self.depth.disparity_error == "derived":
            raise MistakeAt(
                ("depth", "disparity_error"),
                "can be derived only for two cameras alike, and these have other sizes or focal lengths; give it in px",
            )
        if right and right.pixel_pitch not in (None, self.sensor.pixel_pitch):
            self._require_pixels()
        for source in ("corners", "target"):
            if right and getattr(self.calibration, source) is not None:
                raise MistakeAt(
                    ("calibration", source),
                    "only for pictures of equal size; calibrate with another program, and declare errors",
                )
        return self

    def _require_pixels(self) -> None:
        """Refuse errors of the right camera, or of both, in units of length, which its other pixels would scale."""
        errors = {("errors",): self.calibration.errors, ("stability", "ageing"): self.calibration.stability.ageing}
        for where, part in errors.items():
            for name, error in part.given().items():
                values = [getattr(error, key) for key in error.model_fields_set & _OF_LENGTH]
                is_of_right = isinstance(error, LengthOrPixelsDistribution) and not name.startswith("left_")
                if is_of_right and not all(isinstance(value, InPixels) for value in values):
                    raise MistakeAt(
                        ("calibration", *where, name), "the two cameras have different pixels; give this error in px"
                    )

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """As for every part, except what the geometry of a calibrated pair determines."""
        determined = () if self.geometry is None else (("convergence_distance",), ("distortion",))
        yield from (assumption for assumption in super().assumed() if assumption[0] not in determined)

    @classmethod
    def stated_by(cls, imported: Imported) -> Iterator[Stated]:
        """See the function `stated_by`."""
        assert isinstance(imported, ImportedRig | ImportedCorners)
        return stated_by(imported)

    def design(self, picture_law: DisparityErrorLaw | None) -> StereoRig:
        """The rig in SI; axes that meet at the distance Z₀ converge by ``2 atan(B / 2Z₀)``.

        A calibrated pair measures depth with its own geometry. Its design has the `common_focal_length`, the lens
        model of its left camera and, if the axes converge by more than a twentieth of the field of view, their angle.
        """
        sensor, geometry, right_part = self.sensor.sensor(), self.geometry, self.right_sensor
        right = (
            None
            if right_part is None
            else replace(
                sensor,
                columns=right_part.pixels[0],
                rows=right_part.pixels[1],
                pixel_pitch=right_part.pixel_pitch or sensor.pixel_pitch,
            )
        )
        calibrated = None if geometry is None else geometry.pair
        if geometry is None or calibrated is None:
            assert self.baseline is not None  # the validator ensures it
            lens, baseline = self.lenses.lens(sensor), self.baseline
            angle = 2.0 * math.atan(baseline / (2.0 * self.convergence_distance))
            distortion = IDEAL if self.distortion is None else self.distortion.lens_model()
        else:
            focal_length = geometry.focal_length_px * sensor.pixel_pitch
            lens, baseline = self.lenses.of_focal_length(focal_length), geometry.baseline
            distortion, angle = calibrated.lenses[0], geometry.convergence_angle
            half = sensor.width / 2.0 / focal_length
            view = edge_angle(distortion, -half, 0.0) + edge_angle(distortion, half, 0.0)
            if abs(angle) <= _NEARLY_PARALLEL * view:
                angle = 0.0
        return StereoRig(
            lens=lens,
            sensor=sensor,
            right_sensor=None if right == sensor else right,
            focus_distance=None if self.focus_distance == "autofocus" else self.focus_distance,
            principal_distance_rule=self.principal_distance,
            baseline=baseline,
            convergence_angle=angle,
            calibrated_pair=calibrated,
            triangulation=self.depth.estimator,
            distortion=distortion,
            disparity_error_px=self.depth.error(picture_law),
            discrimination_step_px=self.depth.discrimination_step,
            disparity_range_px=self.depth.disparity_range,
        )
