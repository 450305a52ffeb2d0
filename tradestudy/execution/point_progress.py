"""Progress inside one point of a step, reported by the computation itself wherever it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

Listener = Callable[[float], None]


def _nobody(_share: float) -> None:
    """Ignore what is told."""


_listener: Final[ContextVar[Listener]] = ContextVar("_listener", default=_nobody)


def tell(share: float) -> None:
    """Report the fraction of the running point that is done, from 0 to 1.

    Nobody listens in other processes and threads, nor outside a step.
    """
    _listener.get()(share)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Call the listener with what computations within this block `tell`."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def part_of_point(begin: float, end: float) -> Iterator[None]:
    """Within this block, 0 to 1 stand for ``begin`` to ``end`` of what surrounds it."""
    outer = _listener.get()
    with heard_by(lambda share: outer(begin + share * (end - begin))):
        yield
    outer(end)
