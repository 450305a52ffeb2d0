"""Disparity errors derived from the picture, through a study: what follows them, what does not, what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.analysis.plain_depths import CENTRAL, of_rig
from tests.imaging.test_picture import CLOSED, SETTINGS, hand_lens
from tests.study.conftest import STUDIES
from tradestudy.answers import runner
from tradestudy.answers.decision import decide_pair
from tradestudy.answers.depth import depth_at_places_group
from tradestudy.answers.disparity_causes import compute_kirchhoff_pictures
from tradestudy.cameras.calibration import Calibration, Propagation
from tradestudy.depth.evaluation import ERROR_SOURCES, evaluate_depth
from tradestudy.depth.usable import evaluate_limits, usable_intervals
from tradestudy.errors import StudyError
from tradestudy.execution import Steps
from tradestudy.imaging.optical_transfer import kirchhoff_correction
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.models.plan import plan_of
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Choices, PreparedStudy
from tradestudy.uncertainty.distributions import Normal, Uniform

NOISE, BOTH = ERROR_SOURCES.index("noise"), ERROR_SOURCES.index("both")
FOCUS = np.array([55.3e-3])
PICTURE = (
    "scene.picture={texture: {contrast: 1 %, correlation_length: 1 mm}, matching_window: 9 px, light: {electrons: "
    "100 electrons, at_f_number: 4}, read_noise: 20 electrons, full_well: 1e4 electrons, bit_depth: 8}"
)


@pytest.fixture(scope="module")
def study() -> PreparedStudy:
    return load_prepared(STUDIES / "close_range.yaml", ("scene.distances.points=39",))


def uncertainty(study: PreparedStudy, camera: str, distance: np.ndarray) -> np.ndarray:
    return evaluate_depth(study.case.cameras[camera], distance).uncertainty


def test_stopping_down_at_fixed_light_raises_depth_uncertainty_in_focus(study: PreparedStudy) -> None:
    f96, f22 = (uncertainty(study, name, FOCUS)[:, 0] for name in ("pair-f9.8", "pair-f22"))
    assert f22[NOISE] > 3 * f96[NOISE]
    assert f22[BOTH] > 1.4 * f96[BOTH]  # calibration is the larger part of the wider one
    # Light alone costs less: the rest is diffraction.
    lossless = []
    for name in ("pair-f9.8", "pair-f22"):
        camera = study.case.cameras[name]
        law = camera.disparity_error_px
        assert isinstance(law, PictureDisparityError)
        bare = replace(law, models=replace(law.models, main_lens_diffraction="off"))
        lossless.append(evaluate_depth(replace(camera, disparity_error_px=bare), FOCUS).uncertainty[NOISE, 0])
    assert f22[NOISE] / f96[NOISE] > 1.4 * lossless[1] / lossless[0]


def test_a_smaller_aperture_buys_range_with_uncertainty(study: PreparedStudy) -> None:
    depth = {}
    for name in ("pair-f5.6", "pair-f9.8", "pair-f22"):
        (interval,) = usable_intervals(study.case.cameras[name], study.case.criteria, study.case.distance)
        why = "the window is too small for the blur" if name != "pair-f22" else "the matching error exceeds"
        assert interval.near_limit.startswith(f"matching: {why}"), interval
        assert interval.far_limit.startswith(f"matching: {why}")
        depth[name] = interval.far - interval.near
    assert depth["pair-f5.6"] < depth["pair-f9.8"] < depth["pair-f22"]


def test_the_range_ends_where_the_matcher_leaves_the_bound(study: PreparedStudy) -> None:
    camera = study.case.cameras["pair-f9.8"]
    (interval,) = usable_intervals(camera, study.case.criteria, study.case.distance)
    law = camera.disparity_error_px
    for end, outside in ((interval.near, 1 - 1e-6), (interval.far, 1 + 1e-6)):
        assert law.derived(camera, np.array([end])).applies.all()
        broken = law.derived(camera, np.array([end * outside])).violated
        assert [name for name, where in broken.items() if where[0]] == ["the window is too small for the blur"]


@pytest.mark.parametrize("field", [0.0, 0.6])
def test_exact_calibrations_with_a_derived_error_agree_with_random_draws(field: float) -> None:
    """Rotation matrices and a plain disparity, on the axis and off it; the noise is that of the picture there."""
    yaw, roll = 0.004, 0.02
    parts = [("yaw", Uniform(low=-yaw, high=yaw)), ("roll", Normal(mean=0.0, standard_deviation=roll))]
    plain = hand_lens()
    camera = replace(
        plain,
        disparity_error_px=PictureDisparityError(settings=SETTINGS, models=CLOSED),
        calibration=Calibration(groups=tuple(of_rig(*part) for part in parts)),
        propagation=Propagation(model="exact", judged=(54e-3,), tolerance=5e-3, max_draws=2**17),
    )
    rng, draws, places = np.random.default_rng(8), 200_000, np.array([52e-3, 55e-3, 58e-3])
    found = evaluate_depth(camera, places, field)
    c = plain.principal_distance
    right, down = (field * extent / 2.0 / c for extent in (plain.sensor.width, plain.sensor.height))
    turned = Rotation.from_euler(
        "YXZ", np.stack([-rng.uniform(-yaw, yaw, draws), np.zeros(draws), rng.normal(0.0, roll, draws)], axis=1)
    )
    for k, z in enumerate(places):
        noise = rng.normal(0.0, 7.4e-6 * found.disparity_error_px[k], draws)
        # What an ideal pair sees, and the right ray turned as a rig so calibrated believes.
        left = right + plain.baseline / 2.0 / z + noise / 2.0 / c
        ray = turned.apply(
            np.stack([right - plain.baseline / 2.0 / z - noise / 2.0 / c, np.full(draws, down), np.ones(draws)], axis=1)
        )
        depth = plain.baseline / (left - ray[:, 0] / ray[:, 2])
        low, high = np.quantile(depth, CENTRAL[0.6827])
        np.testing.assert_allclose(found.uncertainty[BOTH, k], (high - low) / 2.0, rtol=0.01)
    by_line = evaluate_depth(replace(camera, propagation=Propagation()), places, field)
    np.testing.assert_allclose(by_line.uncertainty[NOISE], found.uncertainty[NOISE], rtol=1e-12)


def test_a_declared_error_is_untouched_by_the_picture(study: PreparedStudy) -> None:
    other = study.with_values({"scene.picture.texture.contrast": "1 %", "scene.picture.matching_window": "30 px"})
    a = study.case.distance
    np.testing.assert_array_equal(uncertainty(study, "pair-declared", a), uncertainty(other, "pair-declared", a))
    assert np.all(uncertainty(other, "pair-f22", FOCUS)[NOISE] > 3 * uncertainty(study, "pair-f22", FOCUS)[NOISE])
    assert "matching" not in evaluate_limits(study.case.cameras["pair-declared"], study.case.criteria, a)


def test_a_declared_error_at_five_metres_ignores_the_picture() -> None:
    path, five = STUDIES / "plenoptic_vs_stereo.yaml", np.array([5.0])
    plain = load_prepared(path)
    pictured = load_prepared(
        path,
        (PICTURE,),
    )
    for name, camera in plain.case.cameras.items():
        assert camera == pictured.case.cameras[name]
    assert "stereo" in {camera.family for camera in plain.case.cameras.values()}
    assert np.isfinite(evaluate_depth(plain.case.cameras["stereo-printed"], five).uncertainty).all()


def test_two_distances_do_not_hide_two_crossings_between_them() -> None:
    """The wider of two lenses is more certain in focus, and less certain where it is blurred on both sides of it."""
    few, many = (load_prepared(STUDIES / "close_range.yaml", (f"scene.distances.points={n}",)) for n in (2, 153))
    pair, nowhere = ("pair-f9.8", "pair-f5.6"), np.array([])
    found, dense = (decide_pair(one.case, pair, nowhere).crossings["both"] for one in (few, many))
    assert [one.nearer for one in found] == ["pair-f9.8", "pair-f5.6"]
    assert [one.distance for one in found] == pytest.approx([one.distance for one in dense], rel=1e-6)
    there = np.array([one.distance for one in found])
    first, second = (evaluate_depth(few.case.cameras[name], there).judged[BOTH] for name in pair)
    assert first == pytest.approx(second, rel=1e-4)


def test_results_contain_the_error_and_its_own_error(study: PreparedStudy) -> None:
    depth = depth_at_places_group(study, tuple(study.case.distance.tolist()))
    names = list(study.case.cameras)
    error = depth["disparity_error_px"].to_numpy()
    own = depth["disparity_error_px_error"].to_numpy()
    assert np.all(error[names.index("pair-declared")] == 0.1)
    assert np.all(own[names.index("pair-declared")] == 0.0)
    derived = error[names.index("pair-f9.8")]
    assert derived.min() < 0.05 < 0.3 < derived.max()
    assert np.all((own[names.index("pair-f9.8")] > 0.0) & (own[names.index("pair-f9.8")] < 0.1 * derived))


def test_other_lens_values_change_the_derived_error(study: PreparedStudy) -> None:
    changed = study.with_values({"pair-f9.8.lenses.f_number": "22"})
    assert changed.case.cameras["pair-f9.8"] == study.case.cameras["pair-f22"]


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ("scene.picture=null", "cameras.pair-f9.8.depth.disparity_error", "scene.picture (texture, window, light"),
        ("scene.picture.matching_window=9 kg", "scene.picture.matching_window", "pixels such as 9 px, or a length"),
        ("scene.picture.matching_window=0 mm", "scene.picture.matching_window", "above 0 px or 0 m"),
        ("scene.picture.bit_depth=17", "scene.picture.bit_depth", "16"),
        ("scene.picture.stop_separation=3 mm", "scene.picture.stop_separation", "give a field_angle"),
        ("scene.picture.light=null", "scene.picture.light", ""),
        ("pair-f22.depth.error_of=coordinate", "cameras.pair-f22.depth.error_of", "leave error_of out"),
        ("pair-f22.depth.disparity_error=derivd", "cameras.pair-f22.depth.disparity_error", "nearest: 'derived'"),
    ],
)
def test_mistakes_are_reported_at_their_place(change: str, place: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        load_prepared(Path(STUDIES / "close_range.yaml"), (change,))
    assert any(problem.path == place and words in problem.what for problem in caught.value.problems), caught.value


def test_kirchhoff_s_correction_is_computed_beforehand_with_progress(study: PreparedStudy) -> None:
    """Then no distance of the study waits for it."""
    few = {"from": "54 mm", "to": "57 mm", "points": 5, "spacing": "log"}
    slow = study.with_values({"scene.distances": few, "decision.at": ["54 mm", "57 mm"]})
    with_kirchhoff = replace(slow, choices=Choices(models={"pair-f22": {"main_lens_diffraction": "kirchhoff"}}))
    reported: list[tuple[str, float]] = []
    compute_kirchhoff_pictures(with_kirchhoff, lambda step, share: reported.append((step, share)))
    shares = [share for _, share in reported]
    assert shares == sorted(set(shares))
    assert len(shares) > 5
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    assert {step for step, _ in reported} == {"pictures"}
    computed = kirchhoff_correction.cache_info().misses
    by_kirchhoff, by_fresnel = (uncertainty(one, "pair-f22", slow.case.distance) for one in (with_kirchhoff, slow))
    assert kirchhoff_correction.cache_info().misses == computed
    assert np.any(by_kirchhoff != by_fresnel)
    reported.clear()
    compute_kirchhoff_pictures(slow, lambda step, share: reported.append((step, share)))
    assert not reported


def test_a_run_computes_it_before_depth(study: PreparedStudy, monkeypatch: pytest.MonkeyPatch) -> None:
    class ReachedError(Exception):
        pass

    def depth(*_: object) -> None:
        raise ReachedError

    monkeypatch.setattr(runner, "depth_tables", depth)
    few = {"scene.distances": {"from": "55 mm", "to": "55.5 mm", "points": 2, "spacing": "log"}}
    forced = study.with_values({**few, "effects": {"main_lens_diffraction": "kirchhoff"}})
    reported: list[tuple[str, float]] = []
    with pytest.raises(ReachedError):
        runner.compute(plan_of(forced), Steps(progress=lambda step, share: reported.append((step, share))))
    assert reported[-1] == ("pictures", 1.0)
