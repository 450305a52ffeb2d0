"""What Kirchhoff's law changes in a disparity error by Fresnel's, held against its closed rule and against trials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.campaigns.depth_cases import KINDS, base_study, random_study
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.effects import Models
from tradestudy.errors import TradestudyError
from tradestudy.imaging.optical_transfer import kirchhoff_transfers
from tradestudy.imaging.transfer import airy_transfer
from tradestudy.models.depth_problem import depth_problems
from tradestudy.models.depth_variant import DepthVariant
from tradestudy.study.prepared import apply_models


@pytest.mark.parametrize("f_number", [2.0, 3.8])
def test_angles_at_the_rim_reduce_transfer_in_proportion_to_diffraction(f_number: float) -> None:
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


def variant(kind: str, folder: Path, values: dict[str, Any], forced: Models) -> DepthVariant:
    (problem,) = depth_problems(base_study(kind, folder).with_values(values), forced)
    return problem._variants[0]


# A hand lens that is held to be in focus everywhere, which aberration blurs all the same; and a plenoptic camera in
# blue light, which shows more aberration than the light of the centre.
IN_FOCUS = (
    "stereo",
    {
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
    },
    {"defocus_blur": "off"},
    0.01,
)
BLUE = (
    "focused",
    {
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
    },
    {"pixel_integration": "off"},
    0.1,
)


@pytest.mark.parametrize(("kind", "values", "forced", "least"), [IN_FOCUS, BLUE])
def test_aberration_stays_within_its_rule(
    tmp_path: Path, kind: str, values: dict[str, Any], forced: Models, least: float
) -> None:
    found = variant(kind, tmp_path, values, forced)
    assert least < found.tried_by_exact_paths()[0] < float(np.nanmax(sum(found.by_exact_paths)))


def test_exact_paths_of_random_cameras_stay_within_their_rule_and_it_is_not_idle(tmp_path: Path) -> None:
    ratios = []
    for number in range(9):
        kind, rng = KINDS[number % 3], np.random.default_rng((31, number))
        try:
            definition = random_study(base_study(kind, tmp_path), kind, rng)
            (problem,) = depth_problems(definition, {})
        except TradestudyError:  # parts that make no camera
            continue
        found = problem._variants[0]
        if found.places.size:
            ratios.append(found.tried_by_exact_paths()[0] / float(np.nanmax(sum(found.by_exact_paths))))
    assert len(ratios) > 5
    assert max(ratios) < 1.0
    assert max(ratios) > 0.1


def test_a_trial_measures_the_change_of_the_uncertainty_and_not_only_of_the_noise(tmp_path: Path) -> None:
    """Against depth by Kirchhoff's and by Fresnel's law at every place, also where calibration errors dominate."""
    found = []
    for number in range(0, 15, 3):
        rng = np.random.default_rng((32, number))
        (problem,) = depth_problems(random_study(base_study("stereo", tmp_path), "stereo", rng), {})
        (variant,), kirchhoff = problem._variants, problem.complete
        if not variant.usable.any():  # where depth hardly has a far end, its uncertainty exceeds all proportion
            continue
        fresnel = {**kirchhoff, "main_lens_diffraction": "fresnel"}
        while problem.try_out(fresnel):
            pass
        by_fresnel, exact = (
            depth_uncertainty(apply_models(variant.camera, {**models, "calibration": "linear"}), variant.places)
            for models in (fresnel, kirchhoff)
        )
        real = float(np.max(np.abs(by_fresnel / exact - 1.0)))
        found.append((problem.changes(fresnel)["depth_uncertainty"].relative / real, variant.noise_share.min()))
    assert min(share for _, share in found) < 0.5
    assert all(1.0 < ratio < 2.0 for ratio, _ in found), found
