"""Samples of the campaigns that force every omission of random cameras, and cases that were hard for them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.campaigns import depth_of_field_bounds
from tests.campaigns.depth_bounds import audit, omissions
from tests.campaigns.depth_cases import base_study
from tradestudy.effects.base import SlotName
from tradestudy.imaging.kirchhoff import kirchhoff_transfers
from tradestudy.imaging.transfer import airy_transfer
from tradestudy.plan.situations.depth import depth_situations


def test_forced_omissions_stay_within_their_bounds() -> None:
    found = list(audit(6, seed=11))
    assert {one.case.split()[0] for one in found} == {"stereo", "focused", "unfocused"}
    assert [one for one in found if not one.within] == []
    ratios = [one.bound / one.change for one in found if one.counts and math.isfinite(one.change)]
    assert len(ratios) > 30
    assert np.median(ratios) < 30.0


# Distances end [mm] ever closer to where the far end of depth is lost: points in place of pixels double the disparity
# error everywhere, and multiply the depth uncertainty there by 1 and at least so much.
@pytest.mark.parametrize(("end", "least"), [(350.0, 1.5), (436.0, 4.0), (470.0, 10.0)])
def test_an_omission_is_bounded_where_the_far_end_of_depth_runs_away(tmp_path: Path, end: float, least: float) -> None:
    values = {
        "scene.distances.from": "156.6 mm",
        "scene.distances.to": f"{end} mm",
        "scene.wavelength": "464.7 nm",
        "cameras.one.calibration.stability.temperature.standard_deviation": "12.3 K",
        "scene.picture.texture.contrast": "9 %",
        "scene.picture.texture.correlation_length": "1.5 mm",
        "scene.picture.matching_window": "23 px",
        "scene.picture.light.electrons": "2488 electrons",
        "scene.picture.light.at_f_number": 9.4,
        "scene.picture.read_noise": "13 electrons",
        "scene.picture.bit_depth": 14,
        "cameras.one.main_lens.focal_length": "6 mm",
        "cameras.one.main_lens.f_number": 9.4,
        "cameras.one.focus.distance": "176.5 mm",
    }
    found = list(omissions("far end", base_study("unfocused", tmp_path).with_values(values)))
    assert [one for one in found if not one.within] == []
    (pixels,) = [one for one in found if one.slot == "pixel_integration"]
    assert least < pixels.change <= pixels.bound


@pytest.mark.parametrize("f_number", [2.0, 3.8])
def test_angles_at_the_rim_take_their_share_of_what_diffraction_takes(f_number: float) -> None:
    """Kirchhoff's transfer in focus against Airy's: their logarithms differ by sin² θ of Airy's, about."""
    aperture, wavelength = 0.1e-3, 550e-9
    plane = f_number * aperture
    share = np.array([0.1, 0.2, 0.4, 0.6])
    frequency = share / (wavelength * f_number)
    exact, _ = kirchhoff_transfers(
        frequency[np.newaxis], wavelength=wavelength, aperture_diameter=aperture, focal_length=np.array([0.8 * plane]),
        plane_distance=np.array([plane]), defocus_waves=np.zeros(1), lens_phase="perfect",
    )  # fmt: skip
    airy = airy_transfer(frequency, wavelength, f_number)
    sine_squared = 1.0 / (1.0 + 4.0 * f_number**2)
    ratio = np.log(exact[0] / airy) / (sine_squared * np.minimum(1.0, np.abs(np.log(airy))))
    assert np.all((ratio > -1.15) & (ratio < -0.8))


def test_aberration_is_bounded_where_everything_is_held_to_be_in_focus(tmp_path: Path) -> None:
    """Without defocus it blurs all the same."""
    forced: dict[SlotName, str] = {"defocus_blur": "off"}
    values = {
        "scene.distances": {"from": "46 mm", "to": "68 mm", "points": 5, "spacing": "log"},
        "scene.picture.texture.contrast": "20 %",
        "scene.picture.texture.correlation_length": "0.066 mm",
        "scene.picture.light.at_f_number": 2.8,
        "scene.picture.spectrum": None,
        "scene.picture.lens_phase": "parabolic",
        "cameras.one.lenses.focal_length": "5 mm",
        "cameras.one.lenses.f_number": 2.8,
        "cameras.one.focus_distance": "52.8 mm",
        "cameras.one.baseline": "5 mm",
    }
    found = list(omissions("aberration", base_study("stereo", tmp_path).with_values(values), forced))
    assert [one for one in found if not one.within] == []
    (fresnel,) = [one for one in found if one.model == "fresnel"]
    assert fresnel.change > 0.01


