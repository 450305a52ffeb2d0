"""Thick lenses, against exact rays through lenses of two thick elements, refracted surface by surface.

Rays at heights proportional to a scale s deviate from the laws of Gauss by terms of second order, so every error must
fall fourfold as s is halved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import pytest

from tests.cameras.builders import depth_read, r5, stereo, unfocused
from tradestudy.cameras.conventional.design import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.two_apertures import Stop, TwoApertures

Ray = tuple[float, float, float]
"""Position along the axis and height [m], and slope, the tangent of the angle to the axis."""
SENSOR = Sensor(columns=2000, rows=1600, pixel_pitch=5e-6)
FOCUS = 0.4
GAP, PITCH = 0.5e-3, 100e-6


@dataclass(frozen=True, kw_only=True)
class Glass:
    """Spherical surfaces (vertex, radius of curvature [m], index behind it), in air, and a stop in air."""

    surfaces: tuple[tuple[float, float, float], ...]
    stop: float

    def trace(self, ray: Ray) -> Ray:
        """Refract a ray at all surfaces that lie ahead of it, towards the sensor."""
        return self._refracted(ray, [one for one in self._crossings if one[0] > ray[0]])

    def back(self, ray: Ray) -> Ray:
        """The same towards the scene."""
        turned = [(z, r, after, before) for z, r, before, after in reversed(self._crossings) if z < ray[0]]
        return self._refracted(ray, turned)

    @property
    def _crossings(self) -> list[tuple[float, float, float, float]]:
        before = [1.0, *(index for _, _, index in self.surfaces)]
        return [(z, r, first, n) for (z, r, n), first in zip(self.surfaces, before, strict=False)]

    @staticmethod
    def _refracted(ray: Ray, crossings: list[tuple[float, float, float, float]]) -> Ray:
        """Snell's law in vector form, in the plane of the axis."""
        z, y, slope = ray
        for vertex, radius, before, after in crossings:
            centre = vertex + radius
            # (z + u − c)² + (y + m u)² = r², the root nearest to the vertex.
            a, b, c = 1.0 + slope**2, (z - centre) + slope * y, (z - centre) ** 2 + y**2 - radius**2
            root = math.sqrt(b * b - a * c)
            u = min(((-b - root) / a, (-b + root) / a), key=lambda one: abs(z + one - vertex))
            z, y = z + u, y + slope * u
            along = np.array([1.0, slope]) / math.hypot(1.0, slope)
            normal = np.array([centre - z, -y]) / radius
            normal *= np.sign(normal @ along)
            ratio, cosine = before / after, float(normal @ along)
            leaving = ratio * along + (math.sqrt(1.0 - ratio**2 * (1.0 - cosine**2)) - ratio * cosine) * normal
            slope = float(leaving[1] / leaving[0])
        return z, y, slope

    @cached_property
    def matrix(self) -> np.ndarray:
        """Height and slope behind the last vertex of those in front of the first, to first order."""
        found, z = np.eye(2), self.surfaces[0][0]
        for vertex, radius, before, after in self._crossings:
            found = np.array([[1.0, vertex - z], [0.0, 1.0]]) @ found
            found = np.array([[1.0, 0.0], [(before / after - 1.0) / radius, before / after]]) @ found
            z = vertex
        return found

    @property
    def planes(self) -> tuple[float, float, float]:
        """Focal length, and positions of both principal planes [m]."""
        (a, _), (c, d) = self.matrix
        first, last = self.surfaces[0][0], self.surfaces[-1][0]
        return -1.0 / c, first + (d - 1.0) / c, last + (1.0 - a) / c

    @property
    def lens(self) -> Lens:
        """The lens of the program, by its principal planes and the entrance pupil that a ray near the axis shows."""
        f, front, rear = self.planes
        z, y, slope = self.back((self.stop, 0.0, 1e-6))
        return Lens(
            focal_length=f,
            f_number=4.0,
            principal_separation=rear - front,
            entrance_pupil=z - y / slope - front,
        )

    @property
    def stop_per_pupil(self) -> float:
        """Height in the stop of a ray of unit height in the entrance pupil, to first order."""
        e = self.planes[1] + self.lens.entrance_pupil
        z, y, slope = self.back((self.stop, 1e-6, 0.0))
        return 1e-6 / (y + slope * (e - z))


def at(ray: Ray, z: float) -> float:
    """Height of a ray where it passes a plane."""
    return ray[1] + ray[2] * (z - ray[0])


def axis_of(ray: Ray) -> float:
    """Where a ray meets the axis."""
    return ray[0] - ray[1] / ray[2]


