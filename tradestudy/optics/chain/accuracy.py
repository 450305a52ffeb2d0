"""Accuracy that is asked of an image, the image with its error, and the integration over pixels.

Conservation of energy gives the amount of far light, and the wave from the rim of an aperture its distribution. That
wave brings an irradiance ∝ 1/d² at the distance d from the edge of the rays' disc, and two points of the rim send light
to every point. Averaged over the fringes, E(r) ∝ [1/(r − a)² + 1/(r + a)²]/r about a disc of radius a. In focus a = 0,
and the law is Airy's: a circular lens sends the share 2/(π v) beyond v = 2π R r/(λ b). Interference between different
microlenses averages out there over the points of a source.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arguments import check_angle, checked
from tradestudy.optics.arrays import FloatArray, require
from tradestudy.optics.chain.behind_microlens import fourier_sum, nearest_microlens
from tradestudy.optics.chain.scene import LightPath, PixelGrid
from tradestudy.optics.sampled_point_spread import Measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COARSER_TOLERANCE = 2.0
_COARSER = 0.9
_LONGER = 1.5
_KNOBS = (
    "pupil_nodes",
    "microlens_nodes",
    "field_sampling",
    "diffraction_reach",
    "pixel_sampling",
    "source_sampling",
)


@checked
@dataclass(frozen=True, kw_only=True)
class ChainAccuracy:
    """Tolerance of an image computed by `chain_image`, and factors that scale its sampling.

    The tolerance determines the sampling of a computation. Each factor, > 0, changes one part of this sampling; a
    larger one makes it finer or wider.

    Parameters
    ----------
    tolerance
        Relative L2 error over the pixels that the sampling should achieve [1], in 1e-6 … 0.2.
    pupil_nodes
        Factor by which the phase variation is multiplied before the number of quadrature nodes in the pupil of the main
        lens is derived from it.
    microlens_nodes
        The corresponding factor for the number of quadrature nodes on a microlens.
    field_sampling
        Factor that scales the density of the samples of the main lens's field on the array.
    diffraction_reach
        Factor that scales the distance from the geometric image up to which diffracted light is followed
        (`fresnel_lengths`).
    pixel_sampling
        Factor that scales the number of samples of the field along a pixel.
    source_sampling
        Factor that scales the density of the points that represent a disc source, and the number of distances from the
        axis at which the main lens's field is computed for such a source. If both legs (see `Legs`) are ``geometric``,
        it scales the density of the rays.
    memory_limit
        Memory that the arrays of one computation may take [bytes]. The error estimate (`compared`) needs a second
        computation at the same time, which may take as much again.

    Raises
    ------
    OutOfRangeError
        If a value is outside its range.

    Examples
    --------
    >>> from tradestudy import optics
    >>> accuracy = optics.ChainAccuracy(tolerance=1e-3)
    >>> accuracy.memory_limit
    2000000000.0
    >>> accuracy.compared().tolerance, accuracy.unstarved().tolerance
    (0.002, 0.0001)
    """

    tolerance: float = 1e-4
    pupil_nodes: float = 1.0
    microlens_nodes: float = 1.0
    field_sampling: float = 1.0
    diffraction_reach: float = 1.0
    pixel_sampling: float = 1.0
    source_sampling: float = 1.0
    memory_limit: float = 2e9

    def __post_init__(self) -> None:
        if not 1e-6 <= self.tolerance <= 0.2:
            raise OutOfRangeError(
                "tolerance of the chain",
                value=f"{self.tolerance:g}",
                limit="1e-6 … 0.2",
                remedy="choose a tolerance in this range",
            )
        for name in (*_KNOBS, "memory_limit"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise OutOfRangeError(
                    name, value=f"{value:g}", limit="> 0, finite", remedy="leave it out for the default"
                )

    @property
    def fresnel_lengths(self) -> float:
        """Distance from the geometric image up to which diffracted light is followed [Fresnel lengths].

        A Fresnel length is √(λ z), where λ is the wavelength and z the distance of propagation.
        """
        return 1.2 * math.pow(self.tolerance, -1 / 6) * self.diffraction_reach

    def compared(self) -> ChainAccuracy:
        """Settings of a second computation, whose difference from the first gives the stated error.

        `tolerance` (up to 0.2) and `diffraction_reach` are increased. `pupil_nodes`, `microlens_nodes` and
        `field_sampling` are reduced, but set to 1 if they are below 1.

        Returns
        -------
        ChainAccuracy
            The settings.
        """
        tolerance = min(_COARSER_TOLERANCE * self.tolerance, 0.2)
        longer = math.pow(tolerance / self.tolerance, 1 / 6)  # the larger tolerance alone would shorten the reach
        return replace(
            self,
            tolerance=tolerance,
            diffraction_reach=longer * max(_LONGER * self.diffraction_reach, 1.0),
            **{
                name: _COARSER * value if value >= 1 else 1.0
                for name in ("pupil_nodes", "microlens_nodes", "field_sampling")
                for value in [getattr(self, name)]
            },
        )

    def unstarved(self) -> ChainAccuracy:
        """Settings for the checks at single points, fine enough even if factors are below 1.

        They have a tenth of the tolerance, but at least 1e-6; factors below 1 are set to 1.

        Returns
        -------
        ChainAccuracy
            The settings.
        """
        return replace(
            self,
            tolerance=max(self.tolerance / 10, 1e-6),
            **{name: max(1.0, getattr(self, name)) for name in _KNOBS},
        )


@dataclass(frozen=True, kw_only=True)
class ChainImage:
    """Light on the pixels with its error, as `chain_image` and `microlens_image` compute it.

    Attributes
    ----------
    pixels
        Fraction of the power through the pupil of the main lens that falls on each pixel [1], shape (rows, columns).
    numerical_error
        Stated relative L2 error over the pixels [1], combined from `error_terms`.
    error_terms
        Contributions to `numerical_error`, by name; each is a relative L2 error over the pixels [1].
    direct_check
        Results of independent checks, by name: root-mean-square difference between the computed field or intensity and
        direct quadrature at random points, relative to the root mean square of that field or intensity [1]. The
        intensity on the detector is checked at points, without integration over pixels, so its difference does not
        measure the error of `pixels`. Empty if there was no check.
    microlens_share
        Fraction of the power through the pupil of the main lens that passes the plane of the microlenses [1]; NaN if
        it was not computed. Its error is not stated; `direct_check` shows the error of the light on the array.
    effort
        Numbers of nodes, samples and source points that the computation used, by name.
    handed_over
        Fraction of the points on the array, or of the light behind it, for which ``boundary_wave`` used Kirchhoff's
        integral instead [1]: the larger of the two fractions. 0 for other methods.
    tolerance
        Requested relative L2 error over the pixels [1]; infinite if none was requested.
    path
        Light path with the positions of the pixels and of the microlenses. Default: None, for pixels of unknown
        position; the light per microlens, the MTF and the plot need it.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square",
    ...     gaps="opaque",
    ...     lens_phase="parabolic",
    ... )
    >>> path = optics.LightPath(
    ...     main_lens=optics.CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
    ...     microlenses=lenses,
    ...     array_distance=2.5e-3,
    ...     detector_distance=0.1e-3,
    ...     pixels=optics.PixelGrid(pitch=4e-6, shape=(21, 21)),
    ... )
    >>> image = optics.chain_image(
    ...     path,
    ...     optics.PointSource(distance=20e-3),
    ...     wavelength=550e-9,
    ...     legs=optics.KIRCHHOFF,
    ...     accuracy=optics.ChainAccuracy(tolerance=1e-2),
    ...     rng=np.random.default_rng(1),
    ... )
    >>> image.pixels.shape, image.numerical_error < 1e-2
    ((21, 21), True)
    >>> image.within_tolerance
    True
    >>> brightest = int(np.argmax(image.light_per_microlens))
    >>> print(f"{image.light_per_microlens[brightest]:.2f} of the light behind microlens {brightest}")
    0.74 of the light behind microlens 4
    >>> print(f"MTF behind it at 50/mm: {image.modulation_transfer(50e3, microlens=brightest):.2f}")
    MTF behind it at 50/mm: 0.91
    >>> figure = image.plot()
    """

    pixels: FloatArray
    numerical_error: float
    error_terms: dict[str, float]
    direct_check: dict[str, float]
    microlens_share: float
    effort: dict[str, int]
    handed_over: float = 0.0
    tolerance: float = math.inf
    path: LightPath | None = None

    def __repr__(self) -> str:
        rows, columns = self.pixels.shape
        return (
            f"ChainImage({rows} × {columns} pixels, {self.pixels.sum():.3g} of the light, "
            f"relative error {self.numerical_error:.1g}, tolerance {self.tolerance:g})"
        )

    @property
    def pixel_error(self) -> float:
        """Largest possible error of a single pixel's fraction [1], reached if the whole stated error falls on it."""
        return self.numerical_error * float(np.linalg.norm(self.pixels))

    @property
    def share_on_pixels(self) -> Measured:
        """Fraction of the power through the pupil of the main lens that falls on all pixels together [1].

        Its error is √n times `pixel_error` for n pixels, the largest possible sum of their errors (Cauchy–Schwarz).
        """
        error = math.sqrt(self.pixels.size) * self.pixel_error
        return Measured(value=np.asarray(self.pixels.sum()), error=np.asarray(error))

    @property
    def light_per_microlens(self) -> Measured:
        """Fraction of the power through the pupil on the pixels of each microlens [1], shape (microlenses,).

        A pixel belongs to the microlens whose centre, projected from the centre of the main lens onto the detector, is
        nearest to the pixel. The errors are √n times `pixel_error` for n pixels, as for `share_on_pixels`.
        """
        path = self._known_path
        owner, count = nearest_microlens(path).ravel(), path.microlenses.count
        light = np.bincount(owner, weights=self.pixels.ravel(), minlength=count).astype(np.float64)
        return Measured(value=light, error=np.sqrt(np.bincount(owner, minlength=count)) * self.pixel_error)

    @checked
    def modulation_transfer(
        self, frequency: npt.ArrayLike, *, angle: float = 0.0, microlens: int | None = None
    ) -> Measured:
        """Modulation transfer function (MTF) of the light as the pixels record it, along one direction.

        It is |Σ p exp(−2πi f·x)|/Σ p, where p is the light on a pixel with its centre at x. The integration over each
        pixel is part of it.

        Parameters
        ----------
        frequency
            Spatial frequencies f on the detector [cycles/m], any shape.
        angle
            Direction along which the intensity is modulated, measured from the x axis [rad], within ±2π.
        microlens
            Index in ``path.microlenses`` of the microlens whose pixels alone are used, as in `light_per_microlens`.
            Default: all pixels.

        Returns
        -------
        Measured
            MTF [1] in the shape of the frequencies; its error is the largest that `numerical_error` allows.

        Raises
        ------
        OutOfRangeError
            If a frequency exceeds the largest that the pixels resolve, 1/(2 pitch), the angle exceeds a full turn, no
            light falls on the pixels, or their positions are unknown.
        """
        check_angle(angle)
        path, f = self._known_path, np.asarray(frequency, dtype=np.float64)
        resolved = 1 / (2 * path.pixels.pitch)
        require(np.abs(f) <= resolved, "spatial frequency", f, limit=f"≤ {resolved:g} 1/m", unit="1/m")
        used = np.ones(self.pixels.shape, dtype=bool) if microlens is None else nearest_microlens(path) == microlens
        light = np.where(used, self.pixels, 0.0)
        if not light.sum() > 0:
            raise OutOfRangeError(
                "pixels without light",
                value="the whole image" if microlens is None else f"those behind microlens {microlens}",
                limit="pixels with light",
                remedy="light_per_microlens shows where the light falls",
            )
        value = fourier_sum(light, path.pixels, f, angle) / light.sum()
        error = math.sqrt(used.sum()) * self.pixel_error * (1 + value) / light.sum()
        return Measured(value=value, error=error)

    def plot(self, file: str | Path | None = None, *, ax: Axes | None = None) -> Figure:
        """Plot the light on the pixels, with the apertures of the microlenses projected onto them.

        Parameters
        ----------
        file
            File in which the figure is saved; its extension sets the format. Default: the figure is not saved.
        ax
            Matplotlib axes in which the image is drawn. Default: axes of a new figure.

        Returns
        -------
        Figure
            Matplotlib figure that contains the axes.

        Raises
        ------
        OutOfRangeError
            If the extension is unknown, the file cannot be written, or the positions of the pixels are unknown.
        """
        from tradestudy.optics.spread_plot import microlens_figure

        return microlens_figure(self.pixels, self._known_path, file=file, ax=ax)

    @property
    def _known_path(self) -> LightPath:
        if self.path is None or self.path.pixels.shape != self.pixels.shape:
            raise OutOfRangeError(
                "light path of the image",
                value="unknown",
                limit="a light path with these pixels",
                remedy="give it as dataclasses.replace(image, path=…)",
            )
        return self.path

    @property
    def within_tolerance(self) -> bool:
        """Whether `numerical_error` is at most `tolerance`."""
        return self.numerical_error <= self.tolerance


