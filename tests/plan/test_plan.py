"""What a plan decides, says and refuses, on the shipped studies."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.accuracy import QUANTITIES, Accuracy
from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.api import Study
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.effects.base import COMPLETE
from tradestudy.effects.selection import Selection
from tradestudy.errors import StudyError, UnaffordableError
from tradestudy.plan.affordable import tightest_offer
from tradestudy.plan.choice import _selections
from tradestudy.plan.plan import Plan

STUDIES = Path(__file__).parents[2] / "studies"
PICTURE = (
    "defocus_blur", "main_lens_diffraction", "microlens_diffraction", "crosstalk", "pixel_integration",
    "source_extent", "spectrum", "vignetting", "sensor_noise",
)  # fmt: skip


@pytest.fixture(scope="module")
def close_range() -> Study:
    return tradestudy.load(STUDIES / "close_range.yaml")


@pytest.fixture(scope="module")
def close_plan(close_range: Study) -> Plan:
    return close_range.plan()


def uncertainty(plan: Plan, camera: str, distance: float) -> float:
    return float(depth_uncertainty(plan.definition.case.cameras[camera], np.array([distance]))[0])


def test_stereo_with_a_declared_error_simulates_no_diffraction_at_5_m_and_says_why() -> None:
    plan = tradestudy.load(
        STUDIES / "plenoptic_vs_stereo.yaml", ["scene.distances.from=4.9 m", "scene.distances.to=5.1 m"]
    ).plan()
    chosen = plan.selections["stereo-65-across"]
    assert {slot: chosen.name_of(slot) for slot in PICTURE} == dict.fromkeys(PICTURE, "off")
    bound = chosen.chosen["main_lens_diffraction"].bounds["depth_uncertainty"]
    assert bound.relative_change == 0.0
    assert bound.reason.startswith("the disparity error is declared, 0.1 px")
    # The number that an expert wants beside it: 1.22 λ N over the pixel, f/8 focused at 1 m, 8 mm lens; the 30.5 mm
    # lens of one reading, whose working f-number is larger, is not usable there.
    working = 8 / (1 - 8e-3)
    assert bound.criterion.value == pytest.approx(1.21967 * 550e-9 * working / 10e-6, rel=2e-3)


def test_a_hand_lens_with_a_derived_error_simulates_diffraction_and_suffers_from_stopping_down(
    close_plan: Plan,
) -> None:
    for camera in ("pair-f9.8", "pair-f22"):
        assert close_plan.selections[camera].name_of("main_lens_diffraction") in ("fresnel", "kirchhoff")
    assert close_plan.selections["pair-declared"].name_of("main_lens_diffraction") == "off"
    # In the same light, where both are in focus.
    assert uncertainty(close_plan, "pair-f22", 55.3e-3) > 1.4 * uncertainty(close_plan, "pair-f9.8", 55.3e-3)


def test_what_was_left_out_moves_depth_by_no_more_than_was_promised(close_range: Study, close_plan: Plan) -> None:
    """Against the most complete models of all slots, at places that the bounds were not looked for at."""
    complete = {
        one.name: {slot.name: slot.model_names[-1] for slot in one.slots if slot.models}
        for one in close_plan.situations
    }
    everything = close_range.definition.with_models(complete).case.cameras
    for camera, selection in close_plan.selections.items():
        for place in (54.7e-3, 55.9e-3):
            full = float(depth_uncertainty(everything[camera], np.array([place]))[0])
            moved = abs(uncertainty(close_plan, camera, place) / full - 1.0)
            assert moved <= selection.bounds["depth_uncertainty"] + 1e-12


def test_a_looser_tolerance_leaves_more_out_and_costs_less(close_range: Study) -> None:
    tight = tradestudy.load(STUDIES / "close_range.yaml", tolerance="0.5 %").plan()
    loose = tradestudy.load(STUDIES / "close_range.yaml", tolerance="50 %").plan()
    for name in ("pair-f9.8", "pair-f5.6"):
        assert loose.selections[name].seconds < tight.selections[name].seconds
        assert loose.selections[name].bounds["depth_uncertainty"] > tight.selections[name].bounds["depth_uncertainty"]


def test_a_forced_model_acts_and_is_told(close_range: Study) -> None:
    forced = close_range.with_values({"effects.main_lens_diffraction": "off"}).plan()
    selection = forced.selections["pair-f22"]
    assert selection.name_of("main_lens_diffraction") == "off"
    why = next(d.why for d in selection.decisions if d.forced)
    assert why.startswith("forced by the study; changes the depth uncertainty by at most ")
    # Without diffraction stopping down would seem harmless but for the light.
    assert uncertainty(forced, "pair-f22", 55.3e-3) < uncertainty(close_range.plan(), "pair-f22", 55.3e-3)


def test_a_model_that_acts_nowhere_is_a_mistake_with_a_position() -> None:
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml", ["effects.main_lens_diffraction=kirchhoff"])
    with pytest.raises(StudyError, match=r"effects\.main_lens_diffraction: 'kirchhoff' acts nowhere in this study"):
        study.plan()


def test_what_nothing_can_give_names_the_nearest_accuracy() -> None:
    study = tradestudy.load(STUDIES / "light_spot.yaml", tolerance="0.01 %")
    text = (
        r"Picture of the light spot: the accuracy wanted of the pixel intensity cannot be had; even the most accurate "
        r"models leave: [\d.]+ %, of which sampling \([\d.]+ %\) [\d.]+ % \(allowed: 0\.01 %\); "
        r"[\d.]+ % can be had; ask for that"
    )
    with pytest.raises(UnaffordableError, match=text):
        study.plan()


def test_a_budget_that_is_too_small_names_what_it_takes() -> None:
    study = tradestudy.load(STUDIES / "close_range.yaml", ["accuracy.time_limit=10 ms"])
    text = r"longer than the budget: .* s \(allowed: 0\.01 s\); with no looser --tolerance it takes less than with "
    with pytest.raises(UnaffordableError, match=text):
        study.plan()
    whole = tradestudy.load(STUDIES / "close_range.yaml", ["accuracy.time_limit=10 ms"], tolerance="100 %")
    with pytest.raises(UnaffordableError, match=r"\(allowed: 0\.01 s\); raise the budget or ask for less"):
        whole.plan()


OWN = f"""\
format: 2
study: own
title: A focused plenoptic camera near by
question: How long does it take to derive its disparity error?
cameras:
  one: {{from: {(STUDIES / "cameras/raytrix-r5.yaml").as_posix()}, depth: {{disparity_error: derived}}}}
