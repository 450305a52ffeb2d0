"""Pictures by waves: how diffraction at the apertures bends every ray of a picture.

The spread of light from a place on a pixel, followed backwards through lens and stop (`TwoApertures`), is computed for
each type of lens, for several offsets of the stop (which depend on the lens's place in the field) and several depths.
Each spread becomes a table of places that represent it, as the rays of a cone represent the lit part of the lens;
between computed spreads, the places are interpolated. A ray still starts at its place on the lens, but is bent there so
that it meets the depth of its cone at its place in the spread. So surfaces hide each other as they do with rays, an
edge in front of or behind that depth is blurred by its own defocus and the same bending, and in the limit of large
apertures nothing changes.

Limits: Light is paraxial and of one wavelength. Light of several microlenses adds without interference, whose fringes
on the object are far finer than a pixel resolves. All rays of a cone are bent as for the depth of its middle ray or, if
that meets nothing, for the median depth of the surrounding pixels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.light_cones import LightCones
from tradestudy.imaging.render.nodes import fewer, nodes
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.two_apertures import Spread, TwoApertures

_LAGS: Final = 24
_WIDTHS: Final = 33


def disc_quantiles(disc: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fractions of the unit disc to the left of each node, and of its column above it; shape (nodes,) each.

    ``½ + (a √(1 − a²) + arcsin a)/π`` and ``½ (1 + b/√(1 − a²))``.
    """
    across, beside = disc.T
    height = np.sqrt(np.maximum(1.0 - across * across, 1e-12))
    left = 0.5 + (across * height + np.arcsin(across)) / math.pi
    return left, np.clip(0.5 * (1.0 + beside / height), 0.0, 1.0)


def transported(spread: Spread, left: FloatArray, above: FloatArray) -> FloatArray:
    """Places [1/m] with given fractions of a spread to their left, and above them in their own column.

    For uniform discs of different size the map is a scaling (H. Knothe, Michigan Math. J. 4, 39, 1957).

    Parameters
    ----------
    spread
        The spread.
    left, above
        Results of `disc_quantiles`, shape (nodes,).

    Returns
    -------
    FloatArray
        Shape (nodes, 2).
    """
    place = spread.place
    step = place[1] - place[0]
    edges = np.append(place, place[-1] + step) - step / 2.0
    x = _place_of(left[None], spread.sums[:1], edges)[0]
    column = np.clip((x - place[0]) / step, 0.0, place.size - 1.001)
    first = column.astype(np.intp)
    share = (column - first)[:, None]
    needed, number = np.unique(np.concatenate([first, first + 1]), return_inverse=True)
    before, after = spread.columns(needed)[number.reshape(2, -1)]
    y = _place_of(above[:, None], (1.0 - share) * before + share * after, edges)[:, 0]
    return np.stack([x, y], axis=-1)


def _place_of(share: FloatArray, density: FloatArray, edges: FloatArray) -> FloatArray:
    """Positions with given fractions of a row's sum to their left, shape (rows, fractions)."""
    total = np.cumsum(density, axis=1)
    total = np.concatenate([np.zeros_like(total[:, :1]), total], axis=1)
    return np.stack(
        [np.interp(wanted * cumulative[-1], cumulative, edges) for wanted, cumulative in zip(share, total, strict=True)]
    )


def transfer(spread: Spread, band: float) -> FloatArray:
    """Transfer functions of a spread along x and y, at the frequencies of `filter_width`; shape (2, frequencies)."""
    wave = np.exp(-2j * np.pi * np.multiply.outer(_frequencies(band), spread.place))
    return np.asarray(spread.sums @ wave.T)


def filter_width(whole: FloatArray, nodes: FloatArray, band: float) -> float:
    """Standard deviation of the Gaussian that, placed on every node, best approximates a spread.

    It is the best fit to the transfer functions along both axes up to a band, with frequencies weighted by ν⁻², for the
    spectra of textures and the number of frequencies.

    Parameters
    ----------
    whole
        `transfer` of the spread.
    nodes
        Equally weighted places that represent the spread, shape (nodes, 2).
    band
        Highest frequency [1/unit of place].
    """
    frequency = _frequencies(band)
    by_nodes = np.exp(-2j * np.pi * frequency[:, None] * nodes.T[:, None]).mean(axis=-1)
    widest = float(np.max(np.std(nodes, axis=0)))
    widths = widest * np.linspace(0.0, 1.5, _WIDTHS)
    gauss = np.exp(-2.0 * np.square(np.pi * np.multiply.outer(widths, frequency)))[:, None]
    miss = np.sum(np.square(np.abs(whole - by_nodes * gauss)) / np.square(frequency), axis=(1, 2))
    return float(widths[np.argmin(miss)])


