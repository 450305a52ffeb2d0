"""The report of a study: which sections it has, in which order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from tradestudy.report.document import Block, Contents, Document, PageBreak
from tradestudy.report.sections.answer import answer
from tradestudy.report.sections.calibration import calibration
from tradestudy.report.sections.cameras import cameras
from tradestudy.report.sections.cost import Measuring, cost
from tradestudy.report.sections.depth_of_field import depth_of_field, sharp_answer
from tradestudy.report.sections.effects import effects
from tradestudy.report.sections.fresnel_validity import fresnel_answer, fresnel_validity
from tradestudy.report.sections.hard_cases import hard_cases
from tradestudy.report.sections.light_spot import light_spot, light_spot_answer
from tradestudy.report.sections.method import method
from tradestudy.report.sections.provenance import provenance
from tradestudy.report.sections.registers import assumptions, claims, contradictions, criteria, requirements
from tradestudy.report.sections.results import results
from tradestudy.results.views.groups import attribute

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing


def compose(
    tree: xr.DataTree,
    run: Mapping[str, Any],
    drawings: Mapping[str, Drawing],
    *,
    cost_not_shown: str = "",
) -> Document:
    """Write the report of a results tree.

    Parameters
    ----------
    tree
        The content of ``results.nc``.
    run
        The content of ``run.json``; what took how long, and where it was computed.
    drawings
        The figures that the tree allows.
    cost_not_shown
        As for `tradestudy.report.write`.
    """
    measuring = Measuring.of(run, not_shown=cost_not_shown)
    return Document(
        title=attribute(tree, "title"),
        subtitle=attribute(tree, "question"),
        blocks=tuple(_blocks(tree, run, drawings, measuring)),
    )


def _blocks(
    tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing], measuring: Measuring
) -> Iterator[Block]:
    first_page = (
        *sharp_answer(tree, drawings),
        *answer(tree, drawings),
        *fresnel_answer(tree, drawings),
        *light_spot_answer(tree, run, drawings),
    )
    yield from first_page
    if first_page:
        yield PageBreak()
    yield Contents()
    yield from cameras(tree)
    yield from assumptions(tree)
    yield from method(tree)
    yield from effects(tree, run)
    yield from results(tree, drawings)
    yield from calibration(tree, drawings)
    yield from depth_of_field(tree, drawings)
    yield from criteria(tree)
    yield from fresnel_validity(tree, drawings)
    yield from light_spot(tree, run, drawings)
    yield from hard_cases(tree, drawings)
    yield from cost(tree, drawings, measuring)
    yield from claims(tree)
    yield from requirements(tree)
    yield from contradictions(tree)
    yield from provenance(run)
