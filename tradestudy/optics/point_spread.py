"""How far a point spreads: widths, encircled energy, Strehl ratio, MTF and shares of light, with error bars.

Shares refer to the power that passed the pupil. What lies outside the sampled window is never guessed: a
number that would need light from there is refused.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.sampled_point_spread import (
    DiscMoments,
    Measured,
    PointSpread,
    measured,
    peak_position,
)


def full_width_at_half_maximum(psf: PointSpread, *, angle: float) -> Measured:
    """FWHM of the cut through the peak: distance of the first half-maximum crossings on both sides [m].

    Parameters
    ----------
    psf
        Sampled intensity.
    angle
        Direction of the cut against the x axis [rad].

    Raises
    ------
    OutOfRangeError
        If a side never falls to half the peak within the window.
    """
    direction = (float(np.cos(angle)), float(np.sin(angle)))

    def width(grid: PointSpread) -> float:
        peak = peak_position(grid)
        return sum(_half_maximum_distance(grid, peak, (s * direction[0], s * direction[1])) for s in (1, -1))

    return measured(psf, width)


def _half_maximum_distance(psf: PointSpread, peak: tuple[float, float], direction: tuple[float, float]) -> float:
    """Distance from the peak to the first crossing of half its height along a direction."""
    reach = _distance_to_rim(psf, peak, direction)
    half = float(psf.at(*peak)) / 2

    def above(distance: FloatArray | float) -> FloatArray:
        return psf.at(peak[0] + distance * direction[0], peak[1] + distance * direction[1]) - half

    steps = np.arange(0, reach, psf.spacing / 4)
    below = np.flatnonzero(above(steps) <= 0)
    if below.size == 0:
        raise OutOfRangeError("half maximum not reached inside the window", remedy="widen the window")
    first = int(below[0])
    return float(brentq(lambda d: float(above(d)), steps[first - 1], steps[first], xtol=1e-14 * reach))


def _distance_to_rim(psf: PointSpread, start: tuple[float, float], direction: tuple[float, float]) -> float:
    """Distance from a point inside the window to its rim along a direction."""
    distances = []
    for at, step, axis in ((start[0], direction[0], psf.x), (start[1], direction[1], psf.y)):
        if step != 0:
            distances.append(((axis[-1] if step > 0 else axis[0]) - at) / step)
    return float(min(distances))


def encircled_energy(psf: PointSpread, *, centre: tuple[float, float], radius: FloatArray) -> Measured:
    """Share of the pupil's power inside circles: ∫∫ I dA / P.

    Parameters
    ----------
    psf
        Sampled intensity.
    centre
        Centre of the circles (x, y) [m]; take the chief ray, the peak or the centroid, and say which.
    radius
        Radii [m], any shape.

    Raises
    ------
    OutOfRangeError
        If a circle leaves the window.
    """
    radii = np.asarray(radius, dtype=np.float64)
    _require_inside(psf, centre, float(radii.max()))

    def shares(grid: PointSpread) -> FloatArray:
        energy = DiscMoments(grid, centre, float(radii.max()))
        return np.reshape([energy(float(r)) / grid.pupil_power for r in radii.ravel()], radii.shape)

    return measured(psf, shares)


def encircled_energy_radius(psf: PointSpread, *, centre: tuple[float, float], share: float) -> Measured:
    """Radius of the circle that holds a share of the pupil's power [m].

    Parameters
    ----------
    psf
        Sampled intensity.
    centre
        Centre of the circle (x, y) [m].
    share
        In (0, 1), for example 0.5 or 0.8.

    Raises
    ------
    OutOfRangeError
        If the largest circle that fits into the window holds less.
    """
    if not 0 < share < 1:
        raise OutOfRangeError("encircled share", value=f"{share:g}", limit="in (0, 1)")
    largest = _largest_radius(psf, centre)
    held = DiscMoments(psf, centre, largest)(largest) / psf.pupil_power
    if held <= share:
        raise OutOfRangeError(
            "the window holds too little of the pupil's power",
            value=f"{held:.4g} within {largest:g} m",
            limit=f"> {share:g}",
            remedy="widen the window",
        )

    def radius(grid: PointSpread) -> float:
        target = share * grid.pupil_power
        energy = DiscMoments(grid, centre, largest)
        if energy(largest) <= target:
            return largest  # a grid this coarse loses the light; its large change then is the error
        return float(brentq(lambda r: energy(r) - target, 0.0, largest, xtol=1e-13 * largest))

    return measured(psf, radius)


def rms_width(psf: PointSpread, *, centre: tuple[float, float], radius: float) -> Measured:
    """Root-mean-square distance from the centre within a circle: √(∫ r² I dA / ∫ I dA) [m].

    The radius belongs to the number: behind a hard aperture I falls as r⁻³ and the width without a limit
    diverges.

    Parameters
    ----------
    psf
        Sampled intensity.
    centre
        Centre (x, y) [m].
    radius
        Declared limit [m].

    Raises
    ------
    OutOfRangeError
        If the circle leaves the window, or the window holds no light.
    """
    _require_inside(psf, centre, radius)
    if not np.any(psf.intensity):
        raise OutOfRangeError("no light in the window")

    def width(grid: PointSpread) -> float:
        moment = DiscMoments(grid, centre, radius)
        return float(np.sqrt(abs(moment(radius, 2) / moment(radius))))

    return measured(psf, width)


def strehl_ratio(psf: PointSpread, *, reference_peak: float) -> Measured:
    """Largest intensity over that of the same pupil without aberration.

    Parameters
    ----------
    psf
        Sampled intensity.
    reference_peak
        Peak without aberration [W/m²], for example `diffraction_limited_peak`.

    Raises
    ------
    OutOfRangeError
        If the reference is not positive, or the peak lies on the rim.
    """
    if not reference_peak > 0:
        raise OutOfRangeError("reference peak", value=f"{reference_peak:g} W/m²", limit="> 0")

    def ratio(grid: PointSpread) -> float:
        return float(grid.at(*peak_position(grid))) / reference_peak

    return measured(psf, ratio)


def diffraction_limited_peak(*, pupil_power: float, pupil_area: float, wavelength: float, distance: float) -> float:
    """Peak of a uniformly lit pupil in focus: P A/(λ z)² [W/m²].

    Born and Wolf, *Principles of Optics*, section 8.5.2; paraxial, so good to 1/(16 F²).
    """
    return pupil_power * pupil_area / (wavelength * distance) ** 2


def modulation_transfer(psf: PointSpread, *, frequency_x: FloatArray, frequency_y: FloatArray) -> Measured:
    """MTF: |∫∫ I e^{−2πi (f_x x + f_y y)} dx dy| / P.

    The error includes the share of power outside the window, which bounds what the missing light could add.

    Parameters
    ----------
    psf
        Sampled intensity.
    frequency_x, frequency_y
        Spatial frequencies [cycles/m], broadcast.

    Raises
    ------
    OutOfRangeError
        If a frequency exceeds half the sampling frequency.
    """
    fx, fy = np.broadcast_arrays(np.asarray(frequency_x, dtype=np.float64), np.asarray(frequency_y, dtype=np.float64))
    limit = 1 / (2 * psf.spacing)
    if max(np.abs(fx).max(), np.abs(fy).max()) > limit:
        raise OutOfRangeError(
            "spatial frequency",
            value=f"{max(np.abs(fx).max(), np.abs(fy).max()):g} 1/m",
            limit=f"≤ {limit:g} 1/m",
            remedy="sample more finely",
        )

    def transfer(grid: PointSpread) -> FloatArray:
        weight_x, weight_y = _trapezoid(grid.x), _trapezoid(grid.y)
        along_x = weight_x[:, None] * np.exp(-2j * np.pi * np.outer(grid.x, fx.ravel()))
        along_y = weight_y[:, None] * np.exp(-2j * np.pi * np.outer(grid.y, fy.ravel()))
        transform = np.einsum("yk,yk->k", along_y, grid.intensity @ along_x)
        return np.reshape(np.abs(transform), fx.shape) / grid.pupil_power

    inside, share = measured(psf, transfer), window_share(psf)
    return Measured(value=inside.value, error=inside.error + abs(1 - share.value) + share.error)


def window_share(psf: PointSpread) -> Measured:
    """Share of the pupil's power that the sampled window holds."""
    return measured(psf, lambda g: g.spline.integral(g.y[0], g.y[-1], g.x[0], g.x[-1]) / g.pupil_power)


