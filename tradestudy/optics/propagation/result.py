"""What a propagation returns: the field, its error bar, and what it took."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.direct import ComplexArray

Method = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]


@dataclass(frozen=True, kw_only=True)
class NumericalError:
    """Stated numerical error: how far the result may be from the exact value of the same integral.

    All entries are relative L2 norms over the targets, of the field unless said otherwise. The two totals are
    meant to hold in at least 95 % of cases; the parts are what was measured or asked for.

    Attributes
    ----------
    field
        Stated error of the complex field.
    intensity
        Stated error of the intensity.
    nodes
        Measured at the check targets: the sum over the nodes against twice as many in each direction.
    low_rank
        Met on nodes and targets kept out of the low-rank factor's making.
    nufft
        Asked from the nonuniform Fourier transform.
    check
        Measured at the check targets: the result against direct quadrature with twice the nodes in each direction.
    """

    field: float
    intensity: float
    nodes: float
    low_rank: float
    nufft: float
    check: float


@dataclass(frozen=True, kw_only=True)
class Effort:
    """What a result took.

    Attributes
    ----------
    nodes
        Quadrature nodes on the aperture (on its edge for the boundary wave).
    radial_nodes, angular_nodes
        Rings and nodes per ring.
    rank
        Terms of the low-rank factor; 0 where everything was summed directly.
    tiles
        Parts into which the targets were split.
    rounds
        How often the computation was refined until its stated error met the tolerance.
    seconds
        Wall time of the result, set-up included.
    check_seconds
        Wall time of the check against direct quadrature.
    check_targets
        Targets at which it was checked.
    """

    nodes: int
    radial_nodes: int
    angular_nodes: int
    rank: int
    tiles: int
    rounds: int
    seconds: float
    check_seconds: float
    check_targets: int


@dataclass(frozen=True, kw_only=True)
class ApertureField:
    """Field of a point source behind a lens.

    Attributes
    ----------
    field
        Complex field in the shape of the targets.
    intensity
        Its squared magnitude; for `geometric` the sum over rays without interference.
    error
        Stated numerical error.
    effort
        Nodes, rank, seconds.
    method
        How it was computed.
    handed_over
        Share of the targets that the boundary wave handed over to Kirchhoff; 0 for the other methods.
    """

    field: ComplexArray
    intensity: FloatArray
    error: NumericalError
    effort: Effort
    method: Method
    handed_over: float = 0.0


def squared_magnitude(field: ComplexArray) -> FloatArray:
    """Intensity of a complex field."""
    return np.asarray(field.real**2 + field.imag**2)
