"""Every published case of propagation and sensitivity, by every method that prints a result."""

import itertools

import mpmath
import numpy as np
import pytest
from scipy import integrate
from scipy.special import ndtri

from tests.uncertainty.published_cases import (
    ISHIGAMI,
    LOGARITHM,
    MASS_CALIBRATION,
    PROPAGATION_CASES,
    STEREO_YAW,
    STEREO_YAW_BEYOND_INFINITY_PRINTED,
    STEREO_YAW_PRINTED,
    SUM_WITH_A_DOMINANT_UNIFORM,
    NormalInput,
)
from tradestudy.uncertainty.distributions import Normal, Uniform
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.propagation import Sampling, linear, propagate
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

SAMPLING = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**17)


def sources_of(case):
    def distribution(given):
        if isinstance(given, NormalInput):
            return Normal(mean=given.mean, standard_deviation=given.standard_deviation)
        return Uniform(low=given.low, high=given.high)

    return Sources(
        groups=tuple(
            Source(name=given.name, distribution=distribution(given), error_class=ErrorClass.RIG)
            for given in case.inputs
        )
    )


def model_of(case):
    return lambda inputs: Outcome(values=case.model(inputs))


@pytest.fixture(scope="module")
def propagated():
    return {
        case.name: propagate(model_of(case), sources_of(case), SAMPLING, seed=0, point=case.name, inverse_depth=False)
        for case in PROPAGATION_CASES
    }


@pytest.mark.parametrize("case", PROPAGATION_CASES, ids=lambda case: case.name)
def test_monte_carlo_agrees_with_the_published_numbers(case, propagated):
    mine, printed = propagated[case.name], case.monte_carlo
    assert mine.mean[0] == pytest.approx(printed.estimate, abs=printed.rounding + 3.0 * mine.mean_error[0])
    deviation, error = mine.standard_deviation[0], mine.standard_deviation_error[0]
    assert deviation == pytest.approx(printed.standard_uncertainty, abs=printed.rounding + 3.0 * error)
    if case.shortest:  # printed, but not computed here
        return
    ends, errors = mine.quantiles[[0, 4], 0], mine.quantiles_error[[0, 4], 0]
    assert np.all(np.abs(ends - printed.interval) <= printed.interval_rounding + 3.0 * errors)


@pytest.mark.parametrize("case", PROPAGATION_CASES, ids=lambda case: case.name)
def test_linear_propagation_agrees_with_the_published_numbers(case):
    mine, printed = linear(model_of(case), sources_of(case)), case.linear
    assert mine.estimate[0] == pytest.approx(printed.estimate, abs=printed.rounding)
    assert mine.standard_uncertainty[0] == pytest.approx(printed.standard_uncertainty, abs=printed.rounding)
    if printed.interval is not None:
        ends = mine.estimate[0] + np.array([-1.0, 1.0]) * ndtri(0.975) * mine.standard_uncertainty[0]
        np.testing.assert_allclose(ends, printed.interval, atol=printed.interval_rounding)


@pytest.mark.parametrize(
    "case", [c for c in PROPAGATION_CASES if c.exact_interval and not c.shortest], ids=lambda case: case.name
)
def test_intervals_agree_with_closed_forms(case, propagated):
    mine = propagated[case.name]
    ends, errors = mine.quantiles[[0, 4], 0], mine.quantiles_error[[0, 4], 0]
    # The rank of a quantile in n draws is only known to 1/n.
    grain = 2.0 / 2**14 / 0.95 * np.ptp(ends)
    assert np.all(errors < 8e-3)  # plain draws: 0.015
    assert np.all(np.abs(ends - case.exact_interval) <= 4.0 * errors + grain)


def sum_of_uniforms_cumulative(half_widths, x):
    """Distribution of a sum of centred rectangles of any widths, by inclusion and exclusion of corners."""
    n = len(half_widths)
    total = mpmath.mpf(0)
    for signs in itertools.product((1, -1), repeat=n):
        corner = x + sum(s * h for s, h in zip(signs, half_widths, strict=True))
        if corner > 0:
            total += mpmath.fprod(signs) * corner**n
    return total / (mpmath.factorial(n) * mpmath.fprod(2 * h for h in half_widths))


