"""The declaration of an unfocused plenoptic camera in a study."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field

from tradestudy.cameras.calibration_declaration import ArrayStabilityPart, CalibrationPart, calibration_part
from tradestudy.cameras.declaration import DisparityPart, PlenopticDeclaration
from tradestudy.cameras.depth_camera import DisparityErrorLaw
from tradestudy.cameras.depth_map import DepthReaderOfKind
from tradestudy.cameras.imported import Imported, ImportedUnfocused, Stated
from tradestudy.cameras.parts import MicrolensArray
from tradestudy.cameras.plenoptic import require_pupil
from tradestudy.cameras.unfocused_plenoptic.depth_reading import ViewsReader
from tradestudy.cameras.unfocused_plenoptic.design import UnfocusedPlenoptic
from tradestudy.cameras.unfocused_plenoptic.views import ViewEstimator
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    FNumber,
    FocalLength,
    MicrolensPitch,
    ObjectDistanceOrInfinity,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.thin_lens import image_distance


class UnfocusedMicrolensesPart(Part):
    """The microlens array of an unfocused plenoptic camera. The sensor lies in the focal plane of the microlenses."""

    absent: ClassVar[Mapping[str, str]] = {"aperture_diameter": "the pitch"}

    layout: Literal["hexagonal", "square"] = Field(description="Arrangement of the microlenses.")
    pitch: MicrolensPitch = Field(
        description="Distance between neighbouring microlens centres; each microlens corresponds to one pixel of every "
        "view."
    )
    focal_length: FocalLength | Literal["f-number-matching"] = Field(
        description="Focal length of a microlens, which is also its distance from the sensor. With "
        "`f-number-matching`, it is pitch × (distance from main lens to array) / (pupil diameter), with distance and "
        "diameter of the exit pupil, which makes the working f-numbers of main lens (distance/diameter) and "
        "microlenses (focal length/pitch) equal."
    )
    aperture_diameter: MicrolensPitch | None = Field(
        default=None, description="Diameter of each microlens; default: the pitch."
    )
    f_number: FNumber | None = Field(
        default=None,
        description="Instead of aperture_diameter: focal length divided by aperture diameter of a microlens.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.aperture_diameter is not None and self.f_number is not None:
            yield MistakeAt((), "give at most one of aperture_diameter and f_number")

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """As for every part, except an aperture that the f-number gives."""
        for path, value in super().assumed():
            if self.f_number is None or path != ("aperture_diameter",):
                yield path, value


class UnfocusedFocusPart(Part):
    """The distance at which an unfocused plenoptic camera is focused."""

    distance: ObjectDistanceOrInfinity = Field(
        description="Distance of the objects that the main lens images onto the microlenses: beyond the focal length "
        "of that lens, or `infinity`."
    )


class UnfocusedDepthPart(DisparityPart):
    """How depth is measured from views, each of which shows the scene through one part of the pupil.

    Each pixel of a view corresponds to one microlens, so 1 px of disparity is one pitch of the microlenses.
    """

    estimator: ViewEstimator = Field(
        description="Views that are compared: the two outermost of the longest row of views across the pupil "
        "(`outermost-views`), or all views by least squares (`least-squares`)."
    )


if TYPE_CHECKING:
    UnfocusedPlenopticCalibration = CalibrationPart
else:
    UnfocusedPlenopticCalibration = calibration_part(UnfocusedPlenoptic, "unfocused-plenoptic", ArrayStabilityPart)


class UnfocusedPlenopticDeclaration(PlenopticDeclaration):
    """An unfocused plenoptic camera (plenoptic 1.0)."""

    camera: ClassVar[type[UnfocusedPlenoptic]] = UnfocusedPlenoptic
    reader: ClassVar[DepthReaderOfKind | None] = ViewsReader
    imports: ClassVar[tuple[type, ...]] = (ImportedUnfocused,)

    kind: Literal["unfocused-plenoptic"]
    microlenses: UnfocusedMicrolensesPart
    focus: UnfocusedFocusPart
    depth: UnfocusedDepthPart
    calibration: UnfocusedPlenopticCalibration = Field(default_factory=UnfocusedPlenopticCalibration)

    @classmethod
    def stated_by(cls, imported: Imported) -> Iterator[Stated]:
        """What a file of such a camera states; the study declares how disparity is measured."""
        assert isinstance(imported, ImportedUnfocused)
        return imported.stated("unfocused-plenoptic")

    def design(self, picture_law: DisparityErrorLaw | None) -> UnfocusedPlenoptic:
        """The camera in SI; with f-number matching ``f_L = p c/A``, where c/A is the f-number on the image side."""
        sensor = self.sensor.sensor()
        lens = self.main_lens.lens(sensor)
        array = self.microlenses
        if not self.focus.distance > lens.focal_length:
            raise OutOfRangeError(
                "the main lens cannot focus that close",
                value=f"{self.focus.distance * 1e3:g} mm",
                limit=f"beyond the focal length, {lens.focal_length * 1e3:g} mm",
                remedy="increase the focus distance",
            )
        z = float(image_distance(self.focus.distance, lens.focal_length))
        require_pupil(lens, z)
        matched = array.pitch * lens.principal_distance(z) / lens.pupil_diameter
        focal_length = matched if array.focal_length == "f-number-matching" else float(array.focal_length)
        aperture = array.aperture_diameter or (focal_length / array.f_number if array.f_number else array.pitch)
        return UnfocusedPlenoptic(
            main_lens=lens,
            sensor=sensor,
            microlenses=MicrolensArray(
                layout=array.layout,
                pitch=array.pitch,
                gap=focal_length,
                focal_lengths=(focal_length,),
                aperture_diameter=aperture,
            ),
            focus_distance=self.focus.distance,
            estimator=self.depth.estimator,
            disparity_error_px=self.depth.error(picture_law),
            discrimination_step_px=self.depth.discrimination_step,
            field_curvature=self.field_curvature,
            known=self.calibration.known_values,
        )
