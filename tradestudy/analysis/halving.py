"""Bisection for the value at which a condition ceases to hold; handles jumps, at which root finders fail."""

from __future__ import annotations

from collections.abc import Callable


def bracketed(
    inside: float,
    outside: float,
    holds: Callable[[float], bool | None],
    *,
    possible: Callable[[float], float],
    close: float,
) -> tuple[float, float]:
    """The last value found at which a condition holds, and the next one at which it does not.

    Parameters
    ----------
    inside, outside
        Where it holds, and where it does not; either may be the larger.
    holds
        Whether it holds at a value; None if this cannot be known, which ends the search.
    possible
        The permitted value nearest to a value, such as a whole number.
    close
        Relative distance of the two values at which the search ends.
    """
    while abs(outside - inside) > close * max(abs(inside), abs(outside)):
        middle = possible((inside + outside) / 2.0)
        if middle in (inside, outside):
            break
        kept = holds(middle)
        if kept is None:
            break
        inside, outside = (middle, outside) if kept else (inside, middle)
    return inside, outside
