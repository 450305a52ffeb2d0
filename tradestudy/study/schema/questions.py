"""Questions of a study: usable range, depth of field, decisions, readings, inverse questions, assumptions, sweeps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    CameraName,
    ErrorSources,
    NonNegativeAngle,
    Number,
    ObjectDistance,
    Pair,
    PositiveCount,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositivePixels,
    QuantityText,
    Scalar,
    Share,
    Text,
    distinct,
)

CriterionName = Annotated[str, Field(pattern=r"^[\w][\w.+-]*$", max_length=60)]
PROBLEM: Final = "depth-of-field"
"""Name of the problem for which models are chosen."""
Diffraction = Literal["none", "airy-diameter", "fwhm"]


class BlurPart(Part):
    """What counts as sharp: an upper bound on geometric blur and diffraction spot together, added in quadrature."""

    blur: PositivePixels = Field(
        description="Largest diameter that counts as sharp: blur and diffraction spot added in quadrature, in pixels "
        "or, for an unfocused plenoptic camera, in microlenses."
    )
    diffraction: Diffraction = Field(
        default="none",
        description="How the diffraction spot counts: not at all (`none`), with the diameter of its first dark ring "
        "(`airy-diameter`), or with its full width at half maximum (`fwhm`).",
    )

    def criterion(self, wavelength: float) -> BlurCriterion:
        """The criterion for light of a wavelength [m]."""
        return BlurCriterion(blur_px=self.blur, measure=self.diffraction, wavelength=wavelength)


class DepthOfFieldPart(Part):
    """The depth of field of every camera, and the range of distances that must be sharp."""

    range: tuple[PositiveLength, PositiveLength] = Field(
        description="Nearest and farthest distance of the range that must be sharp."
    )
    criteria: Annotated[dict[CriterionName, BlurPart], Field(min_length=1, max_length=20)] = Field(
        description="Blur criteria by name; the report's answer rests on the first."
    )
    equal_resolution: PositiveLength | None = Field(
        default=None,
        description="Size of a detail on the object; the report also compares the distances at which each camera "
        "resolves it.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if not self.range[0] < self.range[1]:
            yield MistakeAt(("range", 1), "must lie beyond the first")


class ReliefPart(Part):
    """A depth step and a tilted surface in the middle of depth_of_field.range.

    From them, the program derives further criteria for comparing the cameras, such as the width of the strip that the
    step hides.
    """

    step_height: PositiveLength = Field(
        description="Height of the depth step, which hides a strip beside it from one of the two outermost viewpoints "
        "of a camera (the two lenses of a stereo rig, or opposite edges of a plenoptic camera's pupil)."
    )
    surface_tilt: NonNegativeAngle = Field(
        description="Angle between the surface and the plane perpendicular to the optical axis. The surface is tilted "
        "so that its distance changes along the baseline; the two outermost viewpoints therefore see it foreshortened "
        "by different amounts."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if not self.surface_tilt < math.pi / 2.0:
            yield MistakeAt(("surface_tilt",), "a surface tilted by 90° shows only its edge")


class RefocusingPart(Part):
    """Refocusing of unfocused plenoptic cameras by shifting their views against each other.

    `refocusing: {}` asks for all distinct planes of all such cameras.
    """

    cameras: Annotated[tuple[CameraName, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Unfocused plenoptic cameras to refocus; default: all."
    )
    shifts: Annotated[tuple[Number, ...], Field(max_length=1000), AfterValidator(distinct)] = Field(
        default=(),
        description="Shifts between the views of neighbouring pixels, in microlenses, also fractions; positive ones "
        "refocus nearer than the focus. Default: all distinct planes, at which the outermost views are a whole number "
        "of microlenses apart.",
    )
    pairs: Annotated[tuple[PositiveCount, ...], Field(max_length=20), AfterValidator(distinct)] = Field(
        default=(),
        description="Pairs of views to triangulate with, each by the number of pixels between them. Default: "
        "neighbouring views, and the outermost ones.",
    )
    blur: PositivePixels = Field(
        default=1.0,
        description="Largest blur that counts as sharp; 1 px is one microlens. That of a view limits the range that "
        "can be refocused, that of a refocused picture its depth of field.",
    )

    def asked(self, refocuses: Mapping[str, bool]) -> tuple[str, ...]:
        """Names of the cameras to refocus, from all names and whether each camera can be refocused."""
        return self.cameras or tuple(camera for camera, refocusable in refocuses.items() if refocusable)


class UsableRangePart(Part):
    """Limits of the usable range. A limit that is left out does not apply, unless it has a default."""

    overlap: Share | None = Field(
        default=None, description="Smallest overlap of the two pictures of a stereo rig; default: any above 0 %."
    )
    availability: Share | None = Field(
        default=None,
        description="Smallest availability of a focused plenoptic camera. Availability is the fraction of object "
        "points that are seen by at least two of the microlenses that its estimator uses. Default: any above 0 %.",
    )
    virtual_depth: PositiveNumber | None = Field(
        default=None,
        description="Smallest magnitude of the virtual depth of a focused plenoptic camera; at the total covering "
        "plane, this magnitude is 2.",
    )
    blur: PositivePixels | None = Field(
        default=None,
        description="Largest diameter of the geometric blur, in pixels; for an unfocused plenoptic camera, 1 px here "
        "means one microlens. Diffraction does not count, as it does in `depth_of_field`. With several types of "
        "microlenses, this limit applies to the least sharp type that the estimator needs. A derived disparity error "
        "already contains defocus and needs no such limit.",
    )
    disparity_step: PositivePixels | None = Field(
        default=None,
        description="Smallest difference between the disparity at a usable distance and that at infinity.",
    )
    failed_fraction: Share | None = Field(
        default=None,
        description="Largest fraction of measurements that may fail. A measurement fails if its errors push the depth "
        "beyond infinity, or if its match is false.",
    )
    relative_uncertainty: PositiveFraction | None = Field(
        default=None, description="Largest depth uncertainty, relative to the distance."
    )

    def criteria(self) -> UsableCriteria:
        """The limits in SI."""
        return UsableCriteria(
            overlap=self.overlap,
            availability=self.availability,
            virtual_depth=self.virtual_depth,
            blur_px=self.blur,
            disparity_step_px=self.disparity_step,
            failed_fraction=self.failed_fraction,
            relative_uncertainty=self.relative_uncertainty,
        )


class DecisionPart(Part):
    """Two cameras to compare with each other, and the distances at which they are compared.

    At these distances, the report also names the best of all candidates.
    """

    between: Pair = Field(
        description="Two cameras for which the report gives the ratio of the first one's depth uncertainty to the "
        "second one's, and the crossovers."
    )
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] = Field(
        description="Distances at which the best candidate is named, and the two cameras are compared."
    )
    compare: Annotated[tuple[Pair, ...], Field(max_length=20), AfterValidator(distinct)] = Field(
        default=(),
        description="Pairs of cameras; for each camera of a pair, the program computes the probability that its "
        "depth error is the smaller one. Default: the pair in `between`.",
    )
    candidates: Annotated[tuple[CameraName, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None,
        description="Cameras among which the best is chosen; default: all that measure depth. Of several cameras that "
        "model the same device, list only one.",
    )


class ReadingPart(Part):
    """Another reading of the study's assumptions: values that replace the declared ones."""

    says: Text = Field(description="What this reading assumes, in words.")
    set: Annotated[dict[str, Scalar], Field(min_length=1)] = Field(
        description="The new values, each under the path of the value that it replaces; `null` removes the value at "
        "that path."
    )


