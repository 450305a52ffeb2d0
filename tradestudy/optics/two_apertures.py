"""How waves spread the light of a point behind a lens and a stop: what the stop passes, and where the rest goes.

Between any two planes, two numbers describe paraxial light: a ray through the position η of the lens meets the other
plane at x = m η, and a deflection by an angle κ at the lens moves it by B κ. With (mₛ, Bₛ) at the stop, (mₒ, Bₒ) on the
object and β = mₛ Bₒ − Bₛ mₒ from the stop to the object, Collins's integral over both apertures reads

    U(x) ∝ ∬ dP dη exp{iπ/λ [mₛ η²/Bₛ − 2 η·P/Bₛ + g P² − 2 P·x/β]},    g = Bₒ/(Bₛ β),

with positions relative to the ray through the middle of the lens. Without a stop, the lens takes its role: P = η,
g = mₒ/Bₒ, β = Bₒ. By reciprocity, a point on a pixel gathers light of the object just as light from that point would
spread over the object.

References
----------
S. A. Collins, "Lens-system diffraction integral written in terms of matrix optics", J. Opt. Soc. Am. 60, 1168 (1970).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.quadrature import gauss_legendre

_TAIL: Final = 16.0  # extent of a spread beyond its rays, over the radius of what limits it: 32 λN
_SHADOW: Final = 8.0  # extent of light on the stop beyond the lens's shadow, in radii of its diffraction
_PAD: Final = 3.0  # width of the periodic grid over that of the aperture; 2 avoids overlap of the spread
_MOST_SAMPLES: Final = 4096
_NODES_OF_ARC: Final = 400
_SHARP: Final = 50.0  # Fresnel number from which on a shadow's edge counts as sharp: a seventh of its radius wide
_STEPS_OF_SHARP: Final = 8.0


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A round aperture behind the lens.

    Parameters
    ----------
    scale, reach
        mₛ and Bₛ [m], ≠ 0.
    radius
        Radius of the stop [m].
    """

    scale: float
    reach: float
    radius: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Density of light |U|² over the object, with sum 1, at evenly spaced positions that are the same along x and y.

    Few columns are ever requested, so each is transformed on demand; Parseval's theorem gives the sums without any
    transform. The positions extend beyond the rays by 16 over the lit part's radius; light farther away is folded in.

    Parameters
    ----------
    light
        Light in the plane of the aperture, y ≥ 0 along the rows; the other half is the mirror image.
    step
        Distance between its samples [m].
    count
        Number n of positions along each axis, which is even.
    """

    light: NDArray[np.complex64]
    step: float
    count: int

    @cached_property
    def place(self) -> FloatArray:
        """Positions x/(λβ) along either axis [1/m], shape (n,)."""
        return np.asarray((np.arange(self.count) - self.count // 2) / (self.count * self.step))

    @cached_property
    def sums(self) -> FloatArray:
        """Sums of the density over y at each position along x, and over x at each position along y; shape (2, n)."""
        from scipy import fft

        twice = np.full(len(self.light), 2.0)
        twice[0] = 1.0  # the middle row is its own mirror image
        over_y = twice @ _square(self._by_row)
        over_x = _square(fft.fft(self._both_halves(self.light), n=self.count, axis=0)).sum(axis=1, dtype=np.float64)
        return np.stack([fft.fftshift(density / density.sum()) for density in (over_y, over_x)])

    def columns(self, numbers: NDArray[np.intp]) -> FloatArray:
        """Density along y in some columns, up to a common factor; shape (columns, n)."""
        from scipy import fft

        half = self.count // 2
        rows = self._both_halves(self._by_row[:, (numbers + half) % self.count]).T
        return fft.fftshift(_square(fft.fft(rows, n=self.count, axis=1)), axes=1)

    @cached_property
    def _by_row(self) -> NDArray[np.complex64]:
        """Rows, transformed along x."""
        from scipy import fft

        return np.asarray(fft.fft(self.light, n=self.count, axis=1))

    def _both_halves(self, rows: NDArray[np.complex64]) -> NDArray[np.complex64]:
        return np.concatenate([rows[:0:-1], rows])


def _square(field: NDArray[np.complex64]) -> FloatArray:
    return np.asarray(np.square(field.real) + np.square(field.imag))


@dataclass(frozen=True, kw_only=True)
class TwoApertures:
    """A lens that a point lights evenly, with or without a stop behind it; scalar, paraxial, of one wavelength.

    Parameters
    ----------
    wavelength
        λ [m].
    radius
        Radius of the lens [m].
    stop
        Stop behind the lens; None for the lens alone.
    """

    wavelength: float
    radius: float
    stop: Stop | None = None

    @cached_property
    def _airy(self) -> float:
        """λ Bₛ/2r [m]: the amount by which diffraction at the lens widens its shadow on the stop."""
        return 0.0 if self.stop is None else self.wavelength * abs(self.stop.reach) / (2.0 * self.radius)

    @cached_property
    def is_sharp(self) -> bool:
        """Whether the shadow of the lens on the stop is that of rays alone: ``|mₛ| r²/λ|Bₛ|`` of 50 or more.

        Both apertures still spread light over the object; only the effect of the lens's edge on the light in the stop
        is left out.
        """
        stop = self.stop
        return stop is not None and abs(stop.scale) * self.radius**2 >= _SHARP * self.wavelength * abs(stop.reach)

    @cached_property
    def lit_radius(self) -> float:
        """Approximate radius of the light in the last aperture in front of the object, from its centre [m]."""
        if self.stop is None:
            return self.radius
        return min(self.stop.radius, abs(self.stop.scale) * self.radius + self._airy)

    @cached_property
    def blur(self) -> float:
        """Width of the edge of the lens's shadow on the stop [m]: of a Fresnel zone, or of the Airy disc.

        A sharp shadow has an edge of an eighth of its radius: moving the shadow by this much changes what the stop
        passes.
        """
        if self.stop is None:
            return 0.0
        if self.is_sharp:
            return abs(self.stop.scale) * self.radius / _STEPS_OF_SHARP
        return max(math.sqrt(self.wavelength * abs(self.stop.reach * self.stop.scale)), self._airy)

    @cached_property
    def focused_curvature(self) -> float:
        """g of the object that is in focus [1/m]."""
        if (stop := self.stop) is None:
            return 0.0
        least = self._airy / self.radius  # as for a Gaussian beam, where the shadow itself is in focus
        return stop.scale / (stop.reach * (stop.scale**2 + least**2))

    @property
    def waves_per_curvature(self) -> float:
        """Path error at the edge of the lit part [waves] per 1/m of g away from focus [m]."""
        return self.lit_radius**2 / (2.0 * self.wavelength)

    def curvature(self, defocus_waves: FloatArray) -> FloatArray:
        """g [1/m] of objects that are this many waves out of focus."""
        return np.asarray(self.focused_curvature + defocus_waves / self.waves_per_curvature)

    def rays_slope(self, curvature: float) -> float:
        """mₒ/β [1/m] of an object: rays through the lens at η spread over it by this times η β."""
        if self.stop is None:
            return curvature
        return self.stop.scale * curvature - 1.0 / self.stop.reach

    def amplitude(self, distance: FloatArray) -> FloatArray:
        """Complex light in the plane of the stop at distances [m] from the middle of the shadow [1/m].

        ``V = 2π ∫₀^r exp(iπ mₛ η²/λBₛ) J₀(2π η P/λBₛ) η dη / (√π r λ Bₛ)``: its square integrates to 1. Without a stop,
        it is uniform light on the lens. Gauss–Legendre rule in η², with nodes for the largest phase.
        """
        from scipy.special import j0

        r = self.radius
        if self.stop is None:
            return np.asarray((distance <= r) / (math.sqrt(math.pi) * r), np.complex128)
        reach = self.wavelength * self.stop.reach
        phase = math.pi * self.stop.scale * r * r / reach
        turns = 2.0 * math.pi * r / abs(reach)
        t, weight = gauss_legendre(32 * math.ceil((abs(phase) + turns * float(np.max(distance)) + 32.0) / 64.0))
        bessel = j0(np.multiply.outer(distance, np.sqrt(t) * turns))
        return np.asarray(math.sqrt(math.pi) * r / reach * (bessel @ (weight * np.exp(1j * phase * t))))

    def passed_share(self, offset: FloatArray) -> FloatArray:
        """Fraction of the light of the lens that the stop passes, for centres of stop and shadow this far apart [m]."""
        if (stop := self.stop) is None:
            return np.ones_like(offset)
        t, weight = gauss_legendre(_NODES_OF_ARC)
        first, last = np.maximum(offset - stop.radius, 0.0), offset + stop.radius
        # Rings about the shadow. Those that the stop does not cut are summed separately, so that no rule meets a
        # corner.
        whole = np.maximum(stop.radius - offset, 0.0)
        total = np.zeros_like(offset, dtype=np.float64)
        for low, high, cut in ((np.zeros_like(offset), whole, False), (np.maximum(first, whole), last, True)):
            # The arc begins and ends vertically; the substitution t → sin² makes the rule smooth there.
            ring = low[:, None] + (high - low)[:, None] * np.square(np.sin(0.5 * math.pi * t))
            step = (high - low)[:, None] * (0.5 * math.pi * np.sin(math.pi * t)) * weight
            half = np.full_like(ring, math.pi)
            if cut:
                apart = np.maximum(2.0 * ring * offset[:, None], 1e-300)
                cosine = (np.square(ring) + np.square(offset)[:, None] - stop.radius**2) / apart
                half = np.arccos(np.clip(cosine, -1.0, 1.0))
            total += np.sum(2.0 * half * ring * step * np.square(np.abs(self._shadow(ring))), axis=1)
        return total

    def _shadow(self, distance: FloatArray) -> NDArray[np.complex128]:
        """Light on the stop at distances [m] from the middle of the shadow, out to where the stop ends."""
        stop = self.stop
        assert stop is not None
        if self.is_sharp:
            edge = abs(stop.scale) * self.radius
            bend = -math.pi / (self.wavelength * stop.reach * stop.scale)
            height = 1.0 / (math.sqrt(math.pi) * edge)
            return np.asarray(np.where(distance <= edge, height, 0.0) * np.exp(1j * bend * np.square(distance)))
        from scipy.ndimage import map_coordinates

        step, table = self._amplitudes
        place = distance / step
        last = table.size - 1  # farther away there is almost no light
        light = map_coordinates(table, [np.minimum(place, last)], order=3, mode="mirror", prefilter=False)
        return np.where(place <= last, light, 0.0)

    @cached_property
    def _amplitudes(self) -> tuple[float, NDArray[np.complex128]]:
        """Step [m] and coefficients of a cubic spline through amplitudes, eight to each period of their band."""
        from scipy.ndimage import spline_filter1d

        assert self.stop is not None
        far = 2.0 * (self.stop.radius + self._half_window)
        radii = np.linspace(0.0, far, 8 * math.ceil(far / self._airy) + 33)
        return float(radii[1]), spline_filter1d(self.amplitude(radii), order=3, mode="mirror", output=np.complex128)

    def spread(self, offset: float, curvature: float) -> Spread:
        """Light over the object, for a stop whose centre lies at an offset along x from the middle of the shadow.

        Parameters
        ----------
        offset
            Offset [m]; 0 without a stop.
        curvature
            g [1/m], as in the integral above.

        Raises
        ------
        OutOfRangeError
            If no light passes the stop.
        UnaffordableError
            If the defocus takes more than 4096 samples along an axis.
        """
        low, high, half = self._window(offset)
        farthest = self.radius * abs(self.rays_slope(curvature)) / self.wavelength
        band = farthest + _TAIL / min(self.lit_radius, max(half, (high - low) / 2.0))
        step = 1.0 / (2.0 * band)
        count = _even_size(_PAD * 2.0 * max(half, (high - low) / 2.0) / step)
        columns, rows = math.ceil((high - low) / step) + 3, math.ceil(half / step) + 2
        p_x = (low + high) / 2.0 + step * (np.arange(columns) - (columns - 1) / 2.0)
        p_y = step * np.arange(rows)  # on one side of the middle row; the other side mirrors it
        distance = np.sqrt(np.square(p_x) + np.square(p_y)[:, None])
        if self.stop is None:
            light = _edge(self.radius - distance, step).astype(np.complex128)
        else:
            passed = _edge(self.stop.radius - np.hypot(p_x - offset, p_y[:, None]), step)
            if self.is_sharp:
                passed = passed * _edge(self._half_window - distance, step)
                distance = np.minimum(distance, self._half_window)
            light = passed * self._shadow(distance)
        bend = 1j * math.pi * curvature / self.wavelength
        light *= np.exp(bend * np.square(p_x))
        light *= np.exp(bend * np.square(p_y))[:, None]
        # Single precision resolves more than the edges do.
        return Spread(light=light.astype(np.complex64), step=step, count=count)

    def _window(self, offset: float) -> tuple[float, float, float]:
        """Range along x in which light passes, and half the range along y [m]."""
        if self.stop is None:
            return -self.radius, self.radius, self.radius
        half = self._half_window
        low, high = max(-half, offset - self.stop.radius), min(half, offset + self.stop.radius)
        if high <= low:
            raise OutOfRangeError(
                "from the middle of a lens's shadow to that of the stop",
                value=f"{offset:g} m",
                limit=f"less than {half + self.stop.radius:g} m, beyond which no light passes",
            )
        return low, high, min(half, self.stop.radius)

    @cached_property
    def _half_window(self) -> float:
        """Distance from the middle of the shadow up to which light is followed [m]."""
        assert self.stop is not None
        if self.is_sharp:
            return abs(self.stop.scale) * self.radius
        return abs(self.stop.scale) * self.radius + _SHADOW * self._airy + 3.0 * self.blur


def _edge(inside: FloatArray, step: float) -> FloatArray:
    """Approximate fraction of a sample's square that lies within an edge, by the distance of its centre inside."""
    return np.clip(inside / step + 0.5, 0.0, 1.0)


