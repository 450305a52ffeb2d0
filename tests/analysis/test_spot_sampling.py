"""Pictures of light spots are sampled until their stated error is within the tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from tests.campaigns.light_cases import large_part
from tradestudy.analysis import spot_images
from tradestudy.analysis.spot_images import SpotModels, light_path, light_source, picture_of
from tradestudy.errors import NotConvergedError, TradestudyError, UnaffordableError
from tradestudy.optics.chain import KIRCHHOFF, ChainAccuracy, chain_image


def test_a_picture_whose_first_sampling_misses_its_tolerance_is_refined() -> None:
    part = large_part(np.random.default_rng([811, 73]))
    path, source, tolerance = light_path(part), light_source(part), 0.02
    accuracy, rng = ChainAccuracy(tolerance=tolerance), np.random.default_rng(0)
    first = chain_image(path, source, wavelength=part.mean_wavelength, legs=KIRCHHOFF, accuracy=accuracy, rng=rng)
    assert first.numerical_error > tolerance
    found = picture_of(part, source, SpotModels(method="kirchhoff", tolerance=tolerance, monochromatic=True), seed=0)
    assert found.within_tolerance
    assert found.tolerance == tolerance
    fine = picture_of(part, source, SpotModels(method="kirchhoff", tolerance=0.005, monochromatic=True), seed=0).pixels
    change = np.linalg.norm(found.pixels - fine) / np.linalg.norm(fine)
    assert change < found.numerical_error


@dataclass(frozen=True, kw_only=True)
class _Image:
    numerical_error: float
    tolerance: float


def _sampled(outcomes: Sequence[float | TradestudyError]) -> tuple[float, list[float]]:
    """Stated error of the image to 1 % by samplings with these outcomes, and the tolerances of the samplings."""
    asked: list[float] = []

    def sampled(tolerance: float) -> _Image:
        asked.append(tolerance)
        outcome = outcomes[len(asked) - 1]
        if isinstance(outcome, TradestudyError):
            raise outcome
        return _Image(numerical_error=outcome, tolerance=tolerance)

    found = spot_images._refined(sampled, 0.01)  # type: ignore[arg-type]  # a stand-in for an image
    assert found.tolerance == 0.01
    return found.numerical_error, asked


def test_refinement_stops_at_the_tolerance() -> None:
    assert _sampled([0.05, 0.008, 1.0]) == (0.008, [0.01, pytest.approx(0.0012)])


def test_refinement_goes_on_where_points_disagree() -> None:
    disagreement = NotConvergedError("points disagree", value="0.4", limit="0.3", remedy="refine")
    assert _sampled([disagreement, 0.009]) == (0.009, [0.01, pytest.approx(0.005)])
    with pytest.raises(NotConvergedError):
        _sampled([disagreement] * 4)


def test_refinement_keeps_what_is_affordable() -> None:
    refusal = UnaffordableError("points to follow", value="1e9", limit="1e7", remedy="raise the tolerance")
    assert _sampled([0.05, refusal])[0] == 0.05
    with pytest.raises(UnaffordableError):
        _sampled([refusal])


def test_refinement_gives_up_after_four_rounds() -> None:
    error, asked = _sampled([0.05, 0.04, 0.03, 0.02])
    assert error == 0.02
    assert len(asked) == 4
