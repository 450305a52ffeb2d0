"""The section on effects: one table of what matters, one sentence for what changes nothing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy.accuracy import IN_WORDS, QUANTITIES
from tradestudy.answers.registers import effects_group
from tradestudy.models.plan import Plan
from tradestudy.report.document import Paragraph, Table, Text, spans
from tradestudy.report.sections.depth_numbers import describe_datasheet
from tradestudy.report.sections.program import describe_effects
from tradestudy.results import dataset
from tradestudy.results.views.finding import detailed_cameras
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import NO_MICROLENSES

STUDIES = Path(__file__).parents[2] / "studies"


def plain(text: Text) -> str:
    return "".join(span.text for span in spans(text)).replace("\u00a0", " ")


@pytest.fixture(scope="module", params=[("close_range", None), ("close_range", "0.8 %"), ("robot", None)])
def plan(request: pytest.FixtureRequest) -> Plan:
    study, tolerance = request.param
    return tradestudy.load(STUDIES / f"{study}.yaml", tolerance=tolerance).plan()


def table_of(plan: Plan, name: str) -> Table:
    tree = xr.DataTree.from_dict({"/effects": effects_group(plan)})
    return next(block for block in describe_effects(tree) if isinstance(block, Table) and block.name == name)


def rows_of(plan: Plan, name: str) -> list[list[str]]:
    """The rows of a table, each with the heading above it."""
    found: list[list[str]] = []
    title = ""
    for row in table_of(plan, name).rows:
        if len(row) == 1:
            title = plain(row[0])
        else:
            found.append([title, *map(plain, row)])
    return found


def test_one_row_for_each_camera_and_effect_that_matters(plan: Plan) -> None:
    rows = rows_of(plan, "effects-that-matter")
    expected = [
        (choice.problem.title, decision.slot.replace("_", " "))
        for choice in plan.problems
        for decision in choice.decisions
        if decision.chosen
        and (
            decision.forced
            or (decision.model != "off" and decision.slot not in choice.problem.reasons)
            or any(change.relative > 0.0 for q, change in decision.changes.items() if q in choice.asked)
        )
    ]
    assert [(row[0], row[1]) for row in rows] == expected


def test_models_that_change_nothing_share_one_sentence_for_each_reason_but_the_evident_one(plan: Plan) -> None:
    notes = [plain(note) for note in table_of(plan, "effects-that-matter").notes]
    reasons = {reason for choice in plan.problems for reason in choice.problem.reasons.values()}
    for reason in reasons:
        assert sum(f", because {reason}: " in note for note in notes) == (reason != NO_MICROLENSES)


def test_every_model_in_use_has_the_number_of_what_it_leaves_out(plan: Plan) -> None:
    rows = {tuple(row[:2]): row for row in rows_of(plan, "effects-that-matter")}
    for choice in plan.problems:
        for decision in choice.decisions:
            row = rows.get((choice.problem.title, decision.slot.replace("_", " ")))
            if row is None or not decision.chosen or decision.slot in choice.problem.reasons:
                continue
            quantity = max(choice.asked, key=lambda q: decision.changes[q].relative / choice.asked[q])
            change = decision.changes[quantity].relative
            if change == 0.0:
                assert row[3].isalpha()  # a word instead of a number
            elif change < float("inf"):
                assert row[3] == pretty(change, FRACTION, digits=2)


def test_the_joint_change_is_shown_next_to_the_tolerance(plan: Plan) -> None:
    tree = xr.DataTree.from_dict({"/effects": effects_group(plan)})
    text = " ".join(plain(block.text) for block in describe_effects(tree) if isinstance(block, Paragraph))
    worst = max(choice.changes["depth_uncertainty"].relative for choice in plan.problems)
    allowed = plan.accuracy.tolerances["depth_uncertainty"]
    largest, tolerance = (pretty(value, FRACTION, digits=2) for value in (worst, allowed))
    assert re.search(rf"{IN_WORDS['depth_uncertainty']} by up to {largest}[^.]*tolerance[^.]*{tolerance}", text)
    assert (f"{IN_WORDS['depth_noise']} has no tolerance" in text) == ("depth_noise" not in plan.accuracy.tolerances)


def test_of_many_cameras_the_appendix_details_eight_and_counts_the_others() -> None:
    """Twelve cameras, of which the study compares the last eight."""
    keys = [f"rig-{number}" for number in range(1, 13)]
    titles = [f"Rig {number}" for number in range(1, 13)]
    sheet = {name: np.ones((12, 1)) for name in ("z_accuracy", "temporal_noise", "subpixel_rms", "plane_fit_rms")}
    sheet |= {name: np.ones((12, 1)) for name in ("fill_rate", "field_width", "field_height", "usable")}
    names = ("near_limit", "far_limit", "horizontal_field_of_view", "vertical_field_of_view")
    sheet |= {name: np.ones(12) for name in names}
    kinds = len(QUANTITIES)
    effects = {
        "problem_of": keys, "slot": ["diffraction"] * 12, "model": ["off"] * 12, "chosen": [1.0] * 12,
        "forced": [0.0] * 12, "reason": [""] * 12, "change": np.full((12, kinds), 0.01),
        "change_at": np.ones((12, kinds)), "evidence": [["computed"] * kinds] * 12, "problem_title": titles,
        "tolerance": np.full((12, kinds), 0.02), "joint_change": np.full((12, kinds), 0.01),
        "forced_change": np.full((12, kinds), np.nan),
    }  # fmt: skip
    of = {"camera": keys}
    tree = xr.DataTree.from_dict(
        {
            "/cameras": dataset("cameras", {"title": titles, "method": [""] * 12}, of),
            "/depth": dataset("depth", {"depth_uncertainty": np.ones((12, 1))}, of | {"distance": np.ones(1)}),
            "/datasheet": dataset("datasheet", sheet, of | {"sheet_distance": np.ones(1)}),
            "/decision": xr.Dataset(attrs={"candidates": ", ".join(keys[4:])}),
            "/effects": dataset("effects", effects, {"decision": keys, "problem": keys, "quantity": list(QUANTITIES)}),
        }
    )
    shown, rest = titles[4:], "4 further cameras"
    assert list(detailed_cameras(tree, "depth").values()) == shown
    blocks = [*describe_effects(tree), *describe_datasheet(tree)]
    (models, *sheets) = [block for block in blocks if isinstance(block, Table)]
    assert [plain(row[0]) for row in models.rows if len(row) == 1] == shown
    assert rest in plain(models.notes[-1])
    assert [plain(one.caption).partition(":")[0] for one in sheets] == shown
    assert isinstance(blocks[-1], Paragraph)
    assert rest in plain(blocks[-1].text)
