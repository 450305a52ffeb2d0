"""Plot of a point-spread function and its metrics; matplotlib is loaded on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.lateral_resolution import FIRST_DARK_RING
from tradestudy.optics.sampled_point_spread import PointSpread
from tradestudy.optics.spread_metrics import encircled_energy, strehl_ratio
from tradestudy.optics.spread_shares import modulation_transfer

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 60
_RADII = 200
_SHOWN = 6.0  # Airy radii on every side
_PERCENT = 100.0


def spread_figure(
    psf: PointSpread, *, centre: tuple[float, float], airy_radius: float, reference_peak: float
) -> Figure:
    """Draw spot, cuts, encircled energy and MTF; bands are the stated errors.

    Parameters
    ----------
    psf
        The point-spread function to draw.
    centre
        Where the chief ray lands (x, y) [m]: the origin of the plots.
    airy_radius
        Radius of the first dark ring [m].
    reference_peak
        Peak without aberration, relative to which intensities are plotted [W/m²].

    Returns
    -------
    Figure
        Figure of four panels, not attached to a window.
    """
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    axes = figure.subplots(2, 2)
    x, y = (1e6 * (axis - middle) for axis, middle in zip((psf.x, psf.y), centre, strict=True))
    reach = 1e6 * min(_SHOWN * airy_radius, -1e-6 * x[0], -1e-6 * y[0])
    _spot(axes[0, 0], psf, centre, reach)
    axes[0, 0].set_title(
        f"Strehl ratio {strehl_ratio(psf, reference_peak=reference_peak)}; samples to {psf.relative_error:.0e}",
        fontsize="medium",
    )
    offsets = 1e-6 * np.linspace(-reach, reach, 8 * _POINTS)
    for name, (along_x, along_y) in {"x": (1.0, 0.0), "y": (0.0, 1.0)}.items():
        cut = psf.at(centre[0] + along_x * offsets, centre[1] + along_y * offsets) / reference_peak
        axes[0, 1].plot(1e6 * offsets, cut, label=f"along {name}")
    axes[0, 1].set(xlabel="position, µm", ylabel="intensity over peak without aberration")
    axes[0, 1].legend()
    largest = min(*(abs(axis[end]) for axis in (x, y) for end in (0, -1)))
    radii = np.linspace(0, 0.999 * largest, _RADII)[1:]
    energy = encircled_energy(psf, centre=centre, radius=1e-6 * radii)
    _band(axes[1, 0], radii, _PERCENT * energy.value, _PERCENT * energy.error, "")
    axes[1, 0].set(xlabel="radius about the chief ray, µm", ylabel="encircled energy, %")
    cutoff = FIRST_DARK_RING / airy_radius
    frequencies = np.linspace(0, cutoff, _POINTS)
    for name, angle in {"x": 0.0, "y": np.pi / 2}.items():
        mtf = modulation_transfer(psf, frequency_x=np.cos(angle) * frequencies, frequency_y=np.sin(angle) * frequencies)
        _band(axes[1, 1], 1e-3 * frequencies, mtf.value, mtf.error, f"along {name}")
    axes[1, 1].set(xlabel="spatial frequency, 1/mm", ylabel="MTF", ylim=(0, None))
    axes[1, 1].legend()
    return figure


def _spot(axes: Axes, psf: PointSpread, centre: tuple[float, float], reach: float) -> None:
    """Intensity image on a square-root scale, which shows the rings."""
    extent = [1e6 * (at - centre[i]) for i, axis in enumerate((psf.x, psf.y)) for at in (axis[0], axis[-1])]
    axes.imshow(
        np.sqrt(psf.intensity), origin="lower", extent=(extent[0], extent[1], extent[2], extent[3]), cmap="gray"
    )
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x, µm", ylabel="y, µm")


def _band(axes: Axes, at: FloatArray, value: FloatArray, error: FloatArray, label: str) -> None:
    """Plot a line with its error band."""
    axes.fill_between(at, value - error, value + error, alpha=0.3, linewidth=0)
    axes.plot(at, value, label=label)
