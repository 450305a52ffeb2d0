"""A sample of each long campaign: every kind of fault once, and a fixed few hundred bad inputs."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.campaigns import faults, fuzz

pytestmark = pytest.mark.slow
INPUTS = 300
# One figure and no PDF: a run of it costs little more than starting the program.
QUICK = "format: 2\nstudy: faults\ntitle: T\nquestion: Q\nhard_cases: {families: [equation-27]}\n"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> faults.Bench:
    return faults.Bench(root=tmp_path_factory.mktemp("faults"), rng=random.Random(1), text=QUICK, pdf=False)


@pytest.mark.parametrize(
    "fault",
    [faults.killed, faults.interrupted, faults.truncated, faults.flipped, faults.two_at_once],
    ids=lambda f: f.__name__,
)
def test_a_fault_loses_nothing_and_the_rerun_resumes(bench: faults.Bench, fault: Callable[..., faults.Row]) -> None:
    row = fault(bench, 1)
    assert row.details == []
    assert row.trials == 1


@pytest.mark.parametrize("fault", [faults.file_too_large, faults.read_only], ids=lambda f: f.__name__)
def test_a_folder_that_refuses_writes_keeps_what_it_has(bench: faults.Bench, fault: Callable[..., faults.Row]) -> None:
    row = fault(bench, 1)
    assert row.details == []
    if row.trials == 0:
        pytest.skip(row.note)


def test_the_inspection_of_a_folder_finds_what_is_broken(bench: faults.Bench, tmp_path: Path) -> None:
    out = tmp_path / "out"
    faults.finished(bench, out)
    assert faults.half_written(out) == []
    for name in ("results.nc", "run.json", "report.html", "figures/hard_cases.svg"):
        whole = (out / name).read_bytes()
        (out / name).write_bytes(whole[: len(whole) // 2])
        assert len(faults.half_written(out)) == 1, name
        (out / name).write_bytes(whole)


def test_bad_input_is_refused_with_a_message(tmp_path: Path) -> None:
    kept: list[int] = []
    tally = fuzz.campaign(tmp_path, inputs=INPUTS, seed=2, keep=lambda _path, number: kept.append(number))
    assert tally.findings == []
    assert kept == []
    assert tally.inputs == INPUTS
    # A fuzzer that nothing survives, or that changes nothing, would test little.
    assert INPUTS // 100 < tally.outcomes["planned"] + tally.outcomes["no plan"] < INPUTS // 2


def test_the_fuzzer_detects_a_breach(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(fuzz.api, "load", crash)
    tally = fuzz.campaign(tmp_path, inputs=5, seed=0, keep=lambda _path, _number: None)
    assert len(tally.findings) == 5
    assert tally.outcomes["traceback"] == 5
