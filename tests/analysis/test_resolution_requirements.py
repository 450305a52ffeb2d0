"""Requirements on lateral resolution: diffraction counts, and cameras that measure no depth can meet them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import Judge, is_kept
from tradestudy.errors import StudyError

DATA = Path(__file__).parents[1] / "data"
DIFFRACTION = DATA / "diffraction-and-resolution" / "diff.yaml"
ANY_CAMERA = DATA / "any-camera" / "two.yaml"


def answers(study: tradestudy.Study) -> tuple[RequirementAnswer, dict[str, RequirementAnswer]]:
    one, every = Judge().answer(study.file.requirements["fine"], study.prepared.case)
    return one, dict(every)


def test_an_aperture_of_375_um_does_not_resolve_60_um_at_300_mm() -> None:
    """Airy radius 1.21967 · 0.55 µm · 301 mm/375 µm = 538.4 µm; a pixel covers 53 µm there."""
    study = tradestudy.load(DIFFRACTION)
    one, _ = answers(study)
    assert one.met is False
    assert one.value == pytest.approx(538.4e-6, rel=1e-3)
    assert one.place == pytest.approx(0.301)
    assert one.reason == "worst 538 µm at 0.301 m, by diffraction"
    # Wide open, the pixel decides: 2.2 µm (300 − 12)/12 at 300 mm, and 301/300 of it at the far end.
    wide, _ = answers(study.with_values({"s.lenses.f_number": 2}))
    assert wide.met
    assert wide.value == pytest.approx(2.2e-6 * 24 * 301 / 300, rel=1e-9)
    assert "by sampling" in wide.reason
    # Focused elsewhere, blur decides: A |a − a₀|/a₀ with A = 6 mm, largest at the far end.
    blurred, _ = answers(study.with_values({"s.lenses.f_number": 2, "s.focus_distance": "290 mm"}))
    assert blurred.value == pytest.approx(6e-3 * 11 / 290, rel=1e-9)
    assert "by blur" in blurred.reason


def test_a_focus_stack_counts_for_any_camera() -> None:
    """Airy radius at 100 mm: 1.21967 · 0.55 µm · 100 mm · 9.8/18.3 mm = 35.9 µm; a pixel of the rig: 147 µm."""
    study = tradestudy.load(ANY_CAMERA)
    one, every = answers(study)
    assert (one.met, one.camera) == (True, "conv")
    assert one.value == pytest.approx(35.92e-6, rel=1e-3)
    assert set(every) == {"conv", "s"}
    assert every["s"].met is False
    assert every["s"].value == pytest.approx(20e-6 * (100 - 12) / 12, rel=1e-9)
    assert is_kept(study.file.requirements["fine"], study.prepared.case)
    named, every = answers(study.with_values({"requirements.fine.camera": "conv"}))
    assert named.met
    assert list(every) == ["conv"]
    worst, _ = answers(study.with_values({"requirements.fine.camera": "all"}))
    assert (worst.met, worst.camera) == (False, "s")


@pytest.mark.usefixtures("empty_figures")
def test_the_answer_names_the_conventional_camera_everywhere(tmp_path: Path) -> None:
    result = tradestudy.load(ANY_CAMERA).run()
    line = next(line for line in result.lines() if line.startswith("Met"))
    assert "by Conventional stack (worst 35.9 µm at 0.1 m, by diffraction" in line
    reported = result.conclusions()["requirements"][0]
    assert (reported["met"], reported["camera"]) == (True, "Conventional stack")
    result.write(tmp_path, pdf=False)
    assert "Conventional stack" in (tmp_path / "report.html").read_text(encoding="utf-8")
    found = result.data["depth_of_field"].to_dataset()
    parts = [found[f"resolution_of_{part}"] for part in ("sampling", "blur", "diffraction")]
    np.testing.assert_array_equal(found["lateral_resolution"], np.max(np.stack(parts), axis=0))


def test_a_sweep_of_the_wavelength_moves_the_limit_of_diffraction() -> None:
    study = tradestudy.load(DIFFRACTION)
    judge = Judge()
    values = []
    for wavelength in ("400 nm", "800 nm"):
        changed = study.with_values({"scene.wavelength": wavelength})
        values.append(judge.answer(changed.file.requirements["fine"], changed.prepared.case)[0].value)
    assert values[1] / values[0] == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize(
    "quantity",
    [
        {"depth_uncertainty": {"below": "1 mm", "over": ["30 mm", "100 mm"]}},
        {"usable": {"over": ["30 mm", "100 mm"]}},
        {"overlap": {"above": "50 %", "over": ["30 mm", "100 mm"]}},
        {"failed_fraction": {"below": "5 %", "over": ["30 mm", "100 mm"]}},
    ],
)
def test_what_needs_depth_still_refuses_a_camera_that_measures_none(quantity: dict[str, Any]) -> None:
    with pytest.raises(StudyError, match="measures no depth"):
        tradestudy.load(ANY_CAMERA).with_values({"requirements.own": {"says": "own", "camera": "conv", **quantity}})


def test_a_study_without_any_depth_can_require_resolution(tmp_path: Path) -> None:
    text = ANY_CAMERA.read_text(encoding="utf-8")
    start, end = text.index("  s:\n"), text.index("scene:")
    (tmp_path / "one.yaml").write_text(text[:start] + text[end:], encoding="utf-8")
    one, _ = answers(tradestudy.load(tmp_path / "one.yaml"))
    assert (one.met, one.camera) == (True, "conv")
