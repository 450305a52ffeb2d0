"""Plot of a point-spread function and its metrics; matplotlib is loaded on first use."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.behind_microlens import projection
from tradestudy.optics.chain.scene import LightPath
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
    psf: PointSpread,
    *,
    centre: tuple[float, float],
    airy_radius: float,
    reference_peak: float,
    file: str | Path | None,
    ax: Axes | npt.NDArray[Any] | None,
) -> Figure:
    """Draw spot, cuts, encircled energy and MTF, or the spot alone; bands are the stated errors.

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
    file
        File in which the figure is saved, if any.
    ax
        Axes for the spot, four axes for all panels, or None for a new figure that is not attached to a window.

    Returns
    -------
    Figure
        Figure that contains the axes.

    Raises
    ------
    OutOfRangeError
        If there are neither one nor four axes, the extension is unknown, or the file cannot be written.
    """
    axes = _axes(ax, (9.0, 7.0), panels=4)
    x, y = (1e6 * (axis - middle) for axis, middle in zip((psf.x, psf.y), centre, strict=True))
    reach = 1e6 * min(_SHOWN * airy_radius, -1e-6 * x[0], -1e-6 * y[0])
    _spot(axes[0], psf, centre, reach)
    axes[0].set_title(
        f"Strehl ratio {strehl_ratio(psf, reference_peak=reference_peak)}; samples to {psf.relative_error:.0e}",
        fontsize="medium",
    )
    if len(axes) == 1:
        return _saved(axes[0], file)
    offsets = 1e-6 * np.linspace(-reach, reach, 8 * _POINTS)
    for name, (along_x, along_y) in {"x": (1.0, 0.0), "y": (0.0, 1.0)}.items():
        cut = psf.at(centre[0] + along_x * offsets, centre[1] + along_y * offsets) / reference_peak
        axes[1].plot(1e6 * offsets, cut, label=f"along {name}")
    axes[1].set(xlabel="position, µm", ylabel="intensity over peak without aberration")
    axes[1].legend()
    largest = min(*(abs(axis[end]) for axis in (x, y) for end in (0, -1)))
    radii = np.linspace(0, 0.999 * largest, _RADII)[1:]
    energy = encircled_energy(psf, centre=centre, radius=1e-6 * radii)
    _band(axes[2], radii, _PERCENT * energy.value, _PERCENT * energy.error, "")
    axes[2].set(xlabel="radius about the chief ray, µm", ylabel="encircled energy, %")
    cutoff = FIRST_DARK_RING / airy_radius
    frequencies = np.linspace(0, cutoff, _POINTS)
    for name, angle in {"x": 0.0, "y": np.pi / 2}.items():
        mtf = modulation_transfer(psf, frequency_x=np.cos(angle) * frequencies, frequency_y=np.sin(angle) * frequencies)
        _band(axes[3], 1e-3 * frequencies, mtf.value, mtf.error, f"along {name}")
    axes[3].set(xlabel="spatial frequency, 1/mm", ylabel="MTF", ylim=(0, None))
    axes[3].legend()
    return _saved(axes[0], file)


def microlens_figure(
    pixels: FloatArray, path: LightPath, *, file: str | Path | None, ax: Axes | npt.NDArray[Any] | None
) -> Figure:
    """Draw light on pixels on a square-root scale, and the apertures of the microlenses projected onto them."""
    (axes,) = _axes(ax, (6.0, 5.0), panels=1)
    x, y = (1e6 * edges for edges in (path.pixels.edges_x, path.pixels.edges_y))
    shown = axes.imshow(
        _PERCENT * pixels, origin="lower", extent=(x[0], x[-1], y[0], y[-1]), cmap="gray", norm=PowerNorm(0.5)
    )
    grown = 1e6 * projection(path)
    for centre in path.microlenses.centres * grown:
        axes.add_patch(Circle(centre, grown * path.microlenses.aperture_width / 2, fill=False, edgecolor="tab:blue"))
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), xlabel="x, µm", ylabel="y, µm")
    axes.figure.colorbar(shown, ax=axes, label="share of the light, %")
    return _saved(axes, file)


def _axes(ax: Axes | npt.NDArray[Any] | None, size: tuple[float, float], *, panels: int) -> list[Axes]:
    """The axes to draw in: those given, one or as many as there are panels, or those of a new figure."""
    if ax is None:
        across = math.isqrt(panels)
        ax = Figure(figsize=size, layout="constrained").subplots(across, across)
    axes = np.asarray(ax, dtype=object).ravel().tolist()
    if len(axes) not in (1, panels) or not all(hasattr(item, "imshow") for item in axes):
        raise OutOfRangeError(
            "axes of the plot",
            value=f"{len(axes)} of type {type(axes[0]).__name__ if axes else None}",
            limit="Axes of matplotlib: " + (f"1 or {panels}" if panels > 1 else "1"),
            remedy=f"give those of plt.subplots({'2, 2' if panels > 1 else ''})",
        )
    return axes


def _saved(axes: Axes, file: str | Path | None) -> Figure:
    """The figure of the axes, saved if a file is given."""
    figure = axes.figure.figure  # not a part of it
    assert isinstance(figure, Figure)
    if file is None:
        return figure
    formats = figure.canvas.get_supported_filetypes()
    if not isinstance(file, (str, Path)) or Path(file).suffix[1:].lower() not in formats:
        raise OutOfRangeError(
            "file of the plot",
            value=repr(file),
            limit=f"a path that ends in {', '.join(sorted(formats))}",
            remedy="give a path such as 'spot.svg'",
        )
    try:
        figure.savefig(file)
    except OSError as error:
        raise OutOfRangeError(
            "file of the plot",
            value=str(file),
            limit="a place that can be written",
            remedy=f"choose another place: {error.strerror}",
        ) from error
    return figure


def _spot(axes: Axes, psf: PointSpread, centre: tuple[float, float], reach: float) -> None:
    """Intensity image on a square-root scale, which shows the rings."""
    extent = [1e6 * (end - centre[i]) for i, axis in enumerate((psf.x, psf.y)) for end in (axis[0], axis[-1])]
    axes.imshow(
        np.sqrt(psf.intensity), origin="lower", extent=(extent[0], extent[1], extent[2], extent[3]), cmap="gray"
    )
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x, µm", ylabel="y, µm")


def _band(axes: Axes, position: FloatArray, value: FloatArray, error: FloatArray, label: str) -> None:
    """Plot a line with its error band."""
    axes.fill_between(position, value - error, value + error, alpha=0.3, linewidth=0)
    axes.plot(position, value, label=label)
