"""The whole study file."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy.study.mistakes import MistakeAt, nearest_name
from tradestudy.study.schema.base import Part
from tradestudy.study.schema.calibration import CalibrationStudyPart, calibration_mistakes
from tradestudy.study.schema.cameras import CameraPart, measures_depth
from tradestudy.study.schema.depth_of_field import CriteriaPart, DepthOfFieldPart
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
    depth_of_field: DepthOfFieldPart | None = None
    criteria: CriteriaPart | None = None
    decision: DecisionPart | None = None
    calibration: CalibrationStudyPart | None = None
    readings: dict[Name, ReadingPart] = {}
    solve: dict[Name, SolvePart] = {}
    claims: dict[Name, ClaimPart] = {}
    requirements: dict[Name, RequirementPart] = {}
    sweep: dict[str, SweepValues | SweepRangePart] = {}

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        mistakes = [*self._wrong_cameras(), *self._unknown_readings()]
        if self.criteria is not None and self.depth_of_field is None:
            mistakes.append(MistakeAt(("criteria",), "needs depth_of_field, whose scene it is worked out for"))
        if self.calibration is not None:
            mistakes += calibration_mistakes(self.calibration, self.cameras)
        if mistakes:
            raise mistakes[0] if len(mistakes) == 1 else MistakeAt.several(mistakes)
        return self

    def _wrong_cameras(self) -> list[MistakeAt]:
        """Names of cameras that do not exist, or that are asked for depth and measure none."""
        for_depth = self._asked_for_depth()
        named = [*for_depth, *self._asked_for_focus()]
        return [
            MistakeAt(path, f"no camera is called {name!r}{nearest_name(name, self.cameras)}")
            for path, name in named
            if name not in self.cameras
        ] + [
            MistakeAt(path, f"{name!r} is a {self.cameras[name].kind} camera and measures no depth")
            for path, name in for_depth
            if name in self.cameras and not measures_depth(self.cameras[name])
        ]

    def _asked_for_depth(self) -> list[tuple[tuple[str | int, ...], str]]:
        named: list[tuple[tuple[str | int, ...], str]] = []
        if self.decision:
            named += [(("decision", "between", i), name) for i, name in enumerate(self.decision.between)]
        for key, solve in self.solve.items():
            named += [(("solve", key, "equal", i), name) for i, name in enumerate(solve.equal)]
        for key, claim in self.claims.items():
            if claim.of not in ("depth_of_field", "depth_of_field_ratio"):
                named.append((("claims", key, "camera"), claim.camera))
            if claim.of in ("uncertainty_ratio", "share_better"):
                named.append((("claims", key, "against"), claim.against))
        return named + [
            (("requirements", key, "camera"), requirement.camera)
            for key, requirement in self.requirements.items()
            if requirement.camera != "any"
        ]

    def _asked_for_focus(self) -> list[tuple[tuple[str | int, ...], str]]:
        named: list[tuple[tuple[str | int, ...], str]] = []
        for key, claim in self.claims.items():
            if claim.of in ("depth_of_field", "depth_of_field_ratio"):
                named.append((("claims", key, "camera"), claim.camera))
            if claim.of == "depth_of_field_ratio":
                named.append((("claims", key, "against"), claim.against))
        return named

    def _unknown_readings(self) -> list[MistakeAt]:
        named: list[tuple[tuple[str | int, ...], str]] = []
        for key, claim in self.claims.items():
            named += [(("claims", key, "under", i), name) for i, name in enumerate(claim.under)]
            if claim.reading is not None:
                named.append((("claims", key, "reading"), claim.reading))
        return [
            MistakeAt(path, f"no reading is called {name!r}{nearest_name(name, self.readings)}")
            for path, name in named
            if name not in self.readings
        ]