scene:
  distances: {{from: 0.5 m, to: 2 m, points: 21, spacing: log}}
  wavelength: 550 nm
  picture:
    texture: {{contrast: 15 %, correlation_length: 1 mm}}
    matching_window: 15 px
    light: {{electrons: 4000 electrons, at_f_number: 8}}
    read_noise: 17 electrons
    full_well: 100000 electrons
    bit_depth: 12
"""


def tighter(tolerance: str) -> str:
    """The next tighter percentage of two digits."""
    percent = float(tolerance.removesuffix(" %"))
    step = 10.0 ** (math.floor(math.log10(percent * (1.0 - 1e-9))) - 1)
    return f"{percent - step:.3g} %"


@pytest.mark.parametrize(
    ("name", "asked", "share", "own"),
    [
        ("light_spot", "0.5 %", 0.7, []),
        ("light_spot", "0.5 %", 0.4, []),
        ("light_spot", "1 %", 0.45, []),
        ("light_spot", "1 %", 0.45, ["accuracy.depth_of_field=3 %"]),
        ("close_range", "0.5 %", 0.05, []),
        ("own", "0.1 %", 0.6, []),
        ("own", "0.1 %", 0.02, ["cameras.one.main_lens.f_number=6"]),
    ],
)
def test_the_tolerance_that_is_offered_fits_the_budget_and_the_next_tighter_does_not(
    name: str, asked: str, share: float, own: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The budget lies between what is asked for and the whole."""
    monkeypatch.setattr("tradestudy.plan.plan.machine_speed", lambda: 1.0)
    (tmp_path / "own.yaml").write_text(OWN, encoding="utf-8")
    path = tmp_path / "own.yaml" if name == "own" else STUDIES / f"{name}.yaml"
    free = [tradestudy.load(path, own, tolerance=one).plan().seconds[0] for one in (asked, "100 %")]
    budget = free[1] + share * (free[0] - free[1])
    wanted = [f"accuracy.tolerance={asked}", *own, f"accuracy.time_limit={budget} s"]
    with pytest.raises(UnaffordableError) as error:
        tradestudy.load(path, wanted).plan()
    offer = re.search(r"; ([\d.]+ %) can be had in ([\d.]+) s; ask for that with --tolerance '\1'", str(error.value))
    assert offer is not None, str(error.value)
    seconds = tradestudy.load(path, wanted, tolerance=offer[1]).plan().seconds[0]
    assert seconds == pytest.approx(float(offer[2]), rel=5e-3)
    assert seconds <= budget
    assert float(offer[2]) <= budget
    with pytest.raises(UnaffordableError, match="longer than the budget"):
        tradestudy.load(path, wanted, tolerance=tighter(offer[1])).plan()