RequirementNames = Annotated[tuple[CameraName, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)]


class SolvePart(Part):
    """The values of an input at which a condition holds.

    The condition is that two cameras have the same depth uncertainty, that one camera has a given depth uncertainty, or
    that a requirement begins or ceases to be met.
    """

    says: Text = Field(description="The question in words.")
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        description="Path of the value to vary, or paths of several values, which are kept equal."
    )
    low: QuantityText = Field(description="Smallest value to try, above 0, with its unit.")
    high: QuantityText = Field(description="Largest value to try, with its unit.")
    equal: Pair | None = Field(default=None, description="Two cameras that must have the same depth uncertainty.")
    camera: CameraName | None = Field(
        default=None,
        description="Instead of `equal`: the camera that must reach the depth uncertainty given by `relative` or "
        "`uncertainty`.",
    )
    relative: PositiveFraction | None = Field(
        default=None, description="Depth uncertainty that the camera must reach, relative to the distance."
    )
    uncertainty: PositiveLength | None = Field(
        default=None, description="Instead of `relative`: the depth uncertainty that the camera must reach."
    )
    requirement: CameraName | RequirementNames | None = Field(
        default=None,
        description="Instead of `equal` or `camera`: name of the requirement to meet, or names of several that must "
        "all be met.",
    )
    at: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the two cameras are compared, or at which the camera must reach the depth "
        "uncertainty; a requirement has its own distances.",
    )
    errors: ErrorSources = Field(
        default="both",
        description="Error sources that count: noise, calibration errors, or both. For a requirement, both count.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if sum(condition is not None for condition in (self.equal, self.camera, self.requirement)) != 1:
            yield MistakeAt(
                (), "give one of equal (two cameras), camera (with relative or uncertainty) and requirement (a name)"
            )
        if (self.at is None) == (self.requirement is None):
            yield MistakeAt((), "equal and camera need at; a requirement has its own distances")
        goals = (self.relative is not None) + (self.uncertainty is not None)
        if goals != (self.camera is not None):
            yield MistakeAt(
                (), "camera and one of relative (uncertainty over distance) and uncertainty belong together"
            )

    @property
    def place(self) -> float:
        """Distance of the question [m]; NaN for a requirement, which has its own distances."""
        return math.nan if self.at is None else self.at

    @property
    def goal(self) -> float:
        """Depth uncertainty that the camera must reach [m]."""
        return self.uncertainty if self.uncertainty is not None else (self.relative or 0.0) * self.place

    @property
    def requirements(self) -> tuple[str, ...]:
        """Names of the requirements to meet; empty for another condition."""
        return (self.requirement,) if isinstance(self.requirement, str) else self.requirement or ()

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the values to vary."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


SweepValues = Annotated[tuple[Scalar, ...], Field(min_length=1, max_length=1000)]


class SweepRangePart(Part):
    """A range of values of one input, in linear or logarithmic steps. The key is the path of the input."""

    start: QuantityText = Field(alias="from", description="First value, with its unit.")
    stop: QuantityText = Field(alias="to", description="Last value, with its unit.")
    points: Annotated[int, Field(ge=2, le=1000, strict=True)] = Field(
        description="Number of values, including both ends."
    )
    spacing: Literal["log", "linear"] = Field(
        default="linear", description="Spacing of the values: equal ratios (log) or equal differences (linear)."
    )


class MeasurementPart(Part):
    """A table of measured depth errors, beside their prediction.

    The first line of the file names its columns and their units: `distance [m]` and any of `sigma [mm]`, `rms [mm]`,
    `absolute_error [mm]`, `bias [mm]` (positive where depth is too large), `valid [%]` and `note`. Errors in % are
    relative to the distance.
    """

    camera: CameraName = Field(description="Camera of the study that was measured.")
    file: Text = Field(description="CSV file of the table, relative to the file that names it.")
    source: Text = Field(description="Who measured it, and how, in words.")
    zero: Literal["known", "fitted"] = Field(
        default="known",
        description="Whether distances count from where those of the camera do, or from a place that the fit finds.",
    )


class AssumptionPart(Part):
    """An uncertain assumption: a value with a log-uniform distribution, or a choice among equally likely readings."""

    says: Text | None = Field(
        default=None,
        description="Name of the assumption in reports; default: the first path in `vary` or, for `readings`, the name "
        "of this entry.",
    )
    vary: Text | Annotated[tuple[Text, ...], Field(min_length=2, max_length=20), AfterValidator(distinct)] = Field(
        default=(), description="Path of the value to vary, or paths of several values, which are kept equal."
    )
    low: QuantityText = Field(default="", description="Smallest possible value, above 0, with its unit.")
    high: QuantityText = Field(default="", description="Largest possible value, with its unit.")
    readings: Annotated[tuple[CameraName, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(
            default=None,
            description="Instead of `vary`, `low` and `high`, which belong together: names of readings, each as likely "
            "as the declared study.",
        )
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if len({self.readings is None, bool(self.vary), bool(self.low), bool(self.high)}) > 1:
            yield MistakeAt((), "give either vary, low and high, or readings")

    @property
    def paths(self) -> tuple[str, ...]:
        """Paths of the values to vary; empty for readings."""
        return (self.vary,) if isinstance(self.vary, str) else self.vary


class ValueOfInformationPart(Part):
    """For each assumption, by how much knowing its true value would raise the expected utility of the best choice.

    The utility of a camera is the negative of its relative depth uncertainty, averaged over distances.
    """

    assumptions: Annotated[dict[str, AssumptionPart], Field(min_length=1, max_length=40)] = Field(
        description="Uncertain assumptions, by names that you choose."
    )
    at: Annotated[tuple[ObjectDistance, ...], Field(min_length=1, max_length=20), AfterValidator(distinct)] | None = (
        Field(
            default=None,
            description="Distances over which the relative depth uncertainty is averaged. Default: "
            "decision.at or, without it, up to four of the distances in scene.distances, from the nearest to the "
            "farthest, spaced about evenly on a logarithmic scale.",
        )
    )
    unusable: PositiveFraction = Field(
        default=1.0,
        description="Relative depth uncertainty to assume for a camera where it is unusable. Where it is usable, an "
        "uncertainty larger than this value is replaced by it.",
    )
    draws: Annotated[int, Field(ge=64, le=2**14, strict=True)] = Field(
        default=256, description="Number of combinations of values to draw; powers of two cover the ranges most evenly."
    )

    def mistakes_of_owners(self, readings: Mapping[str, Sequence[str]]) -> list[MistakeAt]:
        """Values that two assumptions vary; ``readings`` gives the paths that each reading of the study sets."""
        owners: dict[str, str] = {}
        mistakes = []
        for name, assumption in self.assumptions.items():
            word = "vary" if assumption.readings is None else "readings"
            set_paths = (path for reading in assumption.readings or () for path in readings.get(reading, ()))
            every = [*assumption.paths, *set_paths]
            # Paths may omit this first key.
            for path in dict.fromkeys(path.removeprefix("cameras.") for path in every):
                if path in owners:
                    place = ("assumptions", name, word)
                    what = f"'{owners[path]}' already varies {path}"
                    mistakes.append(MistakeAt(("value_of_information", *place), what))
                owners.setdefault(path, name)
        return mistakes
