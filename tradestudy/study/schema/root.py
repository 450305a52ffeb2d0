"""The root of a study file: its cameras, scene, accuracy and questions, checked against each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, Literal, Self, get_args

from pydantic import Field, field_validator

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.cameras.kinds import CameraPart
from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import Text
from tradestudy.study.schema.accuracy import AccuracyPart, EffectsPart, PropagationPart, SensitivityPart
from tradestudy.study.schema.claims import ClaimPart, ShareBetterClaim, UncertaintyRatioClaim, wave_claim_mistakes
from tradestudy.study.schema.questions import (
    DecisionPart,
    DepthOfFieldPart,
    MeasurementPart,
    ReadingPart,
    RefocusingPart,
    ReliefPart,
    SolvePart,
    SweepRangePart,
    SweepValues,
    UsableRangePart,
    ValueOfInformationPart,
)
from tradestudy.study.schema.requirements import (
    RequirementPart,
    TradeOffPart,
    attribute_mistakes,
    requirement_mistakes,
    trade_off_mistakes,
)
from tradestudy.study.schema.scene import DepthLoopPart, ScenePart
from tradestudy.study.schema.wave_optics import FresnelValidityPart, LightSpotPart, PointSpreadPart, law_mistakes

FamilyName = Literal[
    "thin-lens", "triangulation", "phases", "fields", "equation-27", "depth-of-field", "propagation", "study-files"
]
EVERY_FAMILY: tuple[FamilyName, ...] = get_args(FamilyName)


class HardCasesPart(Part):
    """Computations that are numerically difficult, and study files that are difficult to read safely.

    Each computation is done by the textbook formula and by this program.
    """

    families: Annotated[tuple[FamilyName, ...], Field(min_length=1, max_length=len(EVERY_FAMILY))] = Field(
        default=EVERY_FAMILY,
        description="Groups of cases to compute: `thin-lens` (main lens and microlens array), `triangulation` (stereo "
        "rig), `phases` (long and short light paths), `fields` (light behind an aperture), `equation-27` (the paper's "
        "minimum f-number), `depth-of-field`, `propagation` (of uncertainty) and `study-files` (extreme values and "
        "harmful content).",
    )


FORMAT = 2
NAME_PATTERN = r"^[\w][\w.+-]*$"
LONGEST_NAME = 80
Location = tuple[str | int, ...]
# The places that name something of each kind; NAME is any key, [] any position of a list.
_REFERENCES: Final = {
    "camera": (
        "decision.between.[]", "decision.candidates.[]", "decision.compare.[].[]", "scene.image.cameras.[]",
        "depth_loop.cameras.[]", "refocusing.cameras.[]", "trade_off.candidates.[]", "solve.NAME.equal.[]",
        "solve.NAME.camera",
        "claims.NAME.camera", "claims.NAME.against", "requirements.NAME.camera",
        "measurements.NAME.camera",
    ),
    "reading": ("claims.NAME.under.[]", "claims.NAME.reading", "value_of_information.assumptions.NAME.readings.[]"),
    "requirement": ("solve.NAME.requirement", "solve.NAME.requirement.[]"),
}  # fmt: skip
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=LONGEST_NAME)]


class StudyFile(Part):
    """A trade study: cameras, a scene, and questions about them."""

    format: Literal[2] = Field(description="Version of the study-file format.")
    study: Name = Field(description="Name of the study and of its report folder.")
    title: Text = Field(description="Title of the report.")
    question: Text = Field(description="The question that the study answers, in words.")
    cameras: Annotated[dict[Name, CameraPart], Field(max_length=100)] = Field(
        default={},
        description="Cameras by name. A camera may start from a file (key `from`) or from another camera of the study "
        "(key `like`); further keys then replace its values.",
    )
    scene: ScenePart | None = None
    accuracy: AccuracyPart = AccuracyPart()
    effects: EffectsPart = EffectsPart()
    propagation: PropagationPart = PropagationPart()
    usable_range: UsableRangePart = UsableRangePart()
    depth_loop: DepthLoopPart | None = None
    depth_of_field: DepthOfFieldPart | None = None
    relief: ReliefPart | None = None
    refocusing: RefocusingPart | None = None
    decision: DecisionPart | None = None
    sensitivity: SensitivityPart | None = None
    fresnel_validity: FresnelValidityPart | None = None
    light_spot: LightSpotPart | None = None
    point_spread: PointSpreadPart | None = None
    hard_cases: HardCasesPart | None = None
    readings: dict[Name, ReadingPart] = Field(
        default={}, description="Alternative readings of the study's assumptions, by name."
    )
    solve: dict[Name, SolvePart] = Field(
        default={}, description="Inverse questions by name: which value of an input gives a required result?"
    )
    claims: dict[Name, ClaimPart] = Field(default={}, description="Published statements to check, by name.")
    measurements: dict[Name, MeasurementPart] = Field(
        default={}, description="Tables of measured depth errors to compare with the predicted ones, by name."
    )
    requirements: dict[Name, RequirementPart] = Field(default={}, description="Requirements on the cameras, by name.")
    value_of_information: ValueOfInformationPart | None = None
    trade_off: TradeOffPart | None = None
    sweep: dict[str, SweepValues | SweepRangePart] = Field(
        default={},
        description="Inputs to vary, each by its path, with a list or a range of values; every combination of values "
        "is a design.",
    )

    @field_validator("format", mode="before")
    @classmethod
    def _is_read(cls, value: object) -> object:
        if value == 1 and not isinstance(value, bool):
            raise MistakeAt((), "format 1 is not read; write format: 2")
        return value

    @field_validator("cameras", mode="before")
    @classmethod
    def _titled(cls, cameras: object) -> object:
        """Give each camera without a title its key as title, and add the keys to equal titles."""
        if not isinstance(cameras, Mapping):
            return cameras
        titles = {name: part.get("title", str(name)) for name, part in cameras.items() if isinstance(part, Mapping)}
        shared = Counter(map(str, titles.values()))
        for name, title in titles.items():
            if isinstance(title, str) and shared[title] > 1:
                titles[name] = f"{title} ({name})"
        return {name: {**part, "title": titles[name]} if name in titles else part for name, part in cameras.items()}

    @classmethod
    def mistakes_of_names(cls, tree: Mapping[str, Any]) -> list[MistakeAt]:
        """References to cameras, readings and requirements that do not exist."""
        mistakes: list[MistakeAt] = []
        for kind in _REFERENCES:
            declared = tree.get(f"{kind}s")
            names = list(map(str, declared)) if isinstance(declared, Mapping) else []
            mistakes += [
                MistakeAt(path, f"no {kind} is called {name!r}{nearest_name(name, names)}")
                for path, name in _named(kind, tree)
                if name not in names
            ]
        return mistakes

    def _mistakes(self) -> Iterator[MistakeAt]:
        if mistakes := self._mistakes_between_parts():
            yield MistakeAt.several(mistakes)

    def _mistakes_between_parts(self) -> list[MistakeAt]:
        attributes = {name: part.attributes for name, part in self.cameras.items()}
        measuring = {name for name, part in self.cameras.items() if isinstance(part, DepthCameraDeclaration)}
        has_relief, picture = self.relief is not None, None if self.scene is None else self.scene.picture
        is_off_axis = any(place > 0.0 for place in self.propagation.field_places)
        needs_no_camera = (self.fresnel_validity, self.light_spot, self.point_spread, self.hard_cases)
        mistakes = [
            MistakeAt(path, f"{name!r} is a {self.cameras[name].kind} camera and measures no depth")
            for path, name in self._asked_for_depth()
            if name in attributes and name not in measuring
        ]
        wrong: tuple[tuple[bool, str, str], ...] = (
            (
                not self.cameras and not any(needs_no_camera),
                "cameras",
                "this key is missing or empty, and the study asks no other question",
            ),
            (bool(self.cameras) and self.scene is None, "scene", "this key is missing; cameras need it"),
            (
                picture is not None
                and picture.stop_separation > 0.0
                and not (picture.field_angle > 0.0 or is_off_axis),
                "scene.picture.stop_separation",
                "has no effect on the axis; give a field_angle or propagation.field_places",
            ),
            (
                self.depth_loop is not None and picture is None,
                "depth_loop",
                "needs scene.picture, which gives its pictures their light and noise",
            ),
            (self.depth_of_field is not None and not self.cameras, "depth_of_field", "needs cameras"),
            (
                has_relief and self.depth_of_field is None,
                "relief",
                "needs depth_of_field, which gives the range of distances",
            ),
            (
                self.value_of_information is not None and not measuring,
                "value_of_information",
                "needs cameras that measure depth",
            ),
            (self.sensitivity is not None and not measuring, "sensitivity", "needs a camera that measures depth"),
        )
        mistakes += [MistakeAt(place.split("."), what) for is_wrong, place, what in wrong if is_wrong]
        if self.light_spot is not None and not self.cameras:  # with cameras, a forced effect may be theirs
            mistakes += law_mistakes(self.light_spot, self.effects)
        mistakes += wave_claim_mistakes(self.claims, self.fresnel_validity, self.light_spot)
        if self.value_of_information is not None:
            set_by_readings = {name: tuple(reading.set) for name, reading in self.readings.items()}
            mistakes += self.value_of_information.mistakes_of_owners(set_by_readings)
        mistakes += self._mistakes_of_refocusing()
        mistakes += attribute_mistakes(attributes)
        mistakes += requirement_mistakes(
            self.requirements,
            attributes,
            focus=self.depth_of_field,
            relief=has_relief,
            measures_depth=bool(measuring),
        )
        # Cameras that do not exist have no attributes; `mistakes_of_names` reports them.
        if self.trade_off is not None and set(self.ranked) <= set(attributes):
            mistakes += trade_off_mistakes(self.trade_off, self.ranked, attributes, measuring, relief=has_relief)
        return mistakes

    def _mistakes_of_refocusing(self) -> Iterator[MistakeAt]:
        """Cameras that views cannot refocus, where the study or a requirement asks for it."""
        refocuses = {name: part.camera.refocuses for name, part in self.cameras.items()}
        what = "only pictures of unfocused plenoptic cameras are sums of shifted views; leave this camera out"
        if self.refocusing is not None and not any(refocuses.values()):
            yield MistakeAt(("refocusing",), "needs an unfocused plenoptic camera")
        for i, name in enumerate((self.refocusing and self.refocusing.cameras) or ()):
            if refocuses.get(name) is False:
                yield MistakeAt(("refocusing", "cameras", i), f"{name!r} is a {self.cameras[name].kind} camera; {what}")
        for key, requirement in self.requirements.items():
            if requirement.asks_for_refocusing and self.refocusing is None:
                place = ("requirements", key, requirement.quantity)
                yield MistakeAt(place, "needs the section refocusing, at least {}")
            elif requirement.asks_for_refocusing and refocuses.get(requirement.camera) is False:
                kind = self.cameras[requirement.camera].kind
                yield MistakeAt(("requirements", key, "camera"), f"{requirement.camera!r} is a {kind} camera; {what}")

    @property
    def ranked(self) -> tuple[str, ...]:
        """Cameras that the trade-off ranks; empty without a trade-off."""
        if self.trade_off is None:
            return ()
        among = None if self.decision is None else self.decision.candidates
        return self.trade_off.candidates or among or tuple(self.cameras)

    @property
    def depth_distances(self) -> tuple[float, ...]:
        """All distances [m] at which the study asks about the depth that cameras measure, in ascending order."""
        parts = (self.decision, self.sensitivity, self.value_of_information)
        distances = {place for part in parts if part is not None for place in part.at or ()}
        weighed = () if self.trade_off is None else self.trade_off.criteria.values()
        distances |= {part.at for part in (*self.solve.values(), *weighed) if part.at is not None}
        requirements = (part for part in self.requirements.values() if part.needs_usable_range)
        claims = (part for part in self.claims.values() if isinstance(part, UncertaintyRatioClaim | ShareBetterClaim))
        return tuple(sorted(distances.union(*(part.over for part in (*requirements, *claims)))))

    def with_parts(self, parts: Mapping[str, Any]) -> Self:
        """The same study with other parts, each valid by itself.

        Raises
        ------
        MistakeAt
            If the new parts and the others are inconsistent.
        """
        changed = self.model_copy(update=dict(parts))
        if mistakes := changed._mistakes_between_parts():
            raise MistakeAt.several(mistakes)
        return changed

    def _asked_for_depth(self) -> Iterator[tuple[Location, str]]:
        """The cameras that must measure depth, with the places that name them."""
        for path, name in _named("camera", dict(self)):
            part, key = path[0], str(path[1])
            if part in ("scene", "trade_off", "refocusing"):  # any camera can take pictures; others check the rest
                continue
            if part == "claims" and self.claims[key].quantity in ("depth_of_field", "depth_of_field_ratio"):
                continue
            if part == "requirements" and not self.requirements[key].asks_for_depth:
                continue
            yield path, name


def _named(kind: str, tree: Mapping[str, Any]) -> Iterator[tuple[Location, str]]:
    """Every place of a study, valid or not, that names something of a kind, with that name as written."""
    for place in _REFERENCES[kind]:
        for path, name in _texts(tree, place.split("."), ()):
            if not (path[0] == "requirements" and name in ("any", "all")):
                yield path, name


def _texts(value: Any, steps: Sequence[str], above: Location) -> Iterator[tuple[Location, str]]:
    """The texts at a place below a value, each with its path."""
    if not steps:
        if isinstance(value, str):
            yield above, value
        return
    below: dict[Any, Any] = {}
    if steps[0] == "[]" and isinstance(value, list | tuple):
        below = dict(enumerate(value))
    elif steps[0] != "[]" and isinstance(value, Mapping | Part):
        below = dict(value)
    for key in below if steps[0] in ("[]", "NAME") else below.keys() & {steps[0]}:
        yield from _texts(below[key], steps[1:], (*above, key))