TWO_POSITIVE = Glass(
    surfaces=((0.0, 40e-3, 1.6), (6e-3, -300e-3, 1.0), (26e-3, 90e-3, 1.5), (31e-3, -45e-3, 1.0)), stop=12e-3
)
TELEPHOTO = Glass(
    surfaces=((0.0, 20e-3, 1.62), (7e-3, -80e-3, 1.0), (19e-3, -30e-3, 1.7), (22e-3, 90e-3, 1.0)), stop=10e-3
)
BEHIND = replace(TWO_POSITIVE, stop=35e-3)
LENSES = {"two positive elements": TWO_POSITIVE, "telephoto": TELEPHOTO, "stop behind": BEHIND}


def telecentric() -> Glass:
    """The stop in the front focal point."""
    f, front, _ = TWO_POSITIVE.planes
    return replace(TWO_POSITIVE, stop=front - f)


@pytest.fixture(params=[*LENSES, "telecentric"])
def glass(request: pytest.FixtureRequest) -> Glass:
    return telecentric() if request.param == "telecentric" else LENSES[request.param]


def views(glass: Glass, **changes: object):
    """An unfocused camera behind the lens."""
    lens = glass.lens
    array = MicrolensArray(layout="square", pitch=PITCH, gap=GAP, focal_lengths=(GAP,), aperture_diameter=PITCH)
    return unfocused(main_lens=lens, sensor=SENSOR, microlenses=array, focus_distance=FOCUS, **changes)


def falls_fourfold(measured: Callable[[float], float], predicted: float, *, within: float) -> None:
    """The error falls with the square of the scale, and is small."""
    errors = [abs(measured(scale) / predicted - 1.0) for scale in (1.0, 0.5, 0.25)]
    assert errors[0] < within
    for wide, narrow in pairwise(errors):
        assert narrow < wide / 3.5 + 2e-9


def test_lenses_are_as_different_as_they_should_be() -> None:
    """Separations of both signs, pupils on both sides, and one at infinity."""
    found = {name: one.lens for name, one in LENSES.items()}
    assert found["two positive elements"].principal_separation < -3e-3
    assert found["telephoto"].principal_separation > 1e-3
    assert found["two positive elements"].entrance_pupil < -4e-3 < 4e-3 < found["telephoto"].entrance_pupil
    assert telecentric().lens.entrance_pupil == pytest.approx(-TWO_POSITIVE.planes[0], rel=1e-6)


def test_conjugates(glass: Glass) -> None:
    """From the object to the array: a, the separation of the principal planes, and z."""
    camera = views(glass)
    start = glass.planes[1] - FOCUS
    total = FOCUS + camera.main_lens.principal_separation + camera.mla_distance
    falls_fourfold(lambda s: axis_of(glass.trace((start, 0.0, 0.015 * s))) - start, total, within=0.02)


def test_exit_pupil(glass: Glass) -> None:
    """The image of the stop, counted from the array in the scale of the entrance pupil."""
    camera, rear = views(glass), glass.planes[2]
    array = rear + camera.mla_distance

    def vergence(s: float) -> float:
        ray = glass.trace((glass.stop, 0.0, 0.1 * s))
        return ray[2] / at(ray, array) * GAP

    spread = float(camera.geometry.image_spread({}))
    if glass == telecentric():
        assert abs(spread) < 1e-9
        assert abs(vergence(0.01)) < 1e-5
    else:
        assert spread == pytest.approx(GAP / (camera.mla_distance - camera.main_lens.exit_pupil), rel=1e-12)
        falls_fourfold(vergence, spread, within=0.05)


def test_magnification_and_f_number(glass: Glass) -> None:
    """The chief ray gives the principal distance, and the cone behind the lens the f-number on the image side."""
    camera, (_, front, rear) = views(glass), glass.planes
    array, c = rear + camera.mla_distance, camera.principal_distance

    def scale(s: float) -> float:
        chief = (glass.stop, 0.0, 0.05 * s)
        return at(glass.trace(chief), array) / glass.back(chief)[2]

    falls_fourfold(scale, c, within=0.05)

    def cone(s: float) -> float:
        ray = glass.trace((front - FOCUS, 0.0, 0.01 * s))
        pupil = 0.01 * s * float(camera.from_pupil(FOCUS))
        return -pupil / ray[2]

    falls_fourfold(cone, c, within=0.05)
    rig = stereo(
        lens=camera.main_lens,
        sensor=SENSOR,
        focus_distance=float(camera.from_pupil(FOCUS)),
        principal_distance_rule="focused",
    )
    assert rig.principal_distance == pytest.approx(c, rel=1e-12)
    assert rig.focus.working_f_number == pytest.approx(c / rig.lens.pupil_diameter, rel=1e-12)


