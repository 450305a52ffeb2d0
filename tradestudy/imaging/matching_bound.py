"""The smallest error of any matcher of two noisy pictures of one texture, and the aliasing by their samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.imaging.transfer import square_transfer
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

REPLICAS = 3
"""Number of replicas of the spectrum that are summed one by one on each side."""
_RADII = 193


@dataclass(frozen=True, kw_only=True, eq=False)
class BandNodes:
    """Nodes in one eighth of the square band of the samples, 0 ≤ ν_y ≤ ν_x ≤ ½ cycles/px, densest at 0.

    ``weight`` covers the whole band: the integral of g(ν) is ``sum(weight * g)`` if g is even in both frequencies and
    symmetric in them.
    """

    x: FloatArray
    y: FloatArray
    weight: FloatArray

    @cached_property
    def radius(self) -> FloatArray:
        """|ν| [cycles/px]."""
        return np.hypot(self.x, self.y)

    @cached_property
    def slope(self) -> FloatArray:
        """Weights of (2π ν_x)², which by symmetry may be replaced by half of (2π |ν|)²."""
        return np.asarray(self.weight * (2.0 * np.pi) ** 2 * np.square(self.radius) / 2.0)


@lru_cache(maxsize=32)
def band_nodes(along: int, across: int) -> BandNodes:
    """Gauss–Legendre nodes in √ν_x (texture spectra have a cusp at 0) and in the slope ν_y/ν_x."""
    s, ws = gauss_legendre(along)
    t, wt = gauss_legendre(across)
    x = 0.5 * s * s
    weight = 8.0 * np.multiply.outer(ws * s * x, wt)  # dν_x = s ds, dν_y = ν_x dt, times eight
    nodes = BandNodes(x=np.repeat(x, across), y=np.multiply.outer(x, t).ravel(), weight=weight.ravel())
    for array in (nodes.x, nodes.y, nodes.weight):
        array.setflags(write=False)
    return nodes


def matching_bound_px(nodes: BandNodes, *, signal: ArrayLike, noise: ArrayLike, window_px: ArrayLike) -> FloatArray:
    """Cramér–Rao bound on a disparity error: ``σ⁻² = W² ∬ (2π ν_x)² γ²/(1 − γ²) d²ν``, γ = S/(S + N).

    It applies to two pictures of one stationary Gaussian texture, shifted by an unknown disparity, each with
    independent white noise. The spectrum of the texture is known, the texture itself is not. γ is the coherence of the
    two pictures, and γ²/(1 − γ²) = r²/(1 + 2r) with r = S/N.

    Parameters
    ----------
    nodes
        Nodes of the band of the samples.
    signal
        S at the nodes: power density of the transferred texture in each picture [electrons²], shape (..., nodes).
    noise
        N at the nodes: power density of the noise, which is the variance of one pixel plus aliased texture
        [electrons²]; broadcast.
    window_px
        Side W of the square window [px]; shape (...).

    Returns
    -------
    FloatArray
        σ [px], shape (...). For S ≫ N it is √(2 σ_n²/Σ g_x²), the classical bound for a known texture in two noisy
        pictures; 0 where there is no noise, infinite where no signal arrives.

    Notes
    -----
    Valid if the window is wide compared with the texture's correlation length and the blur, so that its Fourier modes
    are independent, and if σ is well below the width of the correlation peak: otherwise real matchers jump to other
    peaks, which no local bound describes. Aliased texture counts as noise that is independent in the two pictures,
    which holds on average over the subpixel part of the disparity.

    References
    ----------
    C. H. Knapp and G. C. Carter, "The generalized correlation method for estimation of time delay", IEEE Trans. ASSP
    24, 320 (1976); G. C. Carter, "Coherence and time delay estimation", Proc. IEEE 75, 236 (1987); here in two
    dimensions.
    """
    S, N = np.asarray(signal, dtype=np.float64), np.asarray(noise, dtype=np.float64)
    noisy = ~(N <= 0.0)  # NaN, where there is no picture, stays NaN
    ratio = S / np.where(noisy, N, 1.0)
    usable = np.where(noisy, ratio * (ratio / (1.0 + 2.0 * ratio)), np.where(S > 0.0, np.inf, 0.0))
    information = np.square(np.asarray(window_px, dtype=np.float64)) * np.sum(usable * nodes.slope, axis=-1)
    with np.errstate(divide="ignore"):  # infinite without signal, as documented
        return np.asarray(1.0 / np.sqrt(information))


def alias_radii() -> FloatArray:
    """Frequency radii [cycles/sample] that cover the range of all replicas."""
    return np.linspace(0.5, (REPLICAS + 0.5) * np.sqrt(2.0), _RADII)


@lru_cache(maxsize=64)
def alias_weights(nodes: BandNodes, width: float, every: int) -> FloatArray:
    """Sum of all replicas of a radial spectrum at the nodes, as weights of its values at the alias radii.

    The weights interpolate linearly between the radii, of which every ``every``-th is used, and include the pixel's
    squared transfer function.
    """
    radii = alias_radii()[::every]
    step = radii[1] - radii[0]
    shifts = np.arange(-REPLICAS, REPLICAS + 1)[:, np.newaxis]
    x, y = nodes.x + shifts, nodes.y + shifts
    beside = np.delete(np.arange(shifts.size**2), shifts.size**2 // 2)  # the middle one is the spectrum itself
    position = (np.hypot(x, y[:, np.newaxis]).reshape(-1, nodes.x.size)[beside] - radii[0]) / step
    below = np.clip(position.astype(np.intp), 0, radii.size - 2)
    # The transfer function of a square is a product of factors in x and y.
    along = square_transfer(x, 0.0, width) * square_transfer(0.0, y, width)[:, np.newaxis]
    share, passed = position - below, np.square(along.reshape(-1, nodes.x.size)[beside])
    place = below * nodes.x.size + np.arange(nodes.x.size)  # in the matrix, row by row
    places = np.concatenate([place, place + nodes.x.size])
    weights = np.concatenate([(1.0 - share) * passed, share * passed])
    matrix = np.bincount(places.ravel(), weights.ravel(), radii.size * nodes.x.size).reshape(radii.size, -1)
    matrix.setflags(write=False)
    return np.asarray(matrix, dtype=np.float64)


@lru_cache(maxsize=64)
def ring_weights(width: float) -> FloatArray:
    """Weights of the mean over the outermost alias radii and all directions, with the pixel's squared transfer."""
    radii = alias_radii()
    angle = np.linspace(0.0, np.pi / 2.0, 33)
    seen = np.square(square_transfer(np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)), width))
    ring = radii > REPLICAS
    weights = np.where(ring, seen.mean(axis=1), 0.0) / np.count_nonzero(ring)
    weights.setflags(write=False)
    return weights
