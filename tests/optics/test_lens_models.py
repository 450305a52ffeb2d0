"""Lens models against OpenCV, against their geometry at 30 digits, and their fields against closed forms and search."""

import mpmath
import numpy as np
import pytest

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_families import (
    FAMILIES,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    Omnidirectional,
)
from tradestudy.optics.lens_model import Rational

FULL = Rational(
    k1=0.3, k2=-0.2, p1=0.001, p2=-0.002, k3=0.05, k4=0.25, k5=-0.1, k6=0.02, s1=0.001, s2=-0.002, s3=0.003, s4=0.001,
    tau_x=0.03, tau_y=-0.02,
)  # fmt: skip
FISHEYE = KannalaBrandt(k1=-0.02, k2=0.01, k3=-0.003, k4=0.0004)
MODELS = (
    Rational(), Rational(k1=-0.3), Rational(k1=-0.3, k2=0.1), Rational(k1=0.3), FULL, FISHEYE, KannalaBrandt(k1=-0.1),
    FieldOfView(w=0.9), Omnidirectional(xi=0.0), Omnidirectional(xi=1.0), Omnidirectional(xi=0.7),
    Omnidirectional(xi=1.7, k1=-0.1, k2=0.02, p1=0.001, p2=-0.002), DoubleSphere(xi=-0.2, alpha=0.6),
    DoubleSphere(xi=0.3, alpha=0.3), ExtendedUnified(alpha=0.6, beta=1.2), ExtendedUnified(alpha=0.4, beta=1.2),
    ExtendedUnified(alpha=0.0, beta=1.2),
)  # fmt: skip
CAMERA = np.array([[460.0, 0.0, 319.5], [0.0, 461.0, 179.5], [0.0, 0.0, 1.0]])
POINTS = np.random.default_rng(1).uniform([-0.5, -0.4, 0.8], [0.5, 0.4, 1.2], (10_000, 3))
WIDE = np.array([[0.3, -0.4, 1.0], [1.0, 0.2, 0.1], [-0.7, 0.9, -0.3]])


def directions(angle, azimuth):
    across = np.sin(angle)
    parts = (across * np.cos(azimuth), across * np.sin(azimuth), np.cos(angle))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def test_ten_thousand_points_are_where_opencv_has_them():
    cv2 = pytest.importorskip("cv2")
    none = np.zeros(3)
    rational = cv2.projectPoints(POINTS, none, none, CAMERA, np.array([*FULL.coefficients().values()]))[0][:, 0]
    np.testing.assert_allclose(FULL.project(POINTS) @ CAMERA[:2, :2] + CAMERA[:2, 2], rational, rtol=0, atol=1e-9)
    coefficients = np.array([*FISHEYE.coefficients().values()])
    fisheye = cv2.fisheye.projectPoints(POINTS[:, None], none, none, CAMERA, coefficients)[0][:, 0]
    np.testing.assert_allclose(FISHEYE.project(POINTS) @ CAMERA[:2, :2] + CAMERA[:2, 2], fisheye, rtol=0, atol=1e-9)


def on_sphere(point, xi):
    """From the unit sphere to the plane one before a centre that lies ξ behind that of the sphere."""
    across, along = mpmath.sin(angle_of(point)), mpmath.cos(angle_of(point))
    return across / (along + xi)


def angle_of(point):
    x, y, z = map(mpmath.mpf, point.tolist())
    return mpmath.atan2(mpmath.sqrt(x * x + y * y), z)


def doubly(point, xi, alpha):
    """Onto the first sphere, from the second centre onto the second one, then to a pinhole α/(1 − α) behind that."""
    angle = angle_of(point)
    second = mpmath.atan2(mpmath.sin(angle), mpmath.cos(angle) + xi)
    return mpmath.sin(second) / (mpmath.cos(second) + alpha / (1 - alpha)) / (1 - alpha)


