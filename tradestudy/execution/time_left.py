"""Predict the time left of a run, from its progress so far and the predicted times of its steps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Final

_WEIGHT: Final = 0.1  # of the predicted pace, which counts like the measured pace of this fraction of a step


class TimeLeft:
    """Follows the progress of a run and extrapolates the pace of the running step.

    Steps to come are assumed to take their predicted time, scaled by the square root of the ratio of measured to
    predicted time of the finished steps, whose errors are partly those of the machine and partly their own. In the
    running step, the measured pace gradually replaces the predicted one.

    Parameters
    ----------
    clock
        Returns seconds since a fixed moment.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.predicted: dict[str, float] = {}
        self._step = ""
        self._began = self._round = self._moved = self._told = clock()
        self._first = self._share = 0.0
        self._resumed: dict[str, float] = {}  # fraction of each step that was done when it began
        self._took: dict[str, float] = {}

    def expect(self, predicted: Mapping[str, float]) -> None:
        """Set the predicted seconds of the steps, in the order of the run."""
        self.predicted = dict(predicted)

    def __call__(self, step: str, share: float) -> None:
        """Record the fraction of a step that is done, from 0 to 1; a resumed step starts above 0.

        A smaller fraction than before means that the step begins anew, as when a picture is refined. Time in which the
        first fraction does not grow is spent on preparations, which do not count towards the step's pace.
        """
        now = self.clock()
        if step != self._step:
            if self._step:
                self._took[self._step] = self._took.get(self._step, 0.0) + now - self._began
            self._resumed.setdefault(step, share)
            self._step, self._first = step, share
            self._began = self._round = self._moved = now
        elif share < self._share:
            self._round = self._moved = now
            self._first = share
        elif share == self._first:
            self._moved = now
        self._told, self._share = now, share

    @property
    def of_step(self) -> float:
        """Seconds left of the running step; NaN if neither its pace nor a prediction is known."""
        if self._share >= 1.0:
            return 0.0
        predicted, done = self._off * self.predicted.get(self._step, math.nan), self._share - self._first
        if done == 0.0:
            left = (1.0 - self._first) * predicted - (self.clock() - self._round)
        else:
            taken = self._told - self._moved
            pace = (taken + _WEIGHT * predicted) / (done + _WEIGHT) if predicted > 0.0 else taken / done
            left = (1.0 - self._share) * pace - (self.clock() - self._told)
        return 0.0 if left < 0.0 else left

    @property
    def of_run(self) -> float:
        """Seconds left of the run."""
        names = list(self.predicted)
        later = names[names.index(self._step) + 1 :] if self._step in names else []
        to_come = math.fsum(self.predicted[name] for name in later if name not in self._took)
        left = self.of_step
        return (0.0 if math.isnan(left) else left) + self._off * to_come

    @property
    def _off(self) -> float:
        """Factor by which steps to come are expected to differ from their prediction."""
        finished = [name for name in self._took if name in self.predicted]
        predicted = math.fsum((1.0 - self._resumed[name]) * self.predicted[name] for name in finished)
        return math.sqrt(math.fsum(self._took[name] for name in finished) / predicted) if predicted > 0.0 else 1.0