def test_no_tighter_tolerance_is_passed_over_however_times_jump_from_choice_to_choice(
    close_range: Study, close_plan: Plan
) -> None:
    """Against every percentage of two digits, each chosen for by itself, with times that know no order."""

    def seconds(_: object, selections: Mapping[str, Selection]) -> float:
        names = [[model.name for model in one.chosen.values()] for one in selections.values()]
        return 1.0 + zlib.crc32(repr(names).encode()) % 1000

    texts = [f"{float(f'{digits}e{power}'):g} %" for power in (-2, -1, 0) for digits in range(10, 100)]
    table = {}
    for text in [*texts[41:], "100 %"]:  # beyond 0.5 %
        wanted = Accuracy.of_all(float(text.removesuffix(" %")) / 100.0)
        table[text] = seconds(None, {one.name: one.select(wanted, {}) for one in close_plan.situations})
    times = sorted(set(table.values()))
    assert len(times) > 5
    for budget in times:
        study = close_range.with_values({"accuracy.tolerance": "0.5 %", "accuracy.time_limit": f"{budget} s"})
        offer = tightest_offer(study.definition, close_plan.situations, seconds)
        assert offer is not None
        assert offer.tolerance == next(text for text, value in table.items() if value <= budget)
        assert offer.seconds == table[offer.tolerance]


def test_a_light_spot_is_offered_the_tolerance_at_which_a_compared_picture_is_the_one_that_is_chosen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Kirchhoff's picture at 1 % is one of those compared; looser ones are one more, so that the run takes longer."""
    monkeypatch.setattr("tradestudy.plan.plan.machine_speed", lambda: 1.0)
    spot = STUDIES / "light_spot.yaml"
    at = {one: tradestudy.load(spot, tolerance=one).plan().seconds[0] for one in ("0.99 %", "1 %", "1.1 %", "1.5 %")}
    assert at["1 %"] < min(at["0.99 %"], at["1.1 %"], at["1.5 %"])
    study = tradestudy.load(spot, [f"accuracy.time_limit={1.001 * at['1 %']} s"], tolerance="0.5 %")
    with pytest.raises(UnaffordableError, match=r"; 1 % can be had in"):
        study.plan()