def test_the_dominant_rectangle_has_its_exact_interval(propagated):
    with mpmath.workdps(30):
        halves = [mpmath.sqrt(3)] * 3 + [10 * mpmath.sqrt(3)]
        exact = float(mpmath.findroot(lambda x: sum_of_uniforms_cumulative(halves, x) - mpmath.mpf("0.975"), 16.5))
    mine = propagated[SUM_WITH_A_DOMINANT_UNIFORM.name]
    assert mine.quantiles[4, 0] == pytest.approx(exact, abs=3.0 * mine.quantiles_error[4, 0] + 1e-4)
    assert mine.quantiles_error[4, 0] < 1e-2


def test_the_mass_agrees_with_direct_integration(propagated):
    """Given the buoyancy, the mass is normal: three rectangles are integrated by Gauss-Legendre."""
    mine = propagated[MASS_CALIBRATION.name]
    nodes, weights = np.polynomial.legendre.leggauss(24)
    air, weight, reference = np.meshgrid(0.1 * nodes, 8000 + 1000 * nodes, 8000 + 50 * nodes, indexing="ij")
    share = np.einsum("i,j,k->ijk", weights, weights, weights) / 8.0
    buoyancy = air * (1.0 / weight - 1.0 / reference)
    centre = 1.234 + 100001.234 * buoyancy
    mean = np.sum(share * centre)
    variance = np.sum(share * ((centre - mean) ** 2 + (0.05**2 + 0.02**2) * (1 + buoyancy) ** 2))
    assert mine.mean[0] == pytest.approx(mean, abs=3.0 * mine.mean_error[0])
    assert mine.standard_deviation[0] == pytest.approx(
        np.sqrt(variance), abs=3.0 * mine.standard_deviation_error[0] + 1e-6
    )


def test_the_logarithm_has_its_exact_moments(propagated):
    mine = propagated[LOGARITHM.name]
    mean = integrate.quad(np.log, 0.1, 1.1)[0]
    square = integrate.quad(lambda x: (np.log(x) - mean) ** 2, 0.1, 1.1)[0]
    assert mine.mean[0] == pytest.approx(mean, abs=3.0 * mine.mean_error[0] + 1e-7)
    assert mine.standard_deviation[0] == pytest.approx(np.sqrt(square), abs=1e-4)


def test_the_ishigami_function_has_its_published_indices():
    mine = sobol_indices(
        model_of(ISHIGAMI),
        sources_of(ISHIGAMI),
        Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**20),
        draws=2**13,
        seed=0,
        point="ishigami",
    )
    assert mine.names == ("x1", "x2", "x3")
    assert np.max(mine.first_error) < 3e-3
    assert np.max(mine.total_error) < 3e-3
    assert np.all(np.abs(mine.first[:, 0] - ISHIGAMI.first) <= ISHIGAMI.rounding + 4.0 * mine.first_error[:, 0])
    assert np.all(np.abs(mine.total[:, 0] - ISHIGAMI.total) <= ISHIGAMI.rounding + 4.0 * mine.total_error[:, 0])


def test_stereo_with_a_normal_yaw_has_its_closed_form():
    yaw = Source(
        name="yaw",
        distribution=Normal(mean=0.0, standard_deviation=STEREO_YAW.yaw_standard_deviation),
        error_class=ErrorClass.SESSION,
    )
    mine = propagate(
        lambda inputs: Outcome(values=STEREO_YAW.inverse_depth(inputs["yaw"])),
        Sources(groups=(yaw,)),
        Sampling(absolute_tolerance=2e-3, relative_tolerance=0.0, budget_draws=2**20),
        seed=0,
        point="stereo",
        inverse_depth=True,
    )
    assert mine.status[0] == "converged"
    for probability, printed in STEREO_YAW_PRINTED.items():
        closed = float(STEREO_YAW.depth_quantile(probability))
        assert closed == pytest.approx(printed, rel=2.5e-4)
        row = (0.025, 0.16, 0.5, 0.84, 0.975).index(probability)
        error = mine.quantiles_error[row, 0]
        assert mine.quantiles[row, 0] == pytest.approx(closed, abs=3.0 * error)
        assert error < 1e-3
    beyond = STEREO_YAW.probability_beyond_infinity
    assert beyond == pytest.approx(STEREO_YAW_BEYOND_INFINITY_PRINTED, rel=3e-3)
    assert np.isnan([mine.mean[0], mine.standard_deviation[0]]).all()
