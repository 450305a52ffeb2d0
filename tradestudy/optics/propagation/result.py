"""What a propagation returns: the field, what it took, and the error that a check at random targets states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.propagation.direct import ComplexArray
from tradestudy.optics.propagation.sampling import Targets

Method = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]
# An estimate from sixteen targets scatters, by more where errors are uneven: with 2 one case in twelve exceeded it by
# up to a third, see tests/benchmarks/aperture_audit.py.
_SAFETY = 4.0
_CORNER_SHARE = 0.02  # of the targets, for which the worst corner stands: aliasing grows towards the corners by powers
_UNIFORM_SHARE = 0.3  # of the draws; the others prefer bright targets, whose errors count most in the intensity


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
    targets
        Where.
    pupil_power
        ∫ |U|² over the aperture, in the unit of the intensity times m²: energies are shares of it.
    handed_over
        Share of the targets that the boundary wave handed over to Kirchhoff; 0 for the other methods.

    Examples
    --------
    >>> from tradestudy import optics
    >>> field = optics.aperture_field(
    ...     source=optics.PointSource(distance=0.15),
    ...     lens=optics.CircularLens(radius=1.5e-3, focal_length=12.5e-3, lens_phase="parabolic"),
    ...     targets=optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=0.5e-6, count=65, distance=13.64e-3),
    ...     wavelength=550e-9,
    ...     method="kirchhoff",
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> field.intensity.shape, field.error.intensity <= 1e-6
    ((65, 65), True)
    >>> print(f"{optics.window_share(field).value:.2f} of the light")
    0.96 of the light
    """

    field: ComplexArray
    intensity: FloatArray
    targets: Targets
    pupil_power: float
    error: NumericalError
    effort: Effort
    method: Method
    handed_over: float = 0.0


def squared_magnitude(field: ComplexArray) -> FloatArray:
    """Intensity of a complex field."""
    return np.asarray(field.real**2 + field.imag**2)


@dataclass(frozen=True, kw_only=True)
class CheckTargets:
    """Targets drawn at random, and the weights that make means over them estimates of means over all targets.

    Attributes
    ----------
    index
        Their places among the flat targets.
    weight
        Inverse of the probability of the draw, relative to an even one; 0 for the corners.
    corner
        Which of them were not drawn but are corners of the set, where too few nodes show first.
    x, y, z
        Positions [m].
    """

    index: npt.NDArray[np.intp]
    weight: FloatArray
    corner: BoolArray
    x: FloatArray
    y: FloatArray
    z: FloatArray

    def norm(self, error: ComplexArray) -> float:
        """Root mean squared magnitude over all targets, as estimated from these."""
        return self._mean(squared_magnitude(error))

    def intensity_norm(self, error: ComplexArray, field: ComplexArray) -> float:
        """Root mean squared error of the intensity, at most 2 |U| e + e² for an error e of the field U."""
        size = np.abs(error)
        return self._mean((2 * np.abs(field) * size + size**2) ** 2)

    def shares(self, finer: ComplexArray, field: ComplexArray) -> tuple[float, float]:
        """Size of the finer field over that of the result, and of their intensities; 1 where that is no smaller."""
        sizes = []
        for one in (finer, field):
            intensity = squared_magnitude(one)[~self.corner]
            weight = self.weight[~self.corner]
            sizes.append(np.sqrt([np.mean(weight * intensity), np.mean(weight * intensity**2)]))
        less, more = sizes
        shares = np.divide(less, more, out=np.ones(2), where=less < more)
        return float(shares[0]), float(shares[1])

    def _mean(self, squared: FloatArray) -> float:
        """Root of the weighted mean over the drawn targets, and of what the corners stand for."""
        drawn = float(np.mean((self.weight * squared)[~self.corner]))
        corners = float(np.max(squared[self.corner], initial=0.0))
        return math.sqrt(drawn + _CORNER_SHARE * corners)


@dataclass(frozen=True, kw_only=True)
class CheckErrors:
    """Root mean square errors over the targets, as estimated at the check targets.

    Attributes
    ----------
    nodes
        Of the field, by doubling the nodes.
    sums
        Of the field, fast sum against direct sum on the same nodes.
    total
        Of the field, result against direct sum on doubled nodes.
    intensity
        Of the intensity, likewise.
    field_share, intensity_share
        Root mean square of field and intensity by the finer computation over that of the result, at most 1.
    seconds
        Wall time of the check.
    targets
        Number of check targets.
    """

    nodes: float
    sums: float
    total: float
    intensity: float
    field_share: float
    intensity_share: float
    seconds: float
    targets: int


def choose_check_targets(targets: Targets, field: ComplexArray, *, count: int, seed: int) -> CheckTargets:
    """Draw targets, mostly in proportion to their intensity; all of them where they are few."""
    x, y, z = targets.coordinates()
    if x.size <= count:
        index, weight, corner = np.arange(x.size), np.ones(x.size), np.zeros(x.size, dtype=bool)
    else:
        intensity = squared_magnitude(field)
        even = np.full(x.size, 1.0 / x.size)
        total = float(intensity.sum())
        chance = even if total == 0.0 else _UNIFORM_SHARE * even + (1 - _UNIFORM_SHARE) * intensity / total
        upto = np.cumsum(chance)
        index = np.searchsorted(upto, upto[-1] * np.random.default_rng(seed).random(count), side="right")
        rising, falling = x + y, x - y
        corners = [np.argmin(rising), np.argmin(falling), np.argmax(falling), np.argmax(rising)]
        corner = np.arange(count + len(corners)) >= count
        index = np.concatenate([index, corners])
        weight = np.where(corner, 0.0, even[index] / chance[index])
    return CheckTargets(index=index, weight=weight, corner=corner, x=x[index], y=y[index], z=z[index])


def stated_error(
    field: ComplexArray,
    check: CheckErrors,
    *,
    largest: float,
    rounding: float,
    low_rank: float = 0.0,
    nufft: float = 0.0,
) -> NumericalError:
    """Relative errors over all targets: four times the ones estimated at the check targets, and rounding.

    `rounding`, `low_rank` and `nufft` are relative to `largest`, the field that all nodes could give in phase. The
    errors are relative to the smaller of the result and of what it is checked against: starved nodes invent light. They
    are infinite where doubling the nodes changes the field by as much as there is of it.
    """
    rounding *= largest
    intensity = squared_magnitude(field)
    typical = math.sqrt(float(np.mean(intensity))) * check.field_share
    bright = math.sqrt(float(np.mean(intensity**2))) * check.intensity_share
    if typical == 0.0:
        nothing = math.inf if check.total > 0 else 0.0
        return NumericalError(
            field=nothing, intensity=nothing, nodes=nothing, low_rank=nothing, nufft=nothing, check=nothing
        )
    # Nodes that differ from twice as many by all there is may both be starved: by how much, none of them tells.
    unknown = 0.0 if check.nodes < max(typical, check.sums) or math.isnan(check.nodes) else math.inf
    return NumericalError(
        field=unknown + _SAFETY * check.total / typical + rounding / typical,
        intensity=unknown + _SAFETY * check.intensity / bright + 2 * rounding * typical / bright,
        nodes=check.nodes / typical,
        low_rank=low_rank * largest / typical,
        nufft=nufft * largest / typical,
        check=check.total / typical,
    )
