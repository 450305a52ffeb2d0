"""What the accuracy wanted of a light picture chooses, and that what is chosen acts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.accuracy import Accuracy
from tradestudy.analysis.spot_images import SpotModels, spot_picture
from tradestudy.cameras.focus import BlurCriterion, SingleLensFocus
from tradestudy.cameras.parts import Lens
from tradestudy.effects.light_slots import TOLERANCES, sampling, tolerance_of
from tradestudy.effects.sharpness import diffraction_of_sharpness
from tradestudy.errors import StudyError, UnaffordableError
from tradestudy.optics.chain import microlens_nodes
from tradestudy.plan.situations.light_spot import light_scene, light_spot_situation, spot_models
from tradestudy.plan.situations.point_spread import point_spread_situation
from tradestudy.study.schema.light_spot import LightSpotPart

STUDY = Path(__file__).parents[2] / "studies" / "light_spot.yaml"
SMALL = [
    "light_spot.microlenses.lenses_across=1",
    "light_spot.detector.pixels=23",
    "light_spot.spot.diameter=0.2 mm",
]


def spot(*overrides: str) -> LightSpotPart:
    part = tradestudy.load(STUDY, list(overrides)).file.light_spot
    assert part is not None
    return part


def test_each_digit_of_the_light_spot_picks_another_set_and_costs_more() -> None:
    situation = light_spot_situation(spot())
    found = [situation.select(Accuracy.of_all(asked), {}) for asked in (0.1, 0.01, 0.001)]
    sets = [tuple(model.name for model in one.chosen.values()) for one in found]
    assert len(set(sets)) == 3
    assert [spot_models(one).method for one in found] == ["exact-rays", "kirchhoff", "kirchhoff"]
    assert [one.name_of("sampling") for one in found] == ["0.2 %", "1 %", "0.1 %"]
    for one, asked in zip(found, (0.1, 0.01, 0.001), strict=True):
        assert one.bounds["pixel_intensity"] <= asked * (1 + 1e-12)
    assert found[0].seconds < found[1].seconds < found[2].seconds


@pytest.mark.parametrize("gaps", ["opaque", "clear"])
def test_nodes_are_not_placed_to_count_what_a_picture_costs(gaps: str, monkeypatch: pytest.MonkeyPatch) -> None:
    part = spot(
        f"light_spot.microlenses.interstices={gaps}", "light_spot.spot.diameter=3.9 mm"
    )  # weighed by no other test

    def placed(*_: object, **__: object) -> None:
        raise AssertionError("nodes were placed")

    for name in ("disc_nodes", "rectangle_nodes", "_nodes_of"):
        monkeypatch.setattr(microlens_nodes, name, placed)
    situation = light_spot_situation(part)
    assert situation.select(Accuracy.of_all(0.01), {}).seconds > 0.0
    with pytest.raises(AssertionError, match="nodes were placed"):
        microlens_nodes.cell_nodes(light_scene(part).path.microlenses, cycles=2.0)


def test_rays_and_waves_cannot_be_combined() -> None:
    situation = light_spot_situation(spot())
    with pytest.raises(UnaffordableError, match="Picture of the light spot"):
        situation.select(Accuracy.of_all(0.1), {"main_lens_diffraction": "off", "microlens_diffraction": "kirchhoff"})
    rays = situation.select(Accuracy.of_all(0.05), {"main_lens_diffraction": "off", "microlens_diffraction": "off"})
    assert spot_models(rays).method == "exact-rays"
    assert rays.bounds["pixel_intensity"] > 0.05  # what was forced is told, not held against the accuracy


def test_boundary_waves_stand_on_both_legs_where_they_are_insisted_on() -> None:
    """Never chosen behind the array, for they cost more than Kirchhoff's integral there and err more."""
    situation = light_spot_situation(spot("light_spot.microlenses.focal_length=0.35 mm"))
    both = {"main_lens_diffraction": "boundary_wave", "microlens_diffraction": "boundary_wave"}
    forced = situation.select(Accuracy.of_all(0.05), both)
    assert spot_models(forced).method == "boundary-wave"
    assert 0.0 < forced.chosen["microlens_diffraction"].change_of("pixel_intensity") < 0.1
    edges, integral = (
        situation.select(
            Accuracy.of_all(0.01),
            {"main_lens_diffraction": "kirchhoff", "microlens_diffraction": law, "sampling": "1 %"},
        )
        for law in ("boundary_wave", "kirchhoff")
    )
    assert edges.seconds > integral.seconds
    part = spot(*SMALL, "light_spot.microlenses.focal_length=0.35 mm", "light_spot.spot.diameter=0 mm")
    pictures = [
        spot_picture(part, SpotModels(method=method, tolerance=0.01, point=True))
        for method in ("kirchhoff-boundary-wave", "kirchhoff")
    ]
    change = np.linalg.norm(pictures[0].pixels - pictures[1].pixels) / np.linalg.norm(pictures[1].pixels)
    assert 1e-6 < change < pictures[0].numerical_error + pictures[1].numerical_error < 0.05
    assert pictures[0].handed_over < 0.5


