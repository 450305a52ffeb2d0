"""A study as read from its file, and the same study under other values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.errors import Problem, StudyError, TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.assemble import camera_of, criteria_of
from tradestudy.study.reader import Document, read, validate, with_values
from tradestudy.study.schema.root import StudyFile


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a study computes with: cameras, limits and distances in SI."""

    cameras: Mapping[str, DepthCamera]
    criteria: UsableCriteria
    distance: FloatArray


@dataclass(frozen=True)
class StudyDefinition:
    """A valid study: the document with its positions, and what it says.

    Parameters
    ----------
    document
        As read, with the place of every value.
    file
        What the schema made of it.
    """

    document: Document
    file: StudyFile

    @classmethod
    def of(cls, document: Document) -> StudyDefinition:
        """Check a document wholly: against the schema, and that its cameras can be built.

        Raises
        ------
        StudyError
            With every mistake found.
        """
        definition = cls(document, validate(document, StudyFile))
        definition.case  # noqa: B018 - built here so that an impossible camera is refused before anything runs
        return definition

    @cached_property
    def case(self) -> Case:
        """The cameras, built; every one that cannot be is reported."""
        cameras: dict[str, DepthCamera] = {}
        problems: list[Problem] = []
        for name, part in self.file.cameras.items():
            try:
                cameras[name] = camera_of(part)
            except TradestudyError as error:
                file, line, column = self.document.locate(("cameras", name))
                problems.append(Problem(file=file, line=line, column=column, path=f"cameras.{name}", what=str(error)))
        if problems:
            raise StudyError(problems)
        return Case(
            cameras=cameras,
            criteria=criteria_of(self.file.usable),
            distance=np.array(self.file.scene.distance_values()),
        )

    def with_values(self, values: Mapping[str, str | float | bool | None]) -> StudyDefinition:
        """The same study with other values, by dotted path; None takes a value back. Checked like any other."""
        return StudyDefinition.of(with_values(self.document, {path: _as_yaml(value) for path, value in values.items()}))


def load_definition(path: Path, overrides: tuple[str, ...] = ()) -> StudyDefinition:
    """Read and check a study file with ``path=value`` overrides."""
    return StudyDefinition.of(read(path, overrides))


def _as_yaml(value: str | float | bool | None) -> str:
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)
