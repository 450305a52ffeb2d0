"""Light on workers: rings of source points, microlenses apart, and point-spread functions, with the same bits."""

from __future__ import annotations

import pickle
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import tradestudy
from tests.execution.test_execution import assert_same_results
from tests.study.test_light_spot import SMALL
from tests.study.test_light_spot import STUDY as SPOT_STUDY
from tests.study.test_spot_light import DISC, LOOSE, PATH, SPECTRUM, rng, study
from tradestudy.execution import Checkpoints, Processes, Serial, Steps, Threads
from tradestudy.models import spot_images
from tradestudy.models.spot_images import SpotModels, compared_models
from tradestudy.optics.chain.accuracy import ChainImage, Part, in_turn
from tradestudy.optics.chain.image import chain_image, separate_image
from tradestudy.optics.chain.scene import FRESNEL
from tradestudy.optics.chain.spot_points import SpotRequest, follow_points

STUDIES = SPOT_STUDY.parent


def parts_of(image_of: object, source: object = DISC) -> list[Part]:
    """What one picture hands over to be computed."""
    heard: list[Part] = []

    def compute(parts: list[Part], reported: object) -> list[object]:
        heard.extend(parts)
        return in_turn(parts, lambda _share: None)

    image_of(PATH, source, wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE, rng=rng(), compute=compute)  # type: ignore[operator]  # a function of the chain
    return heard


def test_a_picture_is_cut_into_rings_and_into_microlenses() -> None:
    rings = parts_of(chain_image)
    assert len(rings) > 8  # even and odd angles of four rings at least, and those for the error
    assert all(len(part.args[1]) <= 16 for part in rings if isinstance(part, partial) and part.func is follow_points)
    assert len(parts_of(separate_image, DISC.centre)) == len(PATH.microlenses.centres)


def test_a_part_in_another_process_needs_nothing_of_this_one() -> None:
    for part in parts_of(chain_image):
        here, there = part(), pickle.loads(pickle.dumps(part))()
        assert pickle.dumps(here) == pickle.dumps(there)


def test_requests_that_arrive_one_by_one_are_one_object() -> None:
    request = SpotRequest(path=PATH, source=DISC, wavelength=550e-9, legs=FRESNEL, accuracy=LOOSE)
    first, second = (pickle.loads(pickle.dumps(request)) for _ in range(2))
    assert first is second
    assert first.path.microlenses.centres.tobytes() == PATH.microlenses.centres.tobytes()
    assert pickle.loads(pickle.dumps(replace(request, wavelength=500e-9))).wavelength == 500e-9


SPREADS = """
point_spread:
  elements: {lens: {title: Lens, focal_length: 12.5 mm, object_distance: 150 mm, f_number: 8}}
  lens_phase: parabolic
  pixel_pitch: 12 um
  window: 6
  rms_radius: 5
  f_numbers: [8]
  wavelengths: [550 nm]
  reference_wavelength: 550 nm
  field_angles: [0 deg]
  defocus: [0 waves, 0.5 waves]
  tolerance: 1e-4
accuracy: {tolerance: 20 %}
"""


def test_a_light_spot_has_the_same_bits_everywhere(tmp_path: Path, two_processes: Processes) -> None:
    two = (SPECTRUM, "spectrum: {wavelengths: [500 nm, 600 nm], weights: [1, 1]}")
    study(tmp_path, two, ("\naccuracy: {tolerance: 20 %}\n", SPREADS))
    path = tmp_path / "study.yaml"
    results = []
    for executor in (Serial(), two_processes):
        spot_images._spot_picture.cache_clear()
        results.append(tradestudy.load(path).run(executor=executor))
    assert_same_results(*results)
    points = results[1].run_record["points"]
    assert points == results[0].run_record["points"]
    assert points["image of the spot"]["computed"] > 2 * 8  # of each wavelength
    assert points["point spread"]["computed"] == 2 * (3 + 2)  # laws, one thing varied at a time


def test_microlenses_apart_have_the_same_bits_everywhere(two_processes: Processes) -> None:
    part = tradestudy.load(SPOT_STUDY, SMALL).file.light_spot
    assert part is not None
    part = part.model_copy(update={"microlenses": part.microlenses.model_copy(update={"lenses_across": 3})})
    models = SpotModels(method="fresnel", tolerance=0.05, separate=True, point=True)
    images = []
    for executor in (Serial(), Threads(2), two_processes):
        spot_images._spot_picture.cache_clear()
        images.append(spot_images.spot_picture(part, models, steps=Steps(executor=executor)))
    assert len({one.pixels.tobytes() for one in images}) == 1
    assert len({one.numerical_error for one in images}) == 1


def test_an_interrupted_spot_is_resumed(tmp_path: Path) -> None:
    part = tradestudy.load(SPOT_STUDY, SMALL).file.light_spot
    assert part is not None
    images: list[ChainImage] = []
    for taken_up in (False, True):
        spot_images._spot_picture.cache_clear()
        steps = Steps(checkpoints=Checkpoints(tmp_path))
        images.append(spot_images.spot_picture(part, compared_models(part, "fresnel"), steps=steps))
        assert steps.checkpoints is not None
        steps.checkpoints.close()
        (counts,) = steps.counts.values()
        assert (counts["taken up"] > 0, counts["computed"] > 0) == (taken_up, not taken_up)
    assert images[0].pixels.tobytes() == images[1].pixels.tobytes()


def test_fresnel_validity_has_the_same_bits_everywhere(two_processes: Processes) -> None:
    changes = [
        "fresnel_validity.f_numbers=[3.8, 5.6, 8]", "fresnel_validity.wavelengths=[450 nm]",
        "fresnel_validity.windows=[5]", "fresnel_validity.lens_phases=[parabolic]", "claims={}", "readings={}",
    ]  # fmt: skip
    file = STUDIES / "fresnel_validity.yaml"
    one, other = (tradestudy.load(file, changes).run(executor=executor) for executor in (Serial(), two_processes))
    assert_same_results(one, other)
    assert one.run_record["points"] == other.run_record["points"]
    assert np.isfinite(one.data["fresnel_validity"]["psf_error"].values).all()
