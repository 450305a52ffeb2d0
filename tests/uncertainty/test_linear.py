import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Normal, StudentT, Uniform
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.propagation import Sampling, linear, numerical_tolerance, propagate, validity
from tradestudy.uncertainty.sources import ErrorClass, Source, Sources

RIG = ErrorClass.RIG
FOCAL_LENGTH, BASELINE = 0.0305, 0.1


def independent(**deviations):
    return Sources(
        groups=tuple(
            Source(name=name, distribution=Normal(mean=0.0, standard_deviation=deviation), error_class=RIG)
            for name, deviation in deviations.items()
        )
    )


STEREO = independent(
    yaw=3.49e-3,
    pitch=3.49e-3,
    roll=3.49e-3,
    baseline=5e-5,
    left_focal_length=3e-6,
    right_focal_length=3e-6,
    left_principal_point=1e-6,
    right_principal_point=1e-6,
)


def stereo_at(distance, x=0.004, y=0.003):
    """Exact rotation of the right ray, then disparity: eight error sources, one output."""

    def model(v):
        f = FOCAL_LENGTH
        left = x * (1.0 + v["left_focal_length"] / f) + v["left_principal_point"]
        ray = np.array([x / f - BASELINE / distance, y / f, 1.0])
        cos, sin = np.cos, np.sin
        rx = ray[0] * cos(v["roll"]) - ray[1] * sin(v["roll"])
        ry = ray[0] * sin(v["roll"]) + ray[1] * cos(v["roll"])
        rz = ray[2] * cos(v["pitch"]) - ry * sin(v["pitch"])
        tangent = (rx * cos(v["yaw"]) - rz * sin(v["yaw"])) / (rx * sin(v["yaw"]) + rz * cos(v["yaw"]))
        right = (f + v["right_focal_length"]) * tangent + v["right_principal_point"]
        return Outcome(values=(left - right) / (f * (BASELINE + v["baseline"])))

    return model


@pytest.mark.parametrize(
    ("distance", "x", "share"), [(3.0, 0.0, 1e-3), (10.0, 0.0, 1e-3), (0.5, 0.0, 3e-3), (1.0, 0.004, 3e-3)]
)
def test_seventeen_evaluations_of_inverse_depth_give_the_interval_of_a_stereo_rig(distance, x, share):
    """To 0.001 u on the axis far away; near or off axis the rotations' true second order is up to 0.003 u."""
    model = stereo_at(distance, x=x, y=0.75 * x)
    line = linear(model, STEREO, inverse_depth=True)
    assert line.evaluations == 17
    sampling = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**19)
    exact = propagate(model, STEREO, sampling, seed=0, point=str(distance), inverse_depth=True)
    u, ends, errors = line.standard_uncertainty[0], exact.symmetric_interval[:, 0], exact.quantiles_error[[0, 4], 0]
    assert np.all(errors < 2.0 * share * u)
    wrong = np.abs(line.mapped_quantiles([0.025, 0.975])[:, 0] - ends)
    assert np.all(wrong <= share * u + 3.0 * errors)
    assert np.max(np.abs(line.symmetric_interval[:, 0] - ends)) > 10.0 * np.max(wrong)


def test_sensitivities_are_the_derivatives_of_mpmath():
    model, offsets = stereo_at(1.0), ("yaw", "roll", "baseline", "right_focal_length")
    line = linear(model, STEREO, inverse_depth=True)

    def depth(name, value):
        f, x, y = mpmath.mpf("0.0305"), mpmath.mpf("0.004"), mpmath.mpf("0.003")
        given = dict.fromkeys(offsets, mpmath.mpf(0)) | {name: value}
        rx, ry = x / f - mpmath.mpf("0.1"), y / f
        rx = rx * mpmath.cos(given["roll"]) - ry * mpmath.sin(given["roll"])
        tangent = mpmath.tan(mpmath.atan2(rx, 1) - given["yaw"])
        return f * (mpmath.mpf("0.1") + given["baseline"]) / (x - (f + given["right_focal_length"]) * tangent)

    with mpmath.workdps(30):
        for name in offsets:
            exact = float(mpmath.diff(lambda value, n=name: depth(n, value), 0))
            row = STEREO.parameters.index(name)
            assert line.sensitivity[row, 0] == pytest.approx(exact, rel=1e-5)


