"""The whole study file."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.study.mistakes import MistakeAt, nearest_name
from tradestudy.study.schema.base import Part
from tradestudy.study.schema.cameras import CameraPart
from tradestudy.study.schema.questions import (
    ClaimPart,
    DecisionPart,
    ReadingPart,
    RequirementPart,
    SolvePart,
    SweepRangePart,
    SweepValues,
    Text,
    UsablePart,
)
from tradestudy.study.schema.scene import ScenePart

FORMAT = 1
NAME_PATTERN = r"^[\w][\w.+-]*$"
LONGEST_NAME = 80
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=LONGEST_NAME)]


class StudyFile(Part):
    """A trade study: cameras, a scene, and questions about them."""

    format: Literal[1] = Field(description="Version of this file format.")
    study: Name = Field(description="Name of the study and of its report folder.")
    title: Text
    question: Text
    cameras: Annotated[dict[Name, CameraPart], Field(min_length=1, max_length=100)]
    scene: ScenePart
    usable: UsablePart = UsablePart()
    decision: DecisionPart | None = None
    readings: dict[Name, ReadingPart] = {}
    solve: dict[Name, SolvePart] = {}
    claims: dict[Name, ClaimPart] = {}
    requirements: dict[Name, RequirementPart] = {}
    sweep: dict[str, SweepValues | SweepRangePart] = {}

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        mistakes = [*self._unknown_cameras(), *self._unknown_readings()]
        if mistakes:
            raise mistakes[0] if len(mistakes) == 1 else MistakeAt.several(mistakes)
        return self

    def _unknown_cameras(self) -> list[MistakeAt]:
        named: list[tuple[tuple[str | int, ...], str]] = []
        if self.decision:
            named += [(("decision", "between", i), name) for i, name in enumerate(self.decision.between)]
        for key, solve in self.solve.items():
            named += [(("solve", key, "equal", i), name) for i, name in enumerate(solve.equal)]
        for key, claim in self.claims.items():
            named.append((("claims", key, "camera"), claim.camera))
            if claim.of in ("uncertainty_ratio", "share_better"):
                named.append((("claims", key, "against"), claim.against))
        named += [
            (("requirements", key, "camera"), requirement.camera)
            for key, requirement in self.requirements.items()
            if requirement.camera != "any"
        ]
        return [
            MistakeAt(path, f"no camera is called {name!r}{nearest_name(name, self.cameras)}")
            for path, name in named
            if name not in self.cameras
        ]

    def _unknown_readings(self) -> list[MistakeAt]:
        return [
            MistakeAt(
                ("claims", key, "under", i),
                f"no reading is called {name!r}{nearest_name(name, self.readings)}",
            )
            for key, claim in self.claims.items()
            for i, name in enumerate(claim.under)
            if name not in self.readings
        ]
