"""Principal planes, pupils and the front of the housing as studies declare them."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

import tradestudy
from tests.study.test_camera_objects import PLENOPTIC, SMALL
from tests.study.test_python_studies import RIG
from tradestudy.cameras.conventional.design import ConventionalCamera
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.errors import StudyError
from tradestudy.report.document import Table
from tradestudy.report.sections.depth_numbers import describe_datasheet
from tradestudy.results.views.groups import origin_words
from tradestudy.results.views.terminal import terminal_lines
from tradestudy.wording import distance

MAIN = PLENOPTIC["main_lens"]
VIEWS = {
    **PLENOPTIC,
    "kind": "unfocused-plenoptic",
    "microlenses": {"layout": "square", "pitch": 60e-6, "focal_length": "f-number-matching"},
    "focus": {"distance": 0.3},
    "depth": {"estimator": "least-squares", "disparity_error": 0.1},
}
STACK = {
    "kind": "conventional",
    "lens": {"focal_length": 0.025, "f_number": 4},
    "sensor": {"pixels": [1000, 800], "pixel_pitch": 5e-6},
    "focus": {"distance": 0.3},
}
LENS_OF = {"stereo": "lenses", "conventional": "lens"}


def study(camera: dict[str, Any], **lens: Any) -> tradestudy.Study:
    part = LENS_OF.get(camera["kind"], "main_lens")
    changed = {**camera, part: {**camera[part], **lens}}
    return tradestudy.load({**SMALL, "cameras": {"one": {key: v for key, v in changed.items() if v is not None}}})


@pytest.mark.parametrize("camera", [RIG, PLENOPTIC, VIEWS, STACK], ids=lambda one: one["kind"])
def test_every_kind_of_camera_takes_the_keys(camera: dict[str, Any]) -> None:
    f = camera[LENS_OF.get(camera["kind"], "main_lens")]["focal_length"]
    given = study(camera, f_number=None, entrance_pupil_diameter=f / 4, exit_pupil=-0.3 * f, principal_separation=-2e-3)
    lens = given.prepared.case.all_cameras["one"].gathering_lens
    assert lens.f_number == pytest.approx(4.0, rel=1e-15)
    assert 1.0 / lens.exit_pupil == pytest.approx(1.0 / lens.entrance_pupil + 1.0 / f, rel=1e-12)
    assert lens.exit_pupil == pytest.approx(-0.3 * f, rel=1e-12)
    telecentric = study(camera, exit_pupil=math.inf).prepared.case.all_cameras["one"]
    assert telecentric.gathering_lens.exit_pupil == math.inf
    assert ("exit pupil, behind the second principal plane", "∞") in [(k, str(v)) for k, v in telecentric.properties()]


@pytest.mark.parametrize("camera", [RIG, PLENOPTIC, VIEWS, STACK], ids=lambda one: one["kind"])
def test_pupils_that_contradict_each_other_are_reported(camera: dict[str, Any]) -> None:
    part = LENS_OF.get(camera["kind"], "main_lens")
    f = camera[part]["focal_length"]
    agree = study(camera, entrance_pupil=0.5 * f, exit_pupil=f / 3.0)
    assert not [one for one in agree.warnings if "exit pupil" in str(one)]
    (warning,) = [
        one for one in study(camera, entrance_pupil=0.5 * f, exit_pupil=0.5 * f).warnings if "exit" in str(one)
    ]
    assert f"{part}.exit_pupil" in str(warning)


DRIFTING = {**PLENOPTIC, "calibration": {"errors": {"pupil_distance": {"standard_deviation": 1e-5}}}}


@pytest.mark.parametrize(
    ("camera", "lens", "message"),
    [
        (PLENOPTIC, {"entrance_pupil_diameter": 3e-3}, "exactly one of f_number and entrance_pupil_diameter"),
        (PLENOPTIC, {"f_number": None}, "exactly one of f_number and entrance_pupil_diameter"),
        (RIG, {"f_number": 4, "entrance_pupil_diameter": 3e-3}, "exactly one of f_number and entrance_pupil_diameter"),
        (DRIFTING, {"exit_pupil": math.inf}, "errors.pupil_distance: the exit pupil lies at infinity"),
        (PLENOPTIC, {"exit_pupil": 0.0125}, "telecentric in object space"),
        (PLENOPTIC, {"entrance_pupil": -0.3}, "entrance_pupil of the main lens"),
        (VIEWS, {"entrance_pupil": -0.6}, "entrance_pupil of the main lens"),
        (RIG, {"entrance_pupil": -0.3}, "in front of the front focal point"),
    ],
)
def test_refusals(camera: dict[str, Any], lens: dict[str, Any], message: str) -> None:
    with pytest.raises(StudyError, match=message):
        study(camera, **lens)


def test_working_distance_counts_from_the_declared_front() -> None:
    camera = {**STACK, "focus": {"working_distance": 0.2}}
    with pytest.raises(StudyError, match="housing_front"):
        study(camera)
    found = study(camera, housing_front=0.03, entrance_pupil=0.004).prepared.case.all_cameras["one"]
    assert isinstance(found, ConventionalCamera)
    assert found.focus_distance == pytest.approx(0.234, rel=1e-12)
    assert found.front == pytest.approx(0.034, rel=1e-12)


def test_matched_f_numbers_and_the_covering_plane_with_a_pupil() -> None:
    """The gap is pitch × (distance of the exit pupil)/(its diameter), and the plane is where |v| is 2."""
    camera = study(PLENOPTIC, exit_pupil=-8e-3).prepared.case.cameras["one"]
    assert isinstance(camera, FocusedPlenoptic)
    lens, array = camera.main_lens, camera.microlenses
    leaving = lens.pupil_diameter * lens.exit_pupil / lens.entrance_pupil
    assert array.gap / array.pitch == pytest.approx((camera.mla_distance + 8e-3) / leaving, rel=1e-12)
    assert float(camera.virtual_depth(0.15)) == pytest.approx(2.0, rel=1e-9)
    assert not [one for one in study(PLENOPTIC, exit_pupil=-8e-3).warnings if "f-number matching" in str(one)]


@pytest.mark.parametrize("camera", [RIG, PLENOPTIC, VIEWS], ids=lambda one: one["kind"])
def test_depth_of_401_distances_in_a_tenth_of_a_second(camera: dict[str, Any]) -> None:
    found = study(camera, entrance_pupil=5e-3, housing_front=0.02).cameras["one"]
    distance = np.linspace(0.2, 2.0, 401)
    found.depth_uncertainty(distance)
    times = []
    for shift in (1e-6, 2e-6, 3e-6):
        start = time.process_time()
        found.depth_uncertainty(distance + shift)
        times.append(time.process_time() - start)
    assert min(times) < 0.1


def test_results_say_what_distances_count_from() -> None:
    """In the terminal and the report, with working distances where the front is declared."""
    plain = tradestudy.load({**SMALL, "cameras": {"rig": RIG, "plenoptic": PLENOPTIC}})
    assert origin_words(plain.run().data) == []
    changes = {
        "cameras.plenoptic.main_lens.exit_pupil": -0.02,
        "cameras.plenoptic.main_lens.housing_front": 0.025,
        "cameras.rig.lenses.entrance_pupil": 0.003,
        "cameras.rig.lenses.housing_front": -0.01,
    }
    result = plain.with_values(changes).run()
    cameras = result.data["cameras"].to_dataset()
    assert cameras["front"].values == pytest.approx([-0.007, 0.025], rel=1e-12)
    lines = [
        line.replace("\N{NO-BREAK SPACE}", " ")
        for line in terminal_lines(result.data)
        if line.startswith("Distances of")
    ]
    assert len(lines) == 2
    assert lines[0].endswith("count from the entrance pupil; working distances, from the front, are 7 mm longer")
    assert lines[1].endswith(
        "count from the first principal plane; working distances, from the front, are 25 mm shorter"
    )
    sheets = [block for block in describe_datasheet(result.data) if isinstance(block, Table)]
    first = [table.rows[0] for table in sheets]
    assert all(row[0] == "Working distance, from the front" for row in first)
    near = float(result.data["datasheet"]["sheet_distance"][0])
    assert first[1][1] == distance(near - 0.025)
