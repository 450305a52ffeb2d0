"""The step of hard cases moves by one case after another."""

from __future__ import annotations

import pytest

from tradestudy.answers import hard_cases as group
from tradestudy.study.schema.root import HardCasesPart
from tradestudy.verification.case import Family, OutcomeCase


def case(name: str) -> OutcomeCase:
    return OutcomeCase(name=name, law="", naive=lambda: "", ours=lambda: name, expected=(name,))


def test_every_case_moves_the_step_by_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    family = Family(name="thin-lens", title="Any", cases=(case("first"), case("second")))
    monkeypatch.setattr(group, "all_families", lambda: (family,))
    shares: list[float] = []
    found = group.hard_cases_group(HardCasesPart(families=("thin-lens",)), lambda _, share: shares.append(share))
    assert shares == [0.0, 0.5, 1.0]
    assert found["our_answer"].values.tolist() == ["first", "second"]
