"""Metrics of a point-spread function: widths, encircled energy and Strehl ratio, with error bars.

Fractions refer to the power that passed the pupil. The light outside the sampled window is never guessed: a number that
depends on it is refused.

An error is the sum of the sampling error and a bound on the effect of the stated error of the samples. The latter
changes an integral ∫∫ w I dA by at most ‖w‖ ‖δI‖ (Cauchy–Schwarz), and a value at a point by at most the whole error
concentrated in one sample.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import check_angle, checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.sampled_point_spread import (
    Measured,
    PointSpread,
    SpreadField,
    as_point_spread,
    measured,
    peak_position,
)


@checked
def full_width_at_half_maximum(field: SpreadField, *, angle: float) -> Measured:
    """Full width at half maximum along a line through the peak [m].

    On either side of the peak, the width extends to where the intensity first falls to half the peak.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    angle
        Direction of the line, measured from the x axis [rad], within ±2π.

    Returns
    -------
    Measured
        Width [m], shape (); its error accounts for the spacing and the stated error of the samples.

    Raises
    ------
    OutOfRangeError
        The angle exceeds a full turn, the brightest sample lies on the edge of the window, or the intensity on one side
        does not fall to half the peak within the window.

    References
    ----------
    Airy's pattern has a width of 1.029 λ N, where λ is the wavelength and N the working f-number. At f/8, the width
    computed with exact paths is 0.2 % greater.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> width = optics.full_width_at_half_maximum(psf, angle=0.0)
    >>> print(f"{width.value / (550e-9 * 8):.3f} λ N, error below 1e-5: {width.error < 1e-5 * width.value}")
    1.031 λ N, error below 1e-5: True
    """
    check_angle(angle)
    psf = as_point_spread(field)
    direction = (float(np.cos(angle)), float(np.sin(angle)))

    def sides(grid: PointSpread) -> list[float]:
        peak = peak_position(grid)
        return [_half_maximum_distance(grid, peak, (s * direction[0], s * direction[1])) for s in (1, -1)]

    peak = peak_position(psf)
    # The crossing moves with the error of the intensity there, and with half the error of the peak.
    moved = sum(
        1.5 * psf.sample_error / abs(_slope(psf, peak, (s * direction[0], s * direction[1]), distance))
        for s, distance in zip((1, -1), sides(psf), strict=True)
    )
    return measured(psf, lambda grid: sum(sides(grid)), carried=moved)


def _slope(psf: PointSpread, start: tuple[float, float], direction: tuple[float, float], distance: float) -> float:
    """Derivative of the intensity along a direction [W/m³]."""
    position = start[0] + distance * direction[0], start[1] + distance * direction[1]
    return float(direction[0] * psf.at(*position, order=(1, 0)) + direction[1] * psf.at(*position, order=(0, 1)))


def _half_maximum_distance(psf: PointSpread, peak: tuple[float, float], direction: tuple[float, float]) -> float:
    """Distance from the peak to the first crossing of half its height along a direction."""
    reach = _distance_to_rim(psf, peak, direction)
    half = float(psf.at(*peak)) / 2

    def above(distance: FloatArray | float) -> FloatArray:
        return psf.at(peak[0] + distance * direction[0], peak[1] + distance * direction[1]) - half

    steps = np.arange(0, reach, psf.spacing / 4)
    below = np.flatnonzero(above(steps) <= 0)
    if below.size == 0:
        raise OutOfRangeError(
            "half maximum not reached inside the window",
            value=f"{reach:g} m from the peak",
            limit="a crossing on both sides",
            remedy="widen the window",
        )
    first = int(below[0])
    return float(brentq(lambda d: float(above(d)), steps[first - 1], steps[first], xtol=1e-14 * reach))


def _distance_to_rim(psf: PointSpread, start: tuple[float, float], direction: tuple[float, float]) -> float:
    """Distance from a point inside the window to its rim along a direction."""
    distances = []
    for place, step, axis in ((start[0], direction[0], psf.x), (start[1], direction[1], psf.y)):
        if step != 0:
            distances.append(((axis[-1] if step > 0 else axis[0]) - place) / step)
    return float(min(distances))


@checked
def encircled_energy(field: SpreadField, *, centre: tuple[float, float], radius: FloatArray) -> Measured:
    """Fraction of the power through the pupil that falls inside a circle, ∬ I dA / P, for one or more radii.

    I is the intensity and P the power through the pupil; the integral extends over the circle.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    centre
        Centre of the circles (x, y) [m], such as the position of the chief ray, the peak or the centroid.
    radius
        Radii of the circles [m], ≥ 0, any shape.

    Returns
    -------
    Measured
        Fractions [1] in the shape of the radii; their error accounts for the spacing and the stated error of the
        samples.

    Raises
    ------
    OutOfRangeError
        A radius is negative, or a circle reaches beyond the window.

    References
    ----------
    For Airy's pattern, the fraction inside radius r is 1 − J₀(v)² − J₁(v)² with v = π r/(λ N), where λ is the
    wavelength, N the working f-number, and J₀ and J₁ are Bessel functions (Rayleigh 1881). It is 0.838 at the first
    dark ring.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4, method="fresnel")
    >>> dark_ring = 1.2197 * 550e-9 * 8
    >>> share = optics.encircled_energy(psf, centre=(0.0, 0.0), radius=np.array(dark_ring))
    >>> print(f"{share.value:.3f}, error below 1e-5: {share.error < 1e-5}")
    0.838, error below 1e-5: True
    """
    psf = as_point_spread(field)
    radii = np.asarray(radius, dtype=np.float64)
    if radii.size == 0:
        raise OutOfRangeError("radius", value="none", limit="at least one", remedy="give a radius")
    for extreme in (radii.min(), radii.max()):
        _require_inside(psf, centre, float(extreme), zero=True)

    def shares(grid: PointSpread) -> FloatArray:
        energy = grid.moments(centre, float(radii.max()))
        return np.reshape([energy(float(r)) / grid.pupil_power for r in radii.ravel()], radii.shape)

    # By Cauchy–Schwarz, an L2 error of the intensity changes the power on a disc by at most √area times that error.
    return measured(psf, shares, carried=np.sqrt(np.pi) * radii * psf.intensity_error / psf.pupil_power)


@checked
def encircled_energy_radius(field: SpreadField, *, centre: tuple[float, float], share: float) -> Measured:
    """Radius of the circle that contains a given fraction of the power through the pupil [m].

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    centre
        Centre of the circle (x, y) [m].
    share
        Fraction of the power through the pupil [1], between 0 and 1, for example 0.5 or 0.8.

    Returns
    -------
    Measured
        Radius [m], shape (); its error accounts for the spacing and the stated error of the samples.

    Raises
    ------
    OutOfRangeError
        The fraction is not between 0 and 1, or even the largest circle that fits into the window contains less.

    References
    ----------
    The radius is found by solving ``encircled_energy`` = ``share``.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> radius = optics.encircled_energy_radius(psf, centre=(0.0, 0.0), share=0.5)
    >>> print(f"{radius.value / (550e-9 * 8):.3f} λ N, error below 1e-5: {radius.error < 1e-5 * radius.value}")
    0.536 λ N, error below 1e-5: True
    """
    if not 0 < share < 1:
        raise OutOfRangeError(
            "encircled share", value=f"{share:g}", limit="in (0, 1)", remedy="give a fraction: 80 % is 0.8"
        )
    psf = as_point_spread(field)
    largest = _largest_radius(psf, centre)
    inside = psf.moments(centre, largest)
    held = inside(largest) / psf.pupil_power
    if held <= share:
        raise OutOfRangeError(
            "the window contains too little of the pupil's power",
            value=f"{held:.4g} within {largest:g} m",
            limit=f"> {share:g}",
            remedy="widen the window",
        )

    def radius(grid: PointSpread) -> float:
        target = share * grid.pupil_power
        energy = grid.moments(centre, largest)
        if energy(largest) <= target:
            return largest  # a grid this coarse loses light; the large change then counts as the error
        return float(brentq(lambda r: energy(r) - target, 0.0, largest, xtol=1e-13 * largest))

    # The bound on the error of the power, over the rise of the power with the radius, bounds that of the radius.
    nominal, step = radius(psf), psf.spacing / 4
    rise = (inside(min(nominal + step, largest)) - inside(max(nominal - step, 0.0))) / (2 * step)
    return measured(psf, radius, carried=np.sqrt(np.pi) * nominal * psf.intensity_error / rise)


@checked
def rms_width(field: SpreadField, *, centre: tuple[float, float], radius: float) -> Measured:
    """Root-mean-square distance of the light from the centre of a circle: √(∬ r² I dA / ∬ I dA) [m].

    I is the intensity, r the distance from the centre, and both integrals extend over the circle. Behind an
    aperture with a hard edge, I falls as r⁻³, so that the width grows with the radius of the circle without limit.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    centre
        Centre of the circle (x, y) [m].
    radius
        Radius of the circle [m], > 0.

    Returns
    -------
    Measured
        Width [m], shape (); its error accounts for the spacing and the stated error of the samples.

    Raises
    ------
    OutOfRangeError
        The radius is not positive, the circle reaches beyond the window, or the window contains no light.

    References
    ----------
    The square of the width is a second moment of the intensity, as in ISO 11146-1, but about the given centre and only
    over the circle.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> width = optics.rms_width(psf, centre=(0.0, 0.0), radius=15e-6)
    >>> print(f"{width.value * 1e6:.3f} µm, error below 0.1 nm: {width.error < 1e-10}")
    3.700 µm, error below 0.1 nm: True
    """
    psf = as_point_spread(field)
    _require_inside(psf, centre, radius)
    if not np.any(psf.intensity):
        raise OutOfRangeError("light in the window", value="none", limit="> 0", remedy="move or widen the window")

    def width(grid: PointSpread) -> float:
        of_grid = grid.moments(centre, radius)
        return float(np.sqrt(abs(of_grid(radius, 2) / of_grid(radius))))

    nominal = width(psf)
    second = radius**3 * np.sqrt(np.pi / 3) + nominal**2 * radius * np.sqrt(np.pi)  # ‖r²‖ and w² ‖1‖ over the disc
    return measured(
        psf, width, carried=second * psf.intensity_error / (2 * nominal * psf.moments(centre, radius)(radius))
    )


@checked
def strehl_ratio(field: SpreadField, *, reference_peak: float) -> Measured:
    """Strehl ratio: the peak intensity divided by the peak intensity of the same pupil without aberration.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    reference_peak
        Peak intensity without aberration [unit of the intensity of ``field``], > 0, for example from
        `diffraction_limited_peak`.

    Returns
    -------
    Measured
        Ratio [1], shape (); its error accounts for the spacing and the stated error of the samples. The
        reference peak is taken as exact.

    Raises
    ------
    OutOfRangeError
        The reference peak is not positive and finite, or the brightest sample lies on the edge of the window.

    References
    ----------
    M. Born and E. Wolf, *Principles of Optics*, section 9.1.3.

    Examples
    --------
    By Maréchal's criterion, an aberration of λ/14 (rms) gives a Strehl ratio of about 0.8. The result of `point_spread`
    contains the reference peak of the lens:

    >>> from tradestudy import optics
    >>> psf = optics.point_spread(
    ...     focal_length=50e-3,
    ...     f_number=8,
    ...     wavelength=550e-9,
    ...     pupil=optics.Pupil.from_waves({4: 1 / 14}, wavelength=550e-9),
    ...     window=4,
    ... )
    >>> print(f"{optics.strehl_ratio(psf, reference_peak=psf.reference_peak).value:.4f}")
    0.8141
    """
    if not 0 < reference_peak < np.inf:
        raise OutOfRangeError(
            "reference peak",
            value=f"{reference_peak:g} W/m²",
            limit="> 0, finite",
            remedy="compute it with diffraction_limited_peak",
        )
    psf = as_point_spread(field)

    def ratio(grid: PointSpread) -> float:
        return float(grid.at(*peak_position(grid))) / reference_peak

    return measured(psf, ratio, carried=psf.sample_error / reference_peak)


@checked
def diffraction_limited_peak(*, pupil_power: float, pupil_area: float, wavelength: float, distance: float) -> float:
    """Peak intensity at the focus of a uniformly lit pupil without aberration: P A/(λ z)² [W/m²].

    Parameters
    ----------
    pupil_power
        Power through the pupil, P [W], > 0.
    pupil_area
        Area of the pupil, A [m²], > 0.
    wavelength
        Wavelength λ [m], > 0.
    distance
        Distance from the pupil to the image, z [m], > 0.

    Returns
    -------
    float
        Intensity [W/m²]. The formula is paraxial; its relative error is about 1/(4 F²), where F is z divided by the
        diameter of the pupil.

    Raises
    ------
    OutOfRangeError
        An argument is not positive and finite.

    References
    ----------
    M. Born and E. Wolf, *Principles of Optics*, section 8.5.2.

    Examples
    --------
    >>> from tradestudy import optics
    >>> peak = optics.diffraction_limited_peak(pupil_power=1.0, pupil_area=3e-5, wavelength=550e-9, distance=50e-3)
    >>> print(f"{peak:.3e} W/m²")
    3.967e+10 W/m²
    """
    quantities = {"pupil power": pupil_power, "pupil area": pupil_area, "wavelength": wavelength, "distance": distance}
    for name, value in quantities.items():
        if not 0 < value < np.inf:
            raise OutOfRangeError(name, value=f"{value:g}", limit="> 0, finite", remedy="give it in SI units")
    return pupil_power * pupil_area / (wavelength * distance) ** 2


def _largest_radius(psf: PointSpread, centre: tuple[float, float]) -> float:
    """Radius of the largest circle about a point inside the window."""
    radius = min(centre[0] - psf.x[0], psf.x[-1] - centre[0], centre[1] - psf.y[0], psf.y[-1] - centre[1])
    if not radius > 0:
        raise OutOfRangeError(
            "centre outside the window",
            value=f"({centre[0]:g}, {centre[1]:g}) m",
            limit=f"x {psf.x[0]:g} … {psf.x[-1]:g} m, y {psf.y[0]:g} … {psf.y[-1]:g} m",
            remedy="move the centre, or widen the window",
        )
    return float(radius)


def _require_inside(psf: PointSpread, centre: tuple[float, float], radius: float, *, zero: bool = False) -> None:
    """Refuse a circle that leaves the window, and a radius of 0 unless allowed."""
    largest = _largest_radius(psf, centre)
    if not 0 <= radius <= largest * (1 + 1e-12) or (radius == 0 and not zero):
        raise OutOfRangeError(
            "radius",
            value=f"{radius:g} m",
            limit=f"in {'[' if zero else '('}0, {largest:g}] m",
            remedy="widen the window",
        )
