"""What the command line prints where nothing fails it, and how every error ends: one line, and an exit status."""

from __future__ import annotations

import io
import os
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from tradestudy.errors import StudyError, TradestudyError, escaped, place_error

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

    from tradestudy.api import Study


INTERRUPTED = 130
UNEXPECTED = 1


class _Unfailing(io.FileIO):
    """The file of standard error; what nobody can read any more is dropped, so that it ends no run."""

    def write(self, content: ReadableBuffer, /) -> int:
        try:
            return super().write(content)
        except OSError:
            return len(memoryview(content))


def prepare_streams() -> None:
    """Let no closed or limited stream end a run."""
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:  # closed: or the next file opened would get its number, and messages
            os.open(os.devnull, mode)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    encoding = "utf-8" if sys.stderr is None else sys.stderr.encoding
    sys.stderr = io.TextIOWrapper(
        io.BufferedWriter(_Unfailing(2, "w", closefd=False)), encoding, "backslashreplace", line_buffering=True
    )


def say(*lines: str, err: bool = False) -> None:
    """Print lines, in which nothing that a study, a result or the name of a file says can act on the terminal."""
    typer.echo("\n".join(map(escaped, lines)), err=err)


def warned(study: Study, *, quiet: bool = False) -> Study:
    """Print what was read from calibration files and the study's warnings; return the study."""
    if quiet:
        return study
    for reading in study.definition.document.imported:
        say(f"read: {reading.lines[0]}", *reading.lines[1:], err=True)
    from tradestudy.study.plausibility import implausible

    for warning in implausible(study.prepared):  # with the place on the command line
        say(f"warning: {warning}", err=True)
    return study


@contextmanager
def reporting_errors(*, debug: bool) -> Iterator[None]:
    """Map every outcome of a command to its exit status and, on failure, to one line that helps the user."""
    try:
        yield
    except KeyboardInterrupt:
        say("interrupted; if you run it again, it takes up what was finished", err=True)
        raise typer.Exit(INTERRUPTED) from None
    except BrokenPipeError:
        # The reader of our output has gone (`| head`); Python would complain about it again when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(UNEXPECTED) from None
    except TradestudyError as error:
        if debug:
            traceback.print_exc()
        say(*(map(str, error.problems) if isinstance(error, StudyError) else str(error).split("\n")), err=True)
        raise typer.Exit(error.exit_status) from None
    except OSError as error:
        if debug:
            traceback.print_exc()
        explained = place_error(error)
        if explained is None:
            raise _unexpected(error) from None
        say(*str(explained).split("\n"), err=True)
        raise typer.Exit(explained.exit_status) from None
    except Exception as error:
        if debug:
            traceback.print_exc()
        raise _unexpected(error) from None


def _unexpected(error: Exception) -> typer.Exit:
    """Report an unexpected error, and where to find its details."""
    text = " ".join(str(error).split())
    say(f"unexpected {type(error).__name__}{f': {text}' if text else ''}; {_logged()}", err=True)
    return typer.Exit(UNEXPECTED)


def _logged() -> str:
    """Write the error being handled to a log file and name it."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="tradestudy-", suffix=".log", encoding="utf-8", errors="backslashreplace", delete=False
        ) as file:
            file.write(f"{' '.join(sys.argv)}\nPython {sys.version}\n\n{traceback.format_exc()}")
    except OSError as error:
        return f"no log could be written ({error.strerror}); --debug shows more"
    return f"details are in {file.name}"
