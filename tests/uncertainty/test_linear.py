import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Normal, StudentT
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.propagation import linear
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


def test_sensitivities_are_the_derivatives_of_mpmath():
    model, offsets = stereo_at(1.0), ("yaw", "roll", "baseline", "right_focal_length")
    line = linear(model, STEREO)

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
            assert -line.sensitivity[row, 0] == pytest.approx(exact, rel=1e-5)


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
        return linear(model, Sources(groups=(group,))).standard_uncertainty[0]

    dz, df = ((distance - f) / f) ** 2 * sd, (distance / f) ** 2 * sd
    assert u(0.0) == pytest.approx(np.hypot(dz, df), rel=1e-6)
    assert u(1.0) == pytest.approx(df - dz, rel=1e-4)
    assert u(-1.0) == pytest.approx(df + dz, rel=1e-6)


def test_a_model_that_fails_near_the_nominal_point_gives_nan():
    line = linear(
        lambda v: Outcome(values=1.0 + v["yaw"] + np.zeros(2), no_overlap=(v["yaw"] > 0.0) & np.array([True, False])),
        independent(yaw=1e-3),
    )
    assert np.isnan(line.standard_uncertainty[0])
    assert line.standard_uncertainty[1] == pytest.approx(1e-3, rel=1e-6)


def test_linear_methods_refuse_what_they_cannot_do():
    t = Source(name="t", distribution=StudentT(location=0.0, scale=1.0, degrees_of_freedom=2.0), error_class=RIG)
    with pytest.raises(OutOfRangeError, match=r"none for t .*Monte Carlo"):
        linear(lambda v: Outcome(values=v["t"]), Sources(groups=(t,)))
