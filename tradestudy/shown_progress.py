"""Progress of long commands: bars in a terminal, lines in a log, or nothing."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class ProgressLine:
    """A step as one line of text, for logs and pipes."""

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.begun = stream, set[str]()

    def expect(self, predicted: Mapping[str, float]) -> None:
        """Ignore the prediction: steps are named only when they begin."""

    def __call__(self, step: str, _share: float) -> None:
        """Print a step when it begins, and not again when it goes on after another one."""
        if step not in self.begun:
            print(f"{step} …", file=self.stream, flush=True)
            self.begun.add(step)


class ProgressBar:
    """Bars with the remaining or elapsed time; they appear only when the work takes longer than `WORTH_A_LOOK` [s]."""

    WORTH_A_LOOK = 2.0

    def __init__(self, *, is_predicted: bool) -> None:
        from tradestudy.execution.time_left import TimeLeft

        self.is_predicted = is_predicted
        self.begin = time.monotonic()
        self.left = TimeLeft()
        self.tasks: dict[str, TaskID] = {}
        self.progress: Progress | None = None

    def expect(self, predicted: Mapping[str, float]) -> None:
        """Take the predicted time of every step [s]."""
        self.left.expect(predicted)

    def __call__(self, step: str, share: float) -> None:
        """Move the bar of a step."""
        self.left(step, share)
        if self.progress is None:
            if time.monotonic() - self.begin < self.WORTH_A_LOOK:
                return
            from rich import progress
            from rich.console import Console

            self.progress = progress.Progress(
                progress.TextColumn("{task.description}"),
                progress.BarColumn(),
                progress.TaskProgressColumn(),
                progress.TextColumn("{task.fields[left]}") if self.is_predicted else progress.TimeElapsedColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self.progress.start()
        if step not in self.tasks:
            for task in self.tasks.values():
                self.progress.update(task, left="")
            self.tasks[step] = self.progress.add_task(step, total=1.0, left=self)
        self.progress.update(self.tasks[step], completed=share, left=self)

    def __str__(self) -> str:
        """Remaining time of the current step and of the run, read anew whenever the bar is drawn."""
        step, run = self.left.of_step, self.left.of_run
        words = "" if math.isnan(step) else f"{_minutes(step)} left"
        return f"{words}, {_minutes(run)} left in all" if run > step else words

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self.progress is not None:
            self.progress.stop()


def _minutes(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02}"


class Silent:
    """Shows nothing."""

    def expect(self, predicted: Mapping[str, float]) -> None:
        """Ignore the prediction."""

    def __call__(self, step: str, share: float) -> None:
        """Ignore the progress."""


@contextmanager
def shown_progress(*, quiet: bool, is_predicted: bool = True) -> Iterator[Silent | ProgressLine | ProgressBar]:
    """Choose how a long command shows its progress; without a prediction, it shows the elapsed time."""
    if quiet:
        yield Silent()
    elif not sys.stderr.isatty():
        yield ProgressLine(sys.stderr)
    else:
        bar = ProgressBar(is_predicted=is_predicted)
        try:
            yield bar
        finally:
            bar.close()
