"""What a run concludes, read back from its sentences: terminal, JSON and first page say the same as the results."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import tradestudy
from tradestudy import figures
from tradestudy.api import Result
from tradestudy.cli import app
from tradestudy.comparison import compare_runs
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import StudyError
from tradestudy.report.contents import compose_report
from tradestudy.report.document import plain_text
from tradestudy.report.sections.answer import _stretches
from tradestudy.results.views.conclusion_list import conclusions
from tradestudy.results.views.conclusions import best_ranges, measure_first, never_best, rests_on, worths
from tradestudy.results.views.decision import best_cameras, reversing
from tradestudy.results.views.designs import parameter_words, path_words
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_sentence
from tradestudy.results.views.terminal import conclusions_as_json, terminal_lines
from tradestudy.units import LENGTH, pretty

pytestmark = pytest.mark.usefixtures("empty_figures")

STUDIES = Path(__file__).parents[2] / "studies"
ASKED = {
    "requirements": {
        "near-and-mid": None,
        "per-cent": {
            "says": "1 % from 0.4 to 3 m",
            "camera": "any",
            "depth_uncertainty": {"below_relative": "1 %", "over": ["0.4 m", "3 m"]},
        },
        "wish": {
            "says": "an R5 that sees as far",
            "camera": "raytrix-r5",
            "priority": "should",
            "usable": {"over": ["0.4 m", "3 m"]},
        },
    },
    "scene.distances.points": 40,
}
SWEPT = {"sweep": {"stereo-75mm.baseline": {"from": "30 mm", "to": "150 mm", "points": 5}}}
WORTH: dict[str, Any] = {
    "value_of_information": {
        "draws": 64,
        "assumptions": {
            "yaw": {
                "says": "yaw of both heads",
                "vary": [f"stereo-{b}mm.calibration.errors.yaw.standard_deviation" for b in (50, 75)],
                "low": "0.001 deg",
                "high": "0.1 deg",
            },
            "light": {"vary": "scene.picture.light.electrons", "low": "500 electrons", "high": "9000 electrons"},
        },
    }
}


def ran(*values: dict[str, Any]) -> Result:
    merged: dict[str, Any] = {}
    for one in values:
        merged |= one
    return tradestudy.load(STUDIES / "robot.yaml").with_values(merged).run()


@pytest.fixture(scope="module")
def swept() -> Result:
    return ran(ASKED, SWEPT)


@pytest.fixture(scope="module")
def valued() -> Result:
    return ran(ASKED, WORTH)


def test_one_camera_is_usable_rather_than_best(swept: Result) -> None:
    tree = xr.DataTree.from_dict(
        {name: swept.data[name].to_dataset().sel(camera=["stereo-75mm"]) for name in ("cameras", "decision", "depth")}
    )
    lines = list(terminal_lines(tree))
    assert " 75 mm stereo head is usable from 0.3 to 4 m, with " in lines[0]
    assert not any(one.startswith(("Best", "Usable")) for one in lines), "the first line says it"


def test_the_terminal_names_the_camera_the_baseline_and_what_the_answer_rests_on(swept: Result) -> None:
    answer, met, wish, weighed, rests, best = swept.lines()
    assert re.fullmatch(
        r"Take the 75 mm stereo head with baseline from 53\.\d mm on \(the sweep ends at 150 mm\): 5 of 6 designs "
        r"meet the requirement with one of the cameras\.",
        answer,
    )
    assert re.fullmatch(
        r"Best, as declared: 75 mm stereo head from 0\.3 to 4 m; 50 mm stereo head is best nowhere \(at least 1\.4 "
        r"times as uncertain\); Raytrix R5 is best nowhere \(at least 18 times as uncertain\)",
        best,
    )
    found = re.fullmatch(
        r"Met if matching is as exact as the pictures allow: 1 % from 0\.4 to 3 m, by 75 mm stereo head "
        r"\(worst ([\d.]+) % at 3 m; "
        r"(\d+) % to spare\); not by 50 mm stereo head \([\d.]+ % at 3 m\) and Raytrix R5 \(not usable from 1\.8\d* to "
        r"3 m: too uncertain; worst [\d.]+ % at 3 m\); met with the "
        r"baseline of the 75 mm stereo head from ([\d.]+) mm on \(the sweep ends at 150 mm\) by 75 mm stereo head; "
        r"nowhere by 50 mm stereo head and Raytrix R5",
        met,
    )
    assert found
    worst, spare, begins = map(float, found.groups())
    case = tradestudy.load(STUDIES / "robot.yaml").prepared.case
    truth = depth_uncertainty(case.cameras["stereo-75mm"], np.array([3.0]))[0] / 3.0
    assert worst / 100.0 == pytest.approx(truth, rel=0.02)
    assert spare / 100.0 == pytest.approx(0.01 / truth - 1.0, rel=0.05)
    assert begins == pytest.approx(53.4, rel=0.02)
    assert wish.startswith("Not met: an R5 that sees as far (should), not by Raytrix R5 (")
    assert re.search(r"1\.8\d* to 3 m", wish)
    assert "missed by" not in wish  # a share of the range on a logarithmic scale would mean nothing to a reader
    assert "design" not in wish  # the sweep varies another camera
    first = next(row for row in conclusions_as_json(swept.data)["trade_off"] if row["camera"] == "50 mm stereo head")
    shown = re.fullmatch(
        r"Weighing all criteria: 50 mm stereo head ranks first for (\d+) % of the possible weights; .*", weighed
    )
    assert shown
    assert float(shown[1]) == pytest.approx(100.0 * first["first"], abs=0.51)
    assert re.fullmatch(
        r"Rests on \(measure first\): yaw of the 75 mm stereo head, assumed 0\.01° \(9\d % of the variance at 3 m\); "
        r"matching noise of the Raytrix R5.*",
        rests,
    )


def test_json_has_the_numbers_of_the_results(swept: Result) -> None:
    reported = json.loads(json.dumps(swept.conclusions("somewhere"), allow_nan=False))
    data = swept.data["requirements"].to_dataset()
    assert reported["format"] == 1
    assert reported["report"] == str(Path("somewhere") / "report.html")
    one = next(row for row in reported["requirements"] if row["name"] == "per-cent")
    here = data.sel(requirement="per-cent")
    assert one["met"] is True
    assert one["margin"] == pytest.approx(float(here["margin_percent"]) / 100.0)
    assert one["met_with"][0]["from"] == float(here["met_from"].values[0])
    assert one["designs_met"] == int((here["design_met"].values == 1).sum())
    assert reported["best"] == [{"near": 0.3, "far": 4.0, "cameras": ["75 mm stereo head"]}]


def test_what_must_hold_comes_first_and_counts_for_strict(swept: Result) -> None:
    assert [one.priority for one in requirement_conclusions(swept.data)] == ["must", "should"]
    assert swept.unmet_requirements == []


def test_every_outcome_of_a_requirement_is_reported(swept: Result) -> None:
    def reported(**changes: Any) -> str:
        tree = swept.data.copy()
        data = tree["requirements"].to_dataset().copy(deep=True)
        for name, value in changes.items():
            data[name][{"requirement": 0}] = value
        tree["requirements"] = xr.DataTree(data)
        one = next(c for c in requirement_conclusions(tree) if c.name == "per-cent")
        return requirement_sentence(one)

    assert reported(met=0, margin_percent=-12.0).startswith("Not met: 1 % from 0.4 to 3 m; closest: 75 mm stereo head")
    assert "missed by a factor of 1.14" in reported(met=0, margin_percent=-12.0)
    assert "factor" not in reported(met=0, margin_percent=-12.0, limited_by="overlap")
    assert reported(met=-1, margin_percent=np.nan).startswith("Cannot be decided: 1 %")
    by = " by 75 mm stereo head; nowhere by 50 mm stereo head and Raytrix R5"
    assert reported(met_from=0.06, met_to=0.09).endswith(f"from 60 mm to 90 mm{by}")
    assert reported(met_from=0.03, met_to=0.09).endswith(f"up to 90 mm (the sweep begins at 30 mm){by}")
    assert reported(met_from=0.03, met_to=0.15).endswith(f"anywhere from 30 mm to 150 mm{by}")
    assert reported(met_from=np.nan, met_to=np.nan).endswith("met by no design that was tried")


def test_a_few_lines_are_enough_and_the_rest_is_counted(swept: Result) -> None:
    assert len(swept.lines()) == 6
    _, more, rests, _ = terminal_lines(swept.data, 4)
    assert re.search(r"\b3 more conclusions .*\b1 requirement not met", more)
    assert rests.startswith("Rests on (measure first)")


def test_answers_to_questions_come_before_a_second_requirement(swept: Result) -> None:
    tree = swept.data.copy()
    asked = {"solved_says": ("question", ["which?"]), "solved_answer": ("question", ["53.4 mm"])}
    tree["decision"] = xr.DataTree(tree["decision"].to_dataset().drop_dims("question", errors="ignore").assign(asked))
    lines = list(terminal_lines(tree, 20))
    first, second = (lines.index(requirement_sentence(one)) for one in requirement_conclusions(tree))
    assert first < lines.index("which? 53.4 mm") < second
    assert "which? 53.4 mm" in terminal_lines(tree, 1)  # however few lines there may be


def test_the_terminal_says_whose_calibration_is_assumed_perfect(swept: Result) -> None:
    assert not any("perfect" in line for line in swept.lines())  # all three declare errors
    tree = swept.data.copy()
    cameras = tree["cameras"].to_dataset().copy(deep=True)
    cameras["perfect_calibration"][:] = [1.0, 0.0, 1.0]
    tree["cameras"] = xr.DataTree(cameras)
    titles = cameras["title"].values
    *others, last, _ = terminal_lines(tree)
    unfair = ", which favours them over the others"
    assert last == f"Assumed perfect: the calibration of {titles[0]} and {titles[2]}{unfair}"
    cameras["perfect_calibration"][:] = 1.0
    tree["cameras"] = xr.DataTree(cameras)
    assert "favours" not in list(terminal_lines(tree))[-2]
    assert len(others) == 4
    assert list(terminal_lines(tree, 1))[1].startswith("and ")  # a shorter answer still counts what it leaves out


def test_paths_are_written_in_words(swept: Result) -> None:
    assert path_words(swept.data, "stereo-75mm.baseline") == "baseline of the 75 mm stereo head"
    paths = ("cameras.raytrix-r5.main_lens.f_number", "cameras.raytrix-r5.microlenses.gap", "seed")
    assert parameter_words(swept.data, paths) == "main lens f-number and microlenses gap of the Raytrix R5 and seed"
    assert path_words(swept.data, "cameras.raytrix-r5.main_lens.f_number") == "main lens f-number of the Raytrix R5"
    assert path_words(swept.data, "scene.wavelength") == "scene wavelength"


def test_assumptions_are_ranked_and_probabilities_lie_between_0_and_1(valued: Result) -> None:
    data = valued.data["value_of_information"].to_dataset()
    assert [one.worth for one in worths(valued.data)] == sorted(data["worth"].values.tolist(), reverse=True)
    assert np.all(data["best_probability"].values >= 0.0)
    assert np.all(data["best_probability"].sum("candidate").values <= 1.0)
    assert float(data["best_overall"].sum()) == pytest.approx(1.0)
    assert np.all(data["worth"].values <= data.attrs["worth_of_all"] + 3.0 * data.attrs["worth_of_all_error"])
    assert measure_first(valued.data)
    # A requirement that yaw alone decides: its probability is the share of yaws below the one that just meets it.
    probability = float(data["requirement_probability"].sel(requirement="per-cent"))
    assert 0.1 < probability < 0.9
    assert conclusions_as_json(valued.data)["assumptions"][0]["assumption"] in (
        "yaw of both heads",
        "light electrons",
    )


def test_one_assumption_alone_is_worth_what_nested_quadrature_says() -> None:
    """Of two decisions by one assumption, partial and perfect information are the same; the mean is an integral."""
    yaw = WORTH["value_of_information"]["assumptions"]["yaw"]
    only = {"value_of_information": {"draws": 128, "assumptions": {"yaw": yaw}}}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values({**ASKED, **only})
    data = study.run().data["value_of_information"].to_dataset()
    places = data["place"].values
    definition = study.plan().study

    def utilities(angle: float) -> list[float]:
        case = definition.with_values(dict.fromkeys(yaw["vary"], f"{angle} deg")).case
        found = []
        for name in data["candidate"].values:
            relative = depth_uncertainty(case.cameras[name], places) / places
            found.append(-float(np.mean(np.where(relative <= 0.1, relative, 1.0))))  # usable up to 10 %
        return found

    shares = (np.arange(32) + 0.5) / 32
    table = np.array([utilities(1e-3 * 100.0**share) for share in shares])
    truth = table.max(axis=1).mean() - table.mean(axis=0).max()
    assert float(data["worth"].values[0]) == pytest.approx(truth, abs=3.0 * float(data["worth_error"].values[0]) + 1e-3)
    assert data.attrs["worth_of_all"] == pytest.approx(truth, abs=3.0 * data.attrs["worth_of_all_error"] + 1e-3)


def test_a_run_with_changed_values_has_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    study = STUDIES / "robot.yaml"
    plain = tradestudy.load(study)
    other = tradestudy.load(study, ["stereo-75mm.baseline=90 mm"], tolerance="5 %")
    assert plain.folder_name == "robot"
    assert other.folder_name == "robot--cameras.stereo-75mm.baseline=90mm--tolerance=5%"
    long = tradestudy.load(study, ["title=" + "x" * 300])
    assert len(long.folder_name) < 100
    assert long.folder_name != tradestudy.load(study, ["title=" + "x" * 301]).folder_name
    few = ["--set", "scene.distances.points=5", "--set", "title=Few"]
    reported = CliRunner().invoke(app, ["run", str(study), *few, "--no-pdf", "--json"])
    assert reported.exit_code == 0, reported.output
    assert json.loads(reported.stdout)["study"] == "robot"
    assert [one.name for one in (tmp_path / "reports").iterdir()] == [
        tradestudy.load(study, [few[1], few[3]]).folder_name
    ]


def test_the_inputs_that_the_answer_rests_on_have_their_basis(swept: Result) -> None:
    assert rests_on(swept.data)[0].startswith("yaw of the 75 mm stereo head, assumed 0.01 deg")
    causes = swept.data["decision"].to_dataset()["cause"]
    assert str(causes.sel(camera="raytrix-r5").item()) == "matching noise of the Raytrix R5, derived from the picture"
    assert [one.words for one in best_ranges(swept.data)] == ["75 mm stereo head from 0.3 to 4 m"]


@pytest.mark.parametrize("title", ["Rig, assumed stiff", "Rig; left"])
@pytest.mark.parametrize(
    ("basis", "words"), [("datasheet", "0.01 deg from the data sheet"), ("assumed", "assumed 0.01 deg")]
)
@pytest.mark.parametrize("asked", [True, False])
def test_only_an_input_with_an_assumed_basis_is_to_be_measured(title: str, basis: str, words: str, asked: bool) -> None:
    """Whatever the title of its camera says."""
    yaw = {"value": "0.01 deg", "basis": basis}
    wish = {
        "says": "fine",
        "camera": "stereo-75mm",
        "depth_uncertainty": {"below_relative": "1 %", "over": ["1 m", "3 m"]},
    }
    changes = {"stereo-75mm.title": title, "stereo-75mm.calibration.errors.yaw.standard_deviation": yaw}
    requirements = {"near-and-mid": None, **({"fine": wish} if asked else {})}
    result = ran(changes, {"requirements": requirements, "scene.distances": ["1 m", "2 m", "3 m"]})
    (said,) = rests_on(result.data)
    assert said.startswith(f"yaw of the {title}, {words} (")
    assert measure_first(result.data) == (f"Measure first: {said}" if basis == "assumed" else "")


def test_results_without_stored_bases_name_no_assumption_to_measure(swept: Result) -> None:
    old = {
        name: node.to_dataset().drop_vars(("cause_basis", "rests_on_basis"), errors="ignore")
        for name, node in swept.data.children.items()
    }
    tree = xr.DataTree.from_dict(old)
    assert set(rests_on(tree)) == set(rests_on(swept.data))
    assert measure_first(swept.data).startswith("Measure first: yaw of the 75 mm stereo head, assumed 0.01 deg")
    assert measure_first(tree) == ""
    assert not any("measure first" in one.lower() for one in terminal_lines(tree))


def test_where_a_limit_decides_the_answer_rests_on_it() -> None:
    """At 0.1 m pictures are blurred beyond what windows of this size can match, however well the rig is calibrated."""
    near = {"says": "close", "camera": "stereo-75mm", "usable": {"over": ["0.05 m", "1 m"]}}
    result = ran({"requirements": {"near-and-mid": None, "near": near}, "scene.distances": ["0.3 m", "1 m"]})
    (row,) = requirement_conclusions(result.data)
    assert not row.met
    assert row.limited_by.startswith("matching: ")
    assert np.isnan(row.rests_on_share)
    (said,) = rests_on(result.data)
    assert "75 mm stereo head" in said
    assert row.limited_by.removeprefix("matching: ") in said
    assert "variance" not in said
    assert measure_first(result.data) == ""


def test_an_assumed_focus_that_ends_the_usable_range_is_an_assumption() -> None:
    """At 0.1 m, f = 2.65 mm at f/2, focused at 1 m, blurs over 1.325 mm · 2.65/997.35 · 0.9/0.1 = 31.7 um: 11 px."""
    near = {"says": "close", "camera": "stereo-75mm", "usable": {"over": ["0.1 m", "1 m"]}}
    limits = {"overlap": "1 %", "relative_uncertainty": None, "blur": "1 px"}
    asked = {"usable_range": limits, "requirements": {"near-and-mid": None, "near": near}}
    asked |= {"stereo-75mm.depth.disparity_error": "0.1 px", "scene.distances": ["0.3 m", "1 m"]}
    assumed = ran(asked)
    (said,) = rests_on(assumed.data, only_assumed=True)
    assert said == (
        "the usable range of 75 mm stereo head (out of focus, by its assumed f-number of 2 and focus distance of 1 m)"
    )
    assert measure_first(assumed.data) == f"Measure first: {said}"
    known = {
        f"stereo-75mm.{key}": {"value": value, "basis": "measured"}
        for key, value in {"lenses.f_number": 2, "focus_distance": "1 m"}.items()
    }
    assert rests_on(ran(asked | known).data) == ("the usable range of 75 mm stereo head (out of focus)",)


def test_where_errors_decide_a_whole_range_the_answer_rests_on_their_largest_cause() -> None:
    """Beyond 1.1 m the R5 is too uncertain throughout, so that no share of the range is usable at all."""
    far = {"says": "far", "camera": "raytrix-r5", "usable": {"over": ["2 m", "4 m"]}}
    result = ran({"requirements": {"near-and-mid": None, "far": far}, "scene.distances": ["0.3 m", "1 m", "4 m"]})
    (row,) = requirement_conclusions(result.data)
    assert (row.met, row.limited_by) == (False, "relative_uncertainty")
    assert row.rests_on == "matching noise of the Raytrix R5, derived from the picture"
    assert row.rests_on_share > 0.9


def test_comparing_begins_with_conclusions_that_changed(swept: Result) -> None:
    narrow = {"stereo-75mm.baseline": "40 mm", "stereo-50mm.baseline": "40 mm"}
    other = ran(ASKED, narrow)
    found = compare_runs(["wide", "narrow"], [{}, {}], [swept.data, other.data])
    first, *rest = found.sentences()
    assert re.fullmatch(
        r'Requirement "1 % from 0\.4 to 3 m": met if matching is as exact as the pictures allow → not met '
        r"\(75 mm stereo head: worst 0\.7\d+ % → 1\.3\d* % at 3 m\)\.",
        first,
    )
    assert not any("1 % from" in one for one in rest)
    same = compare_runs(["one", "other"], [{}, {}], [swept.data, swept.data])
    assert same.conclusions == ()
    assert same.unchanged[0] == "2 requirements"


def test_a_range_of_a_sweep_that_moved_is_a_conclusion(swept: Result) -> None:
    """Depth uncertainty by yaw goes as Z² ψ / B: a third more yaw takes a third more baseline."""
    yaw = "stereo-75mm.calibration.errors.yaw.standard_deviation"
    found = compare_runs(["x", "y"], [{}, {}], [swept.data, ran(ASKED, SWEPT, {yaw: "0.0133 deg"}).data])
    (along,) = [one for one in found.conclusions if "baseline of" in one.what]
    assert along.what.startswith('Requirement "1 % from 0.4 to 3 m"')
    assert along.what.endswith("baseline of the 75 mm stereo head")
    ends = [
        float(re.fullmatch(r"met from ([\d.]+) mm on \(the sweep ends at 150 mm\)", value)[1])  # type: ignore[index] # it matches
        for value in along.values
    ]
    assert ends[1] / ends[0] == pytest.approx(1.33, rel=0.02)
    assert all("best camera" in one or "along" in one or "equire" in one or "range" in one for one in found.sentences())


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (["title=Few", "scene.distances.points=5"], ["scene.distances.points=5", "title=Few"], True),
        (["stereo-75mm.baseline=90 mm"], ["cameras.stereo-75mm.baseline=90mm"], True),
        (["title=a b"], ["title=a-b"], False),
        (["title=a--question=b"], ["title=a", "question=b"], False),
        (["title=a/b"], ["title=a-b"], False),
        (["title=../a"], ["title=a"], False),
        (["title=" + "x" * 300], ["title=" + "x" * 299], False),
        (["title=" + "µ" * 60], ["title=" + "µ" * 61], False),
        (["stereo-75mm.baseline=50 mm"], ["stereo-75mm.baseline=5 mm"], False),
    ],
)
def test_a_change_has_a_folder_of_its_own_in_whatever_order_it_is_given(
    one: list[str], other: list[str], same: bool
) -> None:
    folders = [tradestudy.load(STUDIES / "robot.yaml", given).folder_name for given in (one, other)]
    assert (folders[0] == folders[1]) is same
    for folder in folders:
        assert re.fullmatch(r"robot--[\w.+=%-]+", folder)
        assert len(folder.encode()) <= 150


def test_the_curve_of_margins_passes_zero_at_the_limit_that_the_sentence_gives(swept: Result) -> None:
    one = next(one for one in requirement_conclusions(swept.data) if one.name == "per-cent")
    assert one.met_ranges is not None
    drawn = figures.build(swept.data)["requirement_margins"].draw()
    (line,) = [line for line in drawn.axes[0].get_lines() if line.get_label() == one.says]
    x, y = (np.asarray(values, dtype=float) for values in line.get_data())
    assert np.all(np.diff(x) > 0.0)
    crossed = [
        a if before == 0.0 else a + (b - a) * before / (before - after)
        for a, b, before, after in zip(x[:-1], x[1:], y[:-1], y[1:], strict=True)
        if before * after < 0.0 or before == 0.0
    ]
    assert crossed == pytest.approx([1e3 * one.met_ranges[0].low], rel=1e-9)
    assert len(line.get_markevery()) == len(swept.data["depth"]["baseline"])  # only designs are marked


def test_of_many_requirements_the_three_tightest_have_curves_and_the_others_are_counted(swept: Result) -> None:
    tree = swept.data.copy()
    data = tree["requirements"].to_dataset()
    number = [one for one, says in enumerate(data["requirement"].values) if says == "per-cent"] * 5
    many = data.isel(requirement=number).assign_coords(requirement=[f"need-{k}" for k in range(5)])
    many = many.assign(
        says=("requirement", [f"need {k}" for k in range(5)]), margin_percent=("requirement", [5.0, 1.0, 4.0, 2.0, 3.0])
    )
    tree["requirements"] = xr.DataTree(many)
    drawing = figures.build(tree)["requirement_margins"]
    assert "2 other requirements" in drawing.caption
    named = {line.get_label() for line in drawing.draw().axes[0].get_lines()}
    assert {one for one in named if str(one).startswith("need")} == {"need 1", "need 3", "need 4"}


def test_a_margin_without_an_end_is_not_said(swept: Result) -> None:
    conclusion = requirement_conclusions(swept.data)[0]
    other = replace(conclusion.others[0], met=True, margin=np.inf)
    words = requirement_sentence(replace(conclusion, others=(other,)))
    assert f"by {other.camera};" in words


def test_margins_without_an_end_are_not_drawn(swept: Result) -> None:
    assert "requirement_margins" in swept.figure_names
    tree = swept.data.copy()
    data = tree["requirements"].to_dataset().copy(deep=True)
    data["design_margin_percent"][:] = np.inf
    tree["requirements"] = xr.DataTree(data)
    assert "requirement_margins" not in figures.build(tree)


def test_alternatives_that_reverse_a_choice_at_other_distances_name_theirs() -> None:
    """A looser baseline scales all depths, which counts where yaw does not: near by; yaw grows with the distance."""
    errors = {"yaw drifts": "yaw.standard_deviation: 0.08 deg", "loose baseline": "baseline.standard_deviation: 1.2 mm"}
    readings = ", ".join(
        f"{says.split()[1]}: {{says: {says}, set: {{stereo-75mm.calibration.errors.{error}}}}}"
        for says, error in errors.items()
    )
    given = [
        *("requirements=null", "trade_off=null", "usable_range.relative_uncertainty=null", "scene.distances.points=9"),
        "stereo-50mm.calibration.errors.baseline={standard_deviation: 0.6 mm}",
        "stereo-75mm.calibration.errors.baseline={standard_deviation: 0.01 mm}",
        *("decision.at=[0.35 m, 4 m]", f"readings={{{readings}}}"),
    ]
    data = tradestudy.load(STUDIES / "robot.yaml", given).run().data
    (said,) = (one.rest().replace("\N{NO-BREAK SPACE}", " ") for one in conclusions(data) if one.kind == "reversed")
    assert "“loose baseline” (at 0.35 m)" in said
    assert "“yaw drifts” (at 4 m)" in said
    by = conclusions_as_json(data)["reversed_by"]
    assert sorted(by, key=str) == [
        {"reading": says, "at": [at]} for says, at in (("loose baseline", 0.35), ("yaw drifts", 4.0))
    ]
    tree = data.copy()
    alike = tree["decision"].to_dataset()
    tree["decision"] = xr.DataTree(alike.assign(reading_says=("reading", ["as declared", "other", "other"])))
    assert reversing(tree) == (("other", [0.35]), ("other", [4.0]))  # not one reading at both


def test_readings_can_be_unknowns() -> None:
    """A sharper and a duller reading of the yaw: knowing which decides nothing that the declared heads do not."""
    readings = {
        "careless": {
            "says": "yaw of 0.2°",
            "set": {f"stereo-{b}mm.calibration.errors.yaw.standard_deviation": "0.2 deg" for b in (50, 75)},
        }
    }
    which = {"says": "who calibrates", "readings": ["careless"]}
    study = tradestudy.load(STUDIES / "robot.yaml").with_values(
        {**ASKED, "readings": readings, "value_of_information": {"draws": 64, "assumptions": {"who": which}}}
    )
    data = study.run().data["value_of_information"].to_dataset()
    assert data["between"].values.tolist() == ["as declared; yaw of 0.2°"]
    places, names = data["place"].values, data["candidate"].values
    losses = []
    for definition in (study.plan().study, study.plan().study.readings["careless"]):
        cameras = definition.case.cameras
        relative = [depth_uncertainty(cameras[name], places) / places for name in names]
        losses.append([float(np.mean(np.where(one <= 0.1, one, 1.0))) for one in relative])
    # Half of the draws each: the means are exact.
    np.testing.assert_allclose(data["expected_utility"].values, -np.mean(losses, axis=0), rtol=0.02)
    # One assumption alone: knowing it is knowing all.
    assert data["worth"].values[0] == pytest.approx(data.attrs["worth_of_all"], abs=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"decision.candidates": ["stereo-50mm", "stereo-50mm"]}, r"decision\.candidates\.1: is listed twice"),
        (
            {"solve": {"size": {"says": "how large", "vary": "stereo-50mm.title", "low": "1 m", "high": "2 m",
                                "camera": "stereo-50mm", "relative": "2 %", "at": "1 m"}}},
            r"solve\.size\.vary: stereo-50mm\.title: is text; vary a number",
        ),
        (
            {"requirements": {"few": {"says": "few", "camera": "any",
                                      "failed_fraction": {"below": "200 %", "over": ["1 m", "2 m"]}}}},
            r"failed_fraction\.below: '200 %' is out of range",
        ),
    ],
)  # fmt: skip
def test_questions_without_an_answer_are_refused_at_their_place(change: dict[str, object], message: str) -> None:
    overrides = [f"{path}={json.dumps(value)}" for path, value in change.items()]
    with pytest.raises(StudyError, match=message):
        tradestudy.load(STUDIES / "robot.yaml", overrides)


def test_a_value_that_two_assumptions_vary_is_refused_at_the_second() -> None:
    yaw = WORTH["value_of_information"]["assumptions"]["yaw"]
    readings = {"careless": {"says": "worse", "set": {yaw["vary"][0]: "0.2 deg"}}}
    both = {"yaw": yaw, "who": {"readings": ["careless"]}}
    with pytest.raises(StudyError, match=r"who\.readings: 'yaw' already varies"):
        tradestudy.load(STUDIES / "robot.yaml").with_values(
            {"readings": readings, "value_of_information": {"assumptions": both}}
        )
    with pytest.raises(StudyError, match=r"no reading is called 'careles'.*careless"):
        tradestudy.load(STUDIES / "robot.yaml").with_values(
            {"readings": readings, "value_of_information": {"assumptions": {"who": {"readings": ["careles"]}}}}
        )
    with pytest.raises(StudyError, match="give either vary, low and high, or readings"):
        tradestudy.load(STUDIES / "robot.yaml").with_values(
            {"value_of_information": {"assumptions": {"who": {"vary": "scene.wavelength"}}}}
        )


def test_the_readings_that_change_a_verdict_are_named() -> None:
    """As runs with the values of each reading say; a reading that changes nothing goes without mention."""
    bound = {"below": "2.6 mm", "over": ["0.4 m", "1 m"]}
    needed = {"says": "2.6 mm", "camera": "stereo-75mm", "depth_uncertainty": bound}
    others = dict.fromkeys(("trade_off", "decision", "stereo-50mm", "raytrix-r5"))
    small = {"requirements": {"near-and-mid": needed}, "scene.distances.points": 8, **others}
    sets: dict[str, dict[str, Any]] = {
        "dim": {"scene.picture.light.electrons": "400 electrons"},
        "dull": {"scene.picture.texture.contrast": "12 %"},
        "careless": {"stereo-75mm.calibration.errors.yaw.standard_deviation": "0.1 deg"},
    }
    readings = {name: {"says": f"the {name} one", "set": values} for name, values in sets.items()}
    data = ran(small, {"readings": readings}).data
    alone = {name: ran(small, sets[name]).data["requirements"].to_dataset() for name in ("dim", "dull")}
    found = data["requirements"].to_dataset().squeeze("requirement")
    assert found["met"] == 1
    for name, one in alone.items():
        under = found.sel(reading=name)
        assert under["reading_met"] == one["met"].item()
        assert under["reading_camera"] == one["camera_deciding"].item()
    assert found["reading_met"].values.tolist() == [0, 1, 0]
    (conclusion,) = requirement_conclusions(data)
    assert [other.says for other in conclusion.other_verdicts] == ["the dim one", "the careless one"]
    assert "not met under 2 of the 3 alternative assumptions" in requirement_sentence(conclusion)
    (as_json,) = conclusions_as_json(data)["requirements"]
    assert [other["met"] for other in as_json["other_verdicts"]] == [False, False]


def test_a_reading_that_changes_who_meets_a_requirement_is_named() -> None:
    """Depth error by yaw: Z² ψ / B. At 0.4 m, 0.05° is 2 mm for b (70 mm); a (60 mm) then meets 1 mm alone."""
    lenses = {"focal_length": "12 mm", "f_number": 8}
    sensor = {"pixels": [2448, 2048], "pixel_pitch": "3.45 um"}
    errors = {"yaw": {"standard_deviation": "0.02 deg"}}
    a = {
        "kind": "stereo",
        "lenses": lenses,
        "sensor": sensor,
        "baseline": "60 mm",
        "depth": {"disparity_error": "0.1 px"},
    }
    yaw = "calibration.errors.yaw.standard_deviation"
    readings = {
        "one": {"says": "a drifting yaw of b", "set": {f"b.{yaw}": "0.05 deg"}},
        "both": {"says": "two drifting yaws", "set": {f"b.{yaw}": "0.05 deg", f"a.{yaw}": "0.05 deg"}},
    }
    needed = {"says": "1 mm", "camera": "any", "depth_uncertainty": {"below": "1 mm", "at": "0.4 m"}}
    study = {
        **{"format": 2, "study": "who", "title": "Who", "question": "Who?", "readings": readings},
        "cameras": {"a": a | {"calibration": {"errors": errors}}, "b": {"like": "a", "baseline": "70 mm"}},
        "scene": {"distances": ["0.3 m", "0.4 m"], "wavelength": "550 nm"},
        "requirements": {"close": needed},
    }
    data = tradestudy.load(study).run().data
    (conclusion,) = requirement_conclusions(data)
    assert (conclusion.met, conclusion.camera) == (True, "b")
    assert [(one.met, one.camera) for one in conclusion.other_verdicts] == [(True, "a"), (False, "b")]
    assert "by a if instead “a drifting yaw of b” and not met if instead “two drifting yaws”" in requirement_sentence(
        conclusion
    )


def test_a_verdict_that_numerical_errors_could_reverse_says_how_probable_it_is(valued: Result) -> None:
    one = requirement_conclusions(valued.data)[0]
    assert "given its numerical error" not in requirement_sentence(replace(one, conformity=0.96))
    said = requirement_sentence(replace(one, met=True, conformity=0.84))
    assert "met with a probability of 84 %, given its numerical error" in said.replace("\N{NO-BREAK SPACE}", " ")


def test_the_terminal_names_the_verdict_on_every_claim() -> None:
    verdicts = ["not met", "met", "met", "cannot be decided from its source"]
    claims = xr.Dataset({"verdict": ("claim", verdicts)}, {"claim": ["A", "B", "C", "D"]})
    tree = xr.DataTree.from_dict({"/claims": claims})
    words = "Claims: met – B and C; not met – A; cannot be decided from its source – D"
    assert list(terminal_lines(tree)) == [words]


RIG = """
    kind: stereo
    lenses: {focal_length: 12 mm, f_number: FNUMBER}
    sensor: {pixels: [1280, 1024], pixel_pitch: 5 um}
    baseline: BASELINE
    focus_distance: 655 mm
    principal_distance: focused
    depth: {disparity_error: 0.1 px}