def relative_change(fine: FloatArray, compared: FloatArray) -> float:
    """L2 change between two computations, relative to the smaller, as too few nodes invent light; 0 for no change."""
    change = float(np.linalg.norm(fine - compared))
    size = min(float(np.linalg.norm(pixels)) for pixels in (fine, compared))
    return 0.0 if change == 0.0 else change / size if size > 0.0 else math.inf


MARGIN = 3  # samples beyond the window on each side that the correction needs
_CELL_AVERAGE = ((1.0, 1 / 24, -17 / 5760, 367 / 967680), (1.0, 1 / 24, -17 / 5760, 0.0))
_STEEPNESS = 4.0  # samples between the edge of the rays and the edge of the patch, where the law is steepest


def refuse_pixel_centres(grid: PixelGrid) -> None:
    """Refuse rays at the centres of pixels.

    Raises
    ------
    OutOfRangeError
        If the pixels do not integrate.
    """
    if not grid.integrated:
        raise OutOfRangeError(
            "rays at the centre of a pixel",
            value="rays behind the microlenses",
            limit="integrals over whole pixels",
            remedy="integrate over pixels, or use waves",
        )


def samples_per_pixel(grid: PixelGrid, needed: float) -> int:
    """Samples along a pixel, at least three; an odd number if the pixel uses only the one at its centre."""
    count = max(3, math.ceil(needed))
    return count if grid.integrated else count + 1 - count % 2


