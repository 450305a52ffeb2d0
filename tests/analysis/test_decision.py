"""Who is better where: crossovers, ends and inverse questions against closed forms, and ties."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.analysis.plain_depths import PIXEL, B, half_width, of_rig
from tests.analysis.test_linear_depth import STUDY
from tests.cameras.builders import stereo
from tradestudy.answers import decision
from tradestudy.answers.decision import TIED, PairVerdict, best_cameras, decide_pair
from tradestudy.answers.questions import solve
from tradestudy.answers.ranks import rank
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.cameras.depth_measurement import Environment
from tradestudy.depth.usable import usable_intervals
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Case, Choices
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sources import ErrorClass, Source

GRID = np.geomspace(0.5, 6.0, 61)
EXACT = Propagation(model="exact", judged=(1.0, 3.0), tolerance=5e-3)


def rig(*, stretched: float = 0.0, noise_px: float = 1.0, **changes) -> DepthCamera:
    """A rig whose baseline is off by a share, in standard deviations."""
    source = of_rig("baseline", Normal(mean=0.0, standard_deviation=stretched * B))
    calibration = Calibration(groups=(source,)) if stretched else Calibration()
    return stereo(**({"disparity_error_px": noise_px, "calibration": calibration, "propagation": EXACT} | changes))


def case(criteria: UsableCriteria | None = None, **cameras: DepthCamera) -> Case:
    return Case(
        cameras=cameras, all_cameras=cameras, criteria=criteria or UsableCriteria(), distance=GRID, wavelength=550e-9
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_spread_of_crossovers_over_scrambles_contains_the_truth(seed: float) -> None:
    """One rig has the larger noise, the other an uncertain baseline; both have closed forms."""

    def lead(z: float) -> float:
        return half_width(z, noise=2.0 * PIXEL, baseline=0.001 * B) / half_width(z, noise=PIXEL, baseline=0.02 * B) - 1

    truth = brentq(lead, 0.6, 5.0)
    exact = replace(EXACT, seed=seed)
    cameras = {
        "noisy": rig(noise_px=2.0, stretched=0.001, propagation=exact),
        "stretched": rig(stretched=0.02, propagation=exact),
    }
    (crossing,) = decide_pair(case(**cameras), ("noisy", "stretched"), GRID[[0, -1]]).crossings["both"]
    assert crossing.nearer == "noisy"
    assert 0.0 < crossing.error < 0.01 * truth
    assert abs(crossing.distance - truth) < 5.0 * crossing.error


def test_a_switch_of_the_winner_has_the_error_of_the_crossover_and_is_reported_once() -> None:
    cameras = {"noisy": rig(noise_px=2.0, stretched=0.001), "stretched": rig(stretched=0.02)}
    found = decide_pair(case(**cameras), ("noisy", "stretched"), np.array([0.6, 5.0]))
    (crossing,), (change,) = found.crossings["both"], found.changes["both"]
    assert (change.distance, change.error) == (crossing.distance, crossing.error)
    assert (change.nearer, change.farther) == ("noisy", "stretched")
    assert [row[2] for row in found.winner] == ["noisy", "stretched"]


@pytest.mark.parametrize("seed", range(5))
def test_cameras_that_differ_by_less_than_their_error_are_tied(seed: int) -> None:
    """The same rig drawn with another seed, and one that is worse by a hundred-thousandth: at all of 60 distances."""
    one = rig(stretched=0.05)
    for other in (
        replace(one, propagation=replace(EXACT, seed=100 + seed)),
        rig(stretched=0.05 * (1.0 + 1e-5), propagation=replace(EXACT, seed=200 + seed)),
    ):
        found = decide_pair(case(one=one, other=other), ("one", "other"), GRID)
        assert {row[2] for row in found.winner} == {f"one{TIED}other"}
        assert {row[2] for row in found.more_certain} == {""}
        assert found.crossings["both"] == found.changes["both"] == ()
    same = decide_pair(case(one=one, other=replace(one)), ("one", "other"), GRID[::10])
    assert all(row[2] == f"one{TIED}other" for row in same.winner)
    assert all(row[2] == "" for row in same.more_certain)
    assert same.crossings["both"] == same.changes["both"] == ()


def test_a_reading_is_decided_anew_if_it_changes_a_distance_or_a_compared_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nine distances in equal steps are also every other one of seventeen, so draws must converge at the same ones."""
    others = "  other: {like: rig, depth: {disparity_error: 2 px}}\n  third: {like: rig}\n"
    text = STUDY.replace("ERRORS", "baseline: {standard_deviation: 1 mm}").replace("scene:", others + "scene:")
    asked = (
        "decision: {between: [rig, other], at: [2 m]}\n"
        "readings:\n"
        "  finer: {says: At more distances., set: {scene.distances.points: 17}}\n"
        "  worse: {says: A worse rig., set: {rig.depth.disparity_error: 3 px}}\n"
        "  beside: {says: A worse third rig., set: {third.depth.disparity_error: 3 px}}\n"
    )
    file = tmp_path / "three.yaml"
    file.write_text(text.replace("points: 21", "points: 9, spacing: linear") + asked, encoding="utf-8")
    study = load_prepared(file)
    decided: list[Case] = []

    def recorded(case: Case, pair: tuple[str, str], places: np.ndarray) -> PairVerdict:
        decided.append(case)
        return decide_pair(case, pair, places)

    monkeypatch.setattr(decision, "decide_pair", recorded)
    readings = {"declared": study, **study.readings}
    decision.decision_group(study, readings)
    anew = [name for name, reading in readings.items() if any(reading.case is case for case in decided)]
    assert anew == ["declared", "finer", "worse"]


