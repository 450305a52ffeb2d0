"""The base class of every part of a study file, and the mistakes that its validators find."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, model_validator

from tradestudy.errors import nearest


class MistakeAt(ValueError):  # noqa: N818  a mistake in a file, not an error of the program
    """A mistake that a validator found in the part that it validates.

    Parameters
    ----------
    tail
        Keys and positions from the validated part to the wrong value; empty for the part itself.
    what
        What is wrong, and what is expected.
    """

    def __init__(self, tail: Sequence[str | int], what: str) -> None:
        super().__init__(what)
        self.tail, self.what = tuple(tail), what
        self.all: tuple[MistakeAt, ...] = (self,)

    @classmethod
    def several(cls, mistakes: Sequence[MistakeAt]) -> MistakeAt:
        """Join mistakes into one exception, so that a validator can report all of them."""
        joined = cls(mistakes[0].tail, mistakes[0].what)
        joined.all = tuple(single for mistake in mistakes for single in mistake.all)
        return joined


def nearest_name(name: str, known: Iterable[str]) -> str:
    """The end of a message: the nearest known name, or all names if there are few, or nothing."""
    names = list(known)
    close = nearest(name, names)
    if close is not None:
        return f"; nearest: {close!r}"
    if 0 < len(names) <= 9:
        return f"; known: {', '.join(repr(known_name) for known_name in names)}"
    return ""


class Part(BaseModel):
    """A mapping in a study file: unknown keys are mistakes, and values never change after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    absent: ClassVar[Mapping[str, str]] = {}
    """What leaving a key out means, such as "unlimited", for keys where that is an assumption."""
    exactly_one: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Groups of keys of which exactly one must be given."""
    increasing: ClassVar[tuple[str, ...]] = ()
    """Keys whose values must increase strictly in this order."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for keys in self.exactly_one:
            count = sum(getattr(self, key) is not None for key in keys)
            if count != 1:
                remedy = " (null removes an inherited one)" if count else ""
                raise MistakeAt((), f"give exactly one of {', '.join(keys[:-1])} and {keys[-1]}{remedy}")
        for low, high in pairwise(self.increasing):
            if not getattr(self, low) < getattr(self, high):
                names = {key: field.alias or key for key, field in type(self).model_fields.items()}
                raise MistakeAt((names[high],), f"must lie beyond {names[low]}")
        for mistake in self._mistakes():
            raise mistake
        return self

    def _mistakes(self) -> Iterator[MistakeAt]:
        """What does not fit together in values that are valid by themselves; only the first mistake is reported."""
        return iter(())

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
