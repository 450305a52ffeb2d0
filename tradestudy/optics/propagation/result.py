"""Result of a propagation: the field, the effort, and the error estimated at random targets."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from tradestudy.optics.arrays import BoolArray, ComplexArray, FloatArray
from tradestudy.optics.propagation.targets import TargetGrid, Targets

Method = Literal["geometric", "boundary_wave", "fresnel", "kirchhoff"]
# An estimate from sixteen targets scatters, more so where errors are uneven. With a factor of 2, one case in twelve
# exceeded the stated error, by up to a third; see tests/benchmarks/aperture_audit.py.
_SAFETY = 4.0
_CORNER_SHARE = 0.02  # of the targets, represented by the worst corner: aliasing grows steeply towards the corners
_BLOCK = 256  # targets summed at once to draw from them
_UNIFORM_SHARE = 0.3  # of the draws; the others favour bright targets, whose errors count most in the intensity


@dataclass(frozen=True, kw_only=True)
class NumericalError:
    """Stated numerical error: how far the result may be from the exact value of the same integral.

    All entries are L2 norms over the targets, relative to that of the field or the intensity [1]. The two totals should
    hold in at least 95 % of cases; the parts, all of the field, are measured or requested values.

    Attributes
    ----------
    field
        Stated relative error of the complex field, without the rounding of its constant phase: about 2e-16 times this
        phase [rad].
    intensity
        Stated relative error of the intensity.
    nodes
        Relative error of the node counts, measured at the check targets: the sum over the nodes against the sum over
        twice as many in each direction.
    low_rank
        Relative error of the low-rank factor, measured on nodes and targets from which it was not built.
    nufft
        Relative error requested from the nonuniform Fourier transform.
    check
        Relative error measured at the check targets: the result against direct quadrature with twice the nodes in each
        direction.

    Examples
    --------
    >>> from tradestudy import optics
    >>> field = optics.aperture_field(
    ...     source=optics.PointSource(distance=0.15),
    ...     lens=optics.CircularLens(radius=1.5e-3, focal_length=12.5e-3, lens_phase="perfect"),
    ...     targets=optics.TargetPoints(x=0.0, y=0.0, distance=13.64e-3),
    ...     wavelength=550e-9,
    ...     method="kirchhoff",
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> field.error.intensity < 1e-6, field.error.check < 1e-6
    (True, True)
    """

    field: float
    intensity: float
    nodes: float
    low_rank: float
    nufft: float
    check: float


@dataclass(frozen=True, kw_only=True)
class Effort:
    """Nodes, rounds and time that a result took.

    Attributes
    ----------
    nodes
        Quadrature nodes on the aperture (on its edge for the boundary wave, unless all targets are handed over).
    radial_nodes, angular_nodes
        As in `NodeCounts`.
    rank
        Terms of the low-rank factor; 0 if everything was summed directly.
    tiles
        Parts into which the targets were split.
    rounds
        Rounds of computation until the stated error met the tolerance; 1 without refinement.
    seconds
        Wall time of the result, set-up included [s].
    check_seconds
        Wall time of the check against direct quadrature, with the nodes that only it needs [s].
    check_targets
        Number of check targets.

    Examples
    --------
    >>> from tradestudy import optics
    >>> effort = optics.point_spread(focal_length=50e-3, f_number=8, wavelength=550e-9, window=4).effort
    >>> effort.rounds, effort.check_targets > 0, effort.seconds > 0
    (1, True, True)
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
    """Field of a point source behind a lens, as `aperture_field` computes it.

    Attributes
    ----------
    field
        Complex field at the targets [1/m² for a source of unit strength], in the shape of the targets.
    intensity
        Squared magnitude of the field [1/m⁴ for a source of unit strength], in the shape of the targets. For
        ``geometric``, the intensities of the rays at a target are added, without interference.
    error
        Stated numerical error. Its entries ``field`` and ``intensity`` are the relative L2 errors of the two over the
        targets [1]; they should be upper bounds in at least 95 % of cases.
    effort
        What the computation took, including the number of quadrature ``nodes`` and the wall time ``seconds`` [s].
    method
        Method of propagation, as given to `aperture_field`.
    targets
        Points at which the field was computed.
    pupil_power
        Power through the pupil [1/m² for a source of unit strength]: ∫ |U|² dA over the aperture, where U is the
        field directly behind the lens. Metrics such as the encircled energy are fractions of this power.
    handed_over
        Fraction of the targets [1] at which ``boundary_wave`` used Kirchhoff's integral instead; 0 for other methods.

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

    def __repr__(self) -> str:
        grid = self.targets if isinstance(self.targets, TargetGrid) else None
        shape = " × ".join(map(str, self.intensity.shape))
        spacing = f", spacing {grid.x_pitch:.3g}, {grid.y_pitch:.3g} m" if grid else ""
        return (
            f"ApertureField({self.method}, {shape} targets{spacing}, "
            f"relative error of the intensity {self.error.intensity:.1g})"
        )


def squared_magnitude(field: ComplexArray) -> FloatArray:
    """Intensity of a complex field."""
    real, imaginary = field.real, field.imag
    squared = np.asarray(real * real)  # ``**`` is slow on every other number of an array
    squared += imaginary * imaginary
    return squared


@dataclass(frozen=True, kw_only=True)
class CheckTargets:
    """Targets drawn at random, weighted so that means over them estimate means over all targets.

    Attributes
    ----------
    index
        Indices into the flat targets.
    weight
        Inverse of the probability of the draw, relative to a uniform draw; 0 for the corners.
    corner
        Whether a target is a corner of the set rather than drawn; too few nodes show at corners first.
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
        """Root-mean-square magnitude of an error over all targets, estimated from these."""
        return self._mean(squared_magnitude(error))

    def intensity_norm(self, error: ComplexArray, field: ComplexArray) -> float:
        """Root-mean-square error of the intensity, at most 2 |U| e + e² for an error e of the field U."""
        size = np.abs(error)
        return self._mean((2 * np.abs(field) * size + size**2) ** 2)

    def shares(self, finer: ComplexArray, field: ComplexArray) -> tuple[float, float]:
        """Norm of the finer field relative to that of the result, and the same for the intensities, each at most 1."""
        sizes = []
        for checked in (finer, field):
            intensity = squared_magnitude(checked)[~self.corner]
            weight = self.weight[~self.corner]
            sizes.append(np.sqrt([np.mean(weight * intensity), np.mean(weight * intensity**2)]))
        less, more = sizes
        shares = np.divide(less, more, out=np.ones(2), where=less < more)
        return float(shares[0]), float(shares[1])

    def _mean(self, squared: FloatArray) -> float:
        """Root of the weighted mean over the drawn targets plus the part that the worst corner represents."""
        drawn = float(np.mean((self.weight * squared)[~self.corner]))
        corners = float(np.max(squared[self.corner], initial=0.0))
        return math.sqrt(drawn + _CORNER_SHARE * corners)


@dataclass(frozen=True, kw_only=True)
class CheckErrors:
    """Root-mean-square errors over the targets, estimated at the check targets.

    Attributes
    ----------
    nodes
        Error of the field: direct sum against direct sum on doubled nodes.
    sums
        Error of the field: fast sum against direct sum on the same nodes.
    total
        Error of the field: result against direct sum on doubled nodes.
    intensity
        Error of the intensity: result against direct sum on doubled nodes.
    field_share, intensity_share
        Root mean square of the finer field and intensity over that of the result, at most 1.
    targets
        Number of check targets.
    """

    nodes: float
    sums: float
    total: float
    intensity: float
    field_share: float
    intensity_share: float
    targets: int


def choose_check_targets(
    targets: Targets, intensity: FloatArray, *, count: int, seed: int, doubt: FloatArray | None = None
) -> CheckTargets:
    """Draw targets, mostly in proportion to their intensity; take all if there are no more than `count`.

    With `doubt`, targets are drawn in proportion to intensity times doubt, the expected squared error of the field.
    """
    size = intensity.size
    if size <= count:
        index, weight, corner = np.arange(size), np.ones(size), np.zeros(size, dtype=bool)
    else:
        favour = intensity if doubt is None else intensity * doubt
        bright = _bright(favour, count)
        if bright.size:
            favour = favour.copy()
            favour[bright] = 0.0
        total = float(favour.sum())
        favoured = (1 - _UNIFORM_SHARE) / total if total > 0.0 else 0.0
        uniform = (_UNIFORM_SHARE if total > 0.0 else 1.0) / size
        by_chance = count - bright.size
        drawn = _draw(favour, favoured, uniform, np.random.default_rng(seed).random(by_chance))
        corners = targets.corners()
        index = np.concatenate([bright, drawn, corners])
        corner = np.arange(index.size) >= count
        expected = by_chance * (uniform + favoured * favour[drawn])
        represented = np.where(np.isin(drawn, bright), 0.0, 1.0 / expected)  # a bright target stands for itself alone
        weight = np.concatenate([np.ones(bright.size), represented, np.zeros(corners.size)]) * (count / size)
    x, y, z = targets.at(index)
    return CheckTargets(index=index, weight=weight, corner=corner, x=x, y=y, z=z)


def _bright(favour: FloatArray, count: int) -> npt.NDArray[np.intp]:
    """Indices of targets so bright that every draw would expect them: they are taken once, not by chance.

    Otherwise all draws could fall on one target, where nodes happen to do well. They take at most half of the draws.
    """
    total, most = float(favour.sum()), count // 2
    if not float(favour.max()) * count > total:
        return np.empty(0, dtype=np.intp)
    brightest = np.argpartition(favour, -most)[-most:]
    brightest = brightest[np.argsort(favour[brightest])[::-1]]
    dimmer = total - np.cumsum(favour[brightest]) + favour[brightest]  # each with all that are dimmer
    expected = np.append(favour[brightest] * count > dimmer, False)
    return brightest[: int(np.argmin(expected))]


def _draw(favour: FloatArray, favoured: float, uniform: float, position: FloatArray) -> npt.NDArray[np.intp]:
    """Indices drawn with probability favoured · favour + uniform, where `position` lies between the sums up to them.

    A block of targets is drawn first, then one target in it: cumulative sums over all targets would take longer.
    """
    starts = np.arange(0, favour.size, _BLOCK)
    lengths = np.minimum(_BLOCK, favour.size - starts)
    before = np.cumsum(favoured * np.add.reduceat(favour, starts) + uniform * lengths)
    position = before[-1] * position
    block = np.minimum(np.searchsorted(before, position, side="right"), starts.size - 1)
    drawn = []
    for index, rest in zip(block, position - np.concatenate([[0.0], before])[block], strict=True):
        inside = favoured * favour[starts[index] : starts[index] + _BLOCK] + uniform
        place = np.searchsorted(np.cumsum(inside), rest, side="right")
        drawn.append(starts[index] + min(place, lengths[index] - 1))
    return np.asarray(drawn, dtype=np.intp)


def stated_error(
    intensity: FloatArray,
    check: CheckErrors,
    *,
    largest: float,
    rounding: float,
    low_rank: float = 0.0,
    nufft: float = 0.0,
) -> NumericalError:
    """Relative errors over all targets: four times those estimated at the check targets, plus rounding.

    `rounding`, `low_rank` and `nufft` are relative to `largest`, the field that all nodes would give in phase. The
    errors are relative to the smaller of the result and its check, because too few nodes invent light. They are
    infinite where doubling the nodes changes the field by its whole size.
    """
    rounding *= largest
    typical = math.sqrt(float(np.mean(intensity))) * check.field_share
    bright = math.sqrt(float(np.einsum("i,i->", intensity, intensity)) / intensity.size) * check.intensity_share
    if typical == 0.0 or bright == 0.0:  # also where the intensity underflows
        nothing = math.inf if check.total > 0 else 0.0
        return NumericalError(
            field=nothing, intensity=nothing, nodes=nothing, low_rank=nothing, nufft=nothing, check=nothing
        )
    # Where doubling the nodes changes the field by its whole size, both sums may be undersampled by an unknown amount.
    unknown = 0.0 if check.nodes < max(typical, check.sums) or math.isnan(check.nodes) else math.inf
    return NumericalError(
        field=unknown + _SAFETY * check.total / typical + rounding / typical,
        intensity=unknown + _SAFETY * check.intensity / bright + 2 * rounding * typical / bright,
        nodes=check.nodes / typical,
        low_rank=low_rank * largest / typical,
        nufft=nufft * largest / typical,
        check=check.total / typical,
    )