def test_ties_use_both_errors_and_only_usable_cameras() -> None:
    where = np.ones(4, dtype=bool)
    usable = {"a": where, "b": where, "c": np.array([True, True, False, False])}
    width = {"a": np.full(4, 1.0), "b": np.array([1.02, 1.04, 1.02, np.inf]), "c": np.array([0.5, 1.0, 0.5, 0.5])}
    error = {"a": np.full(4, 0.02), "b": np.array([0.02, 0.02, 0.02, np.nan]), "c": np.zeros(4)}
    assert best_cameras(usable, width, error) == ["c", f"a{TIED}c", f"a{TIED}b", "a"]
    nowhere = {name: np.zeros(4, dtype=bool) for name in width}
    assert best_cameras(nowhere, width, error) == [""] * 4


def test_a_hardly_known_uncertainty_does_not_tie_with_a_far_smaller_one() -> None:
    """±300 m known to ±1600 m against ±15 mm; where it is ±18 mm with the same relative error, nothing is decided."""
    where = {name: np.ones(3, dtype=bool) for name in ("a", "b")}
    width = {"a": np.array([300.0, 0.018, 0.0]), "b": np.array([0.015, 0.015, 0.0])}
    error = {"a": np.array([1600.0, 0.018 * 1600.0 / 300.0, 0.0]), "b": np.array([1e-5, 1e-5, 0.0])}
    assert best_cameras(where, width, error) == ["b", f"a{TIED}b", f"a{TIED}b"]


@pytest.mark.parametrize("seed", range(5))
def test_the_spread_of_the_end_of_a_range_contains_the_truth(seed: int) -> None:
    """Where the half width is 6 % of the distance, with a baseline off by 5 %."""
    truth = brentq(lambda z: half_width(z, noise=PIXEL, baseline=0.05 * B) / z - 0.06, 0.1, 20.0)
    camera = rig(stretched=0.05, propagation=replace(EXACT, seed=seed))
    (interval,) = usable_intervals(camera, UsableCriteria(relative_uncertainty=0.06), np.geomspace(0.5, 20.0, 61))
    assert interval.far_limit == "relative_uncertainty"
    assert 0.0 < interval.far_error < 0.02 * truth
    assert abs(interval.far - truth) < 5.0 * interval.far_error
    assert interval.near_error == 0.0
    by_line = replace(camera, propagation=Propagation())
    (known,) = usable_intervals(by_line, UsableCriteria(relative_uncertainty=0.06), np.geomspace(0.5, 20.0, 61))
    assert known.far_error == 0.0


