"""What the diffraction spot moves in the ends of sharp ranges."""

from __future__ import annotations

import numpy as np
import pytest

from tradestudy.cameras.focus import BlurCriterion, SingleLensFocus
from tradestudy.cameras.parts import Lens
from tradestudy.plan.pieces.depth_of_field import DepthOfFieldPiece


def test_the_diffraction_spot_moves_sharp_ends_as_the_closed_form_says() -> None:
    """Ends image to b₀/(1 ∓ c/A), the blur circle c whole and with √(c² − (2.44 λ N_w)²) of it."""
    f, n, a, pitch, wavelength = 12.5e-3, 3.8, 0.15, 5.5e-6, 550e-9
    focus = SingleLensFocus(lens=Lens(focal_length=f, f_number=n), focus_distance=a, sample_pitch=pitch)
    with_spot, without = (
        BlurCriterion(blur_px=2.0, measure=measure, wavelength=wavelength) for measure in ("airy-diameter", "none")
    )
    piece = DepthOfFieldPiece([focus], [with_spot], {})
    working = n * a / (a - f)
    allowed = np.sqrt((2 * pitch) ** 2 - (2 * 1.2196698912665045 * wavelength * working) ** 2)
    pupil, image = f / n, a * f / (a - f)
    behind = np.array([[image / (1 - sign * c / pupil) for sign in (1, -1)] for c in (2 * pitch, allowed)])
    ends = f * behind / (behind - f)
    expected = np.max(np.abs(ends[0] / ends[1] - 1))
    change = piece.changes({"main_lens_diffraction": "off"})["depth_of_field"].relative
    assert change == pytest.approx(expected, rel=1e-6)
    assert DepthOfFieldPiece([focus], [without], {}).complete == {"main_lens_diffraction": "off"}