def on_ellipsoid(point, alpha, beta):
    """Where the ray meets α √(β ρ² + z²) + (1 − α) z = 1, along the axis onto the picture."""
    angle = angle_of(point)
    across, along = mpmath.sin(angle), mpmath.cos(angle)
    per_reach = alpha * mpmath.sqrt(beta * across**2 + along**2) + (1 - alpha) * along
    return mpmath.findroot(lambda reach: per_reach * reach - 1, 1) * across


@pytest.mark.parametrize(
    ("model", "radius"),
    [
        (Omnidirectional(xi=0.7), lambda point: on_sphere(point, mpmath.mpf(0.7))),
        (DoubleSphere(xi=-0.2, alpha=0.6), lambda point: doubly(point, mpmath.mpf(-0.2), mpmath.mpf(0.6))),
        (ExtendedUnified(alpha=0.6, beta=1.2), lambda point: on_ellipsoid(point, mpmath.mpf(0.6), mpmath.mpf(1.2))),
        (
            FISHEYE,
            lambda point: mpmath.fsum(
                c * angle_of(point) ** n for n, c in ((1, 1), (3, -0.02), (5, 0.01), (7, -0.003), (9, 0.0004))
            ),
        ),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_wide_points_are_where_geometry_puts_them_at_30_digits(model, radius):
    with mpmath.workdps(30):
        expected = [float(radius(point)) for point in WIDE]
    azimuth = np.arctan2(WIDE[:, 1], WIDE[:, 0])
    found = model.project(WIDE)
    np.testing.assert_allclose(
        found, np.array(expected)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1), rtol=1e-14
    )


def test_the_field_of_view_model_maps_its_own_field_to_one():
    """Of a lens with the full field w, the edge of the ideal fisheye, w/2, is imaged at r = 1/2; atan at 30 digits."""
    w = 0.9
    assert FieldOfView(w=w).project(directions(w / 2, 0.0))[0] == pytest.approx(
        float(mpmath.atan(2 * mpmath.tan(mpmath.mpf(w) / 2) ** 2) / w), rel=1e-14
    )
    # A slope of 1/(2 tan(w/2)) is imaged where w r = 45°.
    slope = 1.0 / (2.0 * np.tan(w / 2.0))
    assert FieldOfView(w=w).project(np.array([slope, 0.0, 1.0]))[0] == pytest.approx(np.pi / 4.0 / w, rel=1e-14)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: f"{model.name} {model.coefficients()}")
def test_inverses_hold_throughout_the_valid_field(model):
    rng = np.random.default_rng(2)
    end = float(model.valid_field)
    seen = directions(rng.uniform(0.0, end * (1.0 - 1e-9), 5000), rng.uniform(0.0, 2.0 * np.pi, 5000))
    np.testing.assert_allclose(model.unproject(model.project(seen)), seen, rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.unproject(model.project(np.array([0.0, 0.0, 2.0]))), [0.0, 0.0, 1.0], atol=1e-15)
    if end < np.pi:
        assert np.isnan(model.project(directions(end * (1.0 + 1e-6), np.array([0.3])))).all()


@pytest.mark.parametrize("model", [Rational(k1=-1e-4), Rational(k4=1e-3, k5=1e-7), Rational(k1=-0.3)])
def test_inverses_hold_up_to_the_end_of_a_wide_field(model):
    angle = float(model.valid_field) - np.geomspace(3e-6, 1e-2, 200)
    u, v = model.image(np.sin(angle), 0.0 * angle, np.cos(angle))
    x, _, z = model.ray(u, v)
    np.testing.assert_allclose(np.arctan2(x, z), angle, atol=1e-11)
    assert model.ray(0.0, 0.0)[0] == 0.0


