"""Published cases of uncertainty propagation: data and functions that tests iterate.

The module states inputs and printed results only; sampling them is the business of whoever checks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class NormalInput:
    """An input with a normal distribution."""

    name: str
    mean: float
    standard_deviation: float


@dataclass(frozen=True, kw_only=True)
class UniformInput:
    """An input with a rectangular distribution."""

    name: str
    low: float
    high: float


Input = NormalInput | UniformInput


@dataclass(frozen=True, kw_only=True)
class PrintedResult:
    """What a source prints; each value with half a unit of its last digit, or with its own sampling error.

    ``rounding`` is what a printed value can differ by from the one computed by the same method.
    """

    estimate: float
    standard_uncertainty: float
    interval: tuple[float, float]
    rounding: float
    interval_rounding: float


@dataclass(frozen=True, kw_only=True)
class PropagationCase:
    """A measurement model with independent inputs, and the printed result of the Monte Carlo method.

    ``model`` takes the inputs by name, each an array that broadcasts, and returns the output.
    ``exact_interval`` is the 95 % interval in closed form where there is one; ``shortest`` tells whether
    intervals are the shortest or the symmetric one.
    """

    name: str
    source: str
    inputs: tuple[Input, ...]
    model: Callable[[Mapping[str, FloatArray]], FloatArray]
    shortest: bool
    printed: PrintedResult
    exact_interval: tuple[float, float] | None = None


def _sum(inputs: Mapping[str, FloatArray]) -> FloatArray:
    return sum(inputs.values(), start=np.zeros(()))


def _sum_inputs(*half_widths: float) -> tuple[Input, ...]:
    return tuple(UniformInput(name=f"X{i}", low=-h, high=h) for i, h in enumerate(half_widths, start=1))


_SQRT3 = math.sqrt(3.0)
_FOUR_UNIFORM_END = 2.0 * _SQRT3 * (2.0 - 0.6**0.25)

SUM_OF_NORMALS = PropagationCase(
    name="sum of four normals",
    source="JCGM 101:2008, 9.2.2",
    inputs=tuple(NormalInput(name=f"X{i}", mean=0.0, standard_deviation=1.0) for i in range(1, 5)),
    model=_sum,
    shortest=False,
    printed=PrintedResult(
        estimate=0.0, standard_uncertainty=2.0, interval=(-3.92, 3.92), rounding=0.005, interval_rounding=0.005
    ),
    exact_interval=(2.0 * float(ndtri(0.025)), 2.0 * float(ndtri(0.975))),
)

SUM_OF_EQUAL_UNIFORMS = PropagationCase(
    name="sum of four equal rectangles",
    source="JCGM 101:2008, 9.2.3",
    inputs=_sum_inputs(_SQRT3, _SQRT3, _SQRT3, _SQRT3),
    model=_sum,
    shortest=False,
    printed=PrintedResult(
        estimate=0.0, standard_uncertainty=2.0, interval=(-3.88, 3.88), rounding=0.05, interval_rounding=0.005
    ),
    exact_interval=(-_FOUR_UNIFORM_END, _FOUR_UNIFORM_END),
)

SUM_WITH_A_DOMINANT_UNIFORM = PropagationCase(
    name="sum of rectangles, one of them dominant",
    source="JCGM 101:2008, 9.2.4",
    inputs=_sum_inputs(_SQRT3, _SQRT3, _SQRT3, 10.0 * _SQRT3),
    model=_sum,
    shortest=False,
    printed=PrintedResult(
        estimate=0.0, standard_uncertainty=10.1, interval=(-17.0, 17.0), rounding=0.05, interval_rounding=0.05
    ),
)


def _mass_deviation_mg(inputs: Mapping[str, FloatArray]) -> FloatArray:
    """Mass in excess of 100 g; the reference is split off before the product, so that no digit is lost."""
    specific_volumes = 1.0 / inputs["weight_density"] - 1.0 / inputs["reference_density"]
    buoyancy = (inputs["air_density"] - 1.2) * specific_volumes
    excess = (inputs["reference_mass"] - 1e5) + inputs["added_mass"]
    return excess + (inputs["reference_mass"] + inputs["added_mass"]) * buoyancy


MASS_CALIBRATION = PropagationCase(
    name="calibration of a 100 g weight [mg]",
    source="JCGM 101:2008, 9.3, with the shortest interval",
    inputs=(
        NormalInput(name="reference_mass", mean=1e5, standard_deviation=0.050),
        NormalInput(name="added_mass", mean=1.234, standard_deviation=0.020),
        UniformInput(name="air_density", low=1.1, high=1.3),
        UniformInput(name="weight_density", low=7000.0, high=9000.0),
        UniformInput(name="reference_density", low=7950.0, high=8050.0),
    ),
    model=_mass_deviation_mg,
    shortest=True,
    # 4e6 draws give [1.0848, 1.3841]: both printed ends are off by 0.0015, their distance by 0.0002.
    printed=PrintedResult(
        estimate=1.2341,
        standard_uncertainty=0.0754,
        interval=(1.0834, 1.3825),
        rounding=1e-4,
        interval_rounding=2e-3,
    ),
)


LOGARITHM = PropagationCase(
    name="natural logarithm of a rectangle",
    source="NPL report DEM-ES-011",
    inputs=(UniformInput(name="x", low=0.1, high=1.1),),
    model=lambda inputs: np.log(inputs["x"]),
    shortest=True,
    printed=PrintedResult(
        estimate=-0.665,
        standard_uncertainty=0.606,
        interval=(-1.895, 0.095),
        rounding=1e-3,
        interval_rounding=3e-3,
    ),
    exact_interval=(math.log(0.15), math.log(1.1)),
)

PROPAGATION_CASES = (
    SUM_OF_NORMALS,
    SUM_OF_EQUAL_UNIFORMS,
    SUM_WITH_A_DOMINANT_UNIFORM,
    MASS_CALIBRATION,
    LOGARITHM,
)
"""Every published case with a distribution to compare."""


@dataclass(frozen=True, kw_only=True)
class SobolCase:
    """A function with published Sobol indices, in the order of its inputs."""

    name: str
    source: str
    inputs: tuple[Input, ...]
    model: Callable[[Mapping[str, FloatArray]], FloatArray]
    first: tuple[float, ...]
    total: tuple[float, ...]
    rounding: float


def _ishigami(inputs: Mapping[str, FloatArray]) -> FloatArray:
    x1, x2, x3 = (inputs[name] for name in ("x1", "x2", "x3"))
    return np.asarray(np.sin(x1) + 7.0 * np.sin(x2) ** 2 + 0.1 * x3**4 * np.sin(x1))


ISHIGAMI = SobolCase(
    name="Ishigami function, a = 7, b = 0.1",
    source="Ishigami and Homma 1990; Saltelli, Chan and Scott, Sensitivity Analysis (2000)",
    inputs=tuple(UniformInput(name=f"x{i}", low=-math.pi, high=math.pi) for i in (1, 2, 3)),
    model=_ishigami,
    first=(0.3139, 0.4424, 0.0),
    total=(0.5576, 0.4424, 0.2437),
    rounding=5e-5,
)


@dataclass(frozen=True, kw_only=True)
class StereoYawCase:
    """A parallel stereo rig with a normal yaw error: the one depth distribution with a closed form.

    Parameters
    ----------
    distance : float
        True depth [m].
    baseline : float
        Distance between the cameras [m].
    yaw_standard_deviation : float
        Standard deviation of the relative yaw [rad]. The focal length drops out: yaw adds f ψ to the
        disparity f B/Z.
    """

    distance: float
    baseline: float
    yaw_standard_deviation: float

    def inverse_depth(self, yaw: FloatArray) -> FloatArray:
        """Inverse depth [1/m] that a rig with this yaw error [rad] reports: 1/Z + ψ/B."""
        return 1.0 / self.distance + yaw / self.baseline

    def depth_quantile(self, probability: ArrayLike) -> FloatArray:
        """Quantile of the reported depth [m]: f B/(d₀ + s Φ⁻¹(1 − p)); +∞ where the disparity is not positive."""
        spread = self.yaw_standard_deviation / self.baseline
        inverse = 1.0 / self.distance + spread * ndtri(1.0 - np.asarray(probability, float))
        positive = inverse > 0.0
        return np.where(positive, 1.0 / np.where(positive, inverse, 1.0), np.inf)

    @property
    def probability_beyond_infinity(self) -> float:
        """Probability of a disparity that is not positive."""
        return float(ndtr(-self.baseline / (self.distance * self.yaw_standard_deviation)))


STEREO_YAW = StereoYawCase(distance=10.0, baseline=0.1, yaw_standard_deviation=math.radians(0.2))
"""Normal yaw of 0.2° at 10 m with 100 mm: no finite variance."""

STEREO_YAW_PRINTED = {0.025: 5.9375, 0.5: 10.0, 0.975: 31.667}
"""Printed quantiles [m] of :data:`STEREO_YAW`; the closed form gives 5.9377 and 31.661, 2e-4 from them."""

STEREO_YAW_BEYOND_INFINITY_PRINTED = 2.09e-3
"""Printed probability of a disparity that is not positive."""