def test_boundary_waves_run_around_circles() -> None:
    square = "light_spot.microlenses.aperture=square"
    for wrong in (["light_spot.methods=[kirchhoff-boundary-wave]"], ["effects={microlens_diffraction: boundary_wave}"]):
        with pytest.raises(StudyError, match="run around circles"):
            spot(square, "claims={}", *wrong)
    assert "boundary_wave" not in light_spot_situation(spot(square)).slots[1].model_names


def test_a_spot_below_resolution_is_a_point() -> None:
    situation = light_spot_situation(spot(*SMALL, "light_spot.spot.diameter=0.1 um"))
    chosen = situation.select(Accuracy.of_all(0.05), {})
    assert chosen.name_of("source_extent") == "off"
    wide = light_spot_situation(spot(*SMALL)).select(Accuracy.of_all(0.05), {})
    assert wide.name_of("source_extent") == "disc"


def test_every_choice_changes_the_picture() -> None:
    part = spot(*SMALL)
    complete = SpotModels(method="fresnel", tolerance=0.05)
    reference = spot_picture(part, complete).pixels
    for changed in (
        SpotModels(method="geometric", tolerance=0.05),
        SpotModels(method="exact-rays", tolerance=0.05),
        SpotModels(method="boundary-wave-kirchhoff", tolerance=0.05),
        SpotModels(method="geometric-fresnel", tolerance=0.05),
        SpotModels(method="fresnel-geometric", tolerance=0.05),
        SpotModels(method="fresnel", tolerance=0.05, integrated=False),
        SpotModels(method="fresnel", tolerance=0.05, point=True),
        SpotModels(method="fresnel", tolerance=0.01),
    ):
        pixels = spot_picture(part, changed).pixels
        assert 1e-6 < np.linalg.norm(pixels - reference) / np.linalg.norm(reference) < 10.0, changed


def test_a_tolerance_belongs_to_methods() -> None:
    with pytest.raises(StudyError, match="belongs to methods"):
        spot("light_spot.methods=[]", "claims={}")


def test_tolerances_are_their_own_bounds() -> None:
    slot = sampling()
    assert [tolerance_of(model) for model in slot.models] == list(TOLERANCES)
    assert slot.model_names[-1] == "0.1 %"


def test_wide_pupils_call_for_kirchhoff_and_narrow_ones_do_not() -> None:
    part = tradestudy.load(STUDY).file.point_spread
    assert part is not None
    wanted = Accuracy.of_all(0.05)
    assert point_spread_situation(part).select(wanted, {}).name_of("main_lens_diffraction") == "kirchhoff"
    slow = part.model_copy(update={"f_numbers": (16.0,), "defocus": (0.0,), "field_angles": (0.0,)})
    elements = {"main-lens": part.elements["main-lens"].model_copy(update={"f_number": 16.0})}
    chosen = point_spread_situation(slow.model_copy(update={"elements": elements})).select(wanted, {})
    assert chosen.name_of("main_lens_diffraction") == "fresnel"


def test_the_diffraction_spot_moves_sharp_ends_as_the_closed_form_says() -> None:
    """Ends image to b₀/(1 ∓ c/A), the blur circle c whole and with √(c² − (2.44 λ N_w)²) of it."""
    f, n, a, pitch, wavelength = 12.5e-3, 3.8, 0.15, 5.5e-6, 550e-9
    focus = SingleLensFocus(lens=Lens(focal_length=f, f_number=n), focus_distance=a, sample_pitch=pitch)
    with_spot, without = (
        BlurCriterion(blur_px=2.0, measure=measure, wavelength=wavelength) for measure in ("airy-diameter", "none")
    )
    slot = diffraction_of_sharpness([focus], [with_spot])
    working = n * a / (a - f)
    allowed = np.sqrt((2 * pitch) ** 2 - (2 * 1.2196698912665045 * wavelength * working) ** 2)
    pupil, image = f / n, a * f / (a - f)
    behind = np.array([[image / (1 - sign * c / pupil) for sign in (1, -1)] for c in (2 * pitch, allowed)])
    ends = f * behind / (behind - f)
    expected = np.max(np.abs(ends[0] / ends[1] - 1))
    assert slot.model("off").change_of("depth_of_field") == pytest.approx(expected, rel=1e-6)
    assert diffraction_of_sharpness([focus], [without]).model_names == ("off",)
