"""What can go wrong: every error carries the value, the limit it broke, and the remedy."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from typing import ClassVar, Final


class TradestudyError(Exception):
    """The base of every error that a user can be told about in one line.

    Parameters
    ----------
    what
        The fact, in words.
    value
        The offending value, as a person would write it.
    limit
        What is allowed.
    remedy
        What to do about it.
    """

    exit_status: ClassVar[int] = 1

    def __init__(self, what: str, *, value: str = "", limit: str = "", remedy: str = "") -> None:
        self.what, self.value, self.limit, self.remedy = what, value, limit, remedy
        super().__init__(what, value, limit, remedy)

    def __str__(self) -> str:
        text = self.what
        if self.value:
            text += f": {self.value}"
        if self.limit:
            text += f" (allowed: {self.limit})"
        if self.remedy:
            text += f"; {self.remedy}"
        return text


class OutOfRangeError(TradestudyError, ValueError):
    """An argument lies outside the validity of the law it is used in."""

    exit_status = 2


class UnaffordableError(TradestudyError):
    """A computation needs more nodes, bytes or seconds than are allowed.

    It is refused before it starts, with the number needed and the knob to turn; nothing is ever undersampled instead.
    """

    exit_status = 2


class NotConvergedError(TradestudyError):
    """An iteration ended without reaching its tolerance."""


class ResultsError(TradestudyError):
    """A results file cannot be read: truncated, foreign, or of another format version."""


class RequirementsNotMetError(TradestudyError):
    """A requirement of the study is not met and the run was asked to be strict."""

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
        return f"{place}: {self.path}: {self.what}" if self.path else f"{place}: {self.what}"


class StudyError(TradestudyError):
    """A study file says something impossible; all its mistakes are listed at once."""

    exit_status = 2

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=lambda p: (p.file, p.line, p.column, p.path)))
        super().__init__("\n".join(str(problem) for problem in self.problems))


class PlaceError(TradestudyError):
    """A file or a folder that was asked for cannot be where it was asked for."""

    exit_status = 2


class DiskError(TradestudyError):
    """A disk cannot take what is written."""


_ANOTHER: Final = "give another --out"
_PLACES: Final = {
    errno.ENOTDIR: f"a folder is expected where a file stands; {_ANOTHER}",
    errno.EEXIST: f"a folder is expected where a file stands; {_ANOTHER}",
    errno.EISDIR: "a file is expected where a folder stands",
    errno.ENAMETOOLONG: f"its name is too long; {_ANOTHER}",
}
_DISKS: Final = {
    errno.EROFS: f"its file system is read-only; {_ANOTHER}",
    errno.EPERM: f"its permissions do not allow that; {_ANOTHER}",
    errno.EACCES: f"its permissions do not allow that; {_ANOTHER}",
    errno.ENOSPC: "make room and run again; what is finished is kept",
    errno.EDQUOT: "make room in the quota and run again; what is finished is kept",
    errno.EIO: "the disk does not answer",
}


def place_error(error: OSError) -> PlaceError | DiskError | None:
    """What the operating system says of a place or a disk, in our words; None of anything else."""
    what = f"{error.filename or 'a file'} cannot be read or written"
    if error.errno in _PLACES:
        return PlaceError(what, value=error.strerror or "", remedy=_PLACES[error.errno])
    if error.errno in _DISKS:
        return DiskError(what, value=error.strerror or "", remedy=_DISKS[error.errno])
    return None
