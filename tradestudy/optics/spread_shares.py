"""MTF, and the fractions of a point's light in the window, outside a disc and on pixels, with error bars.

Fractions refer to the power that passed the pupil; errors are composed as in `spread_metrics`.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.sampled_point_spread import Measured, PointSpread, SpreadField, as_point_spread, measured
from tradestudy.optics.spread_metrics import encircled_energy

_MOST_PIXELS = 2**22


@checked
def modulation_transfer(field: SpreadField, *, frequency_x: FloatArray, frequency_y: FloatArray) -> Measured:
    """Modulation transfer function (MTF): |∬ I exp(−2πi (f_x x + f_y y)) dx dy| / P.

    I is the intensity at (x, y), f_x and f_y are the spatial frequencies, and P is the power through the pupil. The
    integral covers only the window; the error therefore includes the fraction of P that falls outside the window. At
    frequency 0, where the MTF is 1 by definition, the value is the fraction inside, for example 0.992 ± 0.008. Division
    by this fraction would make the MTF too high at all but the lowest frequencies.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    frequency_x, frequency_y
        Spatial frequencies f_x and f_y [cycles/m], which are broadcast together.

    Returns
    -------
    Measured
        MTF [1] in the shape of the frequencies; its error accounts for the spacing and the stated error of the samples,
        and for the light outside the window.

    Raises
    ------
    OutOfRangeError
        A frequency exceeds half the sampling frequency or is not a number, or the shapes do not broadcast.

    References
    ----------
    J. W. Goodman, *Introduction to Fourier Optics*, section 6.3. The MTF of a perfect lens is
    2/π (arccos s − s √(1 − s²)) with s = λ N f, where λ is the wavelength, N the working f-number and f the spatial
    frequency.

    Examples
    --------
    At half the cutoff frequency, where the MTF of a perfect lens is 0.391:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=20)
    >>> half_cutoff = np.array(0.5 / (550e-9 * 8))
    >>> mtf = optics.modulation_transfer(psf, frequency_x=half_cutoff, frequency_y=np.array(0.0))
    >>> print(f"{mtf.value:.2f}, error {mtf.error:.3f}; outside the window {1 - optics.window_share(psf).value:.3f}")
    0.39, error 0.008; outside the window 0.008
    """
    psf = as_point_spread(field)
    try:
        fx, fy = np.broadcast_arrays(frequency_x, frequency_y)
    except ValueError:
        raise OutOfRangeError(
            "spatial frequencies",
            value=f"shapes {np.shape(frequency_x)} and {np.shape(frequency_y)}",
            limit="shapes that broadcast",
            remedy="give both in one shape",
        ) from None
    for frequency, spacing in zip((fx, fy), psf.spacings, strict=True):
        limit = 1 / (2 * spacing)
        if not np.all(np.abs(frequency) <= limit):
            raise OutOfRangeError(
                "spatial frequency",
                value=f"{np.abs(frequency).max():g} 1/m",
                limit=f"≤ {limit:g} 1/m",
                remedy=f"sample at most {1 / (2 * np.abs(frequency).max()):.3g} m apart",
            )

    def transfer(grid: PointSpread) -> FloatArray:
        weight_x, weight_y = _trapezoid(grid.x), _trapezoid(grid.y)
        along_x = weight_x[:, None] * np.exp(-2j * np.pi * np.outer(grid.x, fx.ravel()))
        along_y = weight_y[:, None] * np.exp(-2j * np.pi * np.outer(grid.y, fy.ravel()))
        transform = np.einsum("yk,yk->k", along_y, grid.intensity @ along_x)
        return np.reshape(np.abs(transform), fx.shape) / grid.pupil_power

    inside, share = measured(psf, transfer, carried=_over_window(psf)), window_share(psf)
    return Measured(value=inside.value, error=inside.error + abs(1 - share.value) + share.error)


@checked
def window_share(field: SpreadField) -> Measured:
    """Fraction of the power through the pupil that falls inside the window: ∬ I dA / P.

    I is the intensity, integrated over the window, and P the power through the pupil.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.

    Returns
    -------
    Measured
        Fraction [1], shape (); its error accounts for the spacing and the stated error of the samples.

    Raises
    ------
    OutOfRangeError
        The field does not lie on a regular grid.

    References
    ----------
    M. Born and E. Wolf, *Principles of Optics*, section 8.5.2. The fraction of Airy's pattern outside a large circle of
    radius r is 2 λ N/(π² r), where λ is the wavelength and N the working f-number.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> print(f"{optics.window_share(psf).value:.3f}")
    0.963
    """
    psf = as_point_spread(field)
    return measured(
        psf,
        lambda g: g.power_in((g.x[0], g.x[-1]), (g.y[0], g.y[-1])) / g.pupil_power,
        carried=_over_window(psf),
    )


@checked
def share_outside_disc(field: SpreadField, *, centre: tuple[float, float], radius: float) -> Measured:
    """Fraction of the power through the pupil that falls outside a disc: 1 − ∬ I dA / P.

    I is the intensity, integrated over the disc, and P the power through the pupil.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    centre
        Centre of the disc (x, y) [m].
    radius
        Radius of the disc [m], ≥ 0.

    Returns
    -------
    Measured
        Fraction [1], shape (); its error accounts for the spacing and the stated error of the samples.

    Raises
    ------
    OutOfRangeError
        The radius is negative, or the disc reaches beyond the window.

    References
    ----------
    The fraction is 1 − ``encircled_energy``.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> dark_ring = 1.2197 * 550e-9 * 8
    >>> print(f"{optics.share_outside_disc(psf, centre=(0.0, 0.0), radius=dark_ring).value:.3f}")
    0.163
    """
    inside = encircled_energy(field, centre=centre, radius=np.asarray(radius))
    return Measured(value=1 - inside.value, error=inside.error)


@checked
def pixel_shares(field: SpreadField, *, pitch: float, corner: tuple[float, float], shape: tuple[int, int]) -> Measured:
    """Fraction of the power through the pupil that falls on each pixel: ∬ I dA / P.

    I is the intensity, integrated over the square of the pixel, and P the power through the pupil.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    pitch
        Side of a pixel [m], > 0.
    corner
        Corner of pixel [0, 0] at its smallest x and y, as (x, y) [m].
    shape
        Numbers of rows and columns of pixels.

    Returns
    -------
    Measured
        Fractions [1], in the given shape; their error accounts for the spacing and the stated error of the samples. Row
        i starts at y = ``corner[1] + i * pitch``, column j at x = ``corner[0] + j * pitch``.

    Raises
    ------
    OutOfRangeError
        The pitch is not positive and finite, there are no pixels or more than 2²² of them, or a pixel reaches beyond
        the window.

    References
    ----------
    The intensity between the samples is a quintic spline, which is integrated exactly.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> shares = optics.pixel_shares(psf, pitch=5e-6, corner=(-7.5e-6, -7.5e-6), shape=(3, 3))
    >>> print(f"{shares.value[1, 1]:.3f} on the middle pixel, {shares.value[1, 2]:.3f} beside it")
    0.611 on the middle pixel, 0.059 beside it
    """
    psf = as_point_spread(field)
    if not 0 < pitch < np.inf:
        raise OutOfRangeError(
            "pitch", value=f"{pitch:g} m", limit="> 0, finite", remedy="give the side of a pixel in metres"
        )
    if not (min(shape) >= 1 and shape[0] * shape[1] <= _MOST_PIXELS):
        raise OutOfRangeError(
            "pixels",
            value=f"{shape[0]} × {shape[1]}",
            limit=f"1 × 1 to {_MOST_PIXELS} in all",
            remedy="give (rows, columns)",
        )
    x_edges = corner[0] + pitch * np.arange(shape[1] + 1)
    y_edges = corner[1] + pitch * np.arange(shape[0] + 1)
    slack = 1e-9 * pitch
    if not (
        x_edges[0] >= psf.x[0] - slack
        and x_edges[-1] <= psf.x[-1] + slack
        and y_edges[0] >= psf.y[0] - slack
        and y_edges[-1] <= psf.y[-1] + slack
    ):
        raise OutOfRangeError(
            "pixels leave the sampled window",
            value=f"x {x_edges[0]:g}…{x_edges[-1]:g} m, y {y_edges[0]:g}…{y_edges[-1]:g} m",
            limit=f"x {psf.x[0]:g}…{psf.x[-1]:g} m, y {psf.y[0]:g}…{psf.y[-1]:g} m",
            remedy="widen the window or request fewer pixels",
        )

    def shares(grid: PointSpread) -> FloatArray:
        powers = [[grid.power_in(columns, rows) for columns in pairwise(x_edges)] for rows in pairwise(y_edges)]
        return np.asarray(powers) / grid.pupil_power

    return measured(psf, shares, carried=pitch * psf.intensity_error / psf.pupil_power)


@checked
def share_on_neighbouring_pixels(field: SpreadField, *, pitch: float, centre: tuple[float, float]) -> Measured:
    """Fraction of the power through the pupil that falls on the eight neighbours of a pixel.

    Parameters
    ----------
    field
        `PointSpread`, or `ApertureField` on a regular grid. Its window is the rectangle that the samples cover.
    pitch
        Side of a pixel [m], > 0.
    centre
        Centre of the middle pixel (x, y) [m].

    Returns
    -------
    Measured
        Fraction [1], shape (); its error is the sum of the errors of the fractions on the eight pixels.

    Raises
    ------
    OutOfRangeError
        The pitch is not positive and finite, or one of the nine pixels reaches beyond the window.

    References
    ----------
    The sum of the fractions that `pixel_shares` gives for the eight neighbours.

    Examples
    --------
    >>> from tradestudy import optics
    >>> psf = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4)
    >>> print(f"{optics.share_on_neighbouring_pixels(psf, pitch=5e-6, centre=(0.0, 0.0)).value:.3f}")
    0.283
    """
    block = pixel_shares(field, pitch=pitch, corner=(centre[0] - 1.5 * pitch, centre[1] - 1.5 * pitch), shape=(3, 3))
    ring = np.ones((3, 3))
    ring[1, 1] = 0.0
    return Measured(value=np.asarray(np.sum(ring * block.value)), error=np.asarray(np.sum(ring * block.error)))


def _over_window(psf: PointSpread) -> float:
    """Bound on the change that the stated error makes to an integral over the window with weights of magnitude 1/P."""
    area = float((psf.x[-1] - psf.x[0]) * (psf.y[-1] - psf.y[0]))
    return float(np.sqrt(area)) * psf.intensity_error / psf.pupil_power


def _trapezoid(axis: FloatArray) -> FloatArray:
    """Weights of the trapezoid rule on a uniform axis."""
    weights = np.full(axis.size, (axis[-1] - axis[0]) / (axis.size - 1))
    weights[[0, -1]] /= 2
    return weights