@pytest.mark.parametrize(
    ("model", "end"),
    [
        (Rational(), np.pi / 2),
        # d/dθ of tan θ (1 + k tan²θ), with 3k = −1: (1 − r²)(1 + r²) = 0.01.
        (Rational(k1=-1.0 / 3.0), np.arctan(0.99**0.25)),
        (KannalaBrandt(k1=-0.1), np.sqrt(0.99 / 0.3)),
        (Omnidirectional(xi=0.5), np.arccos(-0.5)),
        # (1 + 2 cos θ)/(cos θ + 2)² = 0.01 · 3/9
        (Omnidirectional(xi=2.0), np.arccos(np.roots([1.0, 4.0 - 600.0, 4.0 - 300.0])[1])),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_the_field_ends_where_the_law_does(model, end):
    assert float(model.valid_field) == pytest.approx(end, rel=1e-9)


def test_the_field_of_an_oblique_lens_ends_in_its_worst_azimuth():
    """Search by finite differences, with 40 000 directions on a cone: the determinant of the map is smallest there."""
    end, azimuth, step = float(FULL.valid_field), np.linspace(0.0, 2.0 * np.pi, 20_001), 1e-6

    def scale(angle):
        out = (FULL.image(*directions(angle + step, azimuth).T), FULL.image(*directions(angle - step, azimuth).T))
        around = (FULL.image(*directions(angle, azimuth + step).T), FULL.image(*directions(angle, azimuth - step).T))
        (a, b), (c, d) = (
            (np.subtract(*one) / (2.0 * step) for one in zip(*pair, strict=True)) for pair in (out, around)
        )
        return (a * d - b * c) / np.hypot(c, d)

    on_axis = scale(1e-4).mean()
    assert scale(end).min() == pytest.approx(0.01 * on_axis, rel=2e-3)
    assert scale(end - 0.01).min() > 0.01 * on_axis


def test_draws_of_coefficients_act_like_each_of_them():
    k1 = np.array([[-0.3], [0.1], [0.0]])
    drawn = KannalaBrandt(k1=k1)
    points = POINTS[:5]
    np.testing.assert_allclose(drawn.valid_field[:, 0], [KannalaBrandt(k1=k).valid_field for k in k1[:, 0]], rtol=1e-12)
    u, v = drawn.image(points[:, 0], points[:, 1], points[:, 2])
    back = np.stack(np.broadcast_arrays(*drawn.ray(u, v)), axis=-1)
    for row, k in enumerate(k1[:, 0]):
        np.testing.assert_allclose(np.stack([u[row], v[row]], axis=-1), KannalaBrandt(k1=k).project(points), rtol=1e-15)
    np.testing.assert_allclose(
        back, np.broadcast_to(points / np.linalg.norm(points, axis=1)[:, None], back.shape), atol=1e-13
    )


@pytest.mark.parametrize("make", [lambda w: FieldOfView(w=w), lambda xi: Omnidirectional(xi=xi)])
def test_coefficients_may_be_lists_of_numbers(make):
    assert make([0.2, 0.4]).valid_field.tolist() == [float(make(one).valid_field) for one in (0.2, 0.4)]


@pytest.mark.parametrize(
    "model", [FULL, FISHEYE, MODELS[7], MODELS[11], MODELS[12], MODELS[14]], ids=lambda model: model.name
)
def test_derivatives_are_those_of_central_differences(model):
    points = WIDE[:1] if model.name in ("rational", "fov") else WIDE[:2]
    names = model.coefficient_names()
    by_points, by_coefficients = model.derivatives(points, names)
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        expected = (model.project(points + step) - model.project(points - step)) / 2e-5
        np.testing.assert_allclose(by_points[..., axis], expected, rtol=1e-6, atol=1e-8)
    for column, name in enumerate(names):
        up, down = (type(model)(**{**model.coefficients(), name: getattr(model, name) + s}) for s in (1e-5, -1e-5))
        expected = (up.project(points) - down.project(points)) / 2e-5
        np.testing.assert_allclose(by_coefficients[..., column], expected, rtol=1e-6, atol=1e-8)


def test_coefficients_without_a_lens_are_refused():
    for make in (
        lambda: FieldOfView(w=4.0), lambda: FieldOfView(w=0.0), lambda: DoubleSphere(xi=0.1, alpha=1.2),
        lambda: ExtendedUnified(alpha=0.5, beta=-1.0), lambda: Omnidirectional(xi=-0.1), lambda: Rational(tau_x=2.0),
    ):  # fmt: skip
        with pytest.raises(OutOfRangeError, match=r"the coefficient .* of the lens model"):
            make()
    assert set(FAMILIES) == {model.name for model in MODELS}
