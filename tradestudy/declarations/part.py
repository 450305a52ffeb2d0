"""What every part of a study file has in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict

from tradestudy.declarations.mistakes import MistakeAt


class Part(BaseModel):
    """A mapping in a study file: unknown keys are mistakes, values never change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    @classmethod
    def mistakes_of_names(cls, tree: Mapping[str, Any]) -> list[MistakeAt]:  # noqa: ARG003 - for parts that refer to names
        """Names that refer to nothing, looked for in the plain values, so that other mistakes do not hide them."""
        return []

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """What was left out and stands at a value that somebody has to have assumed: its path here, and the value.

        Such a default is written as text with its unit and validated as if it stood in the file.
        """
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if isinstance(value, Part):
                yield from (((name, *path), text) for path, text in value.assumed())
            elif field.validate_default and isinstance(field.default, str) and name not in self.model_fields_set:
                yield (name,), field.default