def _frequencies(band: float) -> FloatArray:
    return np.asarray(band * (np.arange(_LAGS) + 0.5) / _LAGS)


_STEP: Final = 0.5  # of defocus between computed spreads [waves], near focus; larger beyond a wave
_MARGIN: Final = 2.0  # how far light is followed beyond the reach of rays, in widths of the shadow's edge
_END: Final = 0.99
_SHARES: Final = 257
_NODES_OF_PIXEL: Final = 3


def paraxial_numbers(cones: LightCones, depth: FloatArray | float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``mₒ, β [m]`` and ``g [1/m]`` of `tradestudy.optics.two_apertures` for cones and depths [m] from the camera."""
    image_distance = np.asarray(cones.image_distance)
    scale = np.asarray(cones.start_by_lens + depth * np.asarray(cones.slope_by_lens))
    reach = -image_distance * (cones.start_by_pixel + depth * np.asarray(cones.slope_by_pixel))
    if (stop := cones.stop) is None:
        return scale, reach, scale / reach
    to_stop = -image_distance * stop.by_pixel
    beta = stop.by_lens * reach - to_stop * scale
    return scale, beta, reach / (to_stop * beta)


@dataclass(frozen=True, kw_only=True)
class LensWaves:
    """One type of lens of a picture, with the apertures that its light passes.

    Light is followed over a limited range; light that is bent farther is redistributed within it.

    Parameters
    ----------
    apertures
        The lens and the stop.
    defocus
        Smallest and largest defocus in the scene [waves].
    """

    apertures: TwoApertures
    defocus: tuple[float, float]

    @property
    def margin(self) -> float:
        """How far light is followed beyond the reach of rays, at the stop [m]."""
        return 0.0 if self.apertures.is_sharp else _MARGIN * self.apertures.blur

    @property
    def farthest(self) -> float:
        """Largest offset between the shadows of the lens and of the stop to which light is followed [m]."""
        stop = self.apertures.stop
        if stop is None:
            return 0.0
        return stop.radius + abs(stop.scale) * self.apertures.radius + self.margin

    @cached_property
    def shares(self) -> FloatArray:
        """Fraction of the lens's light that passes the stop, at evenly spaced offsets from 0 to the farthest."""
        return self._passed / (1.0 - self.bent_farther)

    @cached_property
    def _passed(self) -> FloatArray:
        return self.apertures.passed_share(np.linspace(0.0, self.farthest, _SHARES))

    @cached_property
    def bent_farther(self) -> float:
        """Fraction of light that is not followed: ``1 − ∫ s(q) 2πq dq / πR²`` for a stop of radius R, if s(q) passes.

        All light of the lens meets the plane of the stop somewhere, so without a limit on the offset q it would be 0.
        """
        if (stop := self.apertures.stop) is None:
            return 0.0
        offset = np.linspace(0.0, self.farthest, _SHARES)
        return 1.0 - float(np.trapezoid(self._passed * 2.0 * offset, offset)) / stop.radius**2


@dataclass(frozen=True, kw_only=True)
class Waves:
    """How a picture is rendered by waves.

    Parameters
    ----------
    lenses
        Waves of each type of lens.
    beyond
        Argument of `Exposure.cones` [m].
    fineness
        Factor on the number of computed spreads along each axis of their tables.
    offset_step
        Distance between computed places of the stop, in widths of the shadow's edge, before division by the fineness.
    """

    lenses: tuple[LensWaves, ...]
    beyond: float
    fineness: int = 1
    offset_step: float = 1.0

    @property
    def bent_farther(self) -> float:
        """Fraction of light that is redistributed; the largest for any type of lens."""
        return max(lens.bent_farther for lens in self.lenses)

    def tables(self, samples: int) -> Mapping[int, Tables]:
        """Tables of spreads, by number of rays: for this number, and for the smaller one of dim lenses; cached."""
        return _tables(self, samples)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tables:
    """Computed spreads of all types of lenses, over places of the stop and defocus.

    Parameters
    ----------
    waves
        The waves that are tabulated.
    places
        Places over λβ [1/m] of each node and of its mirror image, shape (2, nodes, 2, types × offsets × defoci).
    widths
        Width of a node's filter over λβ [1/m], shape (types × offsets × defoci,).
    shares
        Fraction of a lens's light that passes, at offsets from 0 to the farthest, shape (types, 257).
    offsets, defoci
        Numbers of computed offsets and defoci.
    knots
        Computed defoci [waves], shape (types, defoci).
    """

    waves: Waves
    places: NDArray[np.float32]
    widths: NDArray[np.float32]
    shares: NDArray[np.float32]
    offsets: int
    defoci: int
    knots: NDArray[np.float32]

    def passed(self, cones: LightCones, x: float, y: float) -> FloatArray:
        """Fraction of each lens's light that passes, seen from a place [m] on the pixel; 0 beyond the table."""
        if cones.stop is None:
            return np.ones(cones.start.shape[1], cones.start.dtype)
        offset, _ = self.towards_stop(cones, x, y)
        place = offset / self.of_type(cones, [lens.farthest for lens in self.waves.lenses]) * (_SHARES - 1)
        first = np.minimum(place.astype(np.intp), _SHARES - 2)
        row = np.asarray(cones.lens_type) * _SHARES + first
        low, high = self.shares.reshape(-1)[row], self.shares.reshape(-1)[row + 1]
        return np.where(place <= _SHARES - 1, low + (place - first) * (high - low), 0)

    def passed_pixel(self, cones: LightCones, pixel_width: float) -> FloatArray:
        """`passed`, averaged over a square pixel of a width [m]; few nodes suffice, because the edge is blurred."""
        if cones.stop is None:
            return self.passed(cones, 0.0, 0.0)
        t, w = np.polynomial.legendre.leggauss(_NODES_OF_PIXEL)
        total = np.zeros(cones.start.shape[1])
        for x, wx in zip(t * pixel_width / 2.0, w, strict=True):
            for y, wy in zip(t * pixel_width / 2.0, w, strict=True):
                total += wx * wy / 4.0 * self.passed(cones, float(x), float(y))
        return total

    def bending(self, cones: LightCones, depth: FloatArray) -> Bending:
        """The bending of cones whose middle rays meet the given finite depths [m] along the camera's axis."""
        kind = cones.start.dtype.type
        scale, beta, curvature = paraxial_numbers(cones, depth)
        lenses = self.waves.lenses
        focused = self.of_type(cones, [lens.apertures.focused_curvature for lens in lenses])
        waves = (curvature - focused) * self.of_type(cones, [lens.apertures.waves_per_curvature for lens in lenses])
        types = np.broadcast_to(cones.lens_type, waves.shape)
        low, high = np.arcsinh(self.knots[types, 0]), np.arcsinh(self.knots[types, -1])
        position = (np.arcsinh(waves) - low) / (high - low) * kind(self.defoci - 1)
        first = np.clip(position.astype(np.intp), 0, self.defoci - 2)
        before, behind = self.knots[types, first], self.knots[types, first + 1]
        return Bending(
            tables=self,
            cones=cones,
            depth=depth,
            scale=scale,
            beta=beta * kind(lenses[0].apertures.wavelength),
            first=types * (self.offsets * self.defoci) + first,
            share=np.clip((waves - before) / (behind - before), 0, 1).astype(kind),
        )

    def farthest(self, cones: LightCones, depth: float) -> float:
        """How far from the middle ray of its cone light is bent at most, at a depth [m]."""
        _, beta, _ = paraxial_numbers(cones, depth)
        widest = float(np.max(np.abs(self.places), initial=0.0)) * self.waves.lenses[0].apertures.wavelength
        return math.sqrt(2.0) * widest * float(np.max(np.abs(beta)))

    def of_type(self, cones: LightCones, values: Iterable[float]) -> FloatArray:
        """Values for each cone, given one number for each type of lens."""
        return np.asarray(list(values), cones.start.dtype)[cones.lens_type]

    def towards_stop(self, cones: LightCones, x: float, y: float) -> tuple[FloatArray, FloatArray]:
        """Distance [m] from the centre of the lens's shadow to that of the stop, and direction (2, cones)."""
        stop = cones.stop
        assert stop is not None
        towards = -(stop.place + np.stack(np.broadcast_arrays(stop.by_pixel * x, stop.by_pixel * y)).reshape(2, -1))
        towards = towards.astype(cones.start.dtype)
        distance = np.sqrt(towards[0] * towards[0] + towards[1] * towards[1])
        return distance, towards / np.maximum(distance, cones.start.dtype.type(1e-12))


@dataclass(frozen=True, kw_only=True, eq=False)
class Bending:
    """Cones, with their spreads at the depths that their middle rays meet.

    Parameters
    ----------
    tables, cones, depth
        The tables of spreads, the cones, and the depths that their middle rays meet [m].
    scale, beta
        mₒ and λβ [m²] of `tradestudy.optics.two_apertures`.
    first, share
        Index of the next smaller tabulated defocus, for a centred stop, and the weight of the next larger one.
    """

    tables: Tables
    cones: LightCones
    depth: FloatArray
    scale: FloatArray
    beta: FloatArray
    first: NDArray[np.intp]
    share: FloatArray

    def deflection(self, node: int, x: float, y: float, eta: FloatArray) -> FloatArray:
        """Change of slope of one ray of each cone, from places η on the lens [m], shape (2, cones).

        It lets the ray meet the depth of its cone at its node of the spread from a place [m] on the pixel.
        """
        tables = self.tables
        first, along = self.first, None
        if self.cones.stop is not None:
            first, along, direction = self._place(x, y)
        # Where the rays of a cone have crossed, the mirrored nodes lie nearest to them and bend them least.
        side = np.where(self.scale < 0, 1, 0)
        components = []
        for axis in (0, 1):
            sides = tables.places[:, node, axis]
            components.append(self._between(sides.reshape(-1), side * sides.shape[1] + first, along))
        across, beside = components
        if self.cones.stop is not None:
            ax, ay = direction
            across, beside = across * ax - beside * ay, across * ay + beside * ax
        return (np.stack([across, beside]) * self.beta - eta * self.scale) / self.depth

    def filter_variance(self) -> FloatArray:
        """Variance [m²] of the Gaussian filter around one node of a spread."""
        first, along = self.first, None
        if self.cones.stop is not None:
            first, along, _ = self._place(0.0, 0.0)
        return np.square(self._between(self.tables.widths, first, along) * self.beta)

    def _place(self, x: float, y: float) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        tables = self.tables
        offset, direction = tables.towards_stop(self.cones, x, y)
        farthest = tables.of_type(self.cones, [lens.farthest for lens in tables.waves.lenses])
        position = np.minimum(offset / farthest, 1) * (tables.offsets - 1)
        row = np.minimum(position.astype(np.intp), tables.offsets - 2)
        return self.first + row * tables.defoci, (position - row).astype(self.share.dtype), direction

    def _between(self, table: NDArray[np.float32], first: NDArray[np.intp], along: FloatArray | None) -> FloatArray:
        """Interpolate linearly over defocus and, with a stop, over its offset."""
        low = table.take(first)
        low = low + self.share * (table.take(first + 1) - low)
        if along is None:
            return np.asarray(low)
        step = self.tables.defoci
        high = table.take(first + step)
        high = high + self.share * (table.take(first + step + 1) - high)
        return np.asarray(low + along * (high - low))


@lru_cache(maxsize=64)  # for all pictures of a study and their error estimates; a megabyte each
def _tables(waves: Waves, samples: int) -> Mapping[int, Tables]:
    lenses, fine = waves.lenses, waves.fineness
    ends = np.arcsinh([lens.defocus for lens in lenses])
    defoci = max(2, math.ceil(fine * float(np.max(ends[:, 1] - ends[:, 0])) / _STEP) + 1)
    knots = np.sinh(np.linspace(ends[:, 0], ends[:, 1], defoci, axis=-1))
    offsets = 1
    if lenses[0].apertures.stop is not None:
        edges = max(lens.farthest / lens.apertures.blur for lens in lenses)
        offsets = math.ceil(fine * edges / waves.offset_step) + 1
    counts = sorted({samples, fewer(samples)})
    shares = {count: _shares(count) for count in counts}
    shape = (len(lenses), offsets, defoci)
    places = {count: np.empty((2 * count, 2, *shape), np.float32) for count in counts}
    widths = {count: np.empty(shape, np.float32) for count in counts}
    for k, lens in enumerate(lenses):
        # At the farthest offset itself, no light passes.
        for i, offset in enumerate(np.minimum(np.linspace(0.0, lens.farthest, offsets), _END * lens.farthest)):
            for j, curvature in enumerate(lens.apertures.curvature(knots[k])):
                spread = lens.apertures.spread(float(offset), float(curvature))
                band = 2.0 * lens.apertures.lit_radius
                whole = transfer(spread, band)
                for count in counts:
                    moved_nodes = transported(spread, *shares[count])
                    places[count][:, :, k, i, j] = moved_nodes
                    widths[count][k, i, j] = filter_width(whole, moved_nodes[:count], band)
    passed = np.asarray([lens.shares for lens in lenses], np.float32)
    return {
        count: Tables(
            waves=waves,
            places=places[count].reshape(2, count, 2, -1),
            widths=widths[count].reshape(-1),
            shares=passed,
            offsets=offsets,
            defoci=defoci,
            knots=knots.astype(np.float32),
        )
        for count in counts
    }


def _shares(count: int) -> tuple[FloatArray, FloatArray]:
    """`disc_quantiles` of the nodes and of their mirror images."""
    mirrored = [disc_quantiles(side * nodes(count).disc) for side in (1.0, -1.0)]
    left, above = (np.concatenate(parts) for parts in zip(*mirrored, strict=True))
    return left, above
