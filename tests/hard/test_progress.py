"""The step of hard cases moves by the effort of each case, since a few take most of the time."""

from __future__ import annotations

import pytest

from tradestudy.run.groups import hard_cases as group
from tradestudy.study.schema.hard_cases import HardCasesPart
from tradestudy.verification.hard_cases.case import Family, OutcomeCase


def case(name: str, effort: float) -> OutcomeCase:
    return OutcomeCase(name=name, law="", naive=lambda: "", ours=lambda: name, expected=(name,), effort=effort)


def test_a_long_case_moves_the_step_by_its_effort(monkeypatch: pytest.MonkeyPatch) -> None:
    family = Family(name="thin-lens", title="Any", cases=(case("short", 1.0), case("long", 9.0)))
    monkeypatch.setattr(group, "all_families", lambda: (family,))
    shares: list[float] = []
    found = group.hard_cases_group(HardCasesPart(families=("thin-lens",)), lambda _, share: shares.append(share))
    assert shares == [0.0, pytest.approx(0.1), 1.0]
    assert found["our_answer"].values.tolist() == ["short", "long"]