@pytest.mark.parametrize("distance", [0.2, 0.35, 2.0])
def test_baselines_of_views(glass: Glass, distance: float) -> None:
    """Two pixels see through two parts of the pupil, and a point elsewhere at two places on the array."""
    camera, (_, front, rear) = views(glass), glass.planes
    array, pupil = rear + camera.mla_distance, front + camera.main_lens.entrance_pupil
    baseline = camera.view_pupil_diameter

    def opening(s: float) -> float:
        slope = 10.0 * s * SENSOR.pixel_pitch / GAP
        return at(glass.back((array, 0.0, slope)), pupil) / (10.0 * s)

    falls_fourfold(opening, -baseline, within=0.03)

    def disparity(s: float) -> float:
        start, height = front - distance, 2e-3 * s
        away = pupil - start
        return at(glass.trace((start, 0.0, height / away)), array) / height

    falls_fourfold(disparity, float(camera.disparity(distance)) / camera.estimator_baseline, within=0.5)


@pytest.mark.parametrize("shift", [-0.1, 0.0, 0.2, 0.6])
def test_refocused_planes_and_their_limits(glass: Glass, shift: float) -> None:
    """Rays from pixels through microlenses, refracted surface by surface, meet where the program says, to 1e-6."""
    camera, (_, front, rear) = views(glass), glass.planes
    array, apart, small = rear + camera.mla_distance, camera.views_across - 1, 5e-4
    chief = glass.trace((glass.stop, 0.0, 1e-6))
    chief_slope = chief[2] / at(chief, array)  # of the middle of a micro-image, per height on the array

    def seen(side: int, pixel: float, edge: float) -> Ray:
        """In front of the lens: the ray of a pixel of one outermost view, and of one edge of its microlens."""
        middle = -side * shift * apart * PITCH / 2.0
        slope = middle * chief_slope + (side * apart / 2.0 + pixel) * SENSOR.pixel_pitch / GAP
        return glass.back((array, small * (middle + edge * PITCH), small * slope))

    def meeting(edge: float) -> float:
        (z, y, m), (_, y2, m2) = seen(-1, edge, edge), seen(1, -edge, -edge)
        other = y2 + m2 * (z - _)
        return front - (z + (other - y) / (m - m2))

    found = camera.refocusing
    limits, expected = found.ray_limits(shift), [meeting(edge) for edge in (0.5, 0.0, -0.5)]
    expected = [one if one > 0.0 else math.inf for one in expected]
    assert [float(one) for one in (limits.near, found.distance(shift), limits.far)] == pytest.approx(expected, rel=1e-6)
    pupil = front + camera.main_lens.entrance_pupil
    first, second = seen(-1, 0.0, 0.0), seen(1, 0.0, 0.0)
    if shift == 0.0:  # rays of one microlens
        assert abs(at(first, pupil) - at(second, pupil)) / small == pytest.approx(found.baseline(apart), rel=1e-6)


@pytest.mark.parametrize("distance", [0.25, 1.5])
def test_blur_of_a_fixed_focus(glass: Glass, distance: float) -> None:
    """A ray at the rim of the pupil, for distances from the centre of projection."""
    lens = glass.lens
    pupil = glass.planes[1] + lens.entrance_pupil
    rig = stereo(lens=lens, sensor=SENSOR, focus_distance=FOCUS)
    array = glass.planes[2] + rig.sensor_distance(FOCUS)

    def blur(s: float) -> float:
        rim = lens.pupil_diameter / 2.0 * s
        return abs(at(glass.trace((pupil - distance, 0.0, rim / distance)), array)) * 2.0 / s

    falls_fourfold(blur, float(rig.estimator_blur_px(distance)) * SENSOR.pixel_pitch, within=0.5)
    camera = ConventionalCamera(lens=lens, sensor=SENSOR, focus_distance=FOCUS)
    sharp = camera.focus.sharp_range(BlurCriterion(blur_px=2.0, measure="none", wavelength=5e-7)).slices
    assert rig.estimator_blur_px(np.array([sharp.near[0], sharp.far[0]])) == pytest.approx(2.0, rel=1e-9)


def test_microlenses_that_see_a_point(glass: Glass) -> None:
    """The disc of light on the array of a focused camera."""
    lens, rear = glass.lens, glass.planes[2]
    camera = r5(main_lens=lens, sensor=SENSOR, mla_distance=lens.focal_length * 1.12)
    distance, array = 0.5, rear + camera.mla_distance
    start = glass.planes[1] - distance

    def disc(s: float) -> float:
        rim = lens.pupil_diameter / 8.0 * s
        ray = glass.trace((start, 0.0, rim / (distance + lens.entrance_pupil)))
        return abs(at(ray, array)) / rim * lens.pupil_diameter / 2.0 / camera.microlenses.pitch

    falls_fourfold(disc, float(camera.radius_over_pitch(distance)), within=0.3)