def light_on_pixels(intensity: FloatArray, grid: PixelGrid, *, per_pixel: int) -> tuple[FloatArray, float]:
    """Integrals over pixels with their relative L2 error by `integrate_pixels`, or centre samples with error 0."""
    spacing = grid.pitch / per_pixel
    if grid.integrated:
        return integrate_pixels(intensity, per_pixel=per_pixel, spacing=spacing)
    first, (rows, columns) = MARGIN + per_pixel // 2, grid.shape
    centres = intensity[first::per_pixel, first::per_pixel][:rows, :columns]
    return np.asarray(centres * grid.pitch**2, dtype=np.float64), 0.0


def integrate_pixels(intensity: FloatArray, *, per_pixel: int, spacing: float) -> tuple[FloatArray, float]:
    """Integrate samples at cell centres over pixels of ``per_pixel``² cells; the last term of the rule gives the error.

    The mean over a cell is the sample plus δ²/24 − 17 δ⁴/5760 + 367 δ⁶/967680 along each axis, where δ is the central
    difference.

    Parameters
    ----------
    intensity
        Samples, shape (rows·per_pixel + 6, columns·per_pixel + 6): three extra on every side.
    per_pixel
        Samples along a pixel.
    spacing
        Distance between samples [m].

    Returns
    -------
    tuple
        Integrals, shape (rows, columns), and their relative L2 change by the last term: the error without it.
    """
    best, lower = (
        _over_pixels(_over_pixels(intensity, weights, per_pixel).T, weights, per_pixel).T * spacing**2
        for weights in (np.convolve(_cell_average(terms), np.ones(per_pixel)) for terms in _CELL_AVERAGE)
    )
    change = float(np.linalg.norm(best - lower))
    return best, change / float(np.linalg.norm(best)) if change > 0 else 0.0  # no light, no error


