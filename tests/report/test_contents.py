from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tradestudy import figures
from tradestudy.api import load
from tradestudy.report.contents import compose_report
from tradestudy.report.document import (
    Appendices,
    Bullets,
    Callout,
    Heading,
    Paragraph,
    Picture,
    Report,
    Table,
    Text,
    all_blocks,
    spans,
)
from tradestudy.report.sections.registers import _times_the_error
from tradestudy.report.sections.results import _factor
from tradestudy.results.views import conclusion_list
from tradestudy.results.views.decision import best_cameras, winners
from tradestudy.results.views.groups import camera_titles
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_details
from tradestudy.wording import span


def plain(text: Text) -> str:
    return "".join(span.text for span in spans(text))


def document_of(tree: xr.DataTree) -> Report:
    return compose_report(tree, {}, figures.build(tree))


def table(document: Report, name: str) -> list[list[str]]:
    found = next(b for b in all_blocks(document.blocks) if isinstance(b, Table) and b.name == name)
    return [[plain(spans(cell)).replace("\u00a0", " ") for cell in row] for row in found.rows]


def headings(document: Report) -> list[str]:
    return [plain(spans(block.text)) for block in all_blocks(document.blocks) if isinstance(block, Heading)]


def sentences(document: Report) -> Iterator[str]:
    for block in all_blocks(document.blocks):
        if isinstance(block, Bullets):
            yield from (plain(spans(item)).replace("\u00a0", " ") for item in block.items)


def part(tree: xr.DataTree, *groups: str) -> xr.DataTree:
    return xr.DataTree.from_dict({"/": tree.to_dataset()} | {f"/{name}": tree[name].to_dataset() for name in groups})


@pytest.mark.parametrize(
    ("groups", "expected"),
    [
        (("cameras",), ["Cameras", "Notes on the cameras, and derived properties"]),
        (
            ("cameras", "claims"),
            ["Cameras", "Claims", "Notes on the cameras, and derived properties", "Claims under every reading"],
        ),
        (
            ("cameras", "contradictions", "requirements"),
            ["Cameras", "Notes on the cameras, and derived properties", "Contradictions found", "Requirements"],
        ),
    ],
)
def test_sections_follow_from_the_groups(tree: xr.DataTree, groups: tuple[str, ...], expected: list[str]) -> None:
    assert headings(document_of(part(tree, *groups))) == expected


def test_hard_cases_have_their_verdict_in_the_main_part_and_their_tables_in_an_appendix() -> None:
    path = Path(__file__).resolve().parents[2] / "studies" / "hard_cases.yaml"
    blocks = document_of(load(path, ("hard_cases.families=[equation-27]",)).run().data).blocks
    appendices = blocks.index(Appendices())
    assert "Where formulas break down" in [one.title for one in blocks[:appendices] if isinstance(one, Callout)]
    assert [isinstance(one, Table) for one in blocks[:appendices]].count(True) == 0
    assert blocks[appendices + 1] == Heading(text="Every hard case", anchor="every-hard-case")
    assert any(isinstance(one, Table) and one.name.startswith("hard-cases-") for one in blocks[appendices:])


def test_maps_over_the_picture_have_a_heading_only_where_one_is_left_for_the_section(tree: xr.DataTree) -> None:
    drawings = figures.build(tree)
    tree = tree.copy()
    tree["depth_map"] = xr.DataTree(xr.Dataset(coords={"camera": ["r5"]}))
    more = drawings | {"depth-map-r5": list(drawings.values())[-1]}
    assert "Over the picture" not in headings(compose_report(tree, {}, drawings))
    assert "Over the picture" in headings(compose_report(tree, {}, more))