def share_outside_disc(psf: PointSpread, *, centre: tuple[float, float], radius: float) -> Measured:
    """Share of the pupil's power outside a disc, such as the geometric footprint: 1 − ∫∫ I dA / P.

    Raises
    ------
    OutOfRangeError
        If the disc leaves the window.
    """
    inside = encircled_energy(psf, centre=centre, radius=np.asarray(radius))
    return Measured(value=1 - inside.value, error=inside.error)


def pixel_shares(psf: PointSpread, *, pitch: float, corner: tuple[float, float], shape: tuple[int, int]) -> Measured:
    """Share of the pupil's power on each pixel, the intensity integrated over the pixel's square.

    Parameters
    ----------
    psf
        Sampled intensity.
    pitch
        Side of a pixel [m].
    corner
        Outer corner (x, y) of pixel [0, 0], at its smallest coordinates [m].
    shape
        (rows, columns).

    Returns
    -------
    Measured
        Shape ``shape``; row i spans y from corner_y + i pitch on.

    Raises
    ------
    OutOfRangeError
        If the pixels leave the window.
    """
    x_edges = corner[0] + pitch * np.arange(shape[1] + 1)
    y_edges = corner[1] + pitch * np.arange(shape[0] + 1)
    slack = 1e-9 * pitch
    if (
        x_edges[0] < psf.x[0] - slack
        or x_edges[-1] > psf.x[-1] + slack
        or y_edges[0] < psf.y[0] - slack
        or y_edges[-1] > psf.y[-1] + slack
    ):
        raise OutOfRangeError(
            "pixels leave the sampled window",
            value=f"x {x_edges[0]:g}…{x_edges[-1]:g} m, y {y_edges[0]:g}…{y_edges[-1]:g} m",
            limit=f"x {psf.x[0]:g}…{psf.x[-1]:g} m, y {psf.y[0]:g}…{psf.y[-1]:g} m",
            remedy="widen the window or ask for fewer pixels",
        )

    def shares(grid: PointSpread) -> FloatArray:
        integrals = [
            [grid.spline.integral(y0, y1, x0, x1) for x0, x1 in pairwise(x_edges)] for y0, y1 in pairwise(y_edges)
        ]
        return np.asarray(integrals) / grid.pupil_power

    return measured(psf, shares)


