"""Depths of a parallel stereo rig and of an R5 in plain numpy, and their distributions in closed form."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from tests.cameras.builders import F_MAIN, PITCH
from tradestudy.uncertainty.distributions import Distribution
from tradestudy.uncertainty.sources import ErrorClass, Source

F, B, PIXEL = 30.5e-3, 0.1, 10e-6
CENTRAL = {0.6827: (ndtr(-1.0), ndtr(1.0)), 0.95: (0.025, 0.975)}


def of_rig(name: str, distribution: Distribution) -> Source:
    return Source(name=name, distribution=distribution, error_class=ErrorClass.RIG)


def stereo_depth(distance: float, errors: Mapping[str, np.ndarray]) -> np.ndarray:
    """Both rays from what the sensors saw, the right one turned back by the yaw; +inf where they do not meet."""
    zero = np.zeros(())
    c = F + errors.get("focal_length", zero)
    seen = F * B / (2.0 * distance) + errors.get("pixel_noise", zero) / 2.0
    left = seen / c
    right = np.tan(np.arctan(seen / c) + errors.get("yaw", zero))
    with np.errstate(divide="ignore"):
        inverse = (left + right) / (B + errors.get("baseline", zero))
        return np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), np.inf)


def r5_depth(distance: float, errors: Mapping[str, np.ndarray]) -> np.ndarray:
    """Equation 8 for two neighbours of the same type, √3 pitches apart, solved for the object; Keplerian."""
    zero, z, gap = np.zeros(()), 14.77255e-3, 0.568093e-3
    behind = z - F_MAIN * distance / (distance - F_MAIN)
    disparity = math.sqrt(3) * PITCH * gap / behind + errors.get("pixel_noise", zero)
    f = F_MAIN + errors.get("focal_length", zero)
    image = (
        z
        + errors.get("mla_distance", zero)
        - (math.sqrt(3) * PITCH * (gap + errors.get("microlens_gap", zero)) / disparity)
    )
    inverse = np.where(disparity > 0.0, 1.0 / f - 1.0 / image, -1.0)
    return np.where(inverse > 0.0, 1.0 / np.maximum(inverse, 1e-300), np.inf)


def depth_quantile(distance: float, p: float, *, noise: float, baseline: float) -> float:
    """Of f(B + δ)/(d + n), both normal: P(Z < z) = P(f(B + δ) < z(d + n)), a normal variable against zero.

    ``noise`` [m on the sensor] and ``baseline`` [m] are standard deviations. For disparities that are surely positive.
    """

    def below(z: float) -> float:
        mean, deviation = F * B - z * F * B / distance, math.hypot(F * baseline, z * noise)
        return float(ndtr(-mean / deviation)) - p

    return float(brentq(below, 0.2 * distance, 5.0 * distance, xtol=1e-14, rtol=1e-14))


def half_width(distance: float, *, noise: float, baseline: float, coverage: float = 0.6827) -> float:
    low, high = (depth_quantile(distance, p, noise=noise, baseline=baseline) for p in CENTRAL[coverage])
    return (high - low) / 2.0


def yaw_and_noise_quantile(distance: float, p: float, *, noise: float, half: float) -> float:
    """Of a rig with uniform yaw within ±half [rad] and normal noise [m], by Gauss–Legendre quadrature over yaw.

    Depth falls with noise: below z are those readings whose noise is above that at which z is read.
    """
    nodes, weights = np.polynomial.legendre.leggauss(80)

    def noise_of(z: float, yaw: float) -> float:
        return float(
            brentq(lambda n: F / stereo_depth(distance, {"pixel_noise": n, "yaw": yaw}) - F / z, -F / 2, F / 2)
        )

    def below(z: float) -> float:
        scores = np.array([noise_of(z, half * node) for node in nodes]) / noise
        return float(weights @ ndtr(-scores)) / 2.0 - p

    return float(brentq(below, 0.3 * distance, 4.0 * distance, xtol=1e-9))
