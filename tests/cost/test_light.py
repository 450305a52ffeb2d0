"""Pictures and depth of field: errors of the cost table against what must hold for them."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.analysis.spot_images import RAYS, SpotModels
from tradestudy.cameras.focus import SharpRange
from tradestudy.cost import measuring, spot
from tradestudy.cost.depth_of_field import _difference, depth_of_field_cost
from tradestudy.cost.entries import CostTable, Entry, a_tenth_of_what_is_asked
from tradestudy.cost.measuring import Allowance, Pace
from tradestudy.cost.point_spread import DIRECT, point_spread_cost
from tradestudy.optics.chain import ChainAccuracy, ChainImage, DiscSource
from tradestudy.optics.depth_of_field import DepthOfField
from tradestudy.plan.situations.every import depth_of_field_situation
from tradestudy.plan.situations.light_spot import light_spot_situation, spot_models
from tradestudy.study.schema.light_spot import LightSpotPart

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture(scope="module")
def points() -> CostTable:
    part = tradestudy.load(STUDIES / "light_spot.yaml").definition.file.point_spread
    assert part is not None
    one = part.model_copy(
        update={"elements": {"microlens": part.elements["microlens"]}, "window": 4.0, "tolerance": 1e-4}
    )
    return point_spread_cost(one, "kirchhoff", Allowance(seconds=1e4), lambda _step, _share: None, (1e-3, 1e-4))


def test_without_time_for_the_quadrature_no_point_spread_is_measured() -> None:
    part = tradestudy.load(STUDIES / "light_spot.yaml").definition.file.point_spread
    assert part is not None
    found = point_spread_cost(part, "kirchhoff", Allowance(seconds=1e-3), lambda _step, _share: None)
    assert found.entries == ()
    assert "a larger --budget" in found.left_out[0]


def test_what_a_run_answers_with_is_measured_before_all_else() -> None:
    part = tradestudy.load(STUDIES / "light_spot.yaml").definition.file.point_spread
    assert part is not None
    one = part.model_copy(update={"elements": {"microlens": part.elements["microlens"]}, "window": 4.0})
    allowance = Allowance(seconds=1e4)

    def until_something_is_measured(_step: str, share: float) -> None:
        if share > 0.0:
            allowance.seconds = 0.0

    found = point_spread_cost(one, "kirchhoff", allowance, until_something_is_measured, (1e-3, 1e-4))
    assert [entry.words for entry in found.entries if entry.chosen] == ["Kirchhoff, tolerance 1e-05"]
    assert len(found.left_out) + len(found.entries) == 11


def test_what_a_study_can_ask_for_is_measured_before_what_is_for_comparison() -> None:
    part = tradestudy.load(STUDIES / "light_spot.yaml").definition.file.point_spread
    assert part is not None
    one = part.model_copy(update={"elements": {"microlens": part.elements["microlens"]}, "window": 4.0})
    allowance = Allowance(seconds=1e4)

    def until_half_is_measured(_step: str, share: float) -> None:
        if share > 0.5:
            allowance.seconds = 0.0

    found = point_spread_cost(one, "kirchhoff", allowance, until_half_is_measured, (1e-3, 1e-4))
    assert {entry.model for entry in found.entries} == {"Fresnel", "Kirchhoff"}
    assert len(found.entries) == 6
    assert len(found.left_out) == 5
    assert all(line.startswith(("rays", "boundary wave", DIRECT)) for line in found.left_out)
    assert all("no time left" in line for line in found.left_out)


def test_what_is_not_begun_says_what_it_would_take_and_what_is_left() -> None:
    words = Allowance(seconds=1e-3).lacking(12.3)
    assert words.startswith("no time left: it takes about 12 s, 0.00")
    assert words.endswith(" s are left for this quantity")


def of(table: CostTable, model: str) -> list[Entry]:
    return [entry for entry in table.entries if entry.model == model]


def test_kirchhoff_keeps_every_tolerance_against_direct_quadrature(points: CostTable) -> None:
    assert points.reference_error < 1e-12
    for entry in of(points, "Kirchhoff"):
        tolerance = float(entry.setting.removeprefix("tolerance "))
        # Held at a part of the places, whose share of the light is not that of all.
        assert entry.error <= 3.0 * tolerance


def test_of_the_laws_that_a_run_computes_the_one_it_answers_with_is_chosen(points: CostTable) -> None:
    assert [entry.words for entry in points.entries if entry.chosen] == ["Kirchhoff, tolerance 1e-04"]
    assert [entry.setting for entry in of(points, "Kirchhoff")] == ["tolerance 1e-03", "tolerance 1e-04"]
    assert set(points.ways) == {"Fresnel", "Kirchhoff"}
    assert "A run computes Fresnel and Kirchhoff" in points.notes[0]


def test_fresnel_errs_by_its_law_at_any_tolerance(points: CostTable) -> None:
    loose, tight = of(points, "Fresnel")
    assert 1e-3 < tight.error < 1e-1
    assert loose.error == pytest.approx(tight.error, rel=0.05)


def test_node_by_node_is_what_the_reference_is(points: CostTable) -> None:
    (entry,) = of(points, DIRECT)
    assert entry.error < 1e-5
    assert entry.evaluations > 100


def sharp(*ranges: tuple[float, float]) -> SharpRange:
    near, far = (np.array(ends, dtype=float) for ends in zip(*ranges, strict=True))
    return SharpRange(names=tuple(map(str, range(len(ranges)))), slices=DepthOfField(near=near, far=far))


def test_the_difference_is_what_is_sharp_by_one_alone() -> None:
    assert _difference(sharp((1.0, 2.0)), sharp((1.0, 2.0)), 0.0, 10.0) == 0.0
    assert _difference(sharp((1.0, 3.0)), sharp((2.0, 4.0)), 0.0, 10.0) == pytest.approx(2.0 / 3.0)
    assert _difference(sharp((1.0, 2.0)), sharp((3.0, 4.0)), 0.0, 10.0) == 1.0
    assert _difference(sharp((1.0, np.inf)), sharp((2.0, np.inf)), 0.0, 11.0) == pytest.approx(0.1)
    assert _difference(sharp((20.0, 30.0)), sharp((21.0, 22.0)), 0.0, 10.0) == 0.0


def test_counting_diffraction_costs_little_and_its_leaving_out_is_seen() -> None:
    definition = tradestudy.load(STUDIES / "hand_lens.yaml").definition
    part = definition.file.depth_of_field
    assert part is not None
    selection = depth_of_field_situation(definition, part).select(definition.file.accuracy.wanted(), {})
    found = depth_of_field_cost(definition, part, selection, Allowance(seconds=5.0), lambda _step, _share: None)
    geometric, half, full = found.entries
    assert full.error == 0.0
    assert 0.0 < half.error <= geometric.error <= 1.0
    assert full.chosen  # the widest blur of this study counts it


def test_a_study_that_leaves_diffraction_out_of_sharpness_has_chosen_rays() -> None:
    definition = tradestudy.load(STUDIES / "hand_lens.yaml", ["effects.main_lens_diffraction=off"]).definition
    part = definition.file.depth_of_field
    assert part is not None
    forced = definition.file.effects.forced()
    selection = depth_of_field_situation(definition, part).select(definition.file.accuracy.wanted(), forced)
    found = depth_of_field_cost(definition, part, selection, Allowance(seconds=5.0), lambda _step, _share: None)
    assert [entry.chosen for entry in found.entries] == [True, False, False]


def small_spot(*changes: str) -> tuple[LightSpotPart, SpotModels]:
    """Narrow lenses, one of them behind the main lens, and the picture that the study's plan makes of a small spot."""
    small = [
        "light_spot.main_lens.f_number=40",
        "light_spot.microlenses.lenses_across=1",
        "light_spot.microlenses.f_number=20",
        "light_spot.detector.pixels=8",
        "light_spot.detector.pixel_pitch=15.8125 um",
        "light_spot.spot.diameter=0.2 mm",
        "light_spot.tolerance=20 %",
        "light_spot.benchmarks=false",
        "light_spot.published_times=null",
        "point_spread=null",
        "readings=null",
        "claims=null",
    ]
    definition = tradestudy.load(STUDIES / "light_spot.yaml", [*small, *changes]).definition
    part = definition.file.light_spot
    assert part is not None
    situation = light_spot_situation(part)
    return part, spot_models(situation.select(definition.file.accuracy.wanted(), definition.file.effects.forced()))


