"""Mistakes that only the validators of the schema can find, and the keys that they concern."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
    if 0 < len(names) <= 8:
        return f"; known: {', '.join(repr(known_name) for known_name in names)}"
    return ""
