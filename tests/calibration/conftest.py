"""Small studies with calibration errors, written to files as a person would."""

from __future__ import annotations

from pathlib import Path

import pytest

STUDIES = Path(__file__).parents[2] / "studies"

HEAD = """
format: 1
study: small
title: Small
question: How sure?
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 30.5 mm, f_number: 8}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    axes_meet_at: infinity
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration: {yaw: {standard_deviation: 0.2 deg}}
  other: {like: rig, title: Other, calibration: {yaw: {standard_deviation: 0.1 deg}}}
  r5:
    kind: focused-plenoptic
    title: R5
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, types: 3}
    focus: {total_covering_plane: 150 mm, relay: keplerian}
    depth: {estimator: same-type-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      mla_distance: {standard_deviation: 2 um}
      focal_length: {standard_deviation: 2 um}
      correlation: 0.9
      microlens_gap: {standard_deviation: 0.2 um}
scene:
  distances: {from: 0.3 m, to: 10 m, points: 11, spacing: log}
  wavelength: 550 nm
calibration:
  seed: 0
  distances: [0.5 m, 1 m, 3 m, 10 m]
  edge: 50 %
  accuracy: 0.5 %
  budget: 65536
  cameras:
"""


@pytest.fixture
def written(tmp_path: Path):
    """Write the small study with the given cameras of its calibration part, and what follows it."""

    def write(cameras: str, after: str = "") -> Path:
        file = tmp_path / "small.yaml"
        indented = "\n".join("    " + line for line in cameras.strip("\n").splitlines())
        file.write_text(HEAD + indented + "\n" + after, encoding="utf-8")
        return file

    return write
