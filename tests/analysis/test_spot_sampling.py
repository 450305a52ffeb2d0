"""Pictures of light spots are sampled until their stated error is within the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from tests.campaigns.light_cases import large_part
from tradestudy.errors import NotConvergedError, TradestudyError, UnaffordableError
from tradestudy.models import spot_images
from tradestudy.models.spot_images import SpotModels, light_path, light_source, picture_of
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.scene import KIRCHHOFF


@pytest.mark.slow
def test_a_picture_whose_first_sampling_misses_its_tolerance_is_refined() -> None:
    part = large_part(np.random.default_rng([811, 73]))
    path, source, tolerance = light_path(part), light_source(part), 0.02
    accuracy, rng = ChainAccuracy(tolerance=tolerance), np.random.default_rng(0)
    first = chain_image(path, source, wavelength=part.mean_wavelength, legs=KIRCHHOFF, accuracy=accuracy, rng=rng)
    assert first.numerical_error > tolerance
    found = picture_of(part, SpotModels(method="kirchhoff", tolerance=tolerance, monochromatic=True), seed=0)
    assert found.within_tolerance
    assert found.tolerance == tolerance
    fine = picture_of(part, SpotModels(method="kirchhoff", tolerance=0.01, monochromatic=True), seed=0).pixels
    change = np.linalg.norm(found.pixels - fine) / np.linalg.norm(fine)
    assert change < found.numerical_error


@dataclass(frozen=True, kw_only=True)
class _Image:
    error_terms: dict[str, float]
    tolerance: float

    @property
    def numerical_error(self) -> float:
        return math.hypot(*self.error_terms.values())


Outcome = tuple[float, float] | TradestudyError


def _sampled(*outcomes: Outcome) -> tuple[float, list[tuple[float, float]]]:
    """Stated error of the image to 1 % by samplings with these outcomes, and their tolerances and source samplings.

    An outcome consists of the errors by points of the source and by everything else.
    """
    asked: list[tuple[float, float]] = []

    def sampled(accuracy: ChainAccuracy) -> _Image:
        asked.append((accuracy.tolerance, accuracy.source_sampling))
        outcome = outcomes[len(asked) - 1]
        if isinstance(outcome, TradestudyError):
            raise outcome
        points, others = outcome
        return _Image(error_terms={"source radii": points, "single points": others}, tolerance=accuracy.tolerance)

    found = spot_images._refined(sampled, 0.01)  # type: ignore[arg-type]  # a stand-in for an image
    assert found.tolerance == 0.01
    return found.numerical_error, asked


def test_refinement_stops_at_the_tolerance() -> None:
    error, asked = _sampled((0.05, 0.0), (0.008, 0.0))
    assert error == 0.008
    assert asked == [(0.01, 1.0), (0.01, pytest.approx(1.4))]


def test_refinement_improves_what_limits_the_error() -> None:
    assert _sampled((0.0, 0.05), (0.0, 0.0))[1][1] == (pytest.approx(0.005), 1.0)
    assert _sampled((0.03, 0.05), (0.0, 0.0))[1][1] == (pytest.approx(0.005), pytest.approx(1.4))


def test_refinement_goes_on_where_points_disagree() -> None:
    disagreement = NotConvergedError("points disagree", value="0.4", limit="0.3", remedy="refine")
    error, asked = _sampled(disagreement, (0.009, 0.0))
    assert error == 0.009
    assert asked == [(0.01, 1.0), (pytest.approx(0.005), 1.0)]
    with pytest.raises(NotConvergedError):
        _sampled(*[disagreement] * 4)


def test_refinement_keeps_what_is_affordable() -> None:
    refusal = UnaffordableError("points to follow", value="1e9", limit="1e7", remedy="raise the tolerance")
    assert _sampled((0.05, 0.0), refusal)[0] == 0.05
    with pytest.raises(UnaffordableError):
        _sampled(refusal)


def test_refinement_ends_with_the_best_image_where_it_gains_nothing() -> None:
    error, asked = _sampled((0.05, 0.0), (0.02, 0.0), (0.03, 0.0))
    assert error == 0.02
    assert len(asked) == 3


def test_refinement_asks_for_no_tolerance_below_the_smallest() -> None:
    found = spot_images._finer(ChainAccuracy(tolerance=1e-6), {"single points": 3.0})
    assert (found.tolerance, found.source_sampling) == (1e-6, 1.0)


def test_refinement_gives_up_after_four_rounds() -> None:
    error, asked = _sampled((0.08, 0.0), (0.06, 0.0), (0.04, 0.0), (0.03, 0.0))
    assert error == 0.03
    assert len(asked) == 4