def test_the_choice_is_the_picture_of_the_plan_and_not_what_it_is_compared_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spot, "_TOLERANCES", (1.0,))
    monkeypatch.setattr(measuring, "_LONG", 0.0)  # once is enough
    forced = {"main_lens_diffraction": "off", "microlens_diffraction": "off", "crosstalk": "off"}
    part, models = small_spot(*(f"effects.{slot}={name}" for slot, name in forced.items()))
    assert (models.method, models.separate) == ("exact-rays", True)
    found = spot.spot_cost(part, models, Allowance(seconds=1e4), lambda _step, _share: None, speed=1.0, asked=0.01)
    (chosen,) = [entry for entry in found.entries if entry.chosen]
    assert (chosen.model, chosen.setting) == ("Exact rays", "tolerance 1 %, no cross-talk")
    whole = next(entry for entry in found.entries if entry.model == "Exact rays" and not entry.chosen)
    assert whole.setting == "tolerance 1 %"
    assert {entry.model for entry in found.entries} == {
        "Paraxial rays", "Exact rays", "Fresnel", "Kirchhoff + Fresnel", "Kirchhoff",
    }  # fmt: skip


def as_accurate_as_asked(seconds_per_tolerance: float, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Pictures err by their tolerance, of finer sources by less, are foreseen to take a time over it, and take none.

    Returns the tolerances that are asked for.
    """
    asked: list[float] = []

    def picture(*given: object, accuracy: ChainAccuracy, seed: int) -> ChainImage:
        asked.append(accuracy.tolerance)
        error = accuracy.tolerance / accuracy.source_sampling**4
        return ChainImage(
            pixels=np.array([1.0 + error]),
            numerical_error=error,
            error_terms={},
            direct_check={},
            microlens_share=math.nan,
            effort={},
        )

    monkeypatch.setattr(spot, "picture_of", picture)
    monkeypatch.setattr(spot, "picture_seconds", lambda _part, models: seconds_per_tolerance / models.tolerance)
    monkeypatch.setattr(measuring, "_LONG", 0.0)
    return asked


def measured_spot(seconds: float) -> CostTable:
    definition = tradestudy.load(STUDIES / "light_spot.yaml").definition
    part = definition.file.light_spot
    assert part is not None
    chosen = SpotModels(method="kirchhoff", tolerance=0.01)
    return spot.spot_cost(part, chosen, Allowance(seconds=seconds), lambda _s, _p: None, speed=1.0, asked=0.01)


def test_the_spot_is_measured_a_digit_beyond_the_study_against_something_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = as_accurate_as_asked(0.0, monkeypatch)
    found = measured_spot(1e3)
    # Rays, which take no tolerance of their own, the choice, the reference, and a digit beyond the choice.
    assert asked[:5] == [0.01, 0.01, 0.01, 0.001, 0.001]
    assert found.reference_error == pytest.approx(0.001 / 1.2**4)
    assert "with 1.2 times the source, nodes, samples and reach" in found.reference
    errors = {entry.setting: entry.error for entry in of(found, "Kirchhoff")}
    assert errors == {
        "tolerance 0.1 %": pytest.approx(0.001 - 0.001 / 1.2**4, rel=1e-2),
        "tolerance 1 %": pytest.approx(0.0095, rel=1e-2),
        "tolerance 10 %": pytest.approx(0.0995, rel=1e-2),
    }
    tenth = a_tenth_of_what_is_asked(found)
    assert tenth is not None
    assert tenth.words == "Kirchhoff, tolerance 0.1 %"
    (note,) = found.notes
    assert "differs from the reference by 0.95 %; at tolerance 0.1 % it took" in note


def test_less_time_gives_a_coarser_reference_and_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    as_accurate_as_asked(0.01, monkeypatch)  # 1 s at 1 %, 10 s for a tenth of it
    found = measured_spot(3.0)
    assert found.reference_error == 0.005
    assert any("tolerance 0.1 %: the reference is no finer" in line for line in found.left_out)
    assert a_tenth_of_what_is_asked(found) is None
    found = measured_spot(0.15)
    assert found.entries == ()
    assert "a reference at 10 %" in found.left_out[0]
    assert "a larger --budget" in found.left_out[0]


class Clock:
    """Wall time that passes only where a picture is computed."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def slow_pictures(pace: float, monkeypatch: pytest.MonkeyPatch) -> tuple[Clock, list[tuple[str, float, float]]]:
    """Rays foreseen to take 0.1 s, waves 0.1 s over the root of their tolerance; all take a pace times as long."""
    clock, made = Clock(), []

    def seconds(_part: LightSpotPart, models: SpotModels) -> float:
        return 0.1 if models.method in RAYS else 0.1 / math.sqrt(models.tolerance)

    def picture(
        _part: LightSpotPart, source: object, models: SpotModels, *, accuracy: ChainAccuracy, seed: int
    ) -> ChainImage:
        finer = accuracy.pupil_nodes**2 * (accuracy.source_sampling**2 if isinstance(source, DiscSource) else 1.0)
        took = pace * finer * seconds(_part, replace(models, tolerance=accuracy.tolerance))
        clock.now += took
        made.append((models.method, accuracy.tolerance, took))
        return ChainImage(
            pixels=np.array([1.0 + accuracy.tolerance]),
            numerical_error=accuracy.tolerance,
            error_terms={},
            direct_check={},
            microlens_share=math.nan,
            effort={},
        )

    monkeypatch.setattr(spot, "picture_of", picture)
    monkeypatch.setattr(spot, "picture_seconds", seconds)
    monkeypatch.setattr(time, "perf_counter", clock)
    return clock, made


def of_spot(kind: str, allowance: Allowance, pace: Pace | None = None) -> CostTable:
    part = tradestudy.load(STUDIES / "light_spot.yaml").definition.file.light_spot
    assert part is not None
    if kind == "point":
        return spot.point_cost(part, allowance, lambda _s, _p: None, speed=1.0, pace=pace)
    chosen = SpotModels(method="kirchhoff", tolerance=0.01)
    return spot.spot_cost(part, chosen, allowance, lambda _s, _p: None, speed=1.0, asked=0.01, pace=pace)


@pytest.mark.parametrize("kind", ["point", "whole"])
@pytest.mark.parametrize("pace", [1.0, 2.0])
@pytest.mark.parametrize("seconds", [0.01, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 60.0, 300.0])
def test_no_reference_is_paid_for_that_nothing_is_held_against(
    kind: str, pace: float, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, made = slow_pictures(pace, monkeypatch)
    found = of_spot(kind, Allowance(seconds=seconds))
    assert clock.now <= seconds  # as slow as a machine in use is expected to be, or quicker
    assert bool(found.entries) == math.isfinite(found.reference_error)
    if not found.entries:
        assert seconds <= 8.0
        assert found.left_out[0].startswith("everything: a reference at")
        assert "a larger --budget" in found.left_out[0]
    else:
        assert found.reference_seconds < clock.now
        assert made[0][0] in RAYS  # what is cheap comes first


@pytest.mark.parametrize("kind", ["point", "whole"])
def test_a_machine_much_slower_than_foreseen_still_leaves_entries(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    clock, _ = slow_pictures(6.0, monkeypatch)
    found = of_spot(kind, Allowance(seconds=6.0))
    assert bool(found.entries) == math.isfinite(found.reference_error)
    assert clock.now < 12.0


def test_the_pace_of_points_keeps_the_whole_spot_within_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, _ = slow_pictures(6.0, monkeypatch)
    pace = Pace()
    of_spot("point", Allowance(seconds=60.0), pace)
    assert pace.for_others().of("kirchhoff") == pytest.approx(6.0)
    begin = clock.now
    found = of_spot("whole", Allowance(seconds=10.0), pace.for_others())
    assert clock.now - begin <= 10.0
    assert found.entries


def test_more_time_gives_a_point_a_finer_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    slow_pictures(1.0, monkeypatch)
    errors = [of_spot("point", Allowance(seconds=seconds)).reference_error for seconds in (5.0, 30.0, 300.0)]
    assert errors[0] > errors[1] > errors[2] == 1e-5


def test_quick_pictures_tell_no_pace_and_unknown_ones_are_taken_for_slow() -> None:
    pace = Pace()
    pace.learn("kirchhoff", predicted=0.01, took=1.0)
    assert pace.of("kirchhoff") == 2.0
    pace.learn("kirchhoff", predicted=1.0, took=3.0)
    pace.learn("kirchhoff", predicted=1.0, took=5.0)
    assert (pace.of("kirchhoff"), pace.of("fresnel"), pace.for_others().of("kirchhoff")) == (5.0, 5.0, 3.0)