"""


def between(folder: Path, points: int, cameras: Mapping[str, tuple[str, str]]) -> Result:
    """Some rigs, by f-number and baseline, between 0.4 and 1.2 m, focused on 655 mm and usable where they are sharp."""
    rigs = [
        f"  {key}:{RIG.replace('FNUMBER', number).replace('BASELINE', baseline)}"
        for key, (number, baseline) in cameras.items()
    ]
    text = f"""
format: 2
study: few
title: Few distances
question: Which rig is best?
cameras:
{"".join(rigs)}
scene: {{distances: {{from: 0.4 m, to: 1.2 m, points: {points}, spacing: log}}, wavelength: 550 nm}}
usable_range: {{blur: 1 px}}
"""
    (folder / f"of-{points}.yaml").write_text(text, encoding="utf-8")
    return tradestudy.load(folder / f"of-{points}.yaml").run()


def test_few_distances_do_not_hide_that_a_camera_is_usable_between_them(tmp_path: Path) -> None:
    """A lens of f/2 at 655 mm is sharp to a pixel from 0.627 to 0.686 m, between two of four distances.

    Z² e / (a b), with e = 0.5 µm, a = 12.224 mm and b = 60 mm, is 268 and 320 µm there.
    """
    result = between(tmp_path, 4, {"pair": ("2", "60 mm")})
    answer, *others = result.lines()
    assert answer == (
        "Depth by the pair is usable from 0.628 to 0.685 m, with ±268 µm to ±320 µm; on average over distance, the "
        "largest part comes from matching noise, declared 0.1 px."
    )
    assert not any("0.628" in line for line in others), "the first line says it"
    sections = str(compose_report(result.data, {}, {}).blocks)
    assert re.search(r"±268\\xa0µm \(.* to ±320\\xa0µm \(", sections), "section 2 says the same"


def test_few_distances_do_not_hide_that_a_camera_is_best_between_them(tmp_path: Path) -> None:
    """At f/2 a pair with the longer baseline is sharp only between two of four distances."""
    rigs = {"wide": ("2", "60 mm"), "narrow": ("16", "30 mm")}
    few, many = (between(tmp_path, points, rigs) for points in (4, 400))
    assert [one.cameras for one in best_ranges(few.data)] == [(), ("narrow",), ("wide",), ("narrow",), ()]
    ranges = [[(one.near, one.far) for one in best_ranges(result.data)] for result in (few, many)]
    assert ranges[0] == [pytest.approx(ends, rel=1e-6) for ends in ranges[1]]
    # Page one reads the uncertainty where the range ends: a²/(b c) · 0.1 px with c = f a_0/(a_0 − f).
    principal = 12e-3 * 0.655 / (0.655 - 12e-3)
    first = next(text for text in map(plain_text, _stretches(best_cameras(few.data))) if ": wide, " in text)
    near, far = (ranges[0][2][end] ** 2 / (60e-3 * principal) * 0.5e-6 for end in (0, 1))
    assert f"±{pretty(near, LENGTH)} (" in first
    assert f"to ±{pretty(far, LENGTH)} (" in first


def test_few_distances_do_not_overstate_how_much_less_certain_a_camera_is(tmp_path: Path) -> None:
    """At the only one of three distances where pairs are sharp, a baseline is 4 times as long; elsewhere 2.4 times."""
    rigs = {"long": ("4", "120 mm"), "middle": ("16", "72 mm"), "short": ("16", "30 mm")}
    few, many = (between(tmp_path, points, rigs) for points in (3, 400))
    assert list(never_best(few.data)) == [("short", pytest.approx(2.4, rel=1e-6))]
    assert list(never_best(many.data)) == list(never_best(few.data))
