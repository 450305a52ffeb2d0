"""From `cost` to the report of `run`: shown for the same study on the same machine, and for nothing else."""

from __future__ import annotations

import html
import json
import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from tradestudy import api
from tradestudy.api import Study
from tradestudy.cli import app
from tradestudy.cost import depth_reference, measuring, stored
from tradestudy.cost.measuring import Allowance, forget, measure
from tradestudy.cost.study_cost import study_cost
from tradestudy.errors import OutOfRangeError
from tradestudy.figures.cost import cost_drawing, measured_quantities
from tradestudy.optics.quadrature import gauss_legendre
from tradestudy.provenance import code_hash
from tradestudy.report.document import Table
from tradestudy.report.sections.cost import Measuring
from tradestudy.report.sections.cost import describe_cost as cost_section
from tradestudy.results import GROUPS

ASKED = "What would one more digit cost?"
HERE = Measuring(file="one.yaml")


@pytest.fixture(scope="module", autouse=True)
def budgets_of_processor_time() -> Iterator[None]:
    """What else runs on the machine does not decide how much fits a budget here."""
    with pytest.MonkeyPatch.context() as patch:
        for timing in (measuring, depth_reference):
            patch.setattr(timing, "time", SimpleNamespace(perf_counter=time.process_time))
        yield


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "small.yaml"
    path.write_text(api.starter("small"), encoding="utf-8")
    return api.load(path)


