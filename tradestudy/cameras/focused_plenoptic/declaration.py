"""The declaration of a focused plenoptic camera in a study."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from pydantic import Field, model_validator

from tradestudy.cameras.calibration_declaration import ArrayStabilityPart, CalibrationPart, calibration_part
from tradestudy.cameras.declaration import DisparityPart, PlenopticDeclaration
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.focused_plenoptic.depth_reading import RawPictureReader
from tradestudy.cameras.focused_plenoptic.design import COVERING_VIRTUAL_DEPTH, FocusedPlenoptic
from tradestudy.cameras.focused_plenoptic.estimator import LENSES_OF_PAIRS, PlenopticEstimator, UsedLenses
from tradestudy.cameras.focused_plenoptic.focus import DepthScaling
from tradestudy.cameras.imported import (
    Imported,
    ImportedFocused,
    ImportedPlenoptic,
    Stated,
    Value,
    asked_of_depth,
    conventions_stated,
)
from tradestudy.cameras.parts import Lens, MicrolensArray
from tradestudy.cameras.plenoptic import PLENOPTIC_ERRORS, require_pupil
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    FocalLength,
    InPixels,
    InverseLength,
    Length,
    LensToSensor,
    MicrolensPitch,
    MicrolensPitchOrPixels,
    ObjectDistanceOrInfinity,
    PositiveNumber,
    PositiveShare,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.plenoptic_depth_of_field import microlens_focal_length, touching_inverse_virtual_depths
from tradestudy.optics.thin_lens import image_distance


class MicrolensesPart(Part):
    """The microlens array."""

    absent: ClassVar[Mapping[str, str]] = {
        "focal_lengths": "such that the depths of field of the types adjoin",
        "aperture_diameter": "the pitch",
    }

    layout: Literal["hexagonal", "square"] = Field(description="Arrangement of the microlenses.")
    pitch: MicrolensPitchOrPixels = Field(
        description="Distance between neighbouring microlens centres. A number of pixels is the distance between the "
        "centres of neighbouring micro-images of a white scene, from which that of the microlenses follows by the "
        "distances from the exit pupil to the array and to the sensor."
    )
    gap: LensToSensor | Literal["f-number-matching"] = Field(
        description="Distance from the microlens array to the sensor. With `f-number-matching`, it is pitch × "
        "(distance from main lens to array) / (pupil diameter), with distance and diameter of the exit pupil, which "
        "makes the working f-numbers of main lens (distance/diameter) and microlenses (gap/pitch) equal."
    )
    types: Literal[1, 3] = Field(
        default=1,
        description="Number of microlens types, which differ in focal length; 3 only with the layout `hexagonal`.",
    )
    focal_lengths: tuple[FocalLength, ...] | Literal["pinhole"] | None = Field(
        default=None,
        description="Focal lengths of the types of microlenses, or `pinhole` for an array of pinholes, whose blur is "
        "the shadow of aperture_diameter. By default, they are chosen such that the depths "
        "of field of the types, for one pixel of blur, adjoin one another, starting at the total covering plane.",
    )
    aperture_diameter: MicrolensPitch | None = Field(
        default=None, description="Diameter of each microlens; default: the pitch."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.focal_lengths == "pinhole":
            if self.types != 1:
                yield MistakeAt(("types",), "pinholes have no focal lengths in which types could differ; write 1")
        elif self.focal_lengths is not None and len(self.focal_lengths) != self.types:
            yield MistakeAt(
                ("focal_lengths",),
                f"{len(self.focal_lengths)} focal lengths for {self.types} types: give one for each type",
            )
        if self.layout == "square" and self.types != 1:
            yield MistakeAt(("types",), "three types cannot tile a square array; use layout: hexagonal")
        pitch = math.inf if isinstance(self.pitch, InPixels) else self.pitch  # checked with the pixel pitch
        if self.aperture_diameter is not None and self.aperture_diameter > pitch:
            yield MistakeAt(
                ("aperture_diameter",),
                "larger than the pitch, so that microlenses overlap; at most the pitch is expected",
            )


class FocusPart(Part):
    """Position of the microlens array, given directly or by the total covering plane."""

    exactly_one = (("mla_distance", "total_covering_plane"),)

    mla_distance: LensToSensor | None = Field(
        default=None,
        description="Distance from the main lens (its second principal plane) to the microlens array.",
    )
    total_covering_plane: ObjectDistanceOrInfinity | None = Field(
        default=None,
        description="Instead of mla_distance: object distance at which the magnitude of the virtual depth is 2.",
    )
    relay: Literal["keplerian", "galilean"] | None = Field(
        default=None,
        description="Whether the main lens forms its image in front of (`keplerian`) or behind (`galilean`) the "
        "microlens array; needed with total_covering_plane.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if (self.total_covering_plane is None) != (self.relay is None):
            yield MistakeAt((), "total_covering_plane and relay belong together; give both or neither")


class DepthScalingPart(Part):
    """Correction of measured depth: metric depth = quadratic × Z² + linear × Z + offset, with Z by the camera's design.

    It multiplies depth uncertainty by its derivative, 2 × quadratic × Z + linear.
    """

    quadratic: InverseLength = Field(default=0.0, description="Coefficient of Z².")
    linear: PositiveNumber = Field(default=1.0, description="Coefficient of Z.")
    offset: Length = Field(default=0.0, description="Metric depth that is read where Z is zero.")


class PlenopticDepthPart(DisparityPart):
    """How the camera measures depth from its micro-images."""

    estimator: PlenopticEstimator = Field(
        description="Micro-images that are compared: those of two adjacent microlenses (`adjacent-pair`); of two "
        "microlenses of the same type, as close together as possible (`same-type-pair`); of the two microlenses "
        "farthest apart that see the point (`widest-pair`); or of all that see it, by least squares (`least-squares`)."
    )
    microlenses: UsedLenses | None = Field(
        default=None,
        description="Microlenses that the estimators `widest-pair` and `least-squares` use: `all`, or only those of "
        "the type that is sharpest at the distance of the point. Default: `sharpest-type`.",
    )
    least_lit_share: PositiveShare | None = Field(
        default=None,
        description="Smallest share of the light of a point's best-lit microlens with which another microlens counts "
        "as seeing the point. Default: a microlens counts if the light reaches its centre. The choice acts in the "
        "number of microlenses, in availability, and in the estimators `widest-pair` and `least-squares`, which take "
        "all microlenses that count as equally precise.",
    )
    scaling: DepthScalingPart = Field(
        default_factory=DepthScalingPart,
        description="Calibrated correction of measured depth; default: none. All distances of the study are metric. "
        "Pictures of scenes are rendered without it and depth maps contain it, so that it appears as a bias there.",
    )

    @model_validator(mode="after")
    def _choice(self) -> Self:
        if self.microlenses is not None and self.estimator in LENSES_OF_PAIRS:
            raise MistakeAt(("microlenses",), f"the estimator {self.estimator} has no choice of microlenses; remove it")
        if self.least_lit_share is not None and self.disparity_error == "derived":
            raise MistakeAt(
                ("least_lit_share",),
                "counts microlenses by the light of a point, and a derived disparity error by the windows that two "
                "micro-images share; declare disparity_error, or remove this",
            )
        return self


if TYPE_CHECKING:
    FocusedPlenopticCalibration = CalibrationPart
else:
    FocusedPlenopticCalibration = calibration_part(FocusedPlenoptic, "focused-plenoptic", ArrayStabilityPart)


class FocusedPlenopticDeclaration(PlenopticDeclaration):
    """A focused plenoptic camera (plenoptic 2.0) with one or three types of microlenses."""

    camera: ClassVar[type[FocusedPlenoptic]] = FocusedPlenoptic
    reader: ClassVar[DepthReaderOfKind | None] = RawPictureReader

    imports: ClassVar[tuple[type, ...]] = (ImportedPlenoptic, ImportedFocused)

    kind: Literal["focused-plenoptic"]
    microlenses: MicrolensesPart
    focus: FocusPart
    depth: PlenopticDepthPart
    calibration: FocusedPlenopticCalibration = Field(default_factory=FocusedPlenopticCalibration)

    @classmethod
    def stated_by(cls, imported: Imported) -> Iterator[Stated]:
        """All values that an imported calibration states; the study declares how disparity is measured."""
        if isinstance(imported, ImportedFocused):
            yield from imported.stated("focused-plenoptic")
            return
        assert isinstance(imported, ImportedPlenoptic)
        camera, keys = imported, imported.keys
        focal_lengths = [f"{f!r} m" for f in camera.focal_lengths]
        values: dict[tuple[str, ...], tuple[Value, str]] = {
            ("main_lens", "focal_length"): (f"{camera.focal_length!r} m", "focal_length"),
            ("main_lens", "f_number"): (camera.f_number, "f_number"),
            ("sensor", "pixels"): (list(camera.pixels), "pixels"),
            ("sensor", "pixel_pitch"): (f"{camera.pixel_pitch!r} m", "pixel_pitch"),
            ("microlenses", "layout"): (camera.layout, "layout"),
            ("microlenses", "pitch"): (f"{camera.pitch!r} m", "pitch"),
            ("microlenses", "gap"): (f"{camera.gap!r} m", "gap"),
            ("microlenses", "types"): (len(camera.focal_lengths) or 1, "focal_lengths"),
            ("microlenses", "focal_lengths"): (focal_lengths or "pinhole", "focal_lengths"),
            ("focus", "mla_distance"): (f"{camera.mla_distance!r} m", "mla_distance"),
        }
        if camera.scaling is not None:
            quadratic, linear, offset = camera.scaling
            values |= {
                ("depth", "scaling", "quadratic"): (f"{quadratic!r} 1/m", "scaling"),
                ("depth", "scaling", "linear"): (linear, "scaling"),
                ("depth", "scaling", "offset"): (f"{offset!r} m", "scaling"),
            }
        for name, number in camera.known.items():
            written = f"{number!r} {PLENOPTIC_ERRORS[name].unit}".removesuffix(" 1")
            values["calibration", "known", name] = (written, "distortion" if "distortion" in name else "known")
        yield Stated(path=("kind",), value="focused-plenoptic", key=keys["mla_distance"], basis="derived")
        for path, (value, origin) in values.items():
            yield Stated(path=path, value=value, key=keys[origin])
        yield from (*asked_of_depth(keys["mla_distance"]), *conventions_stated(imported.conventions))

    def design(self, picture_law: DisparityErrorLaw | None) -> FocusedPlenoptic:
        """The camera in SI; its array is placed so that the declared plane is the total covering plane.

        With b_M the image distance of that plane, ``z = b_M ± 2 b_L`` (Keplerian +, Galilean −); with f-number
        matching, where ``b_L = p (g z − e)/A`` (see `Lens`), this is ``z = (b_M ∓ 2pe/A) / (1 ∓ 2pg/A)``.
        """
        sensor = self.sensor.sensor()
        lens = self.main_lens.lens(sensor)
        array, scaling = self.microlenses, self.depth.scaling
        depth_scaling = DepthScaling(quadratic=scaling.quadratic, linear=scaling.linear, offset=scaling.offset)
        pitch = self._pitch(lens)
        gap_over_z = pitch / lens.pupil_diameter
        sign = -1.0 if self.focus.relay == "galilean" else 1.0
        if self.focus.mla_distance is not None:
            z = self.focus.mla_distance
            gap = gap_over_z * lens.principal_distance(z) if array.gap == "f-number-matching" else array.gap
            sign = math.copysign(1.0, z - lens.focal_length)
        else:
            plane = self.focus.total_covering_plane
            plane = None if plane is None else float(depth_scaling.modelled(plane))
            if plane is None or not plane > lens.focal_length:
                raise OutOfRangeError(
                    "the total covering plane",
                    value="none" if plane is None else f"{plane * 1e3:g} mm",
                    limit=f"beyond the main lens's focal length, {lens.focal_length * 1e3:g} mm",
                )
            b = float(image_distance(plane, lens.focal_length))
            if array.gap == "f-number-matching":
                twice = sign * COVERING_VIRTUAL_DEPTH * gap_over_z
                z = (b - twice * lens.entrance_pupil) / (1.0 - twice * lens.pupil_ratio)
                gap = gap_over_z * lens.principal_distance(z)
            else:
                gap = array.gap
                z = b + sign * COVERING_VIRTUAL_DEPTH * gap
        require_pupil(lens, z)
        if not (z > 0.0 and gap > 0.0):
            raise OutOfRangeError(
                "the microlens array would lie in front of the main lens",
                value=f"{z * 1e3:g} mm",
                remedy="reduce the gap",
            )
        if isinstance(array.pitch, InPixels):  # of micro-images, P = p (1 + g/L) at the distance L of the exit pupil
            pitch = array.pitch.pixels * sensor.pixel_pitch
            pitch /= 1.0 + gap * lens.pupil_ratio / lens.principal_distance(z)
        depth = self.depth
        return FocusedPlenoptic(
            main_lens=lens,
            sensor=sensor,
            microlenses=MicrolensArray(
                layout=array.layout,
                pitch=pitch,
                gap=gap,
                focal_lengths=(
                    (math.inf,)
                    if array.focal_lengths == "pinhole"
                    else array.focal_lengths or self._designed_focal_lengths(gap, sign, pitch)
                ),
                aperture_diameter=array.aperture_diameter or pitch,
            ),
            mla_distance=z,
            estimator=depth.estimator,
            lenses=LENSES_OF_PAIRS.get(depth.estimator, depth.microlenses or "sharpest-type"),
            disparity_error_px=depth.error(picture_law),
            discrimination_step_px=depth.discrimination_step,
            field_curvature=self.field_curvature,
            known=self.calibration.known_values,
            depth_scaling=depth_scaling,
            least_lit_share=depth.least_lit_share,
        )

    def _pitch(self, lens: Lens) -> float:
        """Pitch p of the microlenses [m]; from that of the micro-images, P, with f-number matching.

        There, the gap over the distance of the exit pupil is ``g p/A`` (see `Lens`), so that ``P = p + p² g/A``.
        """
        if not isinstance(self.microlenses.pitch, InPixels):
            return self.microlenses.pitch
        images = self.microlenses.pitch.pixels * self.sensor.pixel_pitch
        return 2.0 * images / (1.0 + math.sqrt(1.0 + 4.0 * images * lens.pupil_ratio / lens.pupil_diameter))

    def _designed_focal_lengths(self, gap: float, sign: float, pitch: float) -> tuple[float, ...]:
        """Focal lengths [m] whose depths of field for one pixel of blur adjoin, from the total covering plane on."""
        array = self.microlenses
        inverse_depths = touching_inverse_virtual_depths(
            nearest_virtual_depth=COVERING_VIRTUAL_DEPTH,
            pixels_per_lens=(array.aperture_diameter or pitch) / self.sensor.pixel_pitch,
            types=array.types,
        )
        return tuple(float(focal_length) for focal_length in microlens_focal_length(sign * inverse_depths, gap))
