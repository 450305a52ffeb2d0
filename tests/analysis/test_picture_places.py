"""Depth on both sides and in both halves of the picture, against plain NumPy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tests.calibration.cameras import focused, stereo
from tradestudy.answers.requirements import check_requirement, is_kept
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.depth_measurement import CORNERS, PicturePlace, place_words, places_within, towards_corners
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.depth.evaluation import distribution
from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.joint import JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Source

COLUMNS, ROWS, PITCH, BASELINE = 1280, 800, 3e-6, 0.095
FOCAL_LENGTH = COLUMNS * PITCH / 2.0 / math.tan(math.radians(87.0 / 2.0))
YAW = math.radians(math.hypot(0.01, 0.005))
NOISE_PX = 0.08


def d455_like(**changes):
    yaw = Source(name="yaw", distribution=Normal(mean=0.0, standard_deviation=YAW), error_class=ErrorClass.RIG)
    return stereo(
        lens=Lens(focal_length=FOCAL_LENGTH, f_number=2.0),
        sensor=Sensor(columns=COLUMNS, rows=ROWS, pixel_pitch=PITCH),
        baseline=BASELINE,
        disparity_error_px=NOISE_PX,
        calibration=Calibration(groups=(yaw,)),
        **changes,
    )


def half_width_by_rays(across: float, down: float, distance: float) -> float:
    """Half the central 68.27 % interval of depth, by tracing both rays with a yaw and noise drawn by NumPy."""
    rng = np.random.default_rng(5)
    x = across * COLUMNS * PITCH / 2.0 / FOCAL_LENGTH * distance
    yaw, noise = rng.normal(0.0, YAW, 400_000), rng.normal(0.0, NOISE_PX * PITCH / FOCAL_LENGTH, 400_000)
    left = (x + BASELINE / 2.0) / distance + noise / 2.0
    right = np.arctan((x - BASELINE / 2.0) / distance - noise / 2.0) - yaw  # the angle of the ray, turned by the yaw
    low, high = np.quantile(BASELINE / (left - np.tan(right)), [0.158655, 0.841345])
    return float(high - low) / 2.0


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("distance", [0.3, 0.6, 1.5])
def test_both_sides_and_halves_of_a_wide_pair_agree_with_rays(corner: str, distance: float) -> None:
    across, down = CORNERS[corner]
    place = PicturePlace(across=0.8 * across, down=0.8 * down)
    found = distribution(d455_like(), np.array([distance]), "both", place).half_width[0]
    assert found == pytest.approx(half_width_by_rays(0.8 * across, 0.8 * down, distance), rel=5e-3)


def test_the_left_half_of_the_picture_of_a_wide_pair_is_the_worse_one() -> None:
    """Published for this rig: 0.276 mm on the right, 0.359 mm on the left, 1.63 times the 0.220 mm on the axis."""
    z, camera = np.array([0.3]), d455_like()
    found = dict(
        zip(CORNERS, (distribution(camera, z, "both", one).half_width[0] for one in towards_corners(0.8)), strict=True)
    )
    assert [round(1e3 * found[one], 3) for one in CORNERS] == [0.276, 0.359, 0.276, 0.359]
    axis = distribution(camera, z, "both").half_width[0]
    assert found["lower left"] / axis == pytest.approx(1.63, abs=0.005)


def test_a_tilt_that_goes_with_the_distance_of_the_array_makes_one_side_of_a_plenoptic_picture_worse() -> None:
    """A tilt t moves the array by x t towards the sensor: with v = a_L/b_L, s = z − f − b_L v errs by z' + (1 + v) x t.

    Its deviation √(σ² + y² τ² + 2 ρ y σ τ), with y = (1 + v) x, is larger where ρ x > 0.
    """
    along, tilt, correlation = 2e-6, 1e-3, 0.8
    joint = JointNormal(
        name="array",
        parameters=("mla_distance", "array_tilt_x"),
        mean=np.zeros(2),
        covariance=np.array([[along**2, correlation * along * tilt], [correlation * along * tilt, tilt**2]]),
        error_class=ErrorClass.RIG,
    )
    camera, share = focused(calibration=Calibration(groups=(joint,))), 0.5
    v = float(camera.virtual_depth(0.4))
    y = (1.0 + v) * share * camera.sensor.width / 2.0
    right, left, *_ = (
        distribution(camera, np.array([0.4]), "calibration", one).half_width[0] for one in towards_corners(share)
    )
    sides = [math.sqrt(along**2 + (y * tilt) ** 2 + 2.0 * sign * correlation * y * along * tilt) for sign in (1, -1)]
    assert max(right, left) / min(right, left) == pytest.approx(max(sides) / min(sides), rel=0.02)


def test_a_place_beyond_the_picture_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="beyond the edge"):
        PicturePlace(across=-1.2, down=0.0)


def test_noise_depends_on_the_distance_from_the_middle_of_the_picture() -> None:
    camera = d455_like()
    assert [camera.field_share(one) for one in towards_corners(0.8)] == pytest.approx([0.8] * 4)
    on_the_side = camera.field_share(PicturePlace(across=-1.0, down=0.0))
    assert on_the_side == pytest.approx(COLUMNS / math.hypot(COLUMNS, ROWS))


BIN = Path(__file__).parents[1] / "data" / "both-sides-of-the-picture" / "bin5.yaml"


@pytest.mark.parametrize(
    ("field", "across", "where"),
    [
        (None, -0.8, "80 % of the way to the lower left corner"),  # the worst of propagation.field_places
        ("0 %", 0.0, "on the axis"),
        ("60 %", -0.6, "60 % of the way to the lower left corner"),
    ],
)
def test_a_requirement_is_judged_at_the_worst_place_of_its_part_of_the_picture(
    field: str | None, across: float, where: str
) -> None:
    study = tradestudy.load(BIN).with_values({} if field is None else {"requirements.near.field": field})
    near, case = study.file.requirements["near"], study.prepared.case
    found = check_requirement(near, case, "d455")
    assert found.value == pytest.approx(half_width_by_rays(across, abs(across), 0.6), rel=5e-3)
    assert found.reason.endswith(where)


def test_a_place_that_misses_the_bound_decides_though_the_axis_meets_it() -> None:
    """1.2 mm lies between 0.869 mm on the axis and 1.337 mm on the left, at 0.6 m."""
    study = tradestudy.load(BIN).with_values({"requirements.near.depth_uncertainty.below": "1.2 mm"})
    near, case = study.file.requirements["near"], study.prepared.case
    assert check_requirement(near, case, "d455").met is False
    assert not is_kept(near.model_copy(update={"camera": "d455"}), case)
    assert check_requirement(near.model_copy(update={"field": 0.0}), case, "d455").met is True


def test_a_part_of_the_picture_reaches_its_edges_and_contains_the_axis() -> None:
    places = places_within(0.8)
    assert len(set(places)) == len(places)
    assert {(one.across, one.down) for one in places} >= {(-0.8, -0.8), (0.8, -0.8), (0.8, 0.0), (0.0, 0.0)}
    aside = "80 % of the way to the left edge and 40 % of the way to the bottom edge"
    assert place_words(PicturePlace(across=-0.8, down=0.4)) == aside
    assert place_words(PicturePlace(across=0.0, down=-0.8)) == "80 % of the way to the top edge"
