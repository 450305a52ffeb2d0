"""The first page: the question answered in words and one figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from tradestudy.report import facts
from tradestudy.report.document import (
    Block,
    Bullets,
    Callout,
    Column,
    Heading,
    Picture,
    Spans,
    Table,
    say,
)
from tradestudy.report.facts import distance, in_words, length, share
from tradestudy.units import significant

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing


def answer(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Say which camera for which distance, how sure, what decides it, and what would turn it over."""
    if not facts.has(tree, "decision", "best_camera") or not facts.has(tree, "depth"):
        return
    yield Heading(text="The answer", anchor="answer")
    yield Callout(
        title="Which camera for which distance", blocks=(Bullets((*_stretches(tree), *_solved(tree))),), tone="answer"
    )
    if "whole-range" in drawings:
        drawing = drawings["whole-range"]
        yield Picture(name=drawing.name, caption=drawing.caption, alt=drawing.alt)
    yield from _stability(tree)


def _stretches(tree: xr.DataTree) -> Iterator[Spans]:
    """One sentence per stretch of distance with one best camera."""
    from tradestudy.figures.depth_data import nominal, nominal_is_declared, winners

    titles, depth, declared = facts.titles(tree), nominal(tree), nominal_is_declared(tree)
    for start, end, key in winners(tree):
        span = f"{distance(start)} to {distance(end)}"
        if not key:
            yield say("**{span}: no camera is usable.**", span=span)
        elif declared:
            yield say(
                "**{span}: {camera}**, {how}.", span=span, camera=titles[key], how=_how_sure(depth, key, start, end)
            )
        else:
            yield say("**{span}: {camera}**.", span=span, camera=titles[key])


def _how_sure(depth: xr.Dataset, camera: str, start: float, end: float) -> str:
    """The uncertainty at both ends of a stretch, absolute and relative, and what decides it there."""
    sigma = depth["depth_uncertainty"].sel(camera=camera)
    inside = sigma.where((sigma["distance"] >= start) & (sigma["distance"] <= end), drop=True)
    places = inside["distance"].values[[0, -1]]
    near, far = (
        f"{length(float(s))} ({share(float(s / z))})" for s, z in zip(inside.values[[0, -1]], places, strict=True)
    )
    first, last = (_largest_part(depth, camera, float(place)) for place in places)
    cause = f"set by {first}" if first == last else f"set first by {first}, then by {last}"
    return f"uncertain by {near} at its near end and {far} at its far end, {cause}"


def _largest_part(depth: xr.Dataset, camera: str, place: float) -> str:
    parts = depth["depth_uncertainty_part"].sel(camera=camera).sel(distance=place, method="nearest")
    return in_words(str(parts["part"].values[int(np.nanargmax(np.asarray(parts.values, dtype=np.float64)))]))


def _solved(tree: xr.DataTree) -> Iterator[Spans]:
    for one in facts.solved(tree):
        yield say("{says} **{answer}**.", says=one.says, answer=one.answer)


def _stability(tree: xr.DataTree) -> Iterator[Block]:
    """How the verdict on the headline pair fares under the other readings, at each declared distance."""
    flips = tuple(facts.flips(tree))
    if not flips:
        return
    titles, decision = facts.titles(tree) | {"": "neither"}, facts.dataset(tree, "decision")

    def factor(one: facts.Flips) -> str:
        ratio = max(one.ratio, 1.0 / one.ratio) if one.ratio > 0 else np.inf
        return significant(ratio, 2) if np.isfinite(ratio) else "∞"

    yield Table(
        name="verdict-table",
        caption=f"{titles[decision.attrs['first']]} against {titles[decision.attrs['second']]}: who is more certain, "
        f"and under which of {flips[0].alternatives} other readings of the open questions that flips.",
        columns=(
            Column(title="At", align="right"),
            Column(title="More certain"),
            Column(title="by a factor", align="right"),
            Column(title="Best usable"),
            Column(title="Flips under", weight=1),
        ),
        rows=tuple(
            (
                distance(one.place),
                titles[one.more_certain],
                factor(one),
                titles[one.winner],
                say(
                    "**{count} of {all}**{names}",
                    count=str(len(one.flipped)),
                    all=str(one.alternatives),
                    names=(": " if one.flipped else "") + ", ".join(one.flipped),
                ),
            )
            for one in flips
        ),
    )