def test_correlated_parameters_enter_with_their_covariance():
    """A plenoptic camera at 1 m: errors of z and f_M of equal size and opposite effect nearly cancel."""
    f, distance, sd = 12.5e-3, 1.0, 1e-6
    image = distance * f / (distance - f)

    def model(v):
        return Outcome(values=1.0 / (f + v["focal_length"]) - 1.0 / (image + v["mla_distance"]))

    def u(correlation):
        group = JointNormal(
            name="optics",
            parameters=("mla_distance", "focal_length"),
            mean=np.zeros(2),
            covariance=sd**2 * np.array([[1.0, correlation], [correlation, 1.0]]),
            error_class=RIG,
        )
        return linear(model, Sources(groups=(group,)), inverse_depth=True).standard_uncertainty[0]

    dz, df = ((distance - f) / f) ** 2 * sd, (distance / f) ** 2 * sd
    assert u(0.0) == pytest.approx(np.hypot(dz, df), rel=1e-6)
    assert u(1.0) == pytest.approx(df - dz, rel=1e-4)
    assert u(-1.0) == pytest.approx(df + dz, rel=1e-6)


def test_a_line_beyond_infinity_is_infinite():
    line = linear(lambda v: Outcome(values=0.1 + v["yaw"] / 0.1), independent(yaw=0.006), inverse_depth=True)
    np.testing.assert_array_equal(np.isinf(line.mapped_quantiles([0.5, 0.975])[:, 0]), [False, True])


def test_a_model_that_fails_near_the_nominal_point_gives_nan():
    line = linear(
        lambda v: Outcome(values=1.0 + v["yaw"] + np.zeros(2), no_overlap=(v["yaw"] > 0.0) & np.array([True, False])),
        independent(yaw=1e-3),
        inverse_depth=True,
    )
    assert np.isnan(line.standard_uncertainty[0])
    assert line.standard_uncertainty[1] == pytest.approx(1e-3, rel=1e-6)


def test_linear_methods_refuse_what_they_cannot_do():
    t = Source(name="t", distribution=StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0), error_class=RIG)
    with pytest.raises(OutOfRangeError, match=r"none for t .*Monte Carlo"):
        linear(lambda v: Outcome(values=v["t"]), Sources(groups=(t,)), inverse_depth=False)
    line = linear(lambda v: Outcome(values=v["yaw"]), independent(yaw=1.0), inverse_depth=False)
    with pytest.raises(OutOfRangeError, match="inverse_depth=True"):
        line.mapped_quantiles([0.5])


@pytest.mark.parametrize(
    ("u", "digits", "tolerance"),
    [
        (0.0539, 2, 0.0005),  # 54·10⁻³
        (0.0539, 1, 0.005),
        (10.1, 2, 0.5),
        (0.0996, 2, 0.005),  # 10·10⁻²
        (0.0994, 2, 0.0005),  # 99·10⁻³
        (35.0, 1, 5.0),
        (0.0, 2, 0.0),
        (np.nan, 2, np.nan),
    ],
)
def test_numerical_tolerance_is_half_the_last_digit(u, digits, tolerance):
    np.testing.assert_allclose(numerical_tolerance(u, digits), tolerance, rtol=1e-12)


def test_the_verdict_is_undecided_where_monte_carlo_is_too_coarse():
    sources, model = independent(yaw=3.49e-3), lambda v: Outcome(values=np.array([4.0, 0.12]) + v["yaw"] / 0.1)
    line = linear(model, sources, inverse_depth=True)

    def verdicts(interval, draws, first_draws, digits):
        sampling = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=draws, first_draws=first_draws)
        mine = propagate(model, sources, sampling, seed=0, point="v", inverse_depth=True)
        u = line.standard_uncertainty
        return list(validity(interval, mine, standard_uncertainty=u, significant_digits=digits).verdict)

    mapped = line.mapped_quantiles([0.025, 0.975])
    assert verdicts(line.symmetric_interval, 2**18, 2**9, 1) == ["valid", "invalid"]
    assert verdicts(mapped, 2**18, 2**9, 2) == ["valid", "valid"]
    assert verdicts(mapped, 2**10, 2**7, 4) == ["undecided", "undecided"]


def test_an_unbounded_interval_is_valid_only_if_both_methods_find_it_unbounded():
    uniform = Source(name="x", distribution=Uniform(low=0.0, high=1.0), error_class=RIG)
    model = lambda v: Outcome(values=v["x"] - 0.1)  # noqa: E731  one line is the whole model
    sampling = Sampling(absolute_tolerance=0.0, relative_tolerance=0.0, budget_draws=2**16)
    mine = propagate(model, Sources(groups=(uniform,)), sampling, seed=0, point="u", inverse_depth=True)
    low = mine.symmetric_interval[0, 0]
    for high, verdict in ((np.inf, "valid"), (50.0, "invalid")):
        judged = validity(np.array([[low], [high]]), mine, standard_uncertainty=np.array([1.0]))
        assert judged.verdict[0] == verdict
