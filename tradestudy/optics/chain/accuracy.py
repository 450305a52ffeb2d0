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
    """Tolerance of an image, and factors on the sampling that it implies: a factor of 2 samples twice as finely.

    Parameters
    ----------
    tolerance
        Target for the relative L2 error over the pixels, in 1e-6 … 0.2.
    pupil_nodes
        Factor on the phase that the nodes of the main pupil resolve.
    microlens_nodes
        Factor on the phase that the nodes of a microlens resolve.
    field_sampling
        Factor on the sampling of the main-lens field.
    diffraction_reach
        Factor on the distance from the geometric image up to which diffracted light is followed.
    pixel_sampling
        Factor on the detector samples along a pixel.
    source_sampling
        Factor on the phase that the nodes on an extended source resolve, and on the number of radii at which the
        main-lens field is computed.
    memory_limit
        Memory that the arrays of one pass may take [bytes]; the error estimate needs a second pass at the same time.

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
        """Distance from where rays land within which diffracted light is followed [Fresnel lengths √(λ z)]."""
        return 1.2 * math.pow(self.tolerance, -1 / 6) * self.diffraction_reach

    def compared(self) -> ChainAccuracy:
        """Settings of the second computation, whose difference from the first gives the error.

        They are coarser, with two exceptions. A factor below 1 becomes 1: undersampled light would alias in the same
        way on even fewer samples. The reach is longer: light beyond it comes from the edges of other microlenses, in
        steps of their pitch, and a shorter reach could miss the same edges.
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
        """Settings for checking single points of a spot: a tenth of the tolerance, and no factor below 1."""
        return replace(
            self,
            tolerance=max(self.tolerance / 10, 1e-6),
            **{name: max(1.0, getattr(self, name)) for name in _KNOBS},
        )


@dataclass(frozen=True, kw_only=True)
class ChainImage:
    """Light on the pixels, with its error.

    Attributes
    ----------
    pixels
        Fraction of the power through the main pupil that falls on each pixel, shape (rows, columns); an extended source
        is averaged over its area.
    numerical_error
        Relative L2 error over the pixels: the change from a coarser computation, or the sum of `error_terms`.
    error_terms
        Contributions to the numerical error, each a relative L2 error.
    direct_check
        Independent check: root-mean-square discrepancy from direct quadrature at random points, relative to the root
        mean square, for the field on the array and for the intensity on the detector. The latter is not integrated over
        pixels and so exceeds the error of the pixels.
    microlens_share
        Fraction of the pupil's power that passes the microlens plane; NaN where it was not computed. It has no stated
        error; `direct_check` shows how well the light on the array is known.
    effort
        Counts of nodes, samples and source points that the computation took.
    handed_over
        Fraction of the points that a boundary wave left to Kirchhoff's integral; 0 for the other methods.
    tolerance
        Requested relative L2 error; infinite if none was.

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
        """Largest possible error of the fraction on a single pixel [1], if the whole stated error falls on it."""
        return self.numerical_error * float(np.linalg.norm(self.pixels))

    @property
    def share_on_pixels(self) -> Measured:
        """Fraction of the power through the main pupil that falls on all pixels together.

        The error is √n times `pixel_error` for n pixels: the largest possible sum of their errors (Cauchy–Schwarz).
        """
        error = math.sqrt(self.pixels.size) * self.pixel_error
        return Measured(value=np.asarray(self.pixels.sum()), error=np.asarray(error))

    @property
    def within_tolerance(self) -> bool:
        """Whether the stated error is within the tolerance."""
        return self.numerical_error <= self.tolerance


def relative_change(fine: FloatArray, other: FloatArray) -> float:
    """L2 change between two computations, relative to the smaller, as too few nodes invent light; 0 for no change."""
    change = float(np.linalg.norm(fine - other))
    size = min(float(np.linalg.norm(one)) for one in (fine, other))
    return 0.0 if change == 0.0 else change / size if size > 0.0 else math.inf
