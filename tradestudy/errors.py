"""What can go wrong: every error carries the value, the limit it broke, and the remedy."""

from __future__ import annotations

import difflib
import errno
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Final

_SHORTEST_BEGINNING: Final = 3


# Control characters, line separators, controls of the direction of writing, halves of characters, non-characters.
_UNPRINTABLE: Final = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff\ufffe\uffff]"
)


def escaped(text: str, *, lines: bool = False) -> str:
    r"""Escape what could change how a terminal or a page shows the rest: a line end becomes ``\n``.

    A byte of a file's name that is not UTF-8 becomes ``\xff``. With ``lines``, the text keeps its lines.
    """
    if lines:
        return "\n".join(map(escaped, text.split("\n")))
    return _UNPRINTABLE.sub(lambda match: _escape(match[0]), text)


def _escape(letter: str) -> str:
    undecoded = ord(letter) - 0xDC00  # how Python keeps a byte that is not UTF-8
    return f"\\x{undecoded:02x}" if 0x80 <= undecoded <= 0xFF else repr(letter)[1:-1]


class TradestudyError(Exception):
    """The base of every error that is reported to the user in one line.

    Parameters
    ----------
    what
        What is wrong.
    value
        The offending value, as a person would write it.
    limit
        The allowed values.
    remedy
        What the user can do about it.
    """

    exit_status: ClassVar[int] = 1

    def __init__(self, what: str, *, value: str = "", limit: str = "", remedy: str = "") -> None:
        self.what, self.value, self.limit, self.remedy = what, value, limit, remedy
        super().__init__(what, value, limit, remedy)

    def __str__(self) -> str:
        text = escaped(self.what, lines=True)
        if self.value:
            text += f": {escaped(self.value)}"
        if self.limit:
            text += f" (allowed: {self.limit})"
        if self.remedy:
            text += f"; {escaped(self.remedy)}"
        return text


class ImplausibleValueWarning(UserWarning):
    """A value given in Python is possible but unusual; stating its basis silences the warning."""


class OutOfRangeError(TradestudyError, ValueError):
    """An argument lies outside the range in which the equation that uses it is valid."""

    exit_status = 2


class UnknownNameError(TradestudyError, KeyError):
    """Nothing has this name; the message lists the names that exist."""

    exit_status = 2


class UnaffordableError(TradestudyError):
    """A computation needs more nodes, bytes or seconds than are allowed.

    The program refuses it before it starts and names the number needed and the setting to change. It never undersamples
    instead.
    """

    exit_status = 2


class NotConvergedError(TradestudyError):
    """An iteration ended without reaching its tolerance."""


class ResultsError(TradestudyError):
    """A results file cannot be read: it is truncated, comes from another program, or has another format version."""


class NoResultsError(ResultsError):
    """A folder contains no results."""

    exit_status = 2


class RequirementsNotMetError(TradestudyError):
    """The study does not meet one of its requirements, and the run is strict."""

    exit_status = 3


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One mistake in an input file: ``FILE:LINE:COLUMN: path: what``."""

    file: str
    line: int
    column: int
    path: str
    what: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}"
        return escaped(f"{place}: {self.path}: {self.what}" if self.path else f"{place}: {self.what}")

    @property
    def message(self) -> str:
        """The mistake, with its place only if it is in a file: Python has no command line with a ``--set``."""
        if not self.file.startswith("--"):
            return str(self)
        return escaped(f"{self.path}: {self.what}" if self.path else self.what)


class StudyError(TradestudyError):
    """A study file is invalid; all its mistakes are listed at once."""

    exit_status = 2

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda p: (p.file, p.line, p.column, p.path)))
        super().__init__("\n".join(problem.message for problem in self.problems))


class PlaceError(TradestudyError):
    """A file or folder cannot be created or read at the requested path."""

    exit_status = 2


class DiskError(TradestudyError):
    """The disk cannot be written or read."""


_ANOTHER: Final = "give another output folder"
_PLACES: Final = {
    errno.ENOTDIR: f"a file exists where a folder is expected; {_ANOTHER}",
    errno.EEXIST: f"a file exists where a folder is expected; {_ANOTHER}",
    errno.ENOENT: f"its folder does not exist and cannot be created; {_ANOTHER}",
    errno.EISDIR: "a folder exists where a file is expected",
    errno.ENAMETOOLONG: f"its name is too long; {_ANOTHER}",
}
_DISKS: Final = {
    errno.EROFS: f"its file system is read-only; {_ANOTHER}",
    errno.EPERM: f"its permissions do not allow it; {_ANOTHER}",
    errno.EACCES: f"its permissions do not allow it; {_ANOTHER}",
    errno.ENOSPC: "free some space and run again; finished work is kept",
    errno.EDQUOT: "free some of the quota and run again; finished work is kept",
    errno.EIO: "check the disk, which reported an input/output error",
}


def place_error(error: OSError) -> PlaceError | DiskError | None:
    """Translate an operating-system error about a path or a disk; return None for any other error."""
    what = f"{error.filename or 'a file'} cannot be read or written"
    if error.errno in _PLACES:
        return PlaceError(what, value=error.strerror or "", remedy=_PLACES[error.errno])
    if error.errno in _DISKS:
        return DiskError(what, value=error.strerror or "", remedy=_DISKS[error.errno])
    return None


def nearest(word: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Find the known word most similar to the given one, or None if none is similar to a ratio of difflib."""
    by_folded = {candidate.casefold(): candidate for candidate in known}
    folded = word.casefold()
    close = difflib.get_close_matches(folded, by_folded, n=1, cutoff=cutoff)
    if not close and len(folded) >= _SHORTEST_BEGINNING:
        close = [candidate for candidate in by_folded if candidate.startswith(folded)]
    return by_folded[close[0]] if close else None
