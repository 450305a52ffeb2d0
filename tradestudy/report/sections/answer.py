"""The first page: the question answered in words and one figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import Block, Bullets, Callout, Heading, KeyFigure, KeyFigures, Picture, Spans, say
from tradestudy.report.facts import distance, in_words, length, quantity, share

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing


def answer(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Say which camera for which distance, how sure, what decides it, and what would turn it over."""
    if not facts.has(tree, "decision", "best_camera") or not facts.has(tree, "depth"):
        return
    yield Heading(text="The answer", anchor="answer")
    sentences = (*_stretches(tree), *_stability(tree))
    yield Callout(title=facts.attribute(tree, "question"), blocks=(Bullets(sentences),), tone="answer")
    yield from _key_figures(tree)
    if "whole-range" in drawings:
        drawing = drawings["whole-range"]
        yield Picture(name=drawing.name, caption=drawing.caption, alt=drawing.alt)


def _stretches(tree: xr.DataTree) -> Iterator[Spans]:
    """One sentence per stretch of distance with one best camera."""
    from tradestudy.figures.depth_data import nominal, winners

    titles, depth = facts.titles(tree), nominal(tree)
    for start, end, key in winners(tree):
        span = f"{distance(start)} to {distance(end)}"
        if not key:
            yield say("**{span}: no camera is usable.**", span=span)
            continue
        sigma = depth["depth_uncertainty"].sel(camera=key)
        inside = sigma.where((sigma["distance"] >= start) & (sigma["distance"] <= end), drop=True)
        first, last = float(inside[0]), float(inside[-1])
        ends = [float(inside["distance"][0]), float(inside["distance"][-1])]
        yield say(
            "**{span}: {camera}**, uncertain by {first} ({first_share}) at the near end and {last} ({last_share}) "
            "at the far end; {part} decides.",
            span=span,
            camera=titles[key],
            first=length(first),
            first_share=share(first / ends[0]),
            last=length(last),
            last_share=share(last / ends[1]),
            part=_deciding_part(depth, key, ends),
        )


def _deciding_part(depth: xr.Dataset, camera: str, ends: list[float]) -> str:
    """The largest part of the uncertainty at both ends of a stretch."""
    parts = depth["depth_uncertainty_part"].sel(camera=camera)
    names = []
    for end in ends:
        values = np.asarray(parts.sel(distance=end, method="nearest").values, dtype=float)
        names.append(in_words(str(parts["part"].values[int(np.nanargmax(values))])))
    return names[0] if names[0] == names[1] else f"first {names[0]}, then {names[1]}"


def _stability(tree: xr.DataTree) -> Iterator[Spans]:
    """How the verdict fares under the other readings, at each declared distance."""
    for one in facts.flips(tree):
        if one.flipped:
            yield say(
                "At {place} the verdict **flips under {count} of {all} readings**: {names}.",
                place=distance(one.place),
                count=str(len(one.flipped)),
                all=str(one.alternatives),
                names=", ".join(one.flipped),
            )
        else:
            yield say(
                "At {place} the verdict holds under all {all} other readings.",
                place=distance(one.place),
                all=str(one.alternatives),
            )


def _key_figures(tree: xr.DataTree) -> Iterator[Block]:
    """The solved inverse questions, as numbers to remember."""
    if not facts.has(tree, "decision", "solved_value", "solved_unit", "solved_says"):
        return
    solved = facts.records(tree, "decision", "question")
    items = [
        KeyFigure(value=quantity(float(one["solved_value"]), str(one["solved_unit"])), label=str(one["solved_says"]))
        for one in solved
        if np.isfinite(float(one["solved_value"]))
    ]
    if items:
        yield KeyFigures(tuple(items[:4]))
