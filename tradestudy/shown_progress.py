"""Progress of long commands: bars in a terminal, lines in a log, or nothing."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class ProgressLine:
    """A step as one line of text, for logs and pipes."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.begun = stream, set[str]()

    def __call__(self, step: str, _share: float) -> None:
        """Print a step when it begins, and not again when it goes on after another one."""
        if step not in self.begun:
            print(f"{step} …", file=self.stream, flush=True)
            self.begun.add(step)


class ProgressBar:
    """A bar for each step, with the time left at its pace; shown once the work takes longer than `WORTH_A_LOOK` [s]."""

    WORTH_A_LOOK = 2.0

    def __init__(self) -> None:
        self.begin = time.monotonic()
        self.tasks: dict[str, TaskID] = {}
        self.progress: Progress | None = None

    def __call__(self, step: str, share: float) -> None:
        """Move the bar of a step."""
        if self.progress is None:
            if time.monotonic() - self.begin < self.WORTH_A_LOOK:
                return
            from rich import progress
            from rich.console import Console

            self.progress = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.TaskProgressColumn(),
                progress.TimeRemainingColumn(elapsed_when_finished=True),
                console=Console(stderr=True),
                transient=True,
                speed_estimate_period=600.0,  # points of a step differ, so its pace is that of many
            )
            self.progress.start()
        if step not in self.tasks:
            self.tasks[step] = self.progress.add_task(step, total=1.0)
        self.progress.update(self.tasks[step], completed=share)

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self.progress is not None:
            self.progress.stop()


class Silent:
    """Shows nothing."""

    def __call__(self, step: str, share: float) -> None:
        """Ignore the progress."""


@contextmanager
def shown_progress(*, quiet: bool) -> Iterator[Silent | ProgressLine | ProgressBar]:
    """Choose how a long command shows its progress."""
    if quiet:
        yield Silent()
    elif not sys.stderr.isatty():
        with _resumption_told(sys.stderr):
            yield ProgressLine(sys.stderr)
    else:
        bar = ProgressBar()
        try:
            yield bar
        finally:
            bar.close()


@contextmanager
def _resumption_told(stream: TextIO) -> Iterator[None]:
    """Print a line for each step that takes finished parts from an interrupted run; a bar shows them by its start."""
    logger, handler = logging.getLogger("tradestudy.execution"), logging.StreamHandler(stream)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
