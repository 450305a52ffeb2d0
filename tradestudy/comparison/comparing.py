"""Build a comparison of runs: what they share, what they conclude, what differs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final

import xarray as xr

from tradestudy.comparison.answers import compare_claims, compare_questions, compare_ranks, compare_requirements
from tradestudy.comparison.best_camera import best_is_compared, common_range, compare_best
from tradestudy.comparison.comparison import Comparison
from tradestudy.comparison.difference import Difference, Run, common_cameras, titles_of
from tradestudy.comparison.inputs import differing_inputs, differing_models
from tradestudy.comparison.ranges import compare_sharp, compare_usable
from tradestudy.comparison.results import ChangedResult, Results, compare_results
from tradestudy.errors import OutOfRangeError
from tradestudy.figures.drawing import Drawing
from tradestudy.figures.overlay import FEW, overlay_drawing
from tradestudy.wording import counted, listed, span

_CHECKSUM: Final = "results_sha256"


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
        names=tuple(names),
        labels=labels,
        notes=tuple(_notes(runs, results)),
        conclusions=conclusions,
        unchanged=unchanged,
        inputs=inputs,
        same_inputs=compared - len(inputs),
        models=tuple(differing_models(runs)),
        results=tuple(one.difference for one in results.moved),
        same_results=results.within_error,
        overlay=overlay,
        without_overlay=without,
    )


def _conclusions(runs: Sequence[Run]) -> tuple[tuple[Difference, ...], tuple[str, ...]]:
    """The conclusions that changed, and those that did not, in words."""
    if not all("cameras" in run.tree.children for run in runs):
        return (), ()
    found = (
        (compare_requirements(runs), "requirement", "requirements"),
        (compare_ranks(runs), "ranking by criteria", "rankings by criteria"),
        (compare_claims(runs), "claim", "claims"),
        (compare_questions(runs), "answer to a question", "answers to questions"),
    )
    changed = [difference for answers, _, _ in found for difference in answers.changed]
    unchanged = [counted(one.unchanged, word, words) for one, word, words in found if one.unchanged]
    if best_is_compared(runs):
        best = compare_best(runs)
        changed += best.changed
        within = ", within the error of its switch distances" if best.has_explained else ""
        unchanged += [] if best.changed else [f"the best camera from {span(*common_range(runs))}{within}"]
    for ranges, word in ((compare_usable(runs), "usable"), (compare_sharp(runs), "sharp")):
        changed += ranges.changed
        unchanged += [f"the {word} range of {counted(ranges.unchanged, 'camera')}"] if ranges.unchanged else []
    return tuple(changed), tuple(unchanged)


def _notes(runs: Sequence[Run], results: Results) -> Iterator[str]:
    """Sentences on what is not compared, because the runs do not share it."""
    checksums = {str(run.record.get(_CHECKSUM, run.name)) for run in runs}
    if len(checksums) == 1:
        yield "The results are identical, to the last bit."
        return
    studies = list(dict.fromkeys(str(run.record.get("study", "")) for run in runs))
    if len(studies) > 1:
        yield f"The runs belong to different studies, {listed(studies)}; only what they share is compared."
    if len({str(run.record.get("code_hash", "")) for run in runs}) > 1:
        yield "Different versions of the program computed the runs, so results can differ even where no input does."
    shared = set(common_cameras(runs, "cameras"))
    for run in runs:
        alone = [title for key, title in titles_of([run]).items() if key not in shared]
        if alone:
            yield f"Not in every run, so not compared: {'; '.join(alone)} ({run.name})."
    if results.apart:
        yield f"Not compared, because the runs share no distance or design: {listed(results.apart)}."


def _labels(runs: Sequence[Run]) -> tuple[str, ...]:
    """The shortest ends of the runs' paths that distinguish them; numbered where the whole paths are the same."""
    parts = [PurePath(run.name).parts for run in runs]
    for length in range(1, max(map(len, parts)) + 1):
        ends = tuple("/".join(one[-length:]) for one in parts)
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
    moved = [one for one in results.moved if (one.group, one.variable) == ("depth", "depth_uncertainty")]
    if not moved:
        return None, "No figure: no curve of depth uncertainty differs by more than its error."
    changed = {one.camera for one in moved}
    shown = cameras if len(cameras) <= FEW else tuple(key for key in cameras if key in changed)
    legend = labels if len(inputs) != 1 else [f"{inputs[0].what}: {value}" for value in inputs[0].values]
    return overlay_drawing([run.tree for run in runs], legend, shown, moved[0].design, _alternative_text(moved)), ""


def _alternative_text(moved: Sequence[ChangedResult]) -> str:
    """What differs most, for readers who do not see the figure."""
    return "; ".join(str(one.difference) for one in moved)
