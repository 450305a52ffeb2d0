"""Names of the methods that compute pictures of a light spot: one for both legs, or ``first-second``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

_LEGS: Final = {
    "geometric": "paraxial rays",
    "exact-rays": "exact rays",
    "boundary-wave": "boundary wave",
    "fresnel": "Fresnel",
    "kirchhoff": "Kirchhoff",
}


def legs_of(method: str) -> tuple[str, str]:
    """Names of the laws to the microlens array and behind it.

    Raises
    ------
    ValueError
        If there is no such method.
    """
    if method in _LEGS:
        return method, method
    for first in _LEGS:
        second = method.removeprefix(f"{first}-")
        if second != method and second in _LEGS:
            return first, second
    raise ValueError(f"unknown method of a picture: {method!r}")


_MOST_COMPLETE_FIRST: Final = (
    "kirchhoff", "boundary-wave-kirchhoff", "kirchhoff-boundary-wave", "boundary-wave",
    "fresnel-kirchhoff", "fresnel-boundary-wave", "kirchhoff-fresnel", "boundary-wave-fresnel", "fresnel",
    "geometric-kirchhoff", "geometric-boundary-wave", "geometric-fresnel",
    "kirchhoff-geometric", "boundary-wave-geometric", "fresnel-geometric",
    "exact-rays", "geometric",
)  # fmt: skip


def most_complete(methods: Iterable[str]) -> str:
    """The method that leaves out the least, with which the others are compared."""
    return min(methods, key=_MOST_COMPLETE_FIRST.index)


def short_title(method: str) -> str:
    """A short title, such as ``Kirchhoff + Fresnel``."""
    first, second = legs_of(method)
    words = _LEGS[first] if first == second else f"{_LEGS[first]} + {_LEGS[second]}"
    return words[0].upper() + words[1:]


def long_title(method: str) -> str:
    """A long title, such as ``Kirchhoff to the array, Fresnel behind it``."""
    first, second = legs_of(method)
    if first != second:
        words = f"{_LEGS[first]} to the array, {_LEGS[second]} behind it"
    else:
        words = _LEGS[first] if "rays" in _LEGS[first] else f"{_LEGS[first]} on both legs"
    return words[0].upper() + words[1:]


def title_within_a_sentence(method: str) -> str:
    """The full title, capitalised only where it begins with a name."""
    return within_a_sentence(long_title(method))


def within_a_sentence(title: str) -> str:
    """A title of a method, capitalised only where it begins with a name."""
    return title if title.startswith(("Kirchhoff", "Fresnel")) else title[0].lower() + title[1:]
