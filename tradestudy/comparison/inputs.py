"""Declared values and chosen models that differ between runs, in words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from tradestudy.comparison.difference import Difference, Run, common_cameras, titles_of
from tradestudy.effects.words import EFFECT, MODEL
from tradestudy.results.views.designs import path_words
from tradestudy.results.views.groups import group, has
from tradestudy.units import ANGLE, DURATION, ELECTRONS, FRACTION, LENGTH, PIXELS, UnitError, parse
from tradestudy.wording import in_words

NOT_SET: Final = "not set"
_ROUNDING: Final = 1e-12  # relative, of values converted from calibration files
_NAMES: Final = ("study", "title", "question")
_NUMBER: Final = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?")
_QUANTITY: Final = re.compile(r"([+-]?[\d.]+(?:e[+-]?\d+)?)\s*([^\W\d]+|%)")
_DIMENSIONS: Final = (LENGTH, ANGLE, FRACTION, PIXELS, ELECTRONS, DURATION)


def differing_inputs(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], int]:
    """Declared values that differ, for cameras that every run has, and the number of compared values.

    Values that are written differently but mean the same, such as 50mm and 0.05 m, count as equal; so do values that
    differ only by rounding, such as a rotation that one file writes as a vector and another as a matrix.
    """
    shared = set(common_cameras(runs, "cameras"))
    every = [run.record.get("inputs", {}) for run in runs]
    declared = [one if isinstance(one, Mapping) else {} for one in every]
    is_one_study = len({str(run.record.get("study", "")) for run in runs}) == 1
    paths = [
        path
        for path in dict.fromkeys(path for one in declared for path in one)
        if (is_one_study or path not in _NAMES) and (not path.startswith("cameras.") or path.split(".")[1] in shared)
    ]
    titles, found = titles_of(runs), []
    for path in paths:
        texts = [str(one[path]) if path in one else NOT_SET for one in declared]
        if not all(_are_alike(texts[0], text) for text in texts[1:]):
            what = path_words(runs[0].tree, path) if path.startswith("cameras.") else _words(path, titles)
            found.append(Difference(what=what, values=tuple(_shown(text, titles) for text in texts)))
    return tuple(found), len(paths)


def _are_alike(one: str, other: str) -> bool:
    """Whether two values mean the same, up to rounding relative to the largest number of a list or to 1 rad."""
    meanings = [[_meaning(part) for part in _parts(text)] for text in (one, other)]
    if [what for what, _ in meanings[0]] != [what for what, _ in meanings[1]]:
        return False
    numbers = [[number for _, number in meaning] for meaning in meanings]
    largest = max((abs(number) for number in (*numbers[0], *numbers[1]) if math.isfinite(number)), default=0.0)
    scale = max(largest, 1.0) if meanings[0][0][0] == ANGLE.name else largest
    return all(a == b or abs(a - b) <= _ROUNDING * scale for a, b in zip(*numbers, strict=True))


def _parts(text: str) -> list[str]:
    """The values of a list, or the only one."""
    is_list = text.startswith("[") and text.endswith("]")
    return [one.strip("' ") for one in text[1:-1].split(",")] if is_list else [text]


def _meaning(text: str) -> tuple[str, float]:
    """The meaning of a value for comparisons: its dimension and SI value if it is a quantity, else the text itself."""
    if _NUMBER.fullmatch(text):
        return "", float(text)
    for dimension in _DIMENSIONS:
        try:
            return dimension.name, parse(text, dimension)
        except UnitError:
            continue
    return text, 0.0


def _words(path: str, titles: Mapping[str, str]) -> str:
    return " › ".join(titles.get(part, in_words(part)) for part in path.split("."))


def _shown(text: str, titles: Mapping[str, str]) -> str:
    """A value as declared, with a space before its unit; lists without brackets, cameras by their titles."""
    if text.startswith("[") and text.endswith("]"):
        return ", ".join(_shown(one, titles) for one in _parts(text))
    return titles.get(text, _QUANTITY.sub(r"\1 \2", text) if _QUANTITY.fullmatch(text) else text)


def differing_models(runs: Sequence[Run]) -> Iterator[Difference]:
    """Models that were chosen differently, for problems that every run solves."""
    if not all(has(run.tree, "effects", "problem_of", "slot", "model", "chosen", "problem_title") for run in runs):
        return
    chosen = [_chosen(run) for run in runs]
    titles = titles_of(runs) | {
        str(key): str(title)
        for run in runs
        for key, title in zip(
            *(group(run.tree, "effects")[name].values for name in ("problem", "problem_title")), strict=True
        )
    }
    for place in chosen[0]:
        if all(place in one for one in chosen) and len({one[place] for one in chosen}) > 1:
            problem, slot = place
            values = tuple(_model_words(slot, one[place]) for one in chosen)
            yield Difference(what=titles.get(problem, problem), values=values)


def _chosen(run: Run) -> dict[tuple[str, str], str]:
    effects = group(run.tree, "effects")
    rows = zip(*(effects[name].values for name in ("problem_of", "slot", "model", "chosen")), strict=True)
    return {(str(problem), str(slot)): str(model) for problem, slot, model, acts in rows if np.equal(acts, 1)}


def _model_words(slot: str, model: str) -> str:
    words = {str(name): text for name, text in EFFECT.items()}[slot]
    known = {(str(name), which): text for (name, which), text in MODEL.items()}
    return known.get((slot, model), f"{words} left out" if model == "off" else f"{words}: {model}")