def test_every_figure_of_the_study_is_shown_once(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree(sweep={"b": [0.05, 0.1]})
    shown = [block.name for block in all_blocks(document_of(tree).blocks) if isinstance(block, Picture)]
    assert sorted(shown) == sorted(figures.build(tree))


def test_depth_without_a_decision_is_still_a_report(tree: xr.DataTree) -> None:
    document = document_of(part(tree, "cameras", "depth"))
    assert "The answer" not in headings(document)
    assert len(table(document, "usable-range-table")) == 3
    assert [row[0] for row in table(document, "depth-table") if len(row) == 1] == [
        "At 50 mm", "At 0.292 m", "At 1.71 m", "At 10 m"
    ]  # fmt: skip


def test_a_camera_that_is_usable_nowhere_is_named_with_what_it_lacks(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["usable_near"][1], depth["usable_far"][1], depth["usable"][1] = np.nan, np.nan, False
    depth["limit_met"][1] = [1, 0]
    tree["depth"] = xr.DataTree(depth)
    row = table(document_of(tree), "usable-range-table")[1]
    assert row == ["Stereo 100 mm, f = 30.5 mm", "nowhere", "focus (at 50 mm)", "", ""]
    for name in ("whole_range", "variance_shares"):
        assert figures.figure(tree, name).svg()


def test_the_answer_says_where_nothing_is_usable_and_why(tree: xr.DataTree) -> None:
    found = list(sentences(document_of(tree)))
    assert next(text for text in found if text.startswith("0.05")) == (
        "0.05 to 0.15 m: no camera is usable (Raytrix R5, Keplerian; Stereo 100 mm, f = 30.5 mm; and Stereo 100 "
        "mm, 65.24° across: too little overlap)."
    )


def test_the_camera_that_each_error_source_favours_is_counted(tree: xr.DataTree) -> None:
    """Noise alone is 20 times, calibration alone a fifth of the ratio: 0.68 at 0.3 m, 0.75, 0.82."""
    found = list(sentences(document_of(tree)))
    assert "Matching noise alone: Stereo 100 mm, 65.24° across at 3 of 3 declared distances." in found
    assert "Calibration errors alone: Raytrix R5, Keplerian at 3 of 3 declared distances." in found


def test_usable_cameras_that_are_not_candidates_are_named(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["usable_near"][1] = 0.05
    tree["depth"] = xr.DataTree(depth)
    tree["decision"].attrs["candidates"] = "r5, stereo-65deg"
    found = list(sentences(document_of(tree)))
    assert next(text for text in found if text.startswith("0.05")) == (
        "0.05 to 0.15 m: no candidate is usable (Raytrix R5, Keplerian; and Stereo 100 mm, 65.24° across: too little "
        "overlap); usable in at least part of this range, but not a candidate: Stereo 100 mm, f = 30.5 mm."
    )
    drawing = figures.build(tree)["whole_range"]
    assert "of the candidates Raytrix R5, Keplerian; and Stereo 100 mm, 65.24° across" in drawing.caption
    assert "Smallest uncertainty of the candidates: no candidate is usable from 0.05 to 0.15 m; " in drawing.alt


def test_a_sliver_of_the_range_is_not_reported(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    decision = tree["decision"].to_dataset().copy(deep=True)
    depth["usable_near"][0] = 0.05000001  # the first distance, 50 mm, lies just before it
    decision["best_camera"][1:] = "r5"
    decision["best_camera"][0] = ""
    tree["depth"], tree["decision"] = xr.DataTree(depth), xr.DataTree(decision)
    assert [key for _, _, key in winners(tree)] == ["", "r5"]
    found = list(sentences(document_of(tree)))
    assert any(re.match(r"0\.05 to 10 m: Raytrix R5, Keplerian, .*±", text) for text in found)
    alt = figures.build(tree)["whole_range"].alt
    assert re.search(r"Smallest uncertainty: Raytrix R5, Keplerian\b.* 0\.05 to 10 m\.", alt)
    # Even such a narrow range is reported, with more digits.
    narrow = np.linspace(1.0, 1.0004, decision.sizes["distance"])
    depth["usable_near"][:], depth["usable_far"][:] = 1.0001, 1.0004
    tree["depth"] = xr.DataTree(depth.assign_coords(distance=narrow))
    decision["best_camera"][:] = np.where(narrow < 1.0001, "", "r5")[:, None]
    tree["decision"] = xr.DataTree(decision.assign_coords(distance=narrow))
    heads = [text.split(":")[0] for text in sentences(document_of(tree))]
    assert [head for head in heads if head.startswith("1")] == ["1 to 1.0001 m", "1.0001 to 1.0004 m"]


def test_equal_uncertainties_do_not_count_as_a_loss(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    decision = tree["decision"].to_dataset().copy(deep=True)
    # Noise: two wins of the second camera and a tie; calibration: a win of the first, a tie, and both unbounded.
    for place, error_source, ratio in ((1, "noise", 1.0), (1, "calibration", 1.0), (2, "calibration", np.nan)):
        spot = {"reading": "as declared", "place": decision["place"].values[place], "error_source": error_source}
        decision["more_certain"].loc[spot] = ""
        decision["uncertainty_ratio"].loc[spot] = ratio
    tree["decision"] = xr.DataTree(decision)
    found = list(sentences(document_of(tree)))
    stereo, r5 = "Stereo 100 mm, 65.24° across", "Raytrix R5, Keplerian"
    assert f"Matching noise alone: {stereo} at 2; and neither at 1 of 3 declared distances." in found
    assert f"Calibration errors alone: neither at 2; and {r5} at 1 of 3 declared distances." in found


def test_the_answer_gives_both_ends_of_a_range_in_millimetres_and_per_cent(tree: xr.DataTree) -> None:
    sentence = next(text for text in sentences(document_of(tree)) if text.startswith("0.391 to 10 m"))
    first = 0.391  # between two distances of the study
    sigma = np.hypot(6.9e-4, 0.0349)
    near = f"±{1e3 * sigma * first**2:.3g} mm ({100 * sigma * first:.3g} %)"
    far = f"±{sigma * 100:.3g} m ({100 * sigma * 10:.3g} %)"
    assert 0 < sentence.index(near) < sentence.index(far) < sentence.index("relative rotation")


def test_without_the_declared_design_the_answer_has_no_numbers(make_tree: Callable[..., xr.DataTree]) -> None:
    found = list(sentences(document_of(make_tree(sweep={"b": [0.05, 0.1]}))))
    assert any(text.endswith("10 m: Stereo 100 mm, 65.24° across.") for text in found)
    assert not any("±" in text for text in found)


def test_a_study_without_other_readings_does_not_speak_of_them(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    tree["decision"] = xr.DataTree(tree["decision"].to_dataset().isel(reading=[0]))
    (found,) = [one for one in document_of(tree).blocks if isinstance(one, Table) and one.name == "verdict-table"]
    assert not any("reading" in column.title for column in found.columns)
    assert "reading" not in plain(found.caption)
    assert "readings" not in figures.build(tree)
    assert "reading-table" not in [one.name for one in document_of(tree).blocks if isinstance(one, Table)]


def test_the_record_says_what_an_interrupted_run_had_computed(tree: xr.DataTree) -> None:
    points = {"depth": {"computed": 3, "taken up": 0}, "ranks": {"computed": 1, "taken up": 2}}
    document = compose_report(tree, {"options": [], "points": points}, figures.build(tree))
    options, heading, *steps = table(document, "provenance-table")
    assert options == ["options", "none"]
    assert len(heading) == 1
    assert steps == [["ranks", "2 of 3"]]


def test_a_sensor_is_width_times_height(tree: xr.DataTree) -> None:
    assumptions = tree["assumptions"].to_dataset().copy(deep=True)
    assumptions["value"][0] = "[2048, 1024]"
    tree = tree.copy()
    tree["assumptions"] = xr.DataTree(assumptions)
    assert "2048 × 1024" in [row[2] for row in table(document_of(tree), "assumption-register") if len(row) > 1]


def test_assumed_values_come_first_with_the_cameras_they_belong_to(tree: xr.DataTree) -> None:
    assert table(document_of(tree), "assumption-register") == [
        ["Assumed (1)"],
        ["Raytrix R5, Keplerian", "microlenses › gap", "0.568 mm", "f-number matching"],
        ["From the paper (1)"],
        ["Stereo 100 mm, f = 30.5 mm; Stereo 100 mm, 65.24° across", "calibration › errors › yaw", "0.2°", ""],
    ]


def test_values_without_a_stated_basis_follow_those_set_for_the_run(tree: xr.DataTree) -> None:
    assumptions = tree["assumptions"].to_dataset().copy(deep=True)
    assumptions["basis"] = ("path", ["", "set for this run"])
    tree = tree.copy()
    tree["assumptions"] = xr.DataTree(assumptions)
    document = document_of(tree)
    headings = [row[0] for row in table(document, "assumption-register") if len(row) == 1]
    assert headings == ["Set for this run (1)", "Without a stated basis (1)"]


def test_claims_are_answered_under_every_reading_tried(tree: xr.DataTree) -> None:
    says = tree["claims/reading_says"].to_series()
    assert table(document_of(tree), "claim-values") == [
        [says["as declared"], "391 mm ✗", "6.8 m ✓"],
        [says["galilean"], "", "36 m ✗"],
        [says["yaw-uniform"], "391 mm ✗", ""],
    ]


def test_the_answer_says_what_it_rests_on(tree: xr.DataTree) -> None:
    texts = [plain(spans(b.text)) for b in all_blocks(document_of(tree).blocks) if hasattr(b, "text")]
    assert any("Rests on (measure first): yaw of a rig, assumed 0.2°" in text for text in texts)


def test_without_requirements_only_predicted_depth_rests_on_an_input(
    tree: xr.DataTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conclusion_list, "rests_on", lambda _tree: ("yaw of a rig",))
    monkeypatch.setattr(conclusion_list, "requirement_conclusions", lambda _tree: ())
    said = [plain(spans(b.text)) for b in all_blocks(document_of(tree).blocks) if hasattr(b, "text")]
    assert any("Predicted depth rests on: yaw of a rig" in text for text in said)


def test_crossovers_are_a_range_of_assumptions(tree: xr.DataTree) -> None:
    texts = [plain(spans(b.text)) for b in all_blocks(document_of(tree).blocks) if hasattr(b, "text")]
    sentence = next(text for text in texts if "In the study as declared, " in text).replace("\u00a0", " ")
    assert "do not cross" in sentence
    assert "Under 2 of the 3 other readings" in sentence
    assert "between 0.4 m and 0.52 m" in sentence


def test_one_reading_that_reverses_the_verdict_is_named(tree: xr.DataTree) -> None:
    data = tree["decision"].to_dataset().sel(error_source="both")
    turning = data["reading"].values[np.asarray(data["flips"].transpose("reading", ...)).any(axis=1)]
    assert len(turning) == 1
    texts = [plain(spans(b.text)) for b in all_blocks(document_of(tree).blocks) if isinstance(b, Paragraph)]
    says = str(data["reading_says"].sel(reading=turning[0]).item())
    (told,) = (text for text in texts if f"The alternative “{says}” reverses the choice between " in text)
    assert re.search(r"65\.24° across at [\d.]+\sm\.", told)


def test_the_method_explains_only_limits_that_apply_in_the_study(tree: xr.DataTree) -> None:
    explained = {text.partition(":")[0] for text in sentences(document_of(tree))}
    assert {"Overlap", "Focus"} <= explained
    assert not {"Total covering plane", "Availability", "Last disparity step", "Matching"} & explained


def test_a_margin_of_over_a_thousand_errors_is_not_counted() -> None:
    margins = [_times_the_error(margin) for margin in (12.34, 6.5e6, -30.0, -6.5e6, math.nan)]
    assert margins == ["12", "> 1000", "−30", "< −1000", "—"]


def test_a_factor_close_to_1_shows_the_digits_that_distinguish_it_from_1() -> None:
    factors = [_factor(ratio) for ratio in (1.0, 1.004, 1.0 / 1.004, 1.00001, 2.5, math.nan, 0.0)]
    assert factors == ["1", "1.004", "1.004", "about 1", "2.5", "—", "∞"]


def test_further_cameras_that_meet_a_requirement_on_any_camera_are_named(tree: xr.DataTree) -> None:
    titles = camera_titles(tree)
    data = tree["requirements"].to_dataset().assign_coords(camera=list(titles))
    deciding = list(titles).index(str(data["camera_deciding"].sel(requirement="mid").item()))
    met, margin = np.full((2, len(titles)), -1), np.full((2, len(titles)), np.nan)
    met[1], met[1, deciding], met[1, 0] = 0, 1, 1
    margin[1], margin[1, 0] = -10.0, 5.0
    data["camera_met"] = ("requirement", "camera"), met
    data["camera_margin_percent"] = ("requirement", "camera"), margin
    reason = np.where(met >= 0, "worst 1.2 % at 1 m", "")
    data["camera_reason"] = ("requirement", "camera"), reason
    changed = tree.copy()
    changed["requirements"] = xr.DataTree(data)
    close, mid = sorted(requirement_conclusions(changed), key=lambda one: one.name)
    first, *rest = mid.others
    assert (first.camera, first.met, first.margin) == (next(iter(titles.values())), True, 0.05)
    assert [one.met for one in rest] == [False] * (len(titles) - 2)
    assert close.others == ()
    assert "1.2 % at 1 m" in requirement_details(mid).partition("; not by ")[2]
    assert f"; also by {next(iter(titles.values()))} (5 % to spare)" in requirement_details(mid)


def test_every_stretch_is_named(tree: xr.DataTree) -> None:
    """Ten ranges by turns, narrow and wide."""
    edges = 0.1 * np.cumprod([1.0, 1.2, 1.6, 1.25, 1.7, 1.3, 1.8, 1.35, 2.2])
    decision = tree["decision"].to_dataset().copy(deep=True)
    places = decision["distance"].values
    numbers = np.searchsorted(edges, places)
    decision["best_camera"][:] = np.where(numbers % 2 == 0, "r5", "stereo-65deg")[:, None]
    decision["crossover_distance"][:] = np.nan
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["usable_near"][:], depth["usable_far"][:] = np.nan, np.nan
    depth["usable_near"][{"interval": 0}], depth["usable_far"][{"interval": 0}] = places[0], places[-1]
    tree = tree.copy()
    tree["decision"], tree["depth"] = xr.DataTree(decision), xr.DataTree(depth)
    reported = best_cameras(tree).reported
    assert len(reported) == 10
    document = document_of(tree)
    (told,) = (one for one in all_blocks(document.blocks) if isinstance(one, Callout) and one.name == "answer-cameras")
    assert isinstance(told.blocks[0], Bullets)
    texts = [plain(spans(item)).replace("\u00a0", " ") for item in told.blocks[0].items]
    words = [span(*one[:2]).replace("\u00a0", " ") for one in reported]
    assert [text.partition(":")[0] for text in texts[:10]] == words
