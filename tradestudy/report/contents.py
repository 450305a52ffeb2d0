"""The report of a study: which sections it has, in which order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Contents, PageBreak, Report
from tradestudy.report.sections.answer import describe_answer
from tradestudy.report.sections.calibration import describe_calibration
from tradestudy.report.sections.cameras import describe_cameras
from tradestudy.report.sections.cost import Measuring, describe_cost
from tradestudy.report.sections.depth_of_field import describe_depth_of_field, describe_sharp_answer
from tradestudy.report.sections.effects import describe_effects
from tradestudy.report.sections.fresnel_validity import describe_fresnel_answer, describe_fresnel_validity
from tradestudy.report.sections.hard_cases import describe_hard_cases
from tradestudy.report.sections.light_spot import describe_light_spot, describe_light_spot_answer
from tradestudy.report.sections.method import describe_method
from tradestudy.report.sections.provenance import describe_provenance
from tradestudy.report.sections.registers import (
    describe_assumptions,
    describe_claims,
    describe_contradictions,
    describe_criteria,
    describe_requirements,
)
from tradestudy.report.sections.results import describe_results
from tradestudy.results.views.groups import attribute


def compose_report(
    tree: xr.DataTree,
    run: Mapping[str, Any],
    drawings: Mapping[str, Drawing],
    *,
    cost_not_shown: str = "",
) -> Report:
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
    return Report(
        title=attribute(tree, "title"),
        subtitle=attribute(tree, "question"),
        blocks=tuple(_blocks(tree, run, drawings, measuring)),
    )


def _blocks(
    tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing], measuring: Measuring
) -> Iterator[Block]:
    first_page = (
        *describe_sharp_answer(tree, drawings),
        *describe_answer(tree, drawings),
        *describe_fresnel_answer(tree, drawings),
        *describe_light_spot_answer(tree, run, drawings),
    )
    yield from first_page
    if first_page:
        yield PageBreak()
    yield Contents()
    yield from describe_cameras(tree)
    yield from describe_assumptions(tree)
    yield from describe_method(tree)
    yield from describe_effects(tree, run)
    yield from describe_results(tree, drawings)
    yield from describe_calibration(tree, drawings)
    yield from describe_depth_of_field(tree, drawings)
    yield from describe_criteria(tree)
    yield from describe_fresnel_validity(tree, drawings)
    yield from describe_light_spot(tree, run, drawings)
    yield from describe_hard_cases(tree, drawings)
    yield from describe_cost(tree, drawings, measuring)
    yield from describe_claims(tree)
    yield from describe_requirements(tree)
    yield from describe_contradictions(tree)
    yield from describe_provenance(run)
