"""The principal distance of a stereo rig as a study declares it, down to what its report says."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tradestudy import load
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.errors import StudyError

STUDIES = Path(__file__).parents[2] / "studies"
CLOSE = STUDIES / "close_range.yaml"


def rig_of(*changes: str) -> StereoRig:
    (rig,) = (c for name, c in load(CLOSE, list(changes)).prepared.case.cameras.items() if name == "pair-declared")
    assert isinstance(rig, StereoRig)
    return rig


def test_the_shipped_rigs_at_close_range_are_focused_and_the_paper_s_is_not() -> None:
    # 15 µm of object on a pixel of 7.4 µm, 55.3 mm away: c is what similar triangles make of it.
    assert rig_of().principal_distance == pytest.approx(7.4 / 15 * 55.3e-3, rel=3e-3)
    stereo = load(STUDIES / "hand_lens.yaml").prepared.case.cameras["stereo"]
    assert isinstance(stereo, StereoRig)
    assert 1 / stereo.principal_distance == pytest.approx(1 / 8e-3 - 1 / 0.15)
    for camera in load(STUDIES / "plenoptic_vs_stereo.yaml").prepared.case.cameras.values():
        assert not isinstance(camera, StereoRig) or camera.principal_distance == camera.lens.focal_length


def test_a_study_is_read_by_the_declared_distance() -> None:
    """Noise of depth at the crossing of the axes, with the sensor where the published image scale puts it."""
    changes = [
        "cameras.pair-f9.8.depth.disparity_error=0.1 px",  # what is derived takes seconds and is not looked at
        "scene.distances.points=9",
        "decision=null",
        "requirements=null",
    ]
    depth = load(CLOSE, changes).run().data["depth"].to_dataset()
    noise = depth["depth_uncertainty_by_error_source"].sel(camera="pair-declared", error_source="noise")
    noise = noise.sel(distance=55.3e-3, method="nearest")
    # Both lines of sight turn by 0.1 px over c; near the crossing, dZ is that times (Z² + B²/4)/B.
    turned = 0.1 * 7.4e-6 / (7.4 / 15 * 55.3e-3)
    assert float(noise) == pytest.approx(turned * (float(noise["distance"]) ** 2 + 4e-3**2) / 8e-3, rel=0.02)


def test_the_report_describes_it() -> None:
    rows = {name: str(value) for name, value in rig_of().properties()}
    assert rows["principal distance"] == rows["thin-lens image distance at the declared focus"] == "27.35 mm"
    rows = {
        name: str(value) for name, value in rig_of("cameras.pair-declared.principal_distance=focal_length").properties()
    }
    assert (rows["principal distance"], rows["thin-lens image distance at the declared focus"]) == (
        "18.3 mm",
        "27.35 mm",
    )
    assert rows["diagonal field of view, from the principal distance"] == "44.03°"  # 14.8 mm behind 18.3 mm
    refocused = ["focus_distance=autofocus", "principal_distance=focal_length"]
    rows = dict(rig_of(*(f"cameras.pair-declared.{change}" for change in refocused)).properties())
    assert str(rows["thin-lens image distance at the declared focus"]).startswith("varies")
    run = load(CLOSE).prepared
    assert any(path[-1] == "principal_distance" for path in run.document.annotations)


def test_a_focus_at_infinity_is_a_focal_length() -> None:
    changes = ["cameras.pair-declared.focus_distance=infinity", "cameras.pair-declared.convergence_distance=infinity"]
    rig = rig_of(*changes)
    assert rig.principal_distance == 18.3e-3
    assert np.isclose(rig.field_of_view, 2 * math.atan(1600 * 7.4e-6 / 2 / 18.3e-3), rtol=1e-15)


def test_lenses_that_refocus_are_refused_with_the_place() -> None:
    with pytest.raises(StudyError, match=r"pair-declared\.principal_distance: .*focus_distance, or .*focal_length"):
        load(CLOSE, ["cameras.pair-declared.focus_distance=autofocus"])
