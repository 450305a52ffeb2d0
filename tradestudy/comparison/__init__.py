"""Compare finished runs: conclusions that changed, inputs that differ, results that changed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.comparison.comparison import Comparison, Difference, Run, are_alike, common_cameras, titles_of
from tradestudy.comparison.conclusions import (
    KINDS,
    compare_answers,
    compare_best,
    compare_requirements,
    compare_sharp,
    compare_usable,
    compared_headline,
)
from tradestudy.comparison.results import Results, compare_results
from tradestudy.effects import EFFECT, MODEL
from tradestudy.errors import OutOfRangeError
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.overlay import FEW, overlay_drawing
from tradestudy.results.views.designs import path_words
from tradestudy.results.views.groups import group, has
from tradestudy.wording import counted, in_words, listed

__all__ = ["Comparison", "Difference", "compare_runs"]

NOT_SET: Final = "not set"
_NAMES: Final = ("study", "title", "question")
_QUANTITY: Final = re.compile(r"([+-]?[\d.]+(?:e[+-]?\d+)?)\s*([^\W\d]+|%)")


def differing_inputs(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], int]:
    """Declared values that differ, for cameras that every run has, and the number of compared values.

    Values that are written differently but mean the same, such as 50mm and 0.05 m, count as equal; so do values that
    differ only by rounding, such as a rotation that one file writes as a vector and another as a matrix.
    """
    shared = set(common_cameras(runs, "cameras"))
    recorded = [run.record.get("inputs", {}) for run in runs]
    declared = [inputs if isinstance(inputs, Mapping) else {} for inputs in recorded]
    is_one_study = len({str(run.record.get("study", "")) for run in runs}) == 1
    paths = [
        path
        for path in dict.fromkeys(path for inputs in declared for path in inputs)
        if (is_one_study or path not in _NAMES) and (not path.startswith("cameras.") or path.split(".")[1] in shared)
    ]
    titles, differences = titles_of(runs), []
    for path in paths:
        texts = [str(inputs[path]) if path in inputs else NOT_SET for inputs in declared]
        if not all(are_alike(texts[0], text) for text in texts[1:]):
            named = {} if path.startswith("scene.") else titles  # no key of a scene is the name of a camera
            what = " › ".join(named.get(part, in_words(part)) for part in path.split("."))
            what = path_words(runs[0].tree, path) if path.startswith("cameras.") else what
            differences.append(Difference(what=what, values=tuple(_shown(text, titles) for text in texts)))
    return tuple(differences), len(paths)


def _shown(text: str, titles: Mapping[str, str]) -> str:
    """A value as declared, with a space before its unit; lists without brackets, cameras by their titles."""
    if text.startswith("[") and text.endswith("]") and "{" not in text:  # parts are shown as they are
        return ", ".join(_shown(part.strip("' "), titles) for part in text[1:-1].split(","))
    return titles.get(text, _QUANTITY.sub(r"\1 \2", text) if _QUANTITY.fullmatch(text) else text)


def differing_models(runs: Sequence[Run]) -> Iterator[Difference]:
    """Models that were chosen differently, for problems that every run solves."""
    if not all(has(run.tree, "effects", "problem_of", "slot", "model", "chosen", "problem_title") for run in runs):
        return
    chosen = [_chosen(run) for run in runs]
    titles = {
        str(key): str(title)
        for run in runs
        for key, title in zip(
            *(group(run.tree, "effects")[variable].values for variable in ("problem", "problem_title")), strict=True
        )
    } | titles_of(runs)
    for key in chosen[0]:
        if all(key in models for models in chosen) and len({models[key] for models in chosen}) > 1:
            problem, slot = key
            values = tuple(_model_words(slot, models[key]) for models in chosen)
            yield Difference(what=titles.get(problem, problem), values=values)


def _chosen(run: Run) -> dict[tuple[str, str], str]:
    effects = group(run.tree, "effects")
    rows = zip(*(effects[variable].values for variable in ("problem_of", "slot", "model", "chosen")), strict=True)
    return {(str(problem), str(slot)): str(model) for problem, slot, model, acts in rows if np.equal(acts, 1)}


def _model_words(slot: str, model: str) -> str:
    words = {str(slot_name): text for slot_name, text in EFFECT.items()}[slot]
    by_model = {(str(effect), chosen): text for (effect, chosen), text in MODEL.items()}
    return by_model.get((slot, model), f"{words} left out" if model == "off" else f"{words}: {model}")


def compare_runs(
    names: Sequence[str], records: Sequence[Mapping[str, Any]], trees: Sequence[xr.DataTree]
) -> Comparison:
    """Compare runs by their records and results.

    Parameters
    ----------
    names
        Name of each run.
    records
        Content of each ``run.json``.
    trees
        Results of each run.

    Raises
    ------
    OutOfRangeError
        If there are fewer than two runs.
    """
    if len(names) < 2:
        raise OutOfRangeError("runs to compare", value=str(len(names)), limit="at least 2")
    runs = [Run(name=name, record=record, tree=tree) for name, record, tree in zip(names, records, trees, strict=True)]
    conclusions, unchanged = _conclusions(runs)
    inputs, compared = differing_inputs(runs)
    results = compare_results(runs)
    labels = _labels(runs)
    overlay, without = _overlay(runs, labels, inputs, results)
    return Comparison(
        headline=compared_headline([run.tree for run in runs], len(conclusions)),
        names=tuple(names),
        labels=labels,
        notes=tuple(_notes(runs, results)),
        conclusions=conclusions,
        unchanged=unchanged,
        inputs=inputs,
        same_inputs=compared - len(inputs),
        models=tuple(differing_models(runs)),
        results=tuple(result.difference for result in results.moved),
        same_results=results.within_error,
        overlay=overlay,
        without_overlay=without,
    )


def _conclusions(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], tuple[str, ...]]:
    """The conclusions that changed, and those that did not, in words."""
    if not all("cameras" in run.tree.children for run in runs):
        return (), ()
    compared = (
        (compare_requirements(runs), "requirement", "requirements"),
        *((compare_answers([answers_of(run.tree) for run in runs]), word, words) for answers_of, word, words in KINDS),
    )
    changed = [difference for answers, _, _ in compared for difference in answers if difference is not None]
    unchanged = [counted(count, word, words) for answers, word, words in compared if (count := answers.count(None))]
    differing, same = compare_best(runs)
    changed += differing
    unchanged += [same] if same else []
    for ranges, word in ((compare_usable(runs), "usable"), (compare_sharp(runs), "sharp")):
        changed += filter(None, ranges)
        unchanged += [f"the {word} range of {counted(count, 'camera')}"] if (count := ranges.count(None)) else []
    return tuple(changed), tuple(unchanged)


def _notes(runs: Sequence[Run], results: Results) -> Iterator[str]:
    """Sentences on what is not compared, because the runs do not share it."""
    checksums = {str(run.record.get("results_sha256", run.name)) for run in runs}
    if len(checksums) == 1:
        yield "The results are identical, to the last bit."
        return
    studies = list(dict.fromkeys(str(run.record.get("study", "")) for run in runs))
    if len(studies) > 1:
        yield f"The runs belong to different studies, {listed(studies)}; only what they share is compared."
    if len({str(run.record.get("code_hash", "")) for run in runs}) > 1:
        yield "Different versions of the program computed the runs, so results can differ even where no input does."
    shared, titles = set(common_cameras(runs, "cameras")), titles_of(runs)
    for run in runs:
        alone = [titles[key] for key in titles_of([run]) if key not in shared]
        if alone:
            yield f"Not in every run, so not compared: {'; '.join(alone)} ({run.name})."
    if results.apart:
        yield f"Not compared, because the runs share no distance or design: {listed(results.apart)}."


def _labels(runs: Sequence[Run]) -> tuple[str, ...]:
    """The shortest ends of the runs' paths that distinguish them; numbered where the whole paths are the same."""
    parts = [PurePath(run.name).parts for run in runs]
    for length in range(1, max(map(len, parts)) + 1):
        ends = tuple("/".join(path[-length:]) for path in parts)
        if len(set(ends)) == len(ends):
            return ends
    return tuple(f"{run.name} ({number})" for number, run in enumerate(runs, start=1))


def _overlay(
    runs: Sequence[Run], labels: Sequence[str], inputs: Sequence[Difference], results: Results
) -> tuple[Drawing | None, str]:
    """The figure of depth uncertainty, or why there is none."""
    cameras = common_cameras(runs, "depth")
    if not cameras:
        return None, "No figure: the runs share no camera with a depth uncertainty."
    moved = [result for result in results.moved if (result.group, result.variable) == ("depth", "depth_uncertainty")]
    if not moved:
        return None, "No figure: no curve of depth uncertainty differs by more than its error."
    changed = {result.camera for result in moved}
    shown = cameras if len(cameras) <= FEW else tuple(key for key in cameras if key in changed)
    legend = labels if len(inputs) != 1 else [f"{inputs[0].what}: {value}" for value in inputs[0].values]
    without_figure = "; ".join(str(result.difference) for result in moved)  # for readers who do not see it
    return overlay_drawing([run.tree for run in runs], legend, shown, moved[0].design, without_figure), ""
