"""Models of pictures against everything at once: the reference by other quadratures, the errors by their bounds."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.cameras.builders import r5, stereo
from tests.imaging.test_picture import SETTINGS, hand_lens
from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.cost import depth, measuring
from tradestudy.cost.entries import CostTable, Entry
from tradestudy.cost.measuring import Allowance
from tradestudy.cost.picture import TITLES, picture_cost
from tradestudy.cost.picture_reference import reference_error_px
from tradestudy.cost.study_cost import study_cost
from tradestudy.errors import UnaffordableError
from tradestudy.imaging import derived_error
from tradestudy.imaging.models import PictureModels, texture_spectrum
from tradestudy.imaging.picture import disparity_error_px
from tradestudy.optics.arrays import FloatArray
from tradestudy.plan.situations.depth import depth_situations
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.loading import load_definition

FOCUS = 55e-3


def by_even_steps(wavelength: float, f_number: float, electrons: float, length_px: float) -> float:
    """The bound in focus on an even grid over the whole band, with the Airy transfer and all replicas it passes."""
    n, pixel = 400, 7.4e-6
    axis = (np.arange(n) + 0.5) / n - 0.5
    fx, fy = np.meshgrid(axis, axis)

    def density(x: FloatArray, y: FloatArray) -> FloatArray:
        s = np.minimum(np.hypot(x, y) * wavelength * f_number / pixel, 1.0)
        airy = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))
        passed = airy * np.sinc(x) * np.sinc(y)
        return electrons**2 * texture_spectrum(np.hypot(x, y), 0.2, length_px) * passed**2

    signal, shifts = density(fx, fy), range(-2, 3)
    aliased = sum(density(fx + i, fy + j) for i in shifts for j in shifts if (i, j) != (0, 0))
    noise = electrons + 10.0**2 + (1e5 / 2**12) ** 2 / 12 + aliased
    coherence = signal / (signal + noise)
    information = 15.0**2 * np.mean((2 * np.pi * fx) ** 2 * coherence**2 / (1 - coherence**2))
    return float(1 / math.sqrt(information))


def test_the_reference_in_focus_is_the_airy_pattern_s_by_another_quadrature() -> None:
    """At f/22 exact paths differ from parabolic ones by next to nothing, and Fresnel in focus is Airy."""
    camera = hand_lens(22.0)
    geometry = camera.picture_geometry(np.array([FOCUS]))
    value, error = reference_error_px(geometry, SETTINGS)
    image = 18.3e-3 * 55 / (55 - 18.3)
    working = image / (18.3e-3 / 22)
    expected = by_even_steps(550e-9, working, 8000 * (9.8 / working) ** 2, 100e-6 * image / FOCUS / 7.4e-6)
    # What is cut off at the spectrum's cusp by a grid of even steps is 1e-4.
    assert value[0] == pytest.approx(expected, rel=5e-4)
    assert 0.0 < error[0] < 1e-3 * value[0]


@pytest.mark.parametrize(
    ("camera", "distance"),
    [(hand_lens(9.8), 57e-3), (r5(), 0.3), (stereo(principal_distance_rule="focused"), 0.9)],
    ids=["hand lens", "focused plenoptic", "stereo"],
)
def test_the_reference_and_a_run_with_every_effect_agree_within_what_both_state(camera, distance: float) -> None:
    geometry = camera.picture_geometry(np.array([distance]))
    complete = PictureModels(
        defocus_blur="disc",
        main_lens_diffraction="kirchhoff",
        microlens_diffraction="off" if geometry.microlens is None else "kirchhoff",
        crosstalk="share",
        pixel_integration="square",
        spectrum="off",
        vignetting="cos4",
        sensor_noise="shot+read+quantisation",
    )
    value, error = reference_error_px(geometry, SETTINGS)
    found = disparity_error_px(geometry, SETTINGS, complete)
    assert abs(found.value[0] - value[0]) <= found.error[0] + error[0]
    assert error[0] < 3e-3 * value[0]


def test_lenses_that_resolve_far_more_than_the_samples_are_refused() -> None:
    camera = hand_lens(0.2)
    with pytest.raises(UnaffordableError, match=r"replicas .* \(allowed: at most 24 to a side\)"):
        reference_error_px(camera.picture_geometry(np.array([FOCUS])), SETTINGS)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyDefinition:
    folder = tmp_path_factory.mktemp("study")
    cameras = Path(__file__).parents[2] / "studies" / "cameras"
    (folder / "one.yaml").write_text(
        f"""