@pytest.fixture(scope="module")
def folder(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cost and no run."""
    directory = tmp_path_factory.mktemp("out")
    api.cost(study, directory, budget=2.0)
    return directory


def test_runs_never_measure_and_show_the_last_cost_or_say_how_to_get_one(study: Study, tmp_path: Path) -> None:
    def report() -> str:
        return (tmp_path / "report.html").read_text(encoding="utf-8")

    api.run(study, tmp_path, pdf=False)
    assert ASKED not in report()
    how = f"python -m tradestudy cost {study.definition.document.locate(()).file} --out DIR"
    assert how in report()
    results = (tmp_path / "results.nc").read_bytes()
    assert api.is_finished(study, tmp_path)
    api.cost(study, tmp_path, budget=6.0)  # renders the finished run's report again
    assert ASKED in report()
    assert "a tenth of that" in report()
    assert not (tmp_path / "report.pdf").exists()
    for name in ("report.html", "figures/cost.svg", "tables/cost_by_entry.csv"):
        (tmp_path / name).unlink()
    measured = (tmp_path / stored.COST).read_bytes()
    api.run(study, tmp_path, pdf=False)
    assert ASKED in report()
    assert (tmp_path / "figures" / "cost.svg").is_file()
    assert "linear in inverse depth" in (tmp_path / "tables" / "cost_by_entry.csv").read_text(encoding="utf-8")
    assert (tmp_path / "results.nc").read_bytes() == results
    assert (tmp_path / stored.COST).read_bytes() == measured


def test_the_command_says_which_report_shows_it(study: Study, tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(api.starter("small"), encoding="utf-8")
    out = tmp_path / "out"
    found = CliRunner().invoke(app, ["cost", str(tmp_path / "small.yaml"), "--out", str(out), "--budget", "3"])
    assert found.exit_code == 0
    assert str(out / "cost.json") in found.output
    assert (
        "The report of the next `run` of this study into this folder shows it, given the same options." in found.output
    )
    assert not (out / "report.html").exists()
    (told,) = [line for line in found.output.splitlines() if line.startswith("Depth uncertainty: ")]
    assert " a run (linear in inverse depth) errs by " in told
    assert not api.is_finished(study, out)


def test_a_report_says_the_command_that_measures_its_cost_and_that_command_does(tmp_path: Path) -> None:
    file, out = tmp_path / "small.yaml", tmp_path / "out"
    file.write_text(api.starter("small"), encoding="utf-8")

    def report() -> str:
        return html.unescape((out / "report.html").read_text(encoding="utf-8"))

    def invoke(*given: str) -> None:
        found = CliRunner().invoke(app, [*given, "--quiet"])
        assert found.exit_code == 0, found.output

    invoke("run", str(file), "--tolerance", "10 %", "--set", "stereo.baseline=60 mm", "--out", str(out), "--no-pdf")
    (said,) = set(re.findall(r"python -m tradestudy (cost [^<]*)<", report()))
    assert said == f"cost {file} --set 'cameras.stereo.baseline=60 mm' --tolerance '10 %' --out DIR"
    assert "lies there" not in report()
    invoke("cost", str(file), "--tolerance", "1 %", "--out", str(out), "--budget", "0.1")  # that of another study
    api.report(out, pdf=False)
    assert ASKED not in report()
    told = "with --tolerance '1 %'"
    assert f"A cost.json that lies there now was measured for small as it stood then, {told}." in report()
    invoke(*shlex.split(said.replace("DIR", str(out))), "--budget", "0.5")
    assert ASKED in report()


def test_a_cost_of_another_study_or_machine_is_not_shown(
    study: Study, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stored.read_cost(folder, study.hash) is not None
    other = study.with_values({"scene.distances.to": "4 m"})
    assert other.hash != study.hash
    assert stored.read_cost(folder, other.hash) is None
    monkeypatch.setattr(stored, "identity", lambda: {"processor": "another", "architecture": "x", "cores": 1})
    assert stored.read_cost(folder, study.hash) is None


def test_a_cost_with_other_variables_is_as_none(study: Study, folder: Path, tmp_path: Path) -> None:
    cost = stored.read_cost(folder, study.hash)
    assert cost is not None
    stored.write_cost(cost.drop_vars("reference_seconds"), tmp_path)
    assert stored.read_cost(tmp_path, study.hash) is None


@pytest.mark.parametrize("content", [b"", b"not a results file", b"\x89HDF\r\n\x1a\n" + bytes(64)])
def test_a_damaged_cost_is_as_none(study: Study, tmp_path: Path, content: bytes) -> None:
    (tmp_path / stored.COST).write_bytes(content)
    assert stored.read_cost(tmp_path, study.hash) is None


def test_an_interrupted_measurement_leaves_the_last_one(study: Study, folder: Path) -> None:
    before = {name: (folder / name).read_bytes() for name in (stored.COST, stored.SUMMARY)}

    def interrupt(_step: str, share: float) -> None:
        if share > 0.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        api.cost(study, folder, budget=1.0, progress=interrupt)
    assert {name: (folder / name).read_bytes() for name in before} == before
    assert not list(folder.glob(".*.part"))


def test_the_summary_says_what_the_table_says(study: Study, folder: Path) -> None:
    cost = stored.read_cost(folder, study.hash)
    summary = json.loads((folder / stored.SUMMARY).read_text(encoding="utf-8"))
    assert cost is not None
    assert [row["model"] for row in summary["entries"]] == cost["model"].values.tolist()
    assert summary["study_hash"] == study.hash
    assert {"machine", "measured", "load_average"} <= set(summary)
    assert {name: array.attrs["units"] for name, array in cost.data_vars.items()} == {
        str(name): GROUPS["cost"][str(name)].units for name in cost.data_vars
    }


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "linear in inverse depth"),
        ({"effects.calibration": "exact", "propagation.max_draws": 4096}, "scrambled Sobol, until 1 %"),
        ({"effects.calibration": "off"}, "noise alone, exactly"),
        (
            {"cameras.stereo.calibration": None},
            "what acts in each camera, linear in inverse depth: Plenoptic 25 mm; "
            "noise alone, exactly: Stereo 300 mm base",
        ),
    ],
)
def test_the_chosen_way_is_the_one_that_depth_is_computed_by(
    study: Study, changes: dict[str, object], words: str
) -> None:
    cost = study.with_values(changes).cost(budget=2.0)
    (chosen,) = np.flatnonzero(cost["chosen"].values)
    assert ", ".join(filter(None, (str(cost[name].values[chosen]) for name in ("model", "setting")))) == words
    assert "what the table of effects calls calibration: linear" in str(cost["notes"].values[0]).lower()
    assert np.all(cost["relative_error"].values >= cost["typical_error"].values)


@pytest.mark.parametrize(("repeats", "budget"), [(2, 1.0), (3, 0.0), (3, float("inf"))])
def test_what_cannot_be_measured_is_refused(study: Study, repeats: int, budget: float) -> None:
    with pytest.raises(OutOfRangeError) as error:
        study_cost(study.definition, repeats=repeats, budget=budget)
    assert ("such as 600" in str(error.value)) == (repeats == 3)


def test_what_does_not_fit_is_left_out_and_named(study: Study) -> None:
    found = study.cost(budget=1e-3)
    assert "no time left" in str(found["left_out"].values[0])
    assert "a larger --budget measures it" in str(found["left_out"].values[0])
    assert found.sizes["entry"] == 0
    assert np.isnan(found["reference_seconds"].values[0])


def test_where_nothing_is_usable_that_is_said(study: Study) -> None:
    strict = study.with_values({"usable_range.relative_uncertainty": "0.00001 %"})
    with pytest.raises(OutOfRangeError, match="none of the cameras is usable at any distance of the study"):
        strict.cost(budget=1.0)


def test_a_camera_that_is_usable_nowhere_is_left_out_and_named(study: Study) -> None:
    strict = study.with_values({"usable_range.relative_uncertainty": "0.5 %"})
    found = strict.cost(budget=2.0)
    assert "Stereo 300 mm base at up to" in str(found["says"].values[0])
    assert "Plenoptic 25 mm: usable at no distance of the study" in str(found["left_out"].values[0])


def test_depth_that_is_measured_nowhere_stands_beside_what_has_a_cost(study: Study) -> None:
    part = {"range": ["1 m", "2 m"], "criteria": {"one-pixel": {"blur": "1 px"}}}
    nowhere = study.with_values({"usable_range.relative_uncertainty": "0.00001 %", "depth_of_field": part})
    found = nowhere.cost(budget=2.0)
    left_out = dict(zip(found["cost_quantity"].values.tolist(), found["left_out"].values.tolist(), strict=True))
    assert "usable at no distance" in left_out["depth_uncertainty"]
    assert "depth_of_field" in left_out


def test_keeping_time_for_a_reference_shortens_what_comes_before_it() -> None:
    allowance = Allowance(seconds=100.0)
    before = allowance.keeping(90.0)
    assert before.allows(9.9)
    assert not before.allows(10.1)
    assert not allowance.keeping(200.0).allows(1e-3)


def test_a_quantity_that_nothing_answers_has_no_panel(study: Study, folder: Path) -> None:
    cost = stored.read_cost(folder, study.hash)
    assert cost is not None
    assert measured_quantities(cost) == ["depth_uncertainty"]
    answerless = cost.assign(relative_error=cost["relative_error"] * np.inf)
    assert measured_quantities(answerless) == []
    assert cost_drawing(xr.DataTree.from_dict({"/cost": cost})).draw().svg()
    tree = xr.DataTree.from_dict({"/depth": xr.Dataset(), "/cost": answerless})
    (table,) = [
        block for block in cost_section(tree, {}, HERE) if isinstance(block, Table) and block.name.endswith("-table")
    ]
    assert {row[1] for row in table.rows} == {"no answer"}


def test_every_run_starts_afresh() -> None:
    gauss_legendre(7)
    code_hash()
    assert gauss_legendre.cache_info().currsize > 0
    forget()
    assert gauss_legendre.cache_info().currsize == 0
    assert code_hash.cache_info().currsize == 1  # no computation of physics
    seen: list[int] = []
    timed = measure(lambda run: seen.append(run) or run, Allowance(seconds=5.0))
    assert seen[:3] == [0, 1, 2]  # random methods take their seed from the number of the run
    assert timed.repeats == len(seen) - 1 >= 3


def test_what_is_timed_once_is_said_to_be(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "_LONG", 0.0)  # as if everything took 5 s
    seen: list[int] = []
    assert measure(lambda run: seen.append(run), Allowance(seconds=5.0)).repeats == 1
    assert seen == [0]
    found = study.cost(budget=2.0)
    assert set(found["repeats"].values) == {1}
    tree = xr.DataTree.from_dict({"/depth": xr.Dataset(), "/cost": found})
    table = next(
        block for block in cost_section(tree, {}, HERE) if isinstance(block, Table) and block.name.endswith("-table")
    )
    assert {row[5] for row in table.rows} == {"once"}
