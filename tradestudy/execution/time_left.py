"""How long a run will still take: what it has done so far, and what was predicted of what is to come."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Final

_TELLS: Final = 0.1  # share of a step from which on its own pace says more than its prediction


class TimeLeft:
    """Hears of the progress of a run; a step takes for the rest of it as long as for what it has done of it.

    Steps to come, and one that has hardly begun, take what was predicted, times how far off the steps before were.

    Parameters
    ----------
    clock
        Seconds since any moment.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.predicted: dict[str, float] = {}
        self._step = ""
        self._began = self._told = clock()
        self._first = self._share = 0.0
        self._took: dict[str, float] = {}

    def expect(self, predicted: Mapping[str, float]) -> None:
        """Predicted seconds of steps, in the order of the run."""
        self.predicted = dict(predicted)

    def __call__(self, step: str, share: float) -> None:
        """Hear that a share of a step is done, 0 … 1; a step that was taken up begins with more than none."""
        now = self.clock()
        if step != self._step:
            if self._step:
                self._took[self._step] = now - self._began
            self._step, self._began, self._first = step, now, share
        self._told, self._share = now, share

    @property
    def of_step(self) -> float:
        """Seconds that are left of the running step; NaN where nothing says how many."""
        if self._share >= 1.0:
            return 0.0
        since = self.clock() - self._told
        if self._share - self._first >= _TELLS * (1.0 - self._first):
            pace = (self._told - self._began) / (self._share - self._first)
            return max(0.0, (1.0 - self._share) * pace - since)
        if self._step not in self.predicted:
            return math.nan
        rest = (1.0 - self._first) * self.predicted[self._step] * self._off
        return max(0.0, rest - (self.clock() - self._began))

    @property
    def of_run(self) -> float:
        """Seconds that are left of the run."""
        names = list(self.predicted)
        to_come = names[names.index(self._step) + 1 :] if self._step in names else []
        left = self.of_step
        return (0.0 if math.isnan(left) else left) + self._off * math.fsum(self.predicted[name] for name in to_come)

    @property
    def _off(self) -> float:
        """How much longer the finished steps took than predicted."""
        finished = [name for name in self._took if name in self.predicted]
        predicted = math.fsum(self.predicted[name] for name in finished)
        return math.fsum(self._took[name] for name in finished) / predicted if predicted > 0.0 else 1.0
