"""The power of a texture at the nodes of its band after every step of the picture, and the resulting matching bound.

Several models of one picture share nodes, texture and transfer functions of lenses, each of which is computed once.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.picture_geometry import MatchedWindow, PictureGeometry
from tradestudy.imaging.models import (
    PictureModels,
    PictureSettings,
    field_illumination,
    mean_electrons,
    neighbours_share,
    noise_variance,
    radial_pupil_width,
    share_beyond,
    texture_spectrum,
)
from tradestudy.imaging.optical_transfer import LensTransfers
from tradestudy.imaging.transfer import disc_transfer, square_transfer
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
    power = np.square(square_transfer(np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle)), width))
    ring = radii > REPLICAS
    weights = np.where(ring, power.mean(axis=1), 0.0) / np.count_nonzero(ring)
    weights.setflags(write=False)
    return weights


_MOST_MULTIPLICATIONS: Final = 200_000


def picture_electrons(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Mean electrons per pixel, over distance."""
    illumination = 1.0
    if models.vignetting == "cos4":
        illumination = field_illumination(
            settings.field_angle,
            pupil_diameter=geometry.pupil_diameter,
            stop_separation=settings.stop_separation if geometry.compared.stops_dim else 0.0,
        )
    return mean_electrons(settings.light, geometry.light_f_number, geometry.pixel_pitch, illumination)


