"""The bound against the exact Fisher information of a window, its limits, and a matcher that knows nothing of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j0

from tests.imaging.matcher import Scene, lucas_kanade, picture_pairs
from tests.imaging.scenes import bound_of
from tradestudy.imaging.passed_texture import band_nodes, matching_bound_px


def gaussian_spectrum(x: np.ndarray, y: np.ndarray, width: float, power: float) -> np.ndarray:
    """Of the autocorrelation power · exp(−r²/2w²): nothing is left at the edge of the band for w above 1 px."""
    return power * 2 * np.pi * width**2 * np.exp(-2 * np.pi**2 * width**2 * (x * x + y * y))


def fisher_of_window(side: int, width: float, power: float, noise: float, disparity: float) -> float:
    """Exact bound [px] from the dense covariance of both windows: J = ½ tr (R⁻¹ ∂R)²."""
    rows, columns = (a.ravel() for a in np.mgrid[:side, :side].astype(float))
    dy, dx = rows[:, None] - rows, columns[:, None] - columns

    def between(shift: float) -> np.ndarray:
        return power * np.exp(-((dx + shift) ** 2 + dy**2) / (2 * width**2))

    same = between(0.0) + noise * np.eye(side * side)
    cross = between(disparity)
    slope = -(dx + disparity) / width**2 * cross
    covariance = np.block([[same, cross], [cross.T, same]])
    derivative = np.block([[np.zeros_like(same), slope], [slope.T, np.zeros_like(same)]])
    product = np.linalg.solve(covariance, derivative)
    return float(1.0 / np.sqrt(0.5 * np.sum(product * product.T)))


@pytest.mark.parametrize("noise", [0.01, 0.3, 3.0])
@pytest.mark.parametrize("width", [1.2, 2.0])
def test_exact_fisher_information_of_a_window_tends_to_the_bound(noise: float, width: float) -> None:
    nodes = band_nodes(40, 14)
    signal = gaussian_spectrum(nodes.x, nodes.y, width, 1.0)
    ratios = []
    for side in (8, 16, 24):
        bound = float(matching_bound_px(nodes, signal=signal, noise=noise, window_px=float(side)))
        ratios.append(fisher_of_window(side, width, 1.0, noise, 0.3) / bound)
    # What a window's edges cost falls as correlation length over side; extrapolated, nothing is left.
    assert ratios[0] > ratios[1] > ratios[2] > 1.0
    assert 1.5 * ratios[2] - 0.5 * ratios[0] == pytest.approx(1.0, abs=0.008)


def test_high_signal_gives_the_classical_bound_of_slopes() -> None:
    """2σ²/Σ g_x² with the mean square slope of the texture in closed form: 1/w² for a Gaussian autocorrelation."""
    nodes = band_nodes(60, 20)
    signal = gaussian_spectrum(nodes.x, nodes.y, 2.0, 1e6)
    found = float(matching_bound_px(nodes, signal=signal, noise=1e-9, window_px=11.0))
    slopes = 121 * 1e6 / 2.0**2
    assert found == pytest.approx(np.sqrt(2e-9 / slopes), rel=1e-4)


def test_low_signal_gives_the_square_law() -> None:
    """γ² → (S/N)²: the information is W² ∬ (2πν_x)² S²/N², a Gaussian integral."""
    nodes, w, s2, noise = band_nodes(40, 14), 1.5, 1e-6, 1.0
    found = float(
        matching_bound_px(nodes, signal=gaussian_spectrum(nodes.x, nodes.y, w, s2), noise=noise, window_px=9.0)
    )
    # ∬ (2πν_x)² (s² 2π w²)² exp(−4π²w²ν²) d²ν = (s² 2π w²)² · (4π²)/(8π² w²) · 1/(4π w²)
    information = 81 * (s2 * 2 * np.pi * w**2) ** 2 * (1 / (2 * w**2)) / (4 * np.pi * w**2)
    assert found == pytest.approx(1 / np.sqrt(information), rel=1e-5)


def test_nodes_integrate_over_the_whole_band() -> None:
    nodes = band_nodes(20, 8)
    assert nodes.weight.sum() == pytest.approx(1.0, rel=1e-13)
    assert np.sum(nodes.weight * nodes.radius**2) == pytest.approx(1 / 6, rel=1e-13)
    # ∬ J₀(2πa|ν|) over the square by a fine trapezoid.
    x = np.linspace(-0.5, 0.5, 1001)
    grid = j0(2 * np.pi * 3 * np.hypot(*np.meshgrid(x, x)))
    assert np.sum(nodes.weight * j0(2 * np.pi * 3 * nodes.radius)) == pytest.approx(
        np.trapezoid(np.trapezoid(grid, x), x), abs=2e-6
    )


def test_no_noise_leaves_no_error_and_no_signal_no_knowledge() -> None:
    nodes = band_nodes(10, 6)
    assert matching_bound_px(nodes, signal=np.ones_like(nodes.x), noise=0.0, window_px=5.0) == 0.0
    assert np.isinf(matching_bound_px(nodes, signal=np.zeros_like(nodes.x), noise=1.0, window_px=5.0))


# Where the bound applies: contrast, correlation length, blur, noise, window.
SCENES = [
    Scene(electrons=5000, contrast=0.2, length_px=4, blur_px=2, noise=75, window=21, oversampling=2),
    pytest.param(
        Scene(electrons=5000, contrast=0.1, length_px=4, blur_px=3, noise=75, window=21, oversampling=2),
        marks=pytest.mark.slow,
    ),
    pytest.param(
        Scene(electrons=5000, contrast=0.05, length_px=3, blur_px=2, noise=75, window=21, oversampling=2),
        marks=pytest.mark.slow,
    ),
    Scene(electrons=5000, contrast=0.1, length_px=2, blur_px=4, noise=75, window=15, oversampling=2),
    Scene(electrons=5000, contrast=0.1, length_px=10, blur_px=2, noise=75, window=15, oversampling=2),
    Scene(electrons=5000, contrast=0.2, length_px=3, blur_px=5, noise=150, window=21, oversampling=2),
]


@pytest.mark.parametrize("scene", SCENES, ids=lambda s: f"c{s.contrast}-l{s.length_px}-b{s.blur_px}-w{s.window}")
def test_a_matcher_comes_within_a_third_of_the_bound_and_not_below(scene: Scene) -> None:
    bound = bound_of(scene)
    assert bound.applies.all()
    rng = np.random.default_rng(20240611)
    disparity = rng.uniform(-0.5, 0.5, 20)
    left, right = picture_pairs(scene, disparity, 16, rng)
    found = np.array(
        [lucas_kanade(a, b, scene.window, smoothing=0.7, start=0.0) for a, b in zip(left, right, strict=True)]
    )
    error = found - np.repeat(disparity, 16)
    ratio = float(np.std(error) / bound.value[0])
    spread = ratio / np.sqrt(2 * error.size)
    assert 1.0 - 2.5 * spread < ratio < 1.3