def test_rays_of_rendered_pictures(glass: Glass) -> None:
    """Rays of pixels through microlenses, followed back through the glass, and their place in the pupil."""
    camera, (_, front, rear) = views(glass), glass.planes
    (exposure,) = camera.exposures(FOCUS, {}, None, 0.0)
    array, pupil = rear + camera.mla_distance, front + camera.main_lens.entrance_pupil

    def error(s: float) -> float:
        places = np.linspace(-2e-3, 2e-3, 801) * s
        cones = exposure.cones(places, np.full_like(places, SENSOR.pixel_pitch / 2.0))
        worst = 0.0
        for k in np.flatnonzero(np.hypot(*cones.stop.place) < cones.stop.radius * s / 2.0):
            start, slope = float(cones.start[0, k]), float(cones.slope[0, k])
            # The axis of the camera points into the scene; in upright coordinates, a point u behind the lens is −u.
            ray = glass.trace((front - 1.0, start + slope, -slope))
            at_array = -at(ray, array)
            arrives = at_array - ray[2] * GAP
            worst = max(worst, abs(arrives - places[cones.pixel[k]]))
            through = start - slope * (pupil - front)
            assert through == pytest.approx(-float(cones.stop.place[0, k]), abs=1e-9)
        return worst

    whole, half = error(1.0), error(0.5)
    assert whole < 60e-6
    assert half < whole / 7.0  # a position, relative to its own size to second order


def test_measured_depth_is_the_true_one(glass: Glass) -> None:
    """Without errors, at the centre and the corner; with a moved array, as conjugates say."""
    distance = np.array([0.25, 0.4, 0.9])
    lens = glass.lens
    for camera in (views(glass), r5(main_lens=lens, sensor=SENSOR, mla_distance=lens.focal_length * 1.2)):
        for field in (0.0, 1.0):
            assert depth_read(camera, distance, field) == pytest.approx(distance, rel=1e-9)
    f = lens.focal_length
    moved = depth_read(views(glass), np.array([FOCUS]), mla_distance=1e-9) - FOCUS
    assert moved == pytest.approx(-(((FOCUS - f) / f) ** 2) * 1e-9, rel=1e-4)


def test_pupil_at_infinity_has_no_error_of_its_distance() -> None:
    lens = replace(TWO_POSITIVE.lens, entrance_pupil=-TWO_POSITIVE.lens.focal_length)
    camera = replace(views(TWO_POSITIVE), main_lens=lens)
    assert lens.exit_pupil == math.inf
    assert float(camera.geometry.image_spread({})) == 0.0
    with pytest.raises(OutOfRangeError, match="pupil_distance"):
        depth_read(camera, 0.3, pupil_distance=1e-3)


def test_stack_covers_its_range(glass: Glass) -> None:
    """Planned by the law of the entrance pupil: touching slices without gaps, and one image fewer does not suffice."""
    lens = replace(glass.lens, f_number=1.5)
    criterion = BlurCriterion(blur_px=2.0, measure="none", wavelength=5e-7)
    plan = FocusStackPlan(near=0.3, far=0.6, most_images=500)
    camera = ConventionalCamera(lens=lens, sensor=SENSOR, focus_distance=FOCUS, stack=plan)
    found = camera.focus.sharp_range(criterion).union
    assert found.complete
    assert found.covered[0, 0] <= 0.3 * (1 + 1e-6)
    assert found.covered[0, 1] >= 0.6 * (1 - 1e-6)
    needed = len(camera.focus.focus_distances(criterion))
    assert needed > 5
    fewer = replace(camera, stack=replace(plan, most_images=needed - 1))
    ends = fewer.focus.sharp_range(criterion).union
    assert not ends.complete or ends.covered[0, 0] > 0.3 or ends.covered[-1, 1] < 0.6


def test_waves_pass_the_image_of_a_stop_as_they_pass_the_stop() -> None:
    """Rendered waves take the exit pupil in the scale of the entrance pupil, which changes no light."""
    stop = Stop(scale=-10.9, reach=14.2e-3, radius=1.64e-3)
    image = Stop(scale=0.3 * stop.scale, reach=0.3 * stop.reach, radius=0.3 * stop.radius)
    offsets = np.array([0.0, 0.9e-3, 1.7e-3, 2.6e-3])
    passed, by_image = (TwoApertures(wavelength=550e-9, radius=63e-6, stop=one) for one in (stop, image))
    assert by_image.passed_share(0.3 * offsets) == pytest.approx(passed.passed_share(offsets), rel=1e-6, abs=1e-9)


def test_waves_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="entrance_pupil"):
        views(TELEPHOTO).light_chain()
    flat = replace(TELEPHOTO.lens, entrance_pupil=0.0)
    assert replace(views(TELEPHOTO), main_lens=flat).light_chain().array_distance > 0.0
