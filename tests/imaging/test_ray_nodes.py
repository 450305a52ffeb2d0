"""Rays of a pixel: their moments, and how far pictures by the declared number of them are from converged ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tradestudy import api
from tradestudy.imaging.render.nodes import nodes
from tradestudy.imaging.render.tiles import FINER, Tile, expected_electrons
from tradestudy.models.rendered_scene import declared_image, recording_of, set_up, whole_pictures
from tradestudy.optics.arrays import FloatArray

STUDY = Path(__file__).parents[2] / "studies" / "rock_scene.yaml"
SIDE, PLACES = 16, 3


@pytest.mark.parametrize("count", [*range(5, 21), 64, 192])
def test_any_number_of_nodes_with_its_filter_has_the_moments_of_pixel_and_disc(count: int) -> None:
    """A unit square has 1/12 along an axis, a unit disc 1/4; place on the pixel and on the lens are independent."""
    found = nodes(count)
    both = np.concatenate([found.pixel, found.disc], axis=1)
    assert both.mean(axis=0) == pytest.approx(np.zeros(4), abs=1e-12)
    filtered = np.diag([found.pixel_spread] * 2 + [found.disc_spread] * 2)
    exact = np.diag([1 / 12, 1 / 12, 1 / 4, 1 / 4])
    assert np.cov(both.T, bias=True) + filtered == pytest.approx(exact, abs=1e-12)
    assert np.max(np.hypot(*found.disc.T)) < 1.0


@pytest.mark.parametrize("count", range(6, 17))
@pytest.mark.parametrize("blend", [0.0, 0.5, -0.5, 1.0])
def test_few_rays_do_not_coincide_at_any_depth(count: int, blend: float) -> None:
    """Neither on an object in focus, where places on the pixel count, nor in the pupil, nor in between."""
    found = nodes(count)
    seen = 2.0 * (1.0 - abs(blend)) * found.pixel + blend * found.disc
    apart = np.hypot(*(seen[:, None] - seen[None]).T)[~np.eye(count, dtype=bool)]
    assert np.min(apart) > 0.1 / np.sqrt(count)


@pytest.fixture(scope="module")
def whole() -> dict[str, Tile]:
    """The first picture of every camera, of the whole sensor, by rays."""
    loaded = api.load(STUDY).with_values({"r5-unfocused.sensor.pixels": [2048, 2048]})
    study = loaded.prepared
    image, picture = declared_image(study)
    scene, cameras = set_up(study, rig="as-designed")
    return {
        one.name: whole_pictures(study, image, scene, one, recording_of(image, picture, one.camera.sensor))[0]
        for one in cameras
    }


def patches(whole: Tile, samples: int) -> FloatArray:
    """Light on squares of pixels spread evenly over the sensor."""
    found = []
    for row in range(PLACES):
        for column in range(PLACES):
            top, left = (
                int((k + 0.5) * size / PLACES) for k, size in ((row, whole.rows[1]), (column, whole.columns[1]))
            )
            part = replace(whole, rows=(top, top + SIDE), columns=(left, left + SIDE), samples=samples)
            found.append(expected_electrons(part)[0])
    return np.array(found)


@pytest.mark.parametrize("camera", ["r5-unfocused", "r5", "stereo", "stack"])
def test_pictures_are_within_half_a_percent_of_sixteen_times_the_rays(whole: dict[str, Tile], camera: str) -> None:
    tile = whole[camera]
    few, many = (patches(tile, factor * tile.samples) for factor in (1, FINER))
    assert np.linalg.norm(few - many) < 0.5e-2 * np.linalg.norm(many)