def _cell_average(terms: tuple[float, ...]) -> FloatArray:
    """Weights of the samples about a cell, `MARGIN` on either side, in the mean over the cell."""
    weights, difference = np.zeros(2 * MARGIN + 1), np.ones(1)
    for order, term in enumerate(terms):
        weights[MARGIN - order : MARGIN + order + 1] += term * difference
        difference = np.convolve(difference, [1.0, -2.0, 1.0])
    return weights


def _over_pixels(samples: FloatArray, weights: FloatArray, per_pixel: int) -> FloatArray:
    """Weighted sums of the samples that each pixel reaches, along the first axis."""
    count = (samples.shape[0] - 2 * MARGIN) // per_pixel
    total = np.zeros((count, *samples.shape[1:]))
    for first, weight in enumerate(weights):
        total += weight * samples[first : first + per_pixel * count : per_pixel]
    return total


def far_light(
    grid: PixelGrid, middles: FloatArray, half_side: float, power: FloatArray, radii: FloatArray
) -> FloatArray:
    """Distribute the light that leaves square patches over the pixels outside, by the law of an edge.

    Parameters
    ----------
    grid
        The detector.
    middles
        Middles (x, y) of the patches [m], shape (n, 2).
    half_side
        Half the side of a patch [m].
    power
        Power that leaves each patch, shape (n,); most of it misses the detector.
    radii
        Radius of the disc of rays in each patch, less than half its side [m], shape (n,).

    Returns
    -------
    ndarray
        Power on every pixel, shape (rows, columns).
    """
    # Each sample represents a part of a pixel, and belongs to a patch if its middle does.
    parts = max(1, math.ceil(_STEEPNESS * grid.pitch / float(np.min(half_side - radii, initial=math.inf))))
    spacing = grid.pitch / parts
    x, y = (edges[0] + spacing * (np.arange(parts * (edges.size - 1)) + 0.5) for edges in (grid.edges_x, grid.edges_y))
    total = np.zeros((y.size, x.size))
    outside = _outside_square(half_side, radii)
    for (middle_x, middle_y), radius, share in zip(middles, radii, power / outside, strict=True):
        across, along = np.abs(x - middle_x), np.abs(y - middle_y)[:, None]
        beyond = np.maximum(across, along) > half_side
        squared = (across**2 + along**2)[beyond]
        law = (squared + radius**2) / (np.sqrt(squared) * (squared - radius**2) ** 2)
        total[beyond] += share * spacing**2 * law
    rows, columns = grid.shape
    return np.asarray(total.reshape(rows, parts, columns, parts).sum(axis=(1, 3)))