@pytest.mark.parametrize("model", ["exact", "linear"])
def test_an_inverse_question_gives_the_closed_form_of_the_baseline(tmp_path: Path, model: str) -> None:
    """Which error of the baseline leaves 5 % at 2 m, beside noise of 1 px?"""
    file = tmp_path / "rig.yaml"
    asked = (
        f"effects: {{calibration: {model}}}\n"
        "solve:\n  stretch: {says: 'Which?', vary: cameras.rig.calibration.errors.baseline.standard_deviation, "
        "camera: rig, relative: 5 %, at: 2 m, low: 0.5 mm, high: 20 mm}\n"
    )
    text = STUDY.replace("ERRORS", "baseline: {standard_deviation: 1 mm}").replace("0.001 px", "1 px")
    file.write_text(text + asked, encoding="utf-8")
    study = load_prepared(file)
    study = replace(study, choices=Choices(models={"rig": {"calibration": model}}))
    found = solve(study, study.file.solve["stretch"])
    truth = brentq(lambda s: half_width(2.0, noise=PIXEL, baseline=s) - 0.1, 1e-4, 2e-2)
    if model == "exact":
        assert 0.0 < found.error < 0.01 * truth
        assert abs(found.value - truth) < 5.0 * found.error
    else:
        assert found.error == 0.0
        assert found.value == pytest.approx(truth, rel=5e-3)


def test_two_cameras_are_equally_certain_at_the_solution(tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    other = (
        "  other: {like: rig, title: Other, depth: {disparity_error: 2 px}, calibration: {errors: {baseline: null}}}\n"
    )
    text = STUDY.replace("ERRORS", "baseline: {standard_deviation: 1 mm}").replace("0.001 px", "1 px")
    text = text.replace("scene:", other + "effects: {calibration: exact}\nscene:")
    asked = (
        "solve:\n  stretch: {says: 'Which?', vary: cameras.rig.calibration.errors.baseline.standard_deviation, "
        "equal: [rig, other], at: 2 m, low: 0.5 mm, high: 20 mm}\n"
    )
    file.write_text(text + asked, encoding="utf-8")
    study = load_prepared(file)
    study = replace(study, choices=Choices(models={"rig": {"calibration": "exact"}, "other": {"calibration": "exact"}}))
    found = solve(study, study.file.solve["stretch"])
    target = half_width(2.0, noise=2.0 * PIXEL, baseline=0.0)
    truth = brentq(lambda s: half_width(2.0, noise=PIXEL, baseline=s) - target, 1e-4, 2e-2)
    assert 0.0 < found.error < 0.01 * truth
    assert abs(found.value - truth) < 5.0 * found.error


def test_ranks_are_the_arctangent_of_two_normal_errors() -> None:
    """P(|a| < |b|) = 2/π · atan(σ_b/σ_a) for independent normal depths, and a shared error is one."""
    places = np.array([1.0, 3.0])
    found = rank(rig(stretched=0.01), rig(stretched=0.02), places, "calibration")
    np.testing.assert_allclose(found.first, 2.0 / np.pi * np.arctan(2.0), atol=5e-3)
    np.testing.assert_allclose(found.first + found.second + found.neither, 1.0)
    noise = rank(rig(noise_px=1.0), rig(noise_px=3.0), places, "both")
    # Depth is a little curved in disparity.
    np.testing.assert_allclose(noise.first, 2.0 / np.pi * np.arctan(3.0), atol=1e-2)


def test_both_cameras_share_one_change_of_temperature() -> None:
    warmer = Source(
        name="temperature_change",
        distribution=Normal(mean=0.0, standard_deviation=5.0),
        error_class=ErrorClass.SESSION,
    )

    housing = Environment(
        housing_expansion=23e-6, baseline_expansion=23e-6, array_expansion=23e-6, scale_expansion=0.0,
        focal_length_expansion=5e-6, glass_index=1.52, wavelength=550e-9,
        temperature=293.15, pressure=101_325.0,
    )  # fmt: skip
    calm, warm = (
        rig(calibration=Calibration(groups=(warmer,), environment=replace(housing, housing_expansion=expansion)))
        for expansion in (23e-6, 46e-6)
    )
    found = rank(calm, warm, np.array([1.0, 3.0]), "calibration")
    assert np.all(found.first > 0.999)  # the same change moves the second by more, always
