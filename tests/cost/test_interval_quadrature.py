"""Two codes that integrate intervals of depth, against direct quadrature over one error and a closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtr

from tradestudy.cost import depth_reference
from tradestudy.cost.depth_reference import ENDS, DepthCase, reference_of
from tradestudy.cost.interval_quadrature import half_width_by_quadrature
from tradestudy.cost.measuring import Allowance
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Distribution, Empirical, Normal, Uniform
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import Model, Outcome
from tradestudy.uncertainty.sources import Source, Sources

INVERSE_DEPTH = np.array([2.0, 0.5])
ALLOWED = Allowance(seconds=1e4)
STANDARD = Normal(mean=0.0, standard_deviation=1.0)


def sources(**laws: Distribution) -> Sources:
    return Sources(
        groups=tuple(Source(name=n, distribution=law, error_class=ErrorClass.RIG) for n, law in laws.items())
    )


def case(model: Model, **laws: Distribution) -> DepthCase:
    return DepthCase(name="c", title="C", model=model, sources=sources(**laws), distance=1.0 / INVERSE_DEPTH)


def product(values: dict[str, FloatArray]) -> Outcome:
    """Far from a plane: each error scales what the other does, as baseline and focal length do with disparity."""
    return Outcome(values=INVERSE_DEPTH * (1.0 + 0.08 * values["a"]) * (1.0 + 0.05 * values["b"]) + 0.01 * values["b"])


def with_uniform(values: dict[str, FloatArray]) -> Outcome:
    return Outcome(values=INVERSE_DEPTH + 0.03 * values["a"] + 0.05 * values["u"])


def half_interval(share_above: Callable[[float], float], middle: float) -> float:
    """Half the interval of depth, from the share of inverse depths above a given one."""
    near, far = (
        1.0 / brentq(lambda t, p=p: share_above(t) - p, 0.5 * middle, 1.5 * middle, xtol=1e-15, rtol=1e-15)
        for p in ENDS
    )
    return (far - near) / 2.0


def exact_product(middle: float) -> float:
    """Trapezoids over one normal error, whose sum converges as fast as its Gaussian falls."""
    b = np.arange(-12.0, 12.0, 0.05)
    weight = 0.05 * np.exp(-b * b / 2.0) / math.sqrt(2.0 * math.pi)

    def above(t: float) -> float:
        return float(weight @ ndtr(-((t - 0.01 * b) / (middle * (1.0 + 0.05 * b)) - 1.0) / 0.08))

    return half_interval(above, middle)


def exact_with_uniform(middle: float) -> float:
    """A normal error beside a uniform one, whose share is the difference of ∫Φ = x Φ + φ at the ends."""

    def integral(x: float) -> float:
        return x * float(ndtr(x)) + math.exp(-x * x / 2.0) / math.sqrt(2.0 * math.pi)

    def above(t: float) -> float:
        return 0.03 / 0.1 * (integral((middle + 0.05 - t) / 0.03) - integral((middle - 0.05 - t) / 0.03))

    return half_interval(above, middle)


@pytest.fixture(scope="module")
def exact() -> dict[str, FloatArray]:
    return {
        "product": np.array([exact_product(float(middle)) for middle in INVERSE_DEPTH]),
        "uniform": np.array([exact_with_uniform(float(middle)) for middle in INVERSE_DEPTH]),
    }


def test_few_nodes_across_the_steepest_direction_are_enough(exact: dict[str, FloatArray]) -> None:
    errors = [
        float(np.max(np.abs(found / exact["product"] - 1)))
        for nodes in (1, 3, 5, 9)
        for found in [half_width_by_quadrature(product, sources(a=STANDARD, b=STANDARD), ENDS, nodes)]
    ]
    assert 1e-5 < errors[0] < 1e-2
    assert all(later < earlier / 10.0 for earlier, later in pairwise(errors[:-1]))
    assert errors[-1] < 1e-11


def test_uniform_errors_are_integrated_too(exact: dict[str, FloatArray]) -> None:
    found = half_width_by_quadrature(with_uniform, sources(a=STANDARD, u=Uniform(low=-1.0, high=1.0)), ENDS, 33)
    assert found == pytest.approx(exact["uniform"], rel=1e-11)


@pytest.mark.parametrize("name", ["product", "uniform"])
def test_the_reference_keeps_the_error_that_it_states(exact: dict[str, FloatArray], name: str) -> None:
    asked = {
        "product": case(product, a=STANDARD, b=STANDARD),
        "uniform": case(with_uniform, a=STANDARD, u=Uniform(low=-1.0, high=1.0)),
    }[name]
    found = reference_of([asked], ALLOWED, 2**12)
    assert found.relative_error < 1e-9
    assert np.all(np.abs(found.half_width / exact[name] - 1.0) <= found.relative_error)


def test_an_interval_without_a_far_end_is_infinite_in_one_and_none_in_the_other() -> None:
    def model(values: dict[str, FloatArray]) -> Outcome:
        return Outcome(values=np.maximum(np.array([1.0, 0.2]) + 0.25 * values["a"], 0.0))

    found = half_width_by_quadrature(model, sources(a=STANDARD), ENDS, 3)
    expected = (1.0 / 0.75 - 1.0 / 1.25) / 2.0
    assert found.tolist() == [pytest.approx(expected, rel=1e-11), math.inf]
    reference = reference_of([case(model, a=STANDARD)], ALLOWED, 2**12)
    assert reference.half_width.tolist() == [pytest.approx(expected, rel=1e-11), pytest.approx(math.nan, nan_ok=True)]


def test_integration_that_draws_contradict_is_not_believed(
    exact: dict[str, FloatArray], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = case(product, a=STANDARD, b=STANDARD)
    monkeypatch.setattr(depth_reference, "_integrated", lambda _cases, _alive: (1.02 * exact["product"], 1e-9))
    found = reference_of([asked], ALLOWED, 2**12)
    assert "draws in 8 scrambles" in found.words
    assert found.half_width == pytest.approx(exact["product"], rel=8.0 * found.relative_error)
    assert found.relative_error < 5e-3


def test_what_cannot_be_integrated_is_drawn_for_reference_and_refused_as_an_entry() -> None:
    drawn = Empirical(draws=np.linspace(-1.0, 1.0, 200))
    assert "draws in 8 scrambles" in reference_of([case(with_uniform, a=STANDARD, u=drawn)], ALLOWED, 2**12).words
    with pytest.raises(OutOfRangeError, match=r"u .*normal or uniform"):
        half_width_by_quadrature(with_uniform, sources(a=STANDARD, u=drawn), ENDS, 3)
    with pytest.raises(OutOfRangeError, match="effect of the normal errors"):
        half_width_by_quadrature(
            lambda v: with_uniform({**v, "a": 0.0 * v["u"]}), sources(u=Uniform(low=-1.0, high=1.0)), ENDS, 3
        )
    with pytest.raises(OutOfRangeError, match=r"100000 in each of 1 dim"):
        half_width_by_quadrature(product, sources(a=STANDARD, b=STANDARD), ENDS, 100_000)
