"""What accuracy costs: a sentence for each camera and light path, and the figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Bullets, Heading, Paragraph, Spans, pictures_of, say
from tradestudy.report.words import percent
from tradestudy.results.views.groups import group, has
from tradestudy.units import DURATION, pretty
from tradestudy.wording import listed


def describe_cost(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write what accuracy costs; nothing if that was not measured."""
    if "cost" not in tree.children:
        return
    yield Heading(text="What accuracy costs", anchor="what-accuracy-costs")
    if has(tree, "depth"):
        yield Paragraph(
            say(
                "The error of a camera is the largest relative difference of its depth uncertainty from that of the "
                "most complete models (the reference), at up to nine usable distances. The notes of [](#depth-table) "
                "give the program's own estimate, which may be smaller than the error of the reference. “Linear "
                "calibration” and “exact calibration” say how calibration errors are propagated."
            )
        )
    yield Paragraph(
        "“At most” marks an error below that of the reference itself. Where nothing else is said, more complete models "
        "give the same result within the error."
    )
    yield Bullets(tuple(answers(group(tree, "cost"))))
    yield from pictures_of(drawings, "cost")


def answers(cost: xr.Dataset) -> Iterator[Spans]:
    """Say, for each camera and picture of a study, the time and error of its models and the cost of another digit."""
    for name in cost["problem"].values:
        rows = cost.isel(entry=cost["problem_of"].values == name)
        yield _answer(cost.sel(problem=name), rows.drop_dims("problem").to_dataframe().to_dict("records"))


def _answer(problem: xr.Dataset, entries: list[dict[Any, Any]]) -> Spans:
    left_out = str(problem["left_out"].item()).splitlines()
    chosen = [entry for entry in entries if entry["chosen"]]
    if not chosen:
        return say("**{title}**: {why}.", title=str(problem["title"].item()), why="; ".join(left_out))
    own, error, floor = chosen[0], float(chosen[0]["relative_error"]), float(problem["reference_error"])
    finer = [entry for entry in entries if entry["next_digit"]]
    if finer:
        more = f"; ten times the accuracy takes {_seconds(finer[0])} ({finer[0]['models']})"
    elif error <= floor:
        more = ""
    else:
        more = "; no measured set of models is ten times as accurate"
    return say(
        "**{title}**: {seconds} for {models}; error {most}{error}{more}.{left_out}",
        title=str(problem["title"].item()),
        models=str(own["models"]),
        seconds=_seconds(own),
        most="at most " if error <= floor else "",
        error=percent(error),
        more=more,
        left_out=f" Left out: {listed(left_out)}." if left_out else "",
    )


def _seconds(entry: Mapping[Any, Any]) -> str:
    return pretty(float(entry["seconds"]), DURATION, digits=2)
