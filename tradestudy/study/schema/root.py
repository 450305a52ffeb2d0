"""Which hard cases a study asks for; they need neither cameras nor a scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, field_validator, model_validator

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.cameras.kinds import CameraPart
from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import Text
from tradestudy.study.schema.accuracy import AccuracyPart, EffectsPart, PropagationPart, SensitivityPart
from tradestudy.study.schema.claims import ClaimPart, wave_claim_mistakes
from tradestudy.study.schema.questions import (
    DecisionPart,
    DepthOfFieldPart,
    ReadingPart,
    ReliefPart,
    SolvePart,
    SweepRangePart,
    SweepValues,
    UsableRangePart,
    ValueOfInformationPart,
)
from tradestudy.study.schema.requirements import RequirementPart, TradeOffPart, requirement_mistakes, trade_off_mistakes
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
        """Give each camera without a title its key as title."""
        if not isinstance(cameras, Mapping):
            return cameras
        return {name: {"title": str(name), **one} if isinstance(one, Mapping) else one for name, one in cameras.items()}

    @classmethod
    def mistakes_of_names(cls, tree: Mapping[str, Any]) -> list[MistakeAt]:
        """References to cameras, readings and requirements that do not exist."""
        found: list[MistakeAt] = []
        for kind, named in (
            ("camera", _named_cameras(tree)),
            ("reading", _named_readings(tree)),
            ("requirement", _named_requirements(tree)),
        ):
            known = [str(name) for name in _mapping(tree.get(f"{kind}s"))]
            found += [
                MistakeAt(path, f"no {kind} is called {name!r}{nearest_name(name, known)}")
                for path, name in named
                if isinstance(name, str) and name not in known
            ]
        return found

    @model_validator(mode="after")
    def _asks_what_can_be_answered(self) -> Self:
        if mistakes := self._mistakes_between_parts():
            raise MistakeAt.several(mistakes)
        return self

    def _mistakes_between_parts(self) -> list[MistakeAt]:
        mistakes = [
            MistakeAt(path, f"{name!r} is a {self.cameras[name].kind} camera and measures no depth")
            for path, name in self._asked_for_depth()
            if name in self.cameras and not isinstance(self.cameras[name], DepthCameraDeclaration)
        ]
        without_cameras = (self.fresnel_validity, self.light_spot, self.point_spread, self.hard_cases)
        if not self.cameras and all(part is None for part in without_cameras):
            mistakes.append(
                MistakeAt(("cameras",), "this key is missing or empty, and the study asks no other question")
            )
        if self.cameras and self.scene is None:
            mistakes.append(MistakeAt(("scene",), "this key is missing; cameras need it"))
        picture = None if self.scene is None else self.scene.picture
        off_axis = any(place > 0.0 for place in self.propagation.field_places)
        if picture is not None and picture.stop_separation > 0.0 and not (picture.field_angle > 0.0 or off_axis):
            place = ("scene", "picture", "stop_separation")
            mistakes.append(
                MistakeAt(place, "has no effect on the axis; give a field_angle or propagation.field_places")
            )
        if self.depth_loop is not None and picture is None:
            mistakes.append(
                MistakeAt(("depth_loop",), "needs scene.picture, which gives its pictures their light and noise")
            )
        if self.light_spot is not None and not self.cameras:  # with cameras, a forced effect may be theirs
            mistakes += law_mistakes(self.light_spot, self.effects)
        mistakes += wave_claim_mistakes(self.claims, self.fresnel_validity, self.light_spot)
        if self.depth_of_field is not None and not self.cameras:
            mistakes.append(MistakeAt(("depth_of_field",), "needs cameras"))
        if self.relief is not None and self.depth_of_field is None:
            mistakes.append(MistakeAt(("relief",), "needs depth_of_field, which gives the range of distances"))
        attributes = {name: part.attributes for name, part in self.cameras.items()}
        measuring = {name for name, part in self.cameras.items() if isinstance(part, DepthCameraDeclaration)}
        if self.value_of_information is not None:
            if not measuring:
                mistakes.append(MistakeAt(("value_of_information",), "needs cameras that measure depth"))
            mistakes += self.value_of_information.mistakes_of_owners(
                {name: tuple(one.set) for name, one in self.readings.items()}
            )
        if self.sensitivity is not None and not measuring:
            mistakes.append(MistakeAt(("sensitivity",), "needs a camera that measures depth"))
        mistakes += requirement_mistakes(
            self.requirements,
            attributes,
            focus=self.depth_of_field,
            relief=self.relief is not None,
            measures_depth=bool(measuring),
        )
        if self.trade_off is not None and set(self.ranked) <= set(attributes):
            mistakes += trade_off_mistakes(
                self.trade_off, self.ranked, attributes, measuring, relief=self.relief is not None
            )
        return mistakes

    @property
    def ranked(self) -> tuple[str, ...]:
        """Cameras that the trade-off ranks; empty without a trade-off."""
        if self.trade_off is None:
            return ()
        among = None if self.decision is None else self.decision.candidates
        return self.trade_off.candidates or among or tuple(self.cameras)

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

    def _asked_for_depth(self) -> list[tuple[Location, str]]:
        asked: list[tuple[Location, str]] = []
        for path, name in _named_cameras(dict(self)):
            claim = self.claims.get(str(path[1])) if path[0] == "claims" else None
            if claim is not None and claim.quantity in ("depth_of_field", "depth_of_field_ratio"):
                continue
            if path[0] == "scene":  # any camera can take pictures
                continue
            if path[0] == "trade_off":  # `trade_off_mistakes` checks it
                continue
            if path[0] == "requirements" and not self.requirements[str(path[1])].asks_for_depth:
                continue
            asked.append((path, name))
        return asked


def _named_cameras(tree: Mapping[str, Any]) -> list[tuple[Location, Any]]:
    """Every place of a study that names a camera, with that name as written."""
    named: list[tuple[Location, Any]] = []
    decision = _mapping(tree.get("decision"))
    for word in ("between", "candidates"):
        named += [(("decision", word, i), name) for i, name in enumerate(_list(decision.get(word)))]
    for i, pair in enumerate(_list(decision.get("compare"))):
        named += [(("decision", "compare", i, side), name) for side, name in enumerate(_list(pair))]
    taking = _list(_mapping(_mapping(tree.get("scene")).get("image")).get("cameras"))
    named += [(("scene", "image", "cameras", i), name) for i, name in enumerate(taking)]
    measuring = _list(_mapping(tree.get("depth_loop")).get("cameras"))
    named += [(("depth_loop", "cameras", i), name) for i, name in enumerate(measuring)]
    ranked = _list(_mapping(tree.get("trade_off")).get("candidates"))
    named += [(("trade_off", "candidates", i), name) for i, name in enumerate(ranked)]
    for key, question in _mapping(tree.get("solve")).items():
        named += [(("solve", key, "equal", i), name) for i, name in enumerate(_list(_mapping(question).get("equal")))]
        named.append((("solve", key, "camera"), _mapping(question).get("camera")))
    for key, claim in _mapping(tree.get("claims")).items():
        named += [(("claims", key, word), _mapping(claim).get(word)) for word in ("camera", "against")]
    for key, requirement in _mapping(tree.get("requirements")).items():
        if (name := _mapping(requirement).get("camera")) not in ("any", "all"):
            named.append((("requirements", key, "camera"), name))
    return [(path, name) for path, name in named if name is not None]


def _named_readings(tree: Mapping[str, Any]) -> list[tuple[Location, Any]]:
    named: list[tuple[Location, Any]] = []
    for key, claim in _mapping(tree.get("claims")).items():
        named += [(("claims", key, "under", i), name) for i, name in enumerate(_list(_mapping(claim).get("under")))]
        if (reading := _mapping(claim).get("reading")) is not None:
            named.append((("claims", key, "reading"), reading))
    assumptions = _mapping(_mapping(tree.get("value_of_information")).get("assumptions"))
    for key, one in assumptions.items():
        where: Location = ("value_of_information", "assumptions", key, "readings")
        named += [((*where, i), name) for i, name in enumerate(_list(_mapping(one).get("readings")))]
    return named


def _named_requirements(tree: Mapping[str, Any]) -> list[tuple[Location, Any]]:
    questions = _mapping(tree.get("solve")).items()
    named: list[tuple[Location, Any]] = []
    for key, question in questions:
        asked, place = _mapping(question).get("requirement"), ("solve", key, "requirement")
        if isinstance(asked, str):
            named.append((place, asked))
        named += [((*place, i), name) for i, name in enumerate(_list(asked))]
    return named


def _mapping(value: Any) -> Mapping[Any, Any]:
    """A mapping, or a validated part as a mapping; empty for anything else."""
    if isinstance(value, Part):
        return dict(value)
    return value if isinstance(value, Mapping) else {}


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []
