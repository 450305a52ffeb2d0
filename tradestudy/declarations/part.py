"""The base class of every part of a study file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from tradestudy.declarations.mistakes import MistakeAt


class Part(BaseModel):
    """A mapping in a study file: unknown keys are mistakes, and values never change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    absent: ClassVar[Mapping[str, str]] = {}
    """What leaving a key out means, such as "unlimited", for keys where that is an assumption."""

    @classmethod
    def mistakes_of_names(cls, tree: Mapping[str, Any]) -> list[MistakeAt]:  # noqa: ARG003 - for parts that refer to names
        """Find names that refer to nothing, in the unvalidated values, so that other mistakes do not hide them."""
        return []

    def assumed(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """Omitted values whose default is an assumption: path in this part, and default, or the words of `absent`.

        A default is text with its unit and is validated as if it were in the file.
        """
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if isinstance(value, Part):
                yield from (((name, *path), text) for path, text in value.assumed())
            elif name in self.absent and (value is None or name not in self.model_fields_set):
                yield (name,), self.absent[name]
            elif field.validate_default and isinstance(field.default, str) and name not in self.model_fields_set:
                yield (name,), field.default
