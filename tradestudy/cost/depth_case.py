"""One camera whose depth is asked for, as every way of propagating its errors takes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.evaluation import Model
from tradestudy.uncertainty.sources import Sources


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthCase:
    """One camera whose depth is asked for.

    Parameters
    ----------
    name, title
        Its key in the study, from which draws take their seed, and its name in words.
    model, sources
        Its exact model of inverse depth, and what is uncertain.
    distance
        Where it is asked for [m].
    closed_form
        The uncertainty by the closed form of ``/depth`` [m]; None where the errors have none.
    """

    name: str
    title: str
    model: Model
    sources: Sources
    distance: FloatArray
    closed_form: Callable[[], FloatArray] | None