def test_the_same_study_has_the_same_plan_whatever_the_machine(
    close_range: Study, close_plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tradestudy.plan.plan.machine_speed", lambda: 1.0)
    usual = close_range.plan()
    monkeypatch.setattr("tradestudy.plan.plan.machine_speed", lambda: 0.1)
    slow = close_range.plan()
    assert {n: dict(s.bounds) for n, s in slow.selections.items()} == {
        n: dict(s.bounds) for n, s in close_plan.selections.items()
    }
    assert slow.seconds == pytest.approx(tuple(10.0 * value for value in usual.seconds))


def test_bounds_are_the_worst_of_every_reading_and_design() -> None:
    """One reading takes the yaw for a uniform one, for which a line is no good."""
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml")
    whole, part = (
        next(one for one in plan.situations if one.name == "stereo-65-across")
        for plan in (study.plan(), study.with_values({"readings": None, "claims": None, "solve": None}).plan())
    )
    bound = [
        next(slot for slot in one.slots if slot.name == "calibration").model("linear").change_of("depth_uncertainty")
        for one in (whole, part)
    ]
    assert bound[0] > 2.0 * bound[1] > 0.0


def test_a_declared_error_tells_the_largest_blur_of_usable_distances_and_where_it_is(close_plan: Plan) -> None:
    """In focus at 55.3 mm, where the range of the study is nearest to it nothing is blurred: that is not the number."""
    blur = close_plan.selections["pair-declared"].chosen["defocus_blur"].bounds["depth_uncertainty"].criterion
    camera = close_plan.definition.case.cameras["pair-declared"]
    assert isinstance(camera, StereoRig)
    f, focus = 18.3e-3, 55.3e-3
    sensor = f * focus / (focus - f)
    expected = f / 9.8 * sensor * abs(1 / focus - 1 / blur.at) / 7.4e-6
    assert blur.value == pytest.approx(expected, rel=1e-9)
    assert blur.at == pytest.approx(42e-3, rel=1e-9)
    assert blur.value > 30.0
    assert "blur over pixel 39.5 at 42 mm" in str(close_plan).replace("\N{NO-BREAK SPACE}", " ")


def test_every_number_of_a_plan_has_a_formula_and_every_model_a_time(close_plan: Plan) -> None:
    text = str(close_plan)
    for selection in close_plan.selections.values():
        for decision in selection.decisions:
            for bound in decision.model.bounds.values():
                if bound is COMPLETE:
                    continue
                assert bound.criterion.definition
                if not np.isnan(bound.criterion.value):
                    assert f"    {bound.criterion.words}: {bound.criterion.definition}" in text
    wide, narrow = (close_plan.selections[name] for name in ("pair-f5.6", "pair-f22"))
    dear, less = (next(d for d in one.decisions if d.model.name == "kirchhoff") for one in (wide, narrow))
    assert dear.seconds > 10.0 * wide.seconds
    assert dear.seconds > 2.0 * less.seconds  # over more waves of defocus, of more nodes each


def test_the_plan_reads_like_a_table(close_plan: Plan) -> None:
    text = str(close_plan)
    assert "Hand-lens pair, f/22 (pair-f22): 5 % of depth uncertainty wanted" in text
    assert "predicted for this machine" in text


def test_bounds_hold_between_the_distances_of_a_coarse_study() -> None:
    """Only the focus is on the grid; the decision is asked for beside it, where the pair is blurred."""
    coarse = [
        "scene.distances.from=45.3 mm", "scene.distances.to=75.3 mm", "scene.distances.points=4", "requirements=null",
    ]  # fmt: skip
    study = tradestudy.load(STUDIES / "close_range.yaml", coarse)
    plan = study.plan()
    complete = {one.name: {slot.name: slot.model_names[-1] for slot in one.slots} for one in plan.situations}
    everything = study.definition.with_models(complete).case.cameras
    for camera in ("pair-f9.8", "pair-f5.6"):
        for place in (53e-3, 58e-3):
            full = float(depth_uncertainty(everything[camera], np.array([place]))[0])
            moved = abs(uncertainty(plan, camera, place) / full - 1.0)
            assert moved <= plan.selections[camera].bounds["depth_uncertainty"] <= 0.05


def test_calibration_is_weighed_beside_the_models_that_are_forced() -> None:
    """Without blur there is less noise, and the same calibration error is a larger share."""
    small = [
        "cameras.pair-f9.8.calibration.errors.yaw.standard_deviation=0.00003 deg",
        "cameras.pair-f9.8.calibration.errors.baseline.standard_deviation=0.01 um",
    ]
    free, forced = (
        tradestudy.load(STUDIES / "close_range.yaml", [*small, *more]).plan()
        for more in ([], ["effects.defocus_blur=off", "effects.main_lens_diffraction=off"])
    )

    def share(plan: Plan) -> float:
        slot = next(
            s for one in plan.situations if one.name == "pair-f9.8" for s in one.slots if s.name == "calibration"
        )
        return slot.model("off").change_of("depth_uncertainty")

    assert share(forced) > 3.0 * share(free)


@pytest.mark.parametrize(
    ("study", "override"),
    [
        ("close_range", "effects.crosstalk=coherent"),
        ("close_range", "effects.main_lens_diffraction=boundary_wave"),
        ("light_spot", "accuracy.tolerance=0.01 %"),
        ("plenoptic_vs_stereo", "effects.spectrum=weighted"),
        ("hand_lens", "effects.sensor_noise=shot"),
        ("light_spot", "effects.calibration=linear"),
        ("light_spot", "effects.main_lens_diffraction=off"),
    ],
)
def test_check_refuses_in_the_same_words_what_plan_refuses(study: str, override: str) -> None:
    loaded = tradestudy.load(STUDIES / f"{study}.yaml", [override])
    with pytest.raises((StudyError, UnaffordableError)) as by_plan:
        loaded.plan()
    with pytest.raises(type(by_plan.value)) as by_check:
        loaded.check()
    assert str(by_check.value) == str(by_plan.value)


@pytest.mark.parametrize("override", ["effects.main_lens_diffraction=kirchhoff", "accuracy.tolerance=1 %"])
def test_check_passes_what_plan_passes(override: str) -> None:
    loaded = tradestudy.load(STUDIES / "close_range.yaml", [override])
    assert loaded.check() == loaded.check_summary()
    assert loaded.plan().selections


def test_depth_can_be_had_to_any_accuracy() -> None:
    """Draws simplify nothing: even where no line through the errors is good enough."""
    study = tradestudy.load(STUDIES / "plenoptic_vs_stereo.yaml", tolerance="0.01 %")
    for selection in study.plan().selections.values():
        assert selection.name_of("calibration") == "exact"
        assert selection.bounds["depth_uncertainty"] == 0.0


def test_every_piece_that_cannot_be_had_is_named_with_what_it_offers() -> None:
    spot = next(one for one in tradestudy.load(STUDIES / "light_spot.yaml").plan().situations if "spot" in one.title)
    pieces = (spot, replace(spot, name="another", title="Another spot"))
    with pytest.raises(UnaffordableError) as refused:
        _selections(pieces, Accuracy(relative=dict.fromkeys(QUANTITIES, 1e-5)), {})
    lines = str(refused.value).splitlines()
    assert [line.split(":")[0] for line in lines] == [spot.title, "Another spot"]
    assert all("even the most accurate models leave" in line and "can be had; ask for that" in line for line in lines)