format: 2
study: one
title: One pair
question: What does its picture cost?
cameras:
  pair:
    from: {cameras / "stereo-100mm.yaml"}
    principal_distance: focused
    lenses: {{f_number: 11}}
    depth: {{disparity_error: derived}}
scene:
  distances: {{from: 0.8 m, to: 1.3 m, points: 9}}
  wavelength: 550 nm
  picture:
    texture: {{contrast: 15 %, correlation_length: 2 mm}}
    matching_window: 15 px
    light: {{electrons: 4000 electrons, at_f_number: 11}}
    read_noise: 10 electrons
    full_well: 20000 electrons
    bit_depth: 12
accuracy: {{tolerance: 2 %}}
""",
        encoding="utf-8",
    )
    return load_definition(folder / "one.yaml", ())


@pytest.fixture(scope="module")
def situation(study: StudyDefinition) -> Situation:
    return depth_situations(study, {})[0]


def measured(study: StudyDefinition, situation: Situation, seconds: float = 1e4) -> CostTable:
    found = picture_cost(
        study,
        situation,
        situation.select(study.file.accuracy.wanted(), {}),
        Allowance(seconds=seconds),
        progress=lambda _step, _share: None,
        name="picture_1",
    )
    assert found is not None
    return found


@pytest.fixture(scope="module")
def table(study: StudyDefinition, situation: Situation) -> CostTable:
    patch = pytest.MonkeyPatch()
    patch.setattr(measuring, "_LONG", 0.0)  # once is enough
    patch.setattr(depth, "MOST_PLACES", 3)
    try:
        return measured(study, situation)
    finally:
        patch.undo()


def entry(table: CostTable, model: str, setting: str = "") -> Entry:
    return next(one for one in table.entries if (one.model, one.setting) == (model, setting))


def test_everything_at_once_errs_by_what_the_reference_does(table: CostTable) -> None:
    assert entry(table, "Kirchhoff").error < 3.0 * table.reference_error < 3e-3
    assert entry(table, "Fresnel").error < 5e-3
    assert entry(table, "no diffraction").error > 3.0 * entry(table, "Fresnel").error


def test_every_omission_errs_by_less_than_it_said_beforehand(table: CostTable, situation: Situation) -> None:
    slots = {slot.name: slot for slot in situation.slots}
    seen = 0
    for one in table.entries:
        law = next(name for name, title in TITLES.items() if title == one.model)
        bound = slots["main_lens_diffraction"].model(law).change_of("depth_uncertainty")
        for words in filter(None, one.setting.split(", ")):
            slot, _, model = words.rpartition(" ")
            bound += slots[slot.replace(" ", "_")].model(model).change_of("depth_uncertainty")  # type: ignore[index]
            seen += 1
        assert one.error <= bound + table.reference_error
    assert seen >= 5


def test_the_choice_is_that_of_the_plan(table: CostTable, study: StudyDefinition, situation: Situation) -> None:
    (chosen,) = [one for one in table.entries if one.chosen]
    selection = situation.select(study.file.accuracy.wanted(), {})
    assert chosen.model == TITLES[selection.name_of("main_lens_diffraction")]
    assert chosen.error <= selection.bounds["depth_uncertainty"] + table.reference_error
    assert len({(one.model, one.setting) for one in table.entries}) == len(table.entries)


def test_without_time_nothing_is_measured_and_that_is_said(study: StudyDefinition, situation: Situation) -> None:
    found = measured(study, situation, seconds=1e-9)
    assert found.entries == ()
    assert math.isnan(found.reference_error)
    assert "time for a reference" in found.left_out[0]


def test_a_study_s_cost_has_one_quantity_for_every_derived_camera(
    study: StudyDefinition, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "_LONG", 0.0)
    monkeypatch.setattr(depth, "MOST_PLACES", 1)
    found = study_cost(study, budget=2.0)
    assert found["cost_quantity"].values.tolist() == ["depth_uncertainty", "picture_1"]
    assert found["title"].values.tolist()[1] == "Picture models: Stereo 30.5 mm"


def test_no_way_of_propagating_errors_is_charged_with_the_picture(
    study: StudyDefinition, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = study.case.cameras["pair"]
    places = depth.usable_places(study, camera)
    known = depth._with_known_errors(camera, places)
    expected = depth_uncertainty(camera, places)

    def derived_again(*_: object) -> None:
        raise AssertionError("the picture is computed again")

    monkeypatch.setattr(derived_error, "disparity_bound_px", derived_again)
    derived_error._bound_px.cache_clear()
    np.testing.assert_allclose(depth_uncertainty(known, places), expected, rtol=1e-14)
