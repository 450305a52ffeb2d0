"""What the diffraction spot moves in the ends of sharp ranges: kept, unless the study leaves it out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.cameras.focus import BlurCriterion, SingleLensFocus
from tradestudy.cameras.parts import Lens
from tradestudy.models.sharpness import DepthOfFieldProblem
from tradestudy.study.schema.questions import PROBLEM

STUDIES = Path(__file__).parents[2] / "studies"


def test_the_diffraction_spot_moves_sharp_ends_as_the_closed_form_says() -> None:
    """Ends image to b₀/(1 ∓ c/A), the blur circle c whole and with √(c² − (2.44 λ N_w)²) of it."""
    f, n, a, pitch, wavelength = 12.5e-3, 3.8, 0.15, 5.5e-6, 550e-9
    focus = SingleLensFocus(lens=Lens(focal_length=f, f_number=n), focus_distance=a, sample_pitch=pitch)
    with_spot, without = (
        BlurCriterion(blur_px=2.0, measure=measure, wavelength=wavelength) for measure in ("airy-diameter", "none")
    )
    problem = DepthOfFieldProblem([focus], [with_spot], {})
    working = n * a / (a - f)
    allowed = np.sqrt((2 * pitch) ** 2 - (2 * 1.2196698912665045 * wavelength * working) ** 2)
    pupil, image = f / n, a * f / (a - f)
    behind = np.array([[image / (1 - sign * c / pupil) for sign in (1, -1)] for c in (2 * pitch, allowed)])
    ends = f * behind / (behind - f)
    expected = np.max(np.abs(ends[0] / ends[1] - 1))
    change = problem.changes({"main_lens_diffraction": "off"})["depth_of_field"].relative
    assert change == pytest.approx(expected, rel=1e-6)
    assert DepthOfFieldProblem([focus], [without], {}).complete == {"main_lens_diffraction": "off"}


def test_a_study_keeps_the_spot_and_reports_what_omitting_it_changes() -> None:
    kept = tradestudy.load(STUDIES / "hand_lens.yaml").plan()
    assert kept.models(PROBLEM) == {"main_lens_diffraction": "airy"}
    forced = tradestudy.load(STUDIES / "hand_lens.yaml", ["effects.main_lens_diffraction=off"]).plan()
    problem = next(one for one in forced.problems if one.name == PROBLEM)
    assert problem.models == {"main_lens_diffraction": "off"}
    case, asked = forced.study.case, forced.study.file.depth_of_field
    assert asked is not None
    counts = {
        (camera.focus.sharp_range(criterion).slices.near.size, camera.focus.sharp_range(bare).slices.near.size)
        for camera in case.all_cameras.values()
        for criterion in (part.criterion(case.wavelength) for part in asked.criteria.values())
        for bare in [BlurCriterion(blur_px=criterion.blur_px, measure="none", wavelength=case.wavelength)]
    }
    assert any(own != without for own, without in counts)  # sharp slices appear or vanish with the spot …
    assert problem.by_forcing["depth_of_field"].relative == np.inf  # … which no tolerance covers
