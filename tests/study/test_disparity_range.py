"""A stereo matcher with a largest disparity measures nothing nearer than focal length times baseline over it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import tradestudy
from tests.cameras.builders import stereo
from tradestudy.cameras.depth_map import DepthSearch
from tradestudy.errors import OutOfRangeError

STUDY = """
format: 2
study: oak
title: OAK-like rig
question: From which distance does it measure?
cameras:
  oak:
    kind: stereo
    title: OAK-like
    lenses: {focal_length: 2.646 mm, f_number: 2}
    sensor: {pixels: [1280, 800], pixel_pitch: 3 um}
    baseline: 75 mm
    focus_distance: 1 m
    depth: {disparity_error: 0.2 px, disparity_range: 95 px}
scene: {distances: {from: 0.5 m, to: 3 m, points: 40, spacing: log}, wavelength: 850 nm}
requirements:
  near: {says: usable from 0.6 m, camera: oak, depth_uncertainty: {below_relative: 2 %, over: [0.6 m, 2 m]}}
"""
NEAREST = 882.0 * 75e-3 / 95.0  # f in pixels times baseline over the largest disparity


def study(tmp_path: Path, text: str = STUDY) -> tradestudy.Study:
    (tmp_path / "oak.yaml").write_text(text, encoding="utf-8")
    return tradestudy.load(tmp_path / "oak.yaml")


def test_search_range_sets_the_near_end_and_the_verdict(tmp_path: Path) -> None:
    data = study(tmp_path).run().data
    depth, row = data["depth"].to_dataset().isel(camera=0), data["requirements"].to_dataset().sel(requirement="near")
    assert float(depth["usable_near"][0]) == pytest.approx(NEAREST, rel=1e-9)
    assert str(depth["near_limit"].values[0]) == "disparity_range"
    assert int(row["met"]) == 0
    assert "search range" in str(row["reason"].values)
    unlimited = study(tmp_path, STUDY.replace(", disparity_range: 95 px", "")).run().data
    assert int(unlimited["requirements"].to_dataset().sel(requirement="near")["met"]) == 1


def test_matcher_of_depth_maps_searches_no_farther() -> None:
    pytest.importorskip("cv2")
    from tradestudy.cameras.stereo.depth_reading import PairReader

    rig, search = (
        stereo(disparity_range_px=95.0),
        DepthSearch(near=0.5, far=10.0, window_px=9, largest_deviation_px=0.5),
    )
    whole = PairReader(camera=replace(rig, disparity_range_px=None), search=search)
    assert max(whole._steps) > 600  # 3050 px · 100 mm / 0.5 m
    assert max(PairReader(camera=rig, search=search)._steps) == 95


def test_search_range_is_positive() -> None:
    with pytest.raises(OutOfRangeError, match="disparity range"):
        stereo(disparity_range_px=0.0)
