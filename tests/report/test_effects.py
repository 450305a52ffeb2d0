"""The tables of effects: every decision of the plan, in its words, with every camera's number."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import xarray as xr

import tradestudy
from tests.campaigns.depth_cases import base_study
from tradestudy.effects.base import NOTHING_LEFT_OUT
from tradestudy.effects.selection import Decision
from tradestudy.plan.plan import Plan, plan_of
from tradestudy.report.document import Paragraph, Table, Text, spans
from tradestudy.report.sections.effects import describe_effects
from tradestudy.run.groups.effects import effects_group
from tradestudy.run.runner import compute
from tradestudy.units import DURATION, pretty, significant

STUDIES = Path(__file__).parents[2] / "studies"


def plain(text: Text) -> str:
    return "".join(span.text for span in spans(text)).replace("\u00a0", " ")


class Section:
    """The section of a plan: rows of its tables, each under the heading that stands above it."""

    def __init__(self, plan: Plan) -> None:
        blocks = list(describe_effects(xr.DataTree.from_dict({"/effects": effects_group(plan)}), {}))
        self.tables = {block.name: block for block in blocks if isinstance(block, Table)}
        self.text = " ".join(plain(block.text) for block in blocks if isinstance(block, Paragraph))
        self.notes = " ".join(plain(note) for table in self.tables.values() for note in table.notes)
        self.rows: list[tuple[str, list[str]]] = []
        for name in ("effects-that-act", "effects-weighed"):
            for row in self.tables[name].rows:
                if len(row) == 1:
                    heading = plain(row[0])
                else:
                    self.rows.append((heading, [plain(cell) for cell in row]))

    def of(self, decision: Decision, title: str, titles: list[str]) -> tuple[str, list[str]]:
        """The one row of a model of a piece."""
        found = [
            (heading, row)
            for heading, row in self.rows
            if f"{heading.lower()} ".partition(": ")[2].startswith(f"{decision.model.name.lower()} ")
            and decision.slot.replace("_", " ") in heading.partition(":")[0].lower().split(", ")
            and title in members(row[0], titles)
        ]
        assert len(found) == 1, (decision.slot, decision.model.name, title, found)
        return found[0]


def members(of: str, titles: list[str]) -> list[str]:
    if of == "all":
        return titles
    if of.startswith("all but "):
        return [title for title in titles if title != of.removeprefix("all but ")]
    return of.split("; ")


@pytest.fixture(scope="module", params=[("close_range", None), ("close_range", "0.8 %"), ("light_spot", "1 %")])
def plan(request: pytest.FixtureRequest) -> Plan:
    study, tolerance = request.param
    return tradestudy.load(STUDIES / f"{study}.yaml", tolerance=tolerance).plan()


@pytest.fixture(scope="module")
def section(plan: Plan) -> Section:
    return Section(plan)


def test_every_decision_stands_in_the_words_of_the_plan_with_its_number_and_time(plan: Plan, section: Section) -> None:
    titles = [one.title for one in plan.situations]
    text = str(plan)
    for one in plan.situations:
        for decision in plan.selections[one.name].decisions:
            bound = max(decision.model.bounds.values(), key=lambda b: b.relative_change)
            heading, row = section.of(decision, one.title, titles)
            if decision.chosen and bound.relative_change == 0.0:
                assert row[-1].startswith(("changes nothing", NOTHING_LEFT_OUT))
            else:
                assert row[-1].startswith(decision.why)
                assert decision.why in text
            if bound.reason != NOTHING_LEFT_OUT and not math.isnan(bound.criterion.value):
                assert bound.criterion.words in f"{heading} {row[1]}"
                assert significant(bound.criterion.value) in row[1]
            if not decision.chosen:
                assert row[2] == pretty(decision.seconds, DURATION, digits=2)


def test_every_rule_and_every_formula_is_told(plan: Plan, section: Section) -> None:
    told = " ".join(row[-1].lower() for _, row in section.rows)
    formulas = {plain(name): plain(text) for name, text in section.tables["effects-numbers"].rows}
    for selection in plan.selections.values():
        for decision in selection.decisions:
            bound = max(decision.model.bounds.values(), key=lambda b: b.relative_change)
            assert bound.reason.lower() in told
            if bound.reason != NOTHING_LEFT_OUT and not math.isnan(bound.criterion.value):
                assert formulas[bound.criterion.words] == bound.criterion.definition
    assert all(formulas.values())


def test_no_model_is_left_aside_without_a_reason(section: Section) -> None:
    for _, row in section.rows:
        verdict = row[-1]
        if verdict.startswith(("not taken", "not needed")):
            assert "costs no more" in verdict or "suffices, for" in verdict or "cannot be combined" in verdict


def test_what_a_change_of_a_picture_is_and_what_the_models_take_is_said(plan: Plan, section: Section) -> None:
    pictures = "light-spot" in plan.selections
    assert ("relative L2 over the pixels of the picture" in section.text) == pictures
    for one in plan.situations:
        assert pretty(plan.selections[one.name].seconds, DURATION, digits=2) in section.notes


def test_rows_of_a_model_stand_together(section: Section) -> None:
    for table in section.tables.values():
        headings = [plain(row[0]).partition(" — ")[0] for row in table.rows if len(row) == 1]
        models = [name for place, name in enumerate(headings) if headings[place - 1 : place] != [name]]
        assert len(set(models)) == len(models)


def test_where_numbers_stand_names_the_distances_that_are_asked_for(plan: Plan, section: Section) -> None:
    """Of depth; light has no such distances."""
    of_depth = any("depth_uncertainty" in one.quantities for one in plan.situations)
    asked_for = "usable or not, also of those that decision.at, solve and requirements ask for"
    for told in (asked_for, "hold for what noise alone makes of it"):
        assert (told in section.notes) == (told in str(plan)) == of_depth


@pytest.mark.parametrize(("yaw", "is_told"), [("1e-5 deg", False), ("0.02 deg", True)])
def test_how_little_noise_makes_is_told_where_calibration_makes_more(tmp_path: Path, yaw: str, is_told: bool) -> None:
    changed = {"cameras.one.calibration.errors.yaw.standard_deviation": yaw, "accuracy.tolerance": "20 %"}
    study = base_study("stereo", tmp_path).with_values(changed)
    tree = compute(plan_of(study))
    depth = tree["depth"].to_dataset().sel(camera="one")
    table = next(block for block in describe_effects(tree, {}) if isinstance(block, Table))
    found = re.search(
        r"Of the variance of inverse depth of (.+), noise makes at most ([\d.]+).% where", plain(table.notes[0])
    )
    assert (found is not None) == is_told
    if found is not None:
        ways = depth["depth_uncertainty_way"].where(depth["usable"] > 0)
        share = (ways.sel(way="noise") / ways.sel(way="both")).max().item() ** 2
        assert float(found[2]) == pytest.approx(100.0 * share, rel=0.05)
