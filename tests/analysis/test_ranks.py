"""Ranks of cameras that lose depth, and inverse questions of several inputs or without an answer."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.analysis.plain_depths import B, F, of_rig
from tests.analysis.test_linear_depth import STUDY
from tests.cameras.builders import stereo
from tradestudy.answers.questions import solve
from tradestudy.answers.ranks import rank
from tradestudy.answers.solutions import Solved
from tradestudy.cameras.calibration import Calibration
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Choices
from tradestudy.uncertainty.distributions import Normal

R5 = """  r5:
    kind: focused-plenoptic
    title: R5
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, types: 3}
    focus: {total_covering_plane: 150 mm, relay: keplerian}
    depth: {estimator: same-type-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors:
        mla_distance: {standard_deviation: 2 um}
        focal_length: {standard_deviation: 2 um}
        microlens_gap: {standard_deviation: 0.2 um}
      correlations: {mla_distance: {focal_length: 0.9}}
solve:
  array:
    says: Which?
    vary: [r5.calibration.errors.mla_distance.standard_deviation, r5.calibration.errors.focal_length.standard_deviation]
    low: 0.01 um
    high: 100 um
    camera: r5
    relative: 1 %
    at: 0.5 m
    errors: INCLUDED
scene:"""


def answer(folder: Path, errors: str, model: str) -> Solved:
    """How well the array of the R5 must be known for 1 % at half a metre."""
    file = folder / "array.yaml"
    text = STUDY.replace("ERRORS", "baseline: {standard_deviation: 1 mm}").replace(
        "scene:", R5.replace("INCLUDED", errors)
    )
    file.write_text(text, encoding="utf-8")
    study = load_prepared(file)
    study = replace(study, choices=Choices(models={"r5": {"calibration": model}}))
    return solve(study, study.file.solve["array"])


@pytest.mark.parametrize("model", ["exact", "linear"])
def test_two_tied_inputs_are_varied_together(tmp_path: Path, model: str) -> None:
    """Both spreads σ, ρ = 0.9: u = s σ √(1 − 2ρw + w²), s = ((a − f)/f)², w = (a/(a − f))²; the gap adds s v δ."""
    f, a, target = 12.5e-3, 0.5, 5e-3
    slope, weight = ((a - f) / f) ** 2, (a / (a - f)) ** 2
    gap = slope * (14.77255e-3 - f * a / (a - f)) / 0.568093e-3 * 0.2e-6
    expected = math.sqrt(target**2 - gap**2) / (slope * math.sqrt(1 - 2 * 0.9 * weight + weight**2))
    found = answer(tmp_path, "calibration", model)
    assert found.value == pytest.approx(expected, rel=0.01)
    assert "declared: 2 um" in found.answer


def test_a_question_without_an_answer_gives_the_reason(tmp_path: Path) -> None:
    """Noise alone is 25.7 mm at half a metre, 5.14 times the goal, whose square is 26.4."""
    found = answer(tmp_path, "both", "linear")
    assert math.isnan(found.value)
    assert math.isnan(found.error)
    noise = r"25\.7 mm, exceeds .*5 mm, .* at least 27 measurements"
    assert re.match(rf".*10 nm .*100 µm: R5 .*not .*1 % at 500 mm.* {noise}$", found.answer)


def test_a_measurement_beyond_infinity_loses_and_two_rank_neither() -> None:
    """Noise σ at a disparity d is beyond infinity with Φ(−d/σ): 15.9 % at d = σ, for each camera on its own."""
    noise = 2.0 * 10e-6
    lost = math.erfc(1.0 / math.sqrt(2.0)) / 2.0
    source = of_rig("baseline", Normal(mean=0.0, standard_deviation=0.001 * B))
    noisy = stereo(disparity_error_px=2.0, calibration=Calibration(groups=(source,)))
    found = rank(noisy, noisy, np.array([F * B / noise]), "both")
    assert found.neither[0] == pytest.approx(lost**2, abs=2e-3)
    np.testing.assert_allclose(found.first, (1.0 - lost**2) / 2.0, atol=5e-3)
    sure = stereo(disparity_error_px=1e-3, calibration=Calibration(groups=(source,)))
    found = rank(sure, noisy, np.array([F * B / noise]), "both")
    assert found.first[0] > 0.99
    assert found.neither[0] == 0.0


def test_neither_of_two_perfect_cameras_errs_less_if_all_noise_is_averaged_out() -> None:
    perfect = stereo(calibration=Calibration(groups=()))
    found = rank(perfect, perfect, np.array([1.0, 3.0]), "calibration")
    np.testing.assert_array_equal(found.neither, 1.0)
