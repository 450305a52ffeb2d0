"""Microlenses that count: against areas of discs by counting, and against four frames of a Raytrix R12."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from tests.cameras.builders import r5
from tradestudy.cameras.focused_plenoptic.declaration import FocusedPlenopticDeclaration, PlenopticDepthPart
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.optics.microlens_coverage import lit_radius_over_pitch

RADII = np.array([0.2, 0.45, 0.5, 0.77, 1.36, 4.75])


def share_lit(apart: float, disc: float, lens: float) -> float:
    """Share of the smaller of two discs that the other covers, by counting points on a fine grid."""
    small, large = min(disc, lens), max(disc, lens)
    x, y = np.meshgrid(*(np.linspace(-small, small, 601),) * 2)
    inside = np.hypot(x, y) <= small
    return float(np.mean((np.hypot(x - apart, y) <= large)[inside]))


@pytest.mark.parametrize("share", [0.03, 0.25, 0.5, 0.9])
@pytest.mark.parametrize("lens", [0.5, 0.3])
def test_at_the_limit_a_microlens_is_lit_by_the_declared_share(share: float, lens: float) -> None:
    for disc, apart in zip(
        RADII, lit_radius_over_pitch(RADII, lens_radius_over_pitch=lens, least_share=share), strict=True
    ):
        assert share_lit(float(apart), float(disc), lens) == pytest.approx(share, abs=2e-3)


def test_the_limits_are_where_light_begins_and_where_it_fills_the_lens() -> None:
    begins, fills = (lit_radius_over_pitch(RADII, lens_radius_over_pitch=0.5, least_share=s) for s in (1e-15, 1.0))
    np.testing.assert_allclose(begins, RADII + 0.5, rtol=1e-9)
    np.testing.assert_allclose(fills, np.abs(RADII - 0.5), atol=1e-7)
    assert np.isnan(lit_radius_over_pitch(np.nan, lens_radius_over_pitch=0.5, least_share=0.5))


def test_a_count_of_centres_is_the_light_of_all_microlenses() -> None:
    """The mean over positions of the sum of lit shares of filled lenses is the mean number of centres in the disc."""
    disc, lens = 1.36, 0.5
    nodes, weights = np.polynomial.legendre.leggauss(100)
    shares = (nodes + 1.0) / 2.0
    radii = [lit_radius_over_pitch(disc, lens_radius_over_pitch=lens, least_share=float(one)) for one in shares]
    light = weights @ np.square(radii) / 2.0  # ∫ π d(share)² dshare, over π
    assert light == pytest.approx(disc**2, rel=1e-5)


# Spread of corners about the best plane of a board [mm], and microlenses per corner, for mean distances [mm], of public
# observations that have 0.68 px of noise in each coordinate of a micro-image (comsee-research/compote, example R12).
FRAMES = {
    "distance": np.array([240.0, 294.3, 339.2, 365.5]) * 1e-3,
    "spread": np.array([1.75, 1.93, 1.33, 1.28]) * 1e-3,
    "microlenses": np.array([79.2, 26.6, 8.8, 4.0]),
}


def r12(**changes: Any) -> FocusedPlenoptic:
    return r5(
        main_lens=Lens(focal_length=49.885e-3, f_number=4.0),
        sensor=Sensor(columns=4080, rows=3068, pixel_pitch=5.5e-6),
        microlenses=MicrolensArray(
            layout="hexagonal",
            pitch=0.12744e-3,
            gap=0.33713e-3,
            focal_lengths=(0.5827e-3, 0.5240e-3, 0.5606e-3),
            aperture_diameter=0.12744e-3,
        ),
        mla_distance=56.860e-3,
        estimator="least-squares",
        lenses="all",
        disparity_error_px=0.68 * math.sqrt(2.0),
        **changes,
    )


@pytest.mark.parametrize(
    ("share", "counts", "ratios"),
    [
        (None, [81.9, 24.7, 6.72, 2.15], [0.89, 1.22, 2.42, 2.80]),
        (0.5, [81.6, 24.4, 6.41, 1.85], [0.89, 1.24, 2.54, 2.97]),
        (0.1, [94.0, 31.5, 10.35, 4.30], [0.77, 0.96, 1.56, 1.54]),
        (1e-6, [100.0, 35.1, 12.6, 5.85], [0.73, 0.86, 1.27, 1.10]),
    ],
)
def test_microlenses_and_spread_of_a_measured_r12(
    share: float | None, counts: list[float], ratios: list[float]
) -> None:
    """What is predicted over what was measured; where few microlenses see a corner, partly lit ones decide."""
    camera, distance = r12(least_lit_share=share), FRAMES["distance"]
    np.testing.assert_allclose(camera.microlenses_seeing(distance), counts, rtol=4e-3)
    np.testing.assert_allclose(depth_uncertainty(camera, distance) / FRAMES["spread"], ratios, atol=0.006)
    if (
        share == 0.1
    ):  # all frames lie between no and any light, and the nearest frames miss microlenses for other reasons
        assert np.all(camera.microlenses_seeing(distance) / FRAMES["microlenses"] < 1.2)


def test_half_of_the_light_is_nearly_the_criterion_of_centres() -> None:
    half, centres = r12(least_lit_share=0.5), r12()
    far = np.array([0.24])
    assert half.microlenses_seeing(far) == pytest.approx(centres.microlenses_seeing(far), rel=5e-3)
    assert half.estimator_baseline(far) == pytest.approx(centres.estimator_baseline(far), rel=5e-3)
    assert dict(half.properties())["microlenses that count"] == (
        "those with 50 % or more of the light of the point's best-lit microlens"
    )
    assert "microlenses that count" not in dict(centres.properties())


def test_pairs_of_neighbours_keep_their_baseline_and_gain_availability() -> None:
    pair, wide = (r12(least_lit_share=share) for share in (None, 0.1))
    near = np.array([0.3655])
    assert pair.availability(near) < wide.availability(near) == 1.0
    widest, wider = (r12(least_lit_share=share) for share in (0.5, 0.1))
    assert widest.estimator_baseline(near) < wider.estimator_baseline(near)


def test_a_share_needs_a_declared_disparity_error() -> None:
    said = {"estimator": "least-squares", "disparity_error": "derived", "least_lit_share": "10 %"}
    with pytest.raises(ValueError, match="counts microlenses by the light of a point"):
        PlenopticDepthPart.model_validate(said)
    part = PlenopticDepthPart.model_validate({**said, "disparity_error": "0.1 px"})
    assert part.least_lit_share == 0.1
    assert FocusedPlenopticDeclaration.model_fields["depth"].annotation is PlenopticDepthPart
