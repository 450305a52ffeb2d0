"""From a wave on an aperture to its field on targets, with a stated error: the core of every diffraction leg."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.fast_sum import FastField, fast_sum
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, Kernel, direct_sum
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.result import (
    ApertureField,
    CheckErrors,
    Effort,
    Method,
    NumericalError,
    choose_check_targets,
    squared_magnitude,
    stated_error,
)
from tradestudy.optics.propagation.sampling import (
    Limits,
    NodeCounts,
    check_affordable,
    check_time,
    needed_nodes,
    outline,
    refuse_near_zone,
    time_left,
)
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.quadrature import disc_nodes

_MAX_ROUNDS = 5
_SMALLEST_SHARE = 1e-15  # tolerance of the sums, below which rounding decides
_SMALLEST_CHECK = 4
_POWER_SHARE, _POWER_ROUNDING = (
    0.1,
    1e-12,
)  # changes of the power that doubling may make: of the stated error, and apart
_MOST_DOUBLINGS = 4


def sample_wave(wave: LensWave, counts: NodeCounts) -> ApertureSamples:
    """Sample the wave behind a lens on the nodes of its disc."""
    lens = wave.lens
    nodes = lens.without_obscuration(
        lambda radius: disc_nodes(
            radius=radius, radial_count=counts.radial, angular_count=counts.on_rings, centre=lens.centre
        )
    )
    x, y = nodes.x - lens.centre[0], nodes.y - lens.centre[1]
    cosine = None if wave.paraxial or wave.obliquity != "textbook" else wave.axial_cosine(x, y)
    return ApertureSamples(nodes=nodes, field=np.asarray(wave.field(x, y), dtype=np.complex128), axial_cosine=cosine)


def nodes_for(wave: LensWave, kernel: Kernel, targets: Targets, accuracy: FieldAccuracy) -> NodeCounts:
    """Node counts for the wave behind a lens and the outline of the targets."""
    x, y, z = targets.box()
    x, y, z = outline(x - wave.lens.centre[0], y - wave.lens.centre[1], z)
    return needed_nodes(
        wave.paths,
        kernel,
        radius=wave.lens.radius,
        x=x,
        y=y,
        z=z,
        tolerance=1e-3 * accuracy.tolerance,
    )


@checked
@dataclass(frozen=True, kw_only=True)
class FieldAccuracy:
    """Tolerance of a field, and the targets at which the result is checked.

    Parameters
    ----------
    tolerance
        Largest relative L2 error of the intensity over the targets [1], in 1e-10 … 0.1.
    check_targets
        Number of targets at which the result is checked, ≥ 4. They are drawn at random, mostly from the bright ones.
        The check is direct quadrature with twice as many nodes in each direction.
    seed
        Seed of the random draw: the same call gives the same digits.

    Raises
    ------
    OutOfRangeError
        A value is outside its range.

    Examples
    --------
    >>> from tradestudy import optics
    >>> optics.FieldAccuracy(tolerance=1e-6).check_targets
    16
    """

    tolerance: float
    check_targets: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1e-10 <= self.tolerance <= 0.1:
            raise OutOfRangeError(
                "tolerance of the intensity",
                value=f"{self.tolerance:g}",
                limit="1e-10 … 0.1",
                remedy="choose a tolerance in this range: double precision reaches about 1e-11",
            )
        if self.check_targets < _SMALLEST_CHECK:
            raise OutOfRangeError(
                "check_targets",
                value=str(self.check_targets),
                limit=f"≥ {_SMALLEST_CHECK}",
                remedy="raise check_targets: the error is measured there",
            )
        if self.seed < 0:
            raise OutOfRangeError("seed", value=str(self.seed), limit="≥ 0", remedy="give another")


@checked
def propagate_samples(
    *, samples: ApertureSamples, kernel: Kernel, targets: Targets, accuracy: FieldAccuracy, limits: Limits | None = None
) -> ApertureField:
    """Propagate to the targets a wave that is known only at the quadrature nodes of an aperture.

    This function **cannot check** whether the nodes are dense enough, so the errors of the field and of the intensity
    are NaN. To estimate them, compare the result with that on twice as many nodes in each direction. For a point source
    behind a lens, use `aperture_field`, which chooses the nodes itself.

    Parameters
    ----------
    samples
        Field of the wave at the nodes.
    kernel
        Kernel that propagates the field from a node to a target.
    targets
        Points at which the field is computed. A `TargetGrid` is faster than scattered `TargetPoints`.
    accuracy
        Tolerance of the sum over the nodes, as a relative L2 error over the targets, and the check that measures this
        error.
    limits
        Nodes, memory and time that the computation may take. Default: 2·10⁷ nodes, 2 GB and 600 s.

    Returns
    -------
    ApertureField
        Field and intensity in the shape of the targets. ``error.field`` and ``error.intensity`` are NaN;
        ``error.check`` is the measured error of the sum over the nodes.

    Raises
    ------
    OutOfRangeError
        The kernel needs the directions of the wave and ``samples.axial_cosine`` is None, the wavelength exceeds the
        width of the aperture, or a target lies within a wavelength of the aperture plane.
    UnaffordableError
        The computation needs more than ``limits`` allows.
    NotConvergedError
        Double precision cannot reach the tolerance at these targets.

    References
    ----------
    The integral of `KirchhoffKernel` or of `FresnelKernel`, as a sum over the nodes.

    Examples
    --------
    Behind a circular aperture that contains an odd number of Fresnel zones, the intensity on the axis is four times
    that of the unobstructed wave:

    >>> import numpy as np
    >>> from tradestudy import optics
    >>> nodes = optics.disc_nodes(radius=0.5e-3, radial_count=20, angular_count=40)
    >>> zones = 3
    >>> field = optics.propagate_samples(
    ...     samples=optics.ApertureSamples(nodes=nodes, field=np.ones(nodes.count, dtype=complex)),
    ...     kernel=optics.FresnelKernel(wavelength=550e-9),
    ...     targets=optics.TargetPoints(x=0.0, y=0.0, distance=(0.5e-3) ** 2 / (zones * 550e-9)),
    ...     accuracy=optics.FieldAccuracy(tolerance=1e-6),
    ... )
    >>> print(f"{field.intensity:.6f}")
    4.000000
    """
    nearest = float(targets.box()[2][0])
    refuse_near_zone(width=2 * samples.nodes.half_extent, nearest=nearest, wavelength=kernel.wavelength)
    counts = NodeCounts(radial=1, angular=samples.nodes.count)
    summed = _refined(
        sample=lambda _: samples,
        counts=counts,
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits or Limits(),
        method=_method(kernel),
        fixed_nodes=False,
        doubling=False,
    )
    # Nothing here shows whether this many nodes are enough for these targets.
    return replace(summed, error=replace(summed.error, field=math.nan, intensity=math.nan))


def propagate_wave(
    *,
    sample: Callable[[NodeCounts], ApertureSamples],
    counts: NodeCounts | Callable[[], NodeCounts],
    kernel: Kernel,
    targets: Targets,
    accuracy: FieldAccuracy,
    limits: Limits | None = None,
    fixed_nodes: bool = False,
) -> ApertureField:
    """Field on targets of a wave that can be sampled on any number of nodes.

    Parameters
    ----------
    sample
        Function that samples the wave on nodes of given counts; the check requests twice as many in each direction.
    counts
        Initial node counts, from `needed_nodes`, or a function that computes them; its time counts as set-up.
    kernel
        `KirchhoffKernel` or `FresnelKernel`.
    targets
        Points or grid.
    accuracy
        Tolerance and check.
    limits
        Memory and time allowed.
    fixed_nodes
        Whether to keep `counts` and state the resulting error instead of refining.

    Returns
    -------
    ApertureField
        The stated errors meet ``accuracy.tolerance`` unless `fixed_nodes` is set.

    Raises
    ------
    UnaffordableError
        The nodes needed exceed the limits, or the time left is too short for the next refinement.
    NotConvergedError
        The tolerance is not reached, by rounding or because `sample` does not converge.
    """
    return _refined(
        sample=sample,
        counts=counts,
        kernel=kernel,
        targets=targets,
        accuracy=accuracy,
        limits=limits or Limits(),
        method=_method(kernel),
        fixed_nodes=fixed_nodes,
        doubling=True,
    )


def _method(kernel: Kernel) -> Method:
    return "fresnel" if isinstance(kernel, FresnelKernel) else "kirchhoff"


def _refined(
    *,
    sample: Callable[[NodeCounts], ApertureSamples],
    counts: NodeCounts | Callable[[], NodeCounts],
    kernel: Kernel,
    targets: Targets,
    accuracy: FieldAccuracy,
    limits: Limits,
    method: Method,
    fixed_nodes: bool,
    doubling: bool,
) -> ApertureField:
    """Compute, check against direct quadrature, and refine what limits the result until it meets the tolerance.

    Unless ``doubling``, `sample` knows one set of nodes only, so that only the sums over them can become more accurate.
    """
    share = 0.2 * accuracy.tolerance
    begun = started = time.perf_counter()
    if callable(counts):
        counts = counts()
    seconds, check_seconds = time.perf_counter() - started, 0.0
    size, nodes, last = math.prod(targets.shape), counts.total, math.nan
    for rounds in range(1, _MAX_ROUNDS + 1):
        spent = time.perf_counter() - begun
        # The time of the first round is predicted; later rounds take as long per node as the one before.
        allowed = time_left(limits, spent) if rounds == 1 else replace(limits, seconds=math.inf)
        check_affordable(counts, targets=size, check_targets=accuracy.check_targets, limits=allowed)
        if rounds > 1:
            check_time(spent=spent, needed=last * counts.total / nodes, limits=limits)
        nodes = counts.total
        started = time.perf_counter()
        samples = sample(counts)
        fast = fast_sum(samples, kernel, targets, low_rank_tolerance=share, nufft_tolerance=0.3 * share)
        intensity = squared_magnitude(fast.field)
        checked = time.perf_counter()
        seconds += checked - started
        finer = sample(counts.scaled(2.0)) if doubling else None
        check = _check(samples, finer, kernel, targets, fast, intensity, accuracy)
        error = stated_error(
            intensity,
            check,
            largest=largest_field(samples, kernel, targets),
            rounding=rounding_error(samples, kernel, targets),
            low_rank=fast.low_rank_error,
            nufft=0.3 * share if fast.rank else 0.0,
        )
        check_seconds += time.perf_counter() - checked
        last = time.perf_counter() - begun - spent
        # On fixed nodes, only the sums can become more accurate, and rounding ends that too.
        good = error.intensity <= accuracy.tolerance
        if good or (fixed_nodes and (check.nodes > check.sums or share < 1e-13)):
            break
        # Refine what limits the result; an error too large to tell comes from the nodes.
        if doubling and (not check.nodes <= check.sums or math.isinf(error.intensity)):
            counts = counts.scaled(1.3)
        elif share > _SMALLEST_SHARE:
            share = max(share * min(0.1, 0.3 * accuracy.tolerance / error.intensity), _SMALLEST_SHARE)
        else:
            raise _not_converged(error, nodes, accuracy)
    else:
        raise _not_converged(error, nodes, accuracy)
    power = _power(samples)
    if finer is not None:
        power = _converged_power(sample, counts, power, _power(finer), error=error.intensity, limits=limits)
    return ApertureField(
        field=fast.field.reshape(targets.shape),
        intensity=intensity.reshape(targets.shape),
        targets=targets,
        pupil_power=power,
        error=error,
        effort=Effort(
            nodes=samples.nodes.count,
            radial_nodes=counts.radial,
            angular_nodes=counts.angular,
            rank=fast.rank,
            tiles=fast.tiles,
            rounds=rounds,
            seconds=seconds,
            check_seconds=check_seconds,
            check_targets=check.targets,
        ),
        method=method,
    )


def _not_converged(error: NumericalError, nodes: int, accuracy: FieldAccuracy) -> NotConvergedError:
    return NotConvergedError(
        "the intensity does not reach its tolerance",
        value=f"stated relative L2 error {error.intensity:.2g} with {nodes} nodes",
        limit=f"{accuracy.tolerance:g}",
        remedy="raise the tolerance, or include targets that are not dark",
    )


def _power(samples: ApertureSamples) -> float:
    """∫ |U|² over the aperture."""
    return float(samples.nodes.weights @ squared_magnitude(samples.field))


def _converged_power(
    sample: Callable[[NodeCounts], ApertureSamples],
    counts: NodeCounts,
    power: float,
    finer: float,
    *,
    error: float,
    limits: Limits,
) -> float:
    """Power on nodes so many that doubling them changes it by less than the stated error of the intensity.

    Nodes that resolve the amplitude of a pupil may not resolve its square, whose frequencies are twice as high.
    """
    allowed = _POWER_SHARE * error + _POWER_ROUNDING
    for _ in range(_MOST_DOUBLINGS):
        if finer == power or abs(finer - power) <= allowed * finer:
            return finer
        counts = counts.scaled(2.0)
        check_affordable(counts.scaled(2.0), targets=0, check_targets=0, limits=limits)
        power, finer = finer, _power(sample(counts.scaled(2.0)))
    raise NotConvergedError(
        "the power through the pupil does not converge",
        value=f"a relative change of {abs(finer - power) / max(finer, power):.2g} with {counts.total} nodes",
        limit=f"{allowed:.2g}",
        remedy="give a smoother amplitude, or raise the tolerance",
    )


def _check(
    samples: ApertureSamples,
    finer: ApertureSamples | None,
    kernel: Kernel,
    targets: Targets,
    fast: FastField,
    intensity: FloatArray,
    accuracy: FieldAccuracy,
) -> CheckErrors:
    """Compare with direct quadrature on the same nodes and on twice as many in each direction."""
    doubt = fast.doubt if fast.doubt.any() and fast.tiles > 1 else None
    probes = choose_check_targets(targets, intensity, count=accuracy.check_targets, seed=accuracy.seed, doubt=doubt)
    same_nodes = direct_sum(samples, kernel, probes.x, probes.y, probes.z)
    best = same_nodes if finer is None else direct_sum(finer, kernel, probes.x, probes.y, probes.z)
    computed = fast.field[probes.index]
    field_share, intensity_share = probes.shares(best, computed)
    return CheckErrors(
        nodes=probes.norm(same_nodes - best) if finer is not None else math.nan,
        sums=probes.norm(computed - same_nodes),
        total=probes.norm(computed - best),
        intensity=probes.intensity_norm(computed - best, best),
        field_share=field_share,
        intensity_share=intensity_share,
        targets=probes.index.size,
    )


def rounding_error(samples: ApertureSamples, kernel: Kernel, targets: Targets) -> float:
    """Rounding error of the phases over the aperture, relative to the field that all nodes would give in phase."""
    nearest = float(targets.box()[2][0])
    turns = kernel.wavenumber * samples.nodes.half_extent**2 / nearest
    return float(np.finfo(np.float64).eps * (10.0 + 2.0 * turns))


def largest_field(samples: ApertureSamples, kernel: Kernel, targets: Targets) -> float:
    """Field that the nodes would give if all were in phase."""
    u, v, strength = samples.local()
    x, y, z = (np.asarray([float(np.mean(c))]) for c in targets.box())
    amplitude = kernel.amplitude(
        u, v, samples.axial_cosine, x - samples.nodes.centre[0], y - samples.nodes.centre[1], z
    )
    return float(np.sum(np.abs(strength * amplitude)))