def _even_size(least: float) -> int:
    from scipy import fft

    count = 2 * int(fft.next_fast_len(math.ceil(least / 2.0)))
    if count > _MOST_SAMPLES:
        raise UnaffordableError(
            "samples along an axis of the spread of a point by waves",
            value=str(count),
            limit=f"at most {_MOST_SAMPLES}",
            remedy="use rays: with hundreds of wavelengths of defocus, diffraction changes nothing",
        )
    return count


_NODES = 64


def centroid_of_common_part(apart: ArrayLike, radius: float, other_radius: float) -> FloatArray:
    """Distance [m] from the centre of the first of two discs to the centroid of their overlap, towards the second.

    Parameters
    ----------
    apart
        Distance between the centres [m], any shape.
    radius, other_radius
        Radii of the discs [m].

    Returns
    -------
    FloatArray
        Distance; 0 where the first disc lies within the second, NaN where they do not overlap.
    """
    s = np.asarray(apart, dtype=np.float64)[..., np.newaxis]
    low, high = np.maximum(-radius, s - other_radius), np.minimum(radius, s + other_radius)
    t, weight = gauss_legendre(_NODES)
    # Nodes cluster at both ends, where the outline is steep.
    x = low + (high - low) * np.square(np.sin(0.5 * np.pi * t))
    height = np.minimum(radius**2 - np.square(x), other_radius**2 - np.square(x - s))
    area = weight * np.sin(np.pi * t) * np.sqrt(np.maximum(height, 0.0))
    with np.errstate(invalid="ignore"):  # no overlap
        return np.asarray(
            np.where(high > low, (area * x).sum(-1, keepdims=True) / area.sum(-1, keepdims=True), np.nan)
        )[..., 0]
