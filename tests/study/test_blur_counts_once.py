"""Derived disparity errors contain defocus: a declared limit on blur that alone decides a verdict is named as such."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy import figures
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirements import check_requirement
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.depth.table import judged_uncertainty
from tradestudy.report.contents import compose_report
from tradestudy.study.starter import starter

STUDY = """
format: 2
study: close
title: Close range
question: Which camera measures close objects?
cameras:
  r12:
    kind: focused-plenoptic
    title: R12-like
    main_lens: {focal_length: 49.885 mm, f_number: 4}
    sensor: {pixels: [4080, 3068], pixel_pitch: 5.5 um}
    microlenses:
      layout: hexagonal
      pitch: 0.12744 mm
      gap: 0.33713 mm
      types: 3
      focal_lengths: [0.5827 mm, 0.5240 mm, 0.5606 mm]
    focus: {mla_distance: 56.86 mm}
    depth: {estimator: adjacent-pair, disparity_error: derived}
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 8 mm, f_number: 4}
    sensor: {pixels: [1280, 1024], pixel_pitch: 5 um}
    baseline: 50 mm
    focus_distance: 0.5 m
    depth: {disparity_error: DISPARITY_ERROR}
scene:
  distances: {from: 330 mm, to: 400 mm, points: 30, spacing: log}
  wavelength: 550 nm
  picture:
    texture: {contrast: 30 %, correlation_length: 50 um}
    matching_window: 21 px
    light: {electrons: 20000 electrons, at_f_number: 4}
    read_noise: 10 electrons
    full_well: 200000 electrons
    bit_depth: 16
usable_range: {LIMITS}
requirements:
  r12: {says: 0.6 mm over 16 mm, camera: r12, depth_uncertainty: {below: BOUND, over: [342 mm, 358 mm]}}
  rig: {says: 1 mm over 16 mm, camera: rig, depth_uncertainty: {below: 1 mm, over: [342 mm, 358 mm]}}
"""
TWICE = "although its derived disparity error already contains blur"


def answer(
    tmp_path: Path, camera: str, limits: str = "blur: 2 px", *, bound: str = "0.6 mm", error: str = "derived"
) -> tuple[RequirementAnswer, tradestudy.Study]:
    text = STUDY.replace("LIMITS", limits).replace("BOUND", bound).replace("DISPARITY_ERROR", error)
    (tmp_path / "close.yaml").write_text(text, encoding="utf-8")
    study = tradestudy.load(tmp_path / "close.yaml")
    return check_requirement(study.file.requirements[camera], study.prepared.case, camera), study


def test_only_the_limit_on_blur_rules_out_a_camera_that_is_accurate_throughout(tmp_path: Path) -> None:
    found, study = answer(tmp_path, "r12")
    camera, places = study.prepared.case.cameras["r12"], np.linspace(0.342, 0.358, 161)
    assert judged_uncertainty(camera, places).max() < 0.6e-3  # where the limit excludes it too
    assert camera.estimator_blur_px(places).max() > 2.0
    assert found.met is False
    assert found.limit == "focus"
    assert f"out of focus, {TWICE}; worst " in found.reason
    assert found.reason.endswith("; meets 600 µm throughout, and only blur: 2 px rules it out")


@pytest.mark.parametrize("limits", ["", "blur: 5 px"])
def test_it_meets_the_requirement_without_the_limit_or_with_a_wide_one(tmp_path: Path, limits: str) -> None:
    found, study = answer(tmp_path, "r12", limits)
    assert found.met is True
    assert study.prepared.case.criteria == UsableCriteria(blur_px=5.0 if limits else None)  # nothing is assumed


def test_no_limit_is_blamed_alone_where_the_value_misses_or_nothing_can_be_measured(tmp_path: Path) -> None:
    found, _ = answer(tmp_path, "r12", bound="0.1 mm")
    assert "out of focus" in found.reason
    assert "throughout" not in found.reason
    (tmp_path / "narrow").mkdir()
    searched, _ = answer(tmp_path / "narrow", "rig", "blur: 0.5 px", error="0.1 px, disparity_range: 100 px")
    assert "throughout" not in searched.reason  # the rig's 229 px at 350 mm are never searched


def test_every_declared_limit_that_rules_out_a_rig_is_named(tmp_path: Path) -> None:
    one, study = answer(tmp_path, "rig", "blur: 0.5 px")
    assert study.prepared.case.cameras["rig"].estimator_blur_px(np.array([0.342]))[0] > 0.5
    assert TWICE in one.reason
    assert one.reason.endswith("; meets 1 mm throughout, and only blur: 0.5 px rules it out")
    two, _ = answer(tmp_path, "rig", "blur: 0.5 px, overlap: 99 %", error="0.1 px")
    assert two.reason.endswith("; meets 1 mm throughout, and only overlap: 99 % and blur: 0.5 px rule it out")
    assert "derived" not in two.reason


def test_terminal_page_and_json_say_which_limit_decides(tmp_path: Path) -> None:
    _, study = answer(tmp_path, "rig", "blur: 0.5 px")
    result = study.with_values({"r12": None, "requirements.r12": None}).run()
    says = "meets 1 mm throughout, and only blur: 0.5 px rules it out"
    assert says in "\n".join(result.lines())
    assert says in str(result.conclusions())
    assert says in repr(compose_report(result.data, {}, figures.build(result.data)))


@pytest.mark.parametrize("kind", ["", "plenoptic", "stereo"])
def test_starters_limit_blur_only_of_declared_errors(tmp_path: Path, kind: str) -> None:
    (tmp_path / "new.yaml").write_text(starter("new", kind), encoding="utf-8")
    case = tradestudy.load(tmp_path / "new.yaml").prepared.case
    assert case.criteria.blur_px == 2.0
    assert all(isinstance(camera.disparity_error_px, float) for camera in case.cameras.values())
    assert "derived errors contain it" in starter("new", kind)
