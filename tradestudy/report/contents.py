"""The report of a study: its sections and their order, with details for specialists in appendices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Appendices, Contents, PageBreak, Report, literal, pictures_of
from tradestudy.report.sections.answer import describe_answer, describe_stretches
from tradestudy.report.sections.budget import list_budgets
from tradestudy.report.sections.calibration import describe_calibration
from tradestudy.report.sections.depth_numbers import describe_datasheet, describe_decision, list_depths
from tradestudy.report.sections.depth_of_field import describe_depth_of_field, describe_sharp_answer
from tradestudy.report.sections.fresnel_validity import (
    describe_fresnel_answer,
    describe_fresnel_criteria,
    describe_fresnel_validity,
)
from tradestudy.report.sections.light_spot import describe_light_spot, describe_light_spot_answer
from tradestudy.report.sections.measured import describe_measurements
from tradestudy.report.sections.method import describe_method
from tradestudy.report.sections.pictures import (
    describe_depth_loop,
    describe_depth_maps,
    describe_pictures,
    list_disparity_scores,
)
from tradestudy.report.sections.program import (
    describe_cost,
    describe_effects,
    describe_hard_cases,
    list_hard_cases,
)
from tradestudy.report.sections.refocusing import describe_refocusing
from tradestudy.report.sections.registers import (
    describe_assumptions,
    describe_cameras,
    describe_claims,
    describe_contradictions,
    describe_criteria,
    describe_properties,
    describe_provenance,
    describe_requirements,
    list_claim_values,
)
from tradestudy.report.sections.results import describe_disparity_causes, describe_results, describe_verdicts
from tradestudy.report.sections.trade_off import describe_trade_off, describe_value_of_information
from tradestudy.results.views.headline import headline


def compose_report(tree: xr.DataTree, run: Mapping[str, Any], drawings: Mapping[str, Drawing]) -> Report:
    """Write the report of a results tree.

    Parameters
    ----------
    tree
        The content of ``results.nc``.
    run
        The content of ``run.json``: how long each step took, and on which machine.
    drawings
        The figures that the tree allows, the first of which belongs to the first page.
    """
    first, drawings = dict(list(drawings.items())[:1]), dict(list(drawings.items())[1:])
    first_page = (
        *describe_answer(tree),
        *describe_sharp_answer(tree),
        *describe_fresnel_answer(tree),
        *describe_light_spot_answer(tree, run),
        *pictures_of(first, *first),
    )
    sections = (
        Contents(),
        *describe_stretches(tree),
        *describe_cameras(tree),
        *describe_verdicts(tree),
        *describe_claims(tree),
        *describe_measurements(tree, drawings),
        *describe_depth_maps(tree, drawings),
        *describe_depth_loop(tree, run, drawings),
        *describe_value_of_information(tree, drawings),
        *describe_trade_off(tree, drawings),
        *describe_results(tree, drawings),
        *describe_refocusing(tree, drawings),
        *describe_fresnel_validity(tree),
        *describe_light_spot(tree, run, drawings),
        *describe_hard_cases(tree, drawings),
    )
    appendices = (
        *list_hard_cases(tree),
        *describe_pictures(tree, drawings),
        *list_disparity_scores(tree),
        *describe_fresnel_criteria(tree, drawings),
        *describe_assumptions(tree),
        *describe_properties(tree),
        *describe_criteria(tree),
        *describe_contradictions(tree),
        *describe_method(tree),
        *describe_effects(tree),
        *list_depths(tree, drawings),
        *list_budgets(tree),
        *describe_decision(tree, drawings),
        *list_claim_values(tree),
        *describe_requirements(tree),
        *describe_depth_of_field(tree, drawings),
        *describe_disparity_causes(tree),
        *describe_calibration(tree, drawings),
        *describe_datasheet(tree),
        *describe_cost(tree, drawings),
        *describe_provenance(run),
    )
    body = (*sections, Appendices(), *appendices) if appendices else sections
    return Report(
        title=str(tree.attrs.get("title", "")),
        subtitle=literal(str(tree.attrs.get("question", ""))),
        headline=literal(headline(tree, run.get("seconds", {}))),
        blocks=(*first_page, PageBreak(), *body) if first_page else body,
    )