def _outside_square(half_side: float, radii: FloatArray) -> FloatArray:
    """∬ (r² + a²)/(r (r² − a²)²) dx dy outside a square of half side H [1/m].

    Along a radius, the integral of (r² + a²)/(r² − a²)² is −r/(r² − a²); around an eighth of the square there remains ∫
    H ds/(H² − a² + a² s²) over the sine s of the azimuth, up to 1/√2.
    """
    rest = half_side**2 - radii**2
    turn = radii / np.sqrt(2.0 * rest)
    slowed = np.divide(np.arctan(turn), turn, out=np.ones_like(turn), where=turn > 0)
    return np.asarray(8.0 * half_side / (np.sqrt(2.0) * rest) * slowed)


Part = Callable[[], Any]
"""A ``functools.partial`` of a module's function and plain arguments, so that other processes can compute it."""


class ComputeParts(Protocol):
    """Function that computes parts; the values must not depend on where it computes them."""

    def __call__(self, parts: Sequence[Part], progress: Callable[[float], None]) -> list[Any]:
        """Values of the parts in their order; ``progress`` is called with the completed share."""
        ...


def in_turn(parts: Sequence[Part], progress: Callable[[float], None]) -> list[Any]:
    """Compute parts in this process, one after another."""
    values = []
    for number, part in enumerate(parts, start=1):
        values.append(part())
        progress(number / len(parts))
    return values


def call(part: Part) -> Any:
    """Compute one part; defined at module level so that workers can load it."""
    return part()