def share_on_neighbouring_pixels(psf: PointSpread, *, pitch: float, centre: tuple[float, float]) -> Measured:
    """Share of the pupil's power on the eight neighbours of the pixel centred at a point.

    Parameters
    ----------
    psf
        Sampled intensity.
    pitch
        Side of a pixel [m].
    centre
        Centre (x, y) of the middle pixel [m].

    Raises
    ------
    OutOfRangeError
        If the nine pixels leave the window.
    """
    block = pixel_shares(psf, pitch=pitch, corner=(centre[0] - 1.5 * pitch, centre[1] - 1.5 * pitch), shape=(3, 3))
    ring = np.ones((3, 3))
    ring[1, 1] = 0.0
    return Measured(value=np.asarray(np.sum(ring * block.value)), error=np.asarray(np.sum(ring * block.error)))


def _largest_radius(psf: PointSpread, centre: tuple[float, float]) -> float:
    """Radius of the largest circle about a point inside the window."""
    radius = min(centre[0] - psf.x[0], psf.x[-1] - centre[0], centre[1] - psf.y[0], psf.y[-1] - centre[1])
    if radius <= 0:
        raise OutOfRangeError("centre outside the window", value=f"({centre[0]:g}, {centre[1]:g}) m")
    return float(radius)


def _require_inside(psf: PointSpread, centre: tuple[float, float], radius: float) -> None:
    """Refuse a circle that leaves the window."""
    largest = _largest_radius(psf, centre)
    if not 0 < radius <= largest * (1 + 1e-12):
        raise OutOfRangeError(
            "radius", value=f"{radius:g} m", limit=f"in (0, {largest:g}] m", remedy="widen the window"
        )


def _trapezoid(axis: FloatArray) -> FloatArray:
    """Weights of the trapezoid rule on a uniform axis."""
    weights = np.full(axis.size, (axis[-1] - axis[0]) / (axis.size - 1))
    weights[[0, -1]] /= 2
    return weights
