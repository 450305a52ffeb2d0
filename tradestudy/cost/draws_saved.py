"""How many draws a quasi-random sequence saves against plain Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cost.entries import Entry

SOBOL: Final = "scrambled Sobol"
PLAIN: Final = "plain Monte Carlo"


def gain(entries: Sequence[Entry], floor: float) -> Iterator[str]:
    """How many times fewer draws Sobol points need, by the median error over places."""
    saved = draws_saved(entries, floor)
    if saved is not None:
        least = "at least " if saved.at_least else ""
        yield (
            f"For a typical error of {100.0 * saved.error:.2g} % scrambled Sobol draws need {least}{saved.factor:.3g} "
            "times fewer evaluations than plain Monte Carlo draws."
        )


@dataclass(frozen=True, kw_only=True)
class DrawsSaved:
    """How many times fewer draws Sobol points need for a typical error; ``at_least`` where the fewest are enough."""

    error: float
    factor: float
    at_least: bool


def draws_saved(entries: Sequence[Entry], floor: float) -> DrawsSaved | None:
    """Compare the draws for the smallest typical error that both ways reach and that the reference can tell.

    Between measured numbers of draws the error is read log–log. None where either way was measured less than twice.
    """
    curves = {}
    for model in (SOBOL, PLAIN):
        rows = sorted(
            (
                (entry.evaluations, entry.typical_error)
                for entry in entries
                if entry.model == model and entry.evaluations > 0.0 and entry.typical_error > 2.0 * floor
            ),
        )
        if len(rows) < 2:
            return None
        draws, errors = (np.array(column) for column in zip(*rows, strict=True))
        # One that happens to be smaller than its successor does not make fewer draws enough.
        curves[model] = (draws, np.maximum.accumulate(errors[::-1])[::-1])
    error = max(float(errors[-1]) for _, errors in curves.values())
    needed = {
        model: math.exp(float(np.interp(-math.log(error), -np.log(errors), np.log(draws))))
        for model, (draws, errors) in curves.items()
    }
    return DrawsSaved(error=error, factor=needed[PLAIN] / needed[SOBOL], at_least=bool(error > curves[SOBOL][1][0]))