def test_aberration_is_bounded_in_light_far_from_the_central_colour(tmp_path: Path) -> None:
    """Blue light shows more of it than that of the centre, which diffraction blurs."""
    forced: dict[SlotName, str] = {"pixel_integration": "off"}
    values = {
        "scene.distances": {"from": "62.5 mm", "to": "95.6 mm", "points": 9, "spacing": "log"},
        "scene.wavelength": "1000 nm",
        "scene.picture.texture.contrast": "20 %",
        "scene.picture.texture.correlation_length": "0.055 mm",
        "scene.picture.light.electrons": "5000 electrons",
        "scene.picture.light.at_f_number": 4.0,
        "scene.picture.read_noise": "1.1 electrons",
        "scene.picture.matching_window": "25 px",
        "scene.picture.spectrum": [
            {"wavelength": "400 nm", "weight": 100.0},
            {"wavelength": "1000 nm", "weight": 0.01},
        ],
        "scene.picture.lens_phase": "parabolic",
        "cameras.one.main_lens.focal_length": "12.32 mm",
        "cameras.one.main_lens.f_number": 4.0,
        "cameras.one.focus.total_covering_plane": "66.16 mm",
    }
    found = list(omissions("blue", base_study("focused", tmp_path).with_values(values), forced))
    assert [one for one in found if not one.within] == []
    (fresnel,) = [one for one in found if (one.slot, one.model) == ("main_lens_diffraction", "fresnel")]
    assert fresnel.change > 0.1


def test_a_sweep_that_goes_through_focus_is_weighed_there_too(tmp_path: Path) -> None:
    """Blurred before and behind, at neither end of the sweep diffraction or pixels change anything to speak of."""
    swept = "cameras.one.focus_distance"
    values = {
        "scene.distances.from": "295 mm",
        "scene.distances.to": "305 mm",
        "scene.picture.texture.contrast": "40 %",
        "scene.picture.texture.correlation_length": "0.2 mm",
        "scene.picture.matching_window": "41 px",
        "scene.picture.light.electrons": "20000 electrons",
        "scene.picture.read_noise": "5 electrons",
        "scene.picture.full_well": "1e7 electrons",
        "cameras.one.lenses.focal_length": "18 mm",
        "cameras.one.lenses.f_number": 8,
        "cameras.one.baseline": "20 mm",
        "cameras.one.principal_distance": "focused",
        "cameras.one.calibration.errors.yaw.standard_deviation": "1e-5 deg",
        swept: "100 mm",
    }
    one = base_study("stereo", tmp_path).with_values(values)
    (situation,) = depth_situations(one.with_values({"sweep": {swept: ["100 mm", "0.3 m", "5 m"]}}), {})
    bounds = {
        slot: next(s for s in situation.slots if s.name == slot).model("off").change_of("depth_uncertainty")
        for slot in ("main_lens_diffraction", "pixel_integration")
    }
    changes = {
        (distance, held.slot): held.change
        for distance in ("100 mm", "0.3 m", "5 m")
        for held in omissions(distance, one.with_values({swept: distance}))
        if held.slot in bounds and held.model == "off"
    }
    for slot, bound in bounds.items():
        assert changes["0.3 m", slot] <= bound
        # Where an end is blurred beyond use, nothing changes at all.
        assert changes["0.3 m", slot] > 3.0 * max(changes.get((end, slot), 0.0) for end in ("100 mm", "5 m"))


def test_calibration_that_is_left_out_does_not_hide_what_else_is(tmp_path: Path) -> None:
    """A yaw of 3° loses the far end of depth wherever it acts: where the study leaves it out, bounds are as without."""
    few = {
        "scene.distances.from": "3 m",
        "scene.distances.to": "20 m",
        "scene.picture.texture.contrast": "3 %",
        "scene.picture.light.electrons": "1000 electrons",
        "cameras.one.baseline": "10 mm",
        "cameras.one.focus_distance": "5 m",
    }
    bounds = []
    for yaw in ("0.001 deg", "3 deg"):
        one = base_study("stereo", tmp_path).with_values(
            few | {"cameras.one.calibration.errors.yaw.standard_deviation": yaw}
        )
        (situation,) = depth_situations(one, {"calibration": "off"})
        picture = [slot for slot in situation.slots if slot.name not in ("calibration", "temperature")]
        bounds.append([model.change_of("depth_uncertainty") for slot in picture for model in slot.models])
    assert bounds[0] == bounds[1]
    assert math.inf in bounds[0]


def test_what_is_sharp_without_the_diffraction_spot_stays_within_its_bound() -> None:
    found = depth_of_field_bounds.audit(40, seed=11)
    assert {one.kind for one in found} == set(depth_of_field_bounds.KINDS)
    assert [one for one in found if not one.within] == []
    assert sum(one.counts for one in found) > 15
    assert np.median([one.bound / one.change for one in found if one.counts]) < 30.0
    assert max(one.off_roots for one in found) < 1e-12
