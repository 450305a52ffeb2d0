"""Building blocks of sentences in reports and messages: counts with their nouns, and ranges of distance."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from tradestudy.units import LENGTH, pretty, rounded, significant

NO_MICROLENSES: Final = "the camera has no microlenses"
"""Why a camera has neither diffraction at microlenses nor crosstalk; reports take this for granted."""
_MOST_DIGITS: Final = 6
_BRACKETS: Final = re.compile(r"\([^()]*\)|“[^”]*”")
_SIZE_OF_DEVICE: Final = re.compile(r"\d[\d.]* (mm|cm|m|px|µm) (?=(.* )?(camera|head|rig|webcam)s?$)", re.IGNORECASE)
_DESIGNATION: Final = re.compile(r"[A-Za-z]|\d+")
_DEVICE: Final = re.compile("(camera|head|rig|webcam)s?", re.IGNORECASE)
_ORDINARY: Final = re.compile(
    "calibrated|cameras?|conventional|far|fine|fixed|focused|front|heads?|left|light|long|moving|multi|narrow|near|normal"
    "|plenoptic|rear|right|rigs?|short|single|stereo|thermal|unfocused|uniform|webcams?|wide",
    re.IGNORECASE,
)
"""First words of camera titles that are not names."""
_SPELLED_UNITS: Final = ((re.compile(r"(?<=\d) ?deg\b"), "°"), (re.compile(r"(?<=\d) ?um\b"), " µm"))


def json_text(value: Any, indent: int = 2) -> str:
    """JSON in ASCII, which every terminal and locale can show, and without control characters."""
    return json.dumps(value, indent=indent).replace("\x7f", "\\u007f")


def counted(number: int, word: str, words: str = "") -> str:
    """Write a count with its noun: "1 reading", "3 readings"; `words` is the plural if it does not end in s alone."""
    return f"{number} {word if number == 1 else words or f'{word}s'}"


def with_unit_symbols(text: str) -> str:
    """Write units as people do, where studies spell them: "0.2 deg" becomes "0.2°", "5.5 um" becomes "5.5 µm"."""
    for spelled, symbol in _SPELLED_UNITS:
        text = spelled.sub(symbol, text)
    return text


def with_article(title: str) -> str:
    """Write the title of a camera within a sentence: "the Raytrix R5", "the stereo rig", "a stereo rig", "Head B".

    An ordinary word at its beginning loses its capital. A title whose second or last word is a letter or a number, such
    as "Head B (50 mm)" or "b", is a name.
    """
    first, *others = _SIZE_OF_DEVICE.sub("", title).split(" ")
    if first in ("a", "an", "the") or any(map(_DESIGNATION.fullmatch, {*others[:1], *(others or [first])[-1:]})):
        return title
    is_ordinary = _ORDINARY.fullmatch(first.partition("-")[0])
    if is_ordinary and not others and not _DEVICE.fullmatch(first):  # an adjective alone, such as "Near"
        return title
    return f"the {title[:1].lower() + title[1:] if is_ordinary else title}"


def listed(items: Sequence[str], last: str = "and") -> str:
    """Join items for a sentence: "a", "a and b", "a, b and c"; items with bare commas as "a, x; and b"."""
    has_commas = len(items) > 1 and any(", " in _BRACKETS.sub("", item) for item in items)
    mark, word = ("; ", f"; {last} ") if has_commas else (", ", f" {last} ")
    return word.join(part for part in (mark.join(items[:-1]), *items[-1:]) if part)


def few(items: Sequence[str], most: int = 3, last: str = "and") -> str:
    """Join items for a sentence, and count those beyond `most`: "a, b, c and 37 more"."""
    return listed(items if len(items) <= most + 1 else [*items[:most], f"{len(items) - most} more"], last)


_SPELLED: Final[Mapping[str, str]] = {
    "f_number": "f-number",
    "mla_distance": "array distance",
    "pixel_noise": "matching noise",
}


def in_words(name: str) -> str:
    """Write a name from studies or results as words, without its unit: "focal length x" for ``focal_length_x_px``."""
    for key, words in _SPELLED.items():
        name = name.replace(key, words)
    return name.removesuffix("_px").replace("_", " ")


def fewest_digits(tells_apart: Callable[[int], bool]) -> int:
    """From three to six significant digits, the fewest that tell values apart; six where none do."""
    return next((digits for digits in range(3, _MOST_DIGITS) if tells_apart(digits)), _MOST_DIGITS)


def distance(value: float, digits: int = 3) -> str:
    """Write a distance [m] in metres, below 0.1 m in millimetres, with a no-break space before the unit."""
    if 0.1 <= abs(value) < math.inf:
        return f"{significant(value, digits)}\N{NO-BREAK SPACE}m"
    return pretty(value, LENGTH, digits).replace(" ", "\N{NO-BREAK SPACE}")


def span(start: float, end: float, digits: int = 0) -> str:
    """Write a range of distances [m], both ends in one unit and with enough digits to tell them apart."""
    in_metres = 0.1 <= end < math.inf

    def written(digits: int) -> tuple[str, str]:
        return significant(start, digits) if in_metres else distance(start, digits), distance(end, digits)

    def differ(digits: int) -> bool:
        first, last = written(digits)
        return not last.startswith(f"{first}\N{NO-BREAK SPACE}") if in_metres else first != last

    return " to ".join(written(digits or fewest_digits(differ)))


def plain_span(start: float, end: float, digits: int = 0) -> str:
    """Write a range of distances [m] as `span` does, with plain spaces: for results, terminals and other programs."""
    return span(start, end, digits).replace("\N{NO-BREAK SPACE}", " ")


def within(
    near: float,
    far: float,
    near_to: Callable[[float], int] = math.ceil,
    far_to: Callable[[float], int] = math.floor,
) -> tuple[float, float, int]:
    """The ends of a range of distances [m], rounded inwards by default, and their number of digits.

    They have three digits, or as many more as a range needs that is narrower than their steps.
    """

    def ends(digits: int) -> tuple[float, float]:
        return rounded(near, digits, near_to), rounded(far, digits, far_to)

    def fits(digits: int) -> bool:
        first, last = ends(digits)
        return first < last and max(abs(first - near), abs(last - far)) <= far - near if far < math.inf else True

    digits = fewest_digits(fits)
    return *ends(digits), digits


def range_words(
    start: float,
    end: float,
    near_to: Callable[[float], int] = math.ceil,
    far_to: Callable[[float], int] = math.floor,
) -> str:
    """A range of distances [m], or a single one, with its preposition and plain spaces: "from 0.4 to 3 m", "at 1 m".

    Its ends are rounded as by `within`; those of a gap between such ranges with `math.floor` and `math.ceil`.
    """
    if start < end:
        return f"from {plain_span(*within(start, end, near_to, far_to))}"
    return f"at {distance(start)}".replace("\N{NO-BREAK SPACE}", " ")


DECLARED_VALUE: Final = "; declared: "  # in answers to inverse questions, before the declared value of the input

_LIMITS: Final[Mapping[str, str]] = {
    "real_image": "no real image",
    "overlap": "too little overlap",
    "total_covering_plane": "points seen by too few microlenses",
    "availability": "too few points seen by two of the microlenses that are compared",
    "focus": "out of focus",
    "saturation": "brightest pixels saturated",
    "matching": "unreliable matching",
    "last_disparity_step": "a disparity step no longer tells them from infinity",
    "disparity_range": "disparities beyond the search range of the matcher",
    "failed_fraction": "too many failed measurements",
    "relative_uncertainty": "too uncertain",
}


def limit_words(name: str) -> str:
    """Say why a camera cannot be used where it breaks limits of the usable range: the first of these.

    Parameters
    ----------
    name
        Names of limits as an end of the usable range has them: "overlap, focus", or "matching: its condition".
    """
    first, _, condition = name.partition(", ")[0].partition(": ")
    return condition or _LIMITS[first]


def lens_in_words(model: str = "rational", fitted: Sequence[str] = ("k1", "k2"), fixed: str = "") -> str:
    """A lens model fitted to corners: its name, its fitted coefficients, and others; by default, the usual model."""
    return f"{model} with {' '.join(fitted)}{fixed}"