def matched_window(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> MatchedWindow:
    """The window over distance: the declared one, limited to the overlap of the compared pictures through the pupil."""
    requested = settings.asked_window(geometry.magnification, geometry.sample_pitch)
    width = 1.0
    if models.vignetting == "cos4":
        width = radial_pupil_width(
            settings.field_angle, pupil_diameter=geometry.pupil_diameter, stop_separation=settings.stop_separation
        )
    return geometry.compared.through(width).window(requested)


@dataclass(frozen=True, kw_only=True, eq=False)
class PassedTexture:
    """The inputs of the bound under some models, for several quadrature rules of decreasing order.

    Attributes
    ----------
    rules
        Nodes of the band.
    inside, beyond
        Power density of the picture at the nodes of each rule, and at those aliasing radii that light still passes.
    tail
        Aliased power from beyond all aliasing radii.
    floor
        Power density of noise.
    foreign
        Power of the texture of neighbouring micro-images relative to that of the micro-image itself, over distance.
    sample_width, window
        Sides of a square sample and of the window [samples].
    transfer, transfer_error
        Transfer function of lenses and round samples at the nodes of the first rule, and its error over distance.
    """

    rules: tuple[BandNodes, ...]
    inside: tuple[FloatArray, ...]
    beyond: FloatArray
    tail: FloatArray
    floor: FloatArray
    foreign: FloatArray
    sample_width: float
    window: FloatArray
    transfer: FloatArray
    transfer_error: FloatArray

    def bound(self, k: int, aliased: FloatArray, every: int = 1) -> FloatArray:
        """The bound by the k-th rule; ``aliased`` is the power from beyond the radii, of which every n-th is used."""
        rule = self.rules[k]
        signal = self.inside[k] * _pixel_power(rule, self.sample_width)
        passed = self.beyond[:, ::every]
        replicas = _product(passed, alias_weights(rule, self.sample_width, every)[: passed.shape[1]])
        noise = self.floor + replicas + aliased + self.foreign * signal
        return matching_bound_px(rule, signal=signal, noise=noise, window_px=self.window)

    def moved_by_transfer(self, value: FloatArray) -> FloatArray:
        """Error of the bound due to the transfer's error δ; relative to it, about δ over the weighted rms transfer."""
        slope = self.rules[0].weight * np.square(self.rules[0].radius)
        strength = np.sqrt(np.square(self.transfer) @ (slope / slope.sum()))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # the bound is infinite if no power passes
            return np.where(self.transfer_error > 0.0, value * self.transfer_error / strength, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class TextureBand:
    """A texture at distances that share band nodes, before models are applied.

    Parameters
    ----------
    geometry, settings
        The picture, with its texture and light.
    rules
        Nodes of the band, of decreasing order.
    interpolated
        See `kirchhoff_transfers`.
    """

    geometry: PictureGeometry
    settings: PictureSettings
    rules: tuple[BandNodes, ...]
    interpolated: bool = True
    _shares: dict[tuple[bool, str], FloatArray] = field(default_factory=dict, init=False)

    def passed(self, models: PictureModels, brighter: ArrayLike = 1.0) -> PassedTexture:
        """Pass the texture through every step, with the light multiplied by ``brighter`` over distance."""
        geometry, settings = self.geometry, self.settings
        transfer, transfer_error = self._lenses.product(models)
        width = _sample_width(geometry, settings, models)
        frequency = self._frequency[: transfer.shape[1]]
        if geometry.sample_shape == "disc":  # the disc from which a microlens collects
            transfer = transfer * disc_transfer(frequency, width)
            width = 0.0
        n = (picture_electrons(geometry, settings, models) * np.asarray(brighter, dtype=np.float64))[:, np.newaxis]
        window = matched_window(geometry, settings, models)
        crosstalk = self._crosstalk(models, window)
        power = np.square((1.0 - crosstalk) * transfer)
        *inside, beyond = np.split(n**2 * self._texture[:, : frequency.size] * power, self._ends, axis=1)
        # The texture beyond the replicas passes like their outermost ring; its aliased power is spread evenly.
        outermost = np.einsum("ij,j->i", power[:, self._ends[-1] :], ring_weights(width)[: beyond.shape[1]])
        share = share_beyond(REPLICAS + 0.5, self._length)
        return PassedTexture(
            rules=self.rules,
            inside=tuple(inside),
            beyond=beyond,
            tail=(n * settings.texture.contrast) ** 2 * share * outermost[:, np.newaxis],
            floor=np.asarray(noise_variance(n, settings.sensor_noise, models.sensor_noise)),
            # It acts as noise with the spectrum of the texture, because it does not match.
            foreign=np.square(crosstalk / (1.0 - crosstalk)),
            sample_width=width,
            window=window.side_px,
            transfer=(1.0 - crosstalk) * transfer[:, : self._ends[0]],
            transfer_error=transfer_error,
        )

    def _crosstalk(self, models: PictureModels, window: MatchedWindow) -> FloatArray:
        """Fraction of the light that comes from neighbouring microlenses, as a column over distance."""
        if models.crosstalk == "off" or self.geometry.microlens is None:
            return np.zeros((self.geometry.distance.size, 1))
        blurred = models.defocus_blur == "disc"
        key = blurred, models.vignetting
        if key not in self._shares:
            share = neighbours_share(self.geometry, self.settings.wavelength, window, blurred=blurred)
            self._shares[key] = share[:, np.newaxis]
        return self._shares[key]

    @cached_property
    def _ends(self) -> tuple[int, ...]:
        """End index of each rule's nodes among the frequencies; the aliasing radii follow."""
        return tuple(itertools.accumulate(rule.x.size for rule in self.rules))

    @cached_property
    def _frequency(self) -> FloatArray:
        return np.concatenate([*(rule.radius for rule in self.rules), alias_radii()])

    @cached_property
    def _length(self) -> FloatArray:
        """The correlation length on the sensor [samples]."""
        length = self.settings.texture.correlation_length * self.geometry.magnification / self.geometry.sample_pitch
        return np.asarray(length[:, np.newaxis])

    @cached_property
    def _texture(self) -> FloatArray:
        return texture_spectrum(self._frequency, self.settings.texture.contrast, self._length)

    @cached_property
    def _lenses(self) -> LensTransfers:
        return LensTransfers(
            geometry=self.geometry,
            settings=self.settings,
            frequency_px=self._frequency,
            always=self._ends[-1],
            interpolated=self.interpolated,
        )


@lru_cache(maxsize=64)
def _pixel_power(nodes: BandNodes, width: float) -> FloatArray:
    """Squared transfer function of a square pixel at the nodes of a band."""
    power = np.square(square_transfer(nodes.x, nodes.y, width))
    power.setflags(write=False)
    return power


def _product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Matrix product in blocks of rows, too small for a library to start threads that cost more than they save."""
    rows = max(1, _MOST_MULTIPLICATIONS // max(1, second.size))
    if rows >= len(first):
        return np.asarray(first @ second)
    return np.concatenate([first[k : k + rows] @ second for k in range(0, len(first), rows)])


def _sample_width(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> float:
    """Side or diameter of the area from which a sample collects light [samples]; 0 for a point."""
    if models.pixel_integration == "off":
        return 0.0
    fill = settings.pixel_fill if geometry.sample_shape == "square" else 1.0
    return fill * geometry.sample_width / geometry.sample_pitch
