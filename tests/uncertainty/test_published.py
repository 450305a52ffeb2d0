"""Every published case of propagation and sensitivity, by every method that prints a result."""

import itertools

import mpmath
import numpy as np
import pytest
from scipy import integrate

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
from tradestudy.uncertainty import Normal, StudentT, Uniform, propagate_through
from tradestudy.uncertainty.sensitivity import sobol_indices
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

REPLICATES = 16  # of `propagate_through`, whose draws follow one another


def inputs_of(case):
    return {
        given.name: Normal(mean=given.mean, standard_deviation=given.standard_deviation)
        if isinstance(given, NormalInput)
        else Uniform(low=given.low, high=given.high)
        for given in case.inputs
    }


@pytest.fixture(scope="module")
def propagated():
    return {
        case.name: propagate_through(
            lambda case=case, **inputs: case.model(inputs), inputs_of(case), coverage=0.95, tolerance=1e-3
        )
        for case in PROPAGATION_CASES
    }


def moments(found):
    """Mean and standard deviation of the draws, each with its standard error from the scatter of the replicates."""
    replicates = found.values.reshape(REPLICATES, -1)
    errors = [np.std(each, ddof=1) / np.sqrt(REPLICATES) for each in (replicates.mean(axis=1), replicates.std(axis=1))]
    return (found.values.mean(), errors[0]), (found.standard_deviation, errors[1])


@pytest.mark.parametrize("case", PROPAGATION_CASES, ids=lambda case: case.name)
def test_propagation_agrees_with_the_published_numbers(case, propagated):
    found, printed = propagated[case.name], case.printed
    (mean, mean_error), (deviation, deviation_error) = moments(found)
    assert found.converged
    assert mean == pytest.approx(printed.estimate, abs=printed.rounding + 3.0 * mean_error)
    assert deviation == pytest.approx(printed.standard_uncertainty, abs=printed.rounding + 3.0 * deviation_error)
    assert max(mean_error, deviation_error) < 1e-3 * deviation
    if case.shortest:  # printed, but not computed here
        return
    ends = np.array([found.low[0], found.high[0]])
    assert np.all(np.abs(ends - printed.interval) <= printed.interval_rounding + 3.0 * found.error[0])


@pytest.mark.parametrize(
    "case", [c for c in PROPAGATION_CASES if c.exact_interval and not c.shortest], ids=lambda case: case.name
)
def test_intervals_agree_with_closed_forms(case, propagated):
    found = propagated[case.name]
    ends = np.array([found.low[0], found.high[0]])
    # The rank of a quantile in n draws is only known to 1/n.
    grain = 2.0 * REPLICATES / found.draws / 0.95 * np.ptp(ends)
    assert found.error[0] < 4e-3  # plain draws: 0.015
    assert np.all(np.abs(ends - case.exact_interval) <= 4.0 * found.error[0] + grain)


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
    found = propagated[SUM_WITH_A_DOMINANT_UNIFORM.name]
    assert found.high[0] == pytest.approx(exact, abs=3.0 * found.error[0] + 1e-4)
    assert found.low[0] == pytest.approx(-exact, abs=3.0 * found.error[0] + 1e-4)
    assert found.error[0] < 1e-2


def test_the_mass_agrees_with_direct_integration(propagated):
    """Given the buoyancy, the mass is normal: three rectangles are integrated by Gauss-Legendre."""
    (found_mean, mean_error), (found_deviation, deviation_error) = moments(propagated[MASS_CALIBRATION.name])
    nodes, weights = np.polynomial.legendre.leggauss(24)
    air, weight, reference = np.meshgrid(0.1 * nodes, 8000 + 1000 * nodes, 8000 + 50 * nodes, indexing="ij")
    share = np.einsum("i,j,k->ijk", weights, weights, weights) / 8.0
    buoyancy = air * (1.0 / weight - 1.0 / reference)
    centre = 1.234 + 100001.234 * buoyancy
    mean = np.sum(share * centre)
    variance = np.sum(share * ((centre - mean) ** 2 + (0.05**2 + 0.02**2) * (1 + buoyancy) ** 2))
    assert found_mean == pytest.approx(mean, abs=3.0 * mean_error)
    assert found_deviation == pytest.approx(np.sqrt(variance), abs=3.0 * deviation_error + 1e-6)


def test_the_logarithm_has_its_exact_moments(propagated):
    (found_mean, mean_error), (found_deviation, _) = moments(propagated[LOGARITHM.name])
    mean = integrate.quad(np.log, 0.1, 1.1)[0]
    square = integrate.quad(lambda x: (np.log(x) - mean) ** 2, 0.1, 1.1)[0]
    assert found_mean == pytest.approx(mean, abs=3.0 * mean_error + 1e-7)
    assert found_deviation == pytest.approx(np.sqrt(square), abs=1e-4)


def test_the_ishigami_function_has_its_published_indices():
    groups = (
        Source(name=name, distribution=given, error_class=ErrorClass.RIG) for name, given in inputs_of(ISHIGAMI).items()
    )
    mine = sobol_indices(ISHIGAMI.model, Sources(groups=tuple(groups)), draws=2**13, seed=0, point="ishigami")
    assert mine.names == ("x1", "x2", "x3")
    assert np.max(mine.first_error) < 3e-3
    assert np.max(mine.total_error) < 3e-3
    assert np.all(np.abs(mine.first[:, 0] - ISHIGAMI.first) <= ISHIGAMI.rounding + 4.0 * mine.first_error[:, 0])
    assert np.all(np.abs(mine.total[:, 0] - ISHIGAMI.total) <= ISHIGAMI.rounding + 4.0 * mine.total_error[:, 0])


def test_stereo_with_a_normal_yaw_has_its_closed_form():
    """The inverse depth is finite where depth is infinite; the quantiles of one are the reciprocals of the other's."""
    yaw = Normal(mean=0.0, standard_deviation=STEREO_YAW.yaw_standard_deviation)
    found = propagate_through(STEREO_YAW.inverse_depth, {"yaw": yaw}, coverage=0.95, tolerance=2.5e-5)
    assert found.converged
    for probability, inverse in ((0.025, found.high[0]), (0.5, found.median), (0.975, found.low[0])):
        closed = float(STEREO_YAW.depth_quantile(probability))
        assert closed == pytest.approx(STEREO_YAW_PRINTED[probability], rel=2.5e-4)
        error = found.error[0] * closed**2
        assert 1.0 / inverse == pytest.approx(closed, abs=3.0 * error)
        assert error < 1e-3
    beyond = STEREO_YAW.probability_beyond_infinity
    assert beyond == pytest.approx(STEREO_YAW_BEYOND_INFINITY_PRINTED, rel=3e-3)
    assert np.mean(found.values <= 0.0) == pytest.approx(beyond, rel=1e-2)


def test_an_input_without_a_variance_has_the_interval_of_every_table_of_t():
    t = StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0)
    found = propagate_through(lambda x: x, {"x": t}, coverage=0.95)
    assert found.high[0] == pytest.approx(4.302653, abs=3.0 * found.error[0])
    assert found.error[0] < 0.02
