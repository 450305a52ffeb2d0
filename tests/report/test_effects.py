"""The section on effects: one table of what matters, one sentence for what changes nothing, every model at the end."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import xarray as xr

import tradestudy
from tradestudy.accuracy import IN_WORDS
from tradestudy.answers.registers import effects_group
from tradestudy.models.plan import Plan
from tradestudy.report.document import Paragraph, Table, Text, spans
from tradestudy.report.sections.program import describe_effects, list_decisions
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
    blocks = [*describe_effects(tree), *list_decisions(tree)]
    return next(block for block in blocks if isinstance(block, Table) and block.name == name)


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


def test_every_model_that_was_compared_is_listed_with_its_number(plan: Plan) -> None:
    rows = rows_of(plan, "effects-all")
    for choice in plan.problems:
        for decision in choice.decisions:
            if decision.slot in choice.problem.reasons:
                continue
            quantity = max(choice.asked, key=lambda q: decision.changes[q].relative / choice.asked[q])
            change = decision.changes[quantity].relative
            name = f"● {decision.model}" if decision.chosen else decision.model
            (row,) = (r for r in rows if r[:3] == [choice.problem.title, decision.slot.replace("_", " "), name])
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
