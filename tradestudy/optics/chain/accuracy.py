"""Tolerance and sampling of the chain, and the image with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.argument_types import checked_fields
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.sampled_point_spread import Measured

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


@checked_fields
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
        kept = math.pow(tolerance / self.tolerance, 1 / 6)  # the larger tolerance alone would shorten the reach
        return replace(
            self,
            tolerance=tolerance,
            diffraction_reach=kept * max(_LONGER * self.diffraction_reach, 1.0),
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
    """

    pixels: FloatArray
    numerical_error: float
    error_terms: dict[str, float]
    direct_check: dict[str, float]
    microlens_share: float
    effort: dict[str, int]
    handed_over: float = 0.0
    tolerance: float = math.inf

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
    def within_tolerance(self) -> bool:
        """Whether `numerical_error` is at most `tolerance`."""
        return self.numerical_error <= self.tolerance


def relative_change(fine: FloatArray, other: FloatArray) -> float:
    """L2 change between two computations, relative to the smaller, as too few nodes invent light; 0 for no change."""
    change = float(np.linalg.norm(fine - other))
    size = min(float(np.linalg.norm(one)) for one in (fine, other))
    return 0.0 if change == 0.0 else change / size if size > 0.0 else math.inf
