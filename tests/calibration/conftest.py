"""A small study of calibrated cameras, written to a file as a person would."""

from __future__ import annotations

STUDY = """
format: 2
study: small
title: Small
question: How sure are cameras that were calibrated on a board?
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {field_of_view: 65.24 deg, across: width, f_number: 8}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    convergence_distance: infinity
    focus_distance: 1 m
    principal_distance: focal_length
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors:
        yaw: {standard_deviation: 0.2 deg}
        pitch: {standard_deviation: 0.2 deg}
        roll: {standard_deviation: 0.2 deg}
        baseline: {standard_deviation: 0.2 mm}
        left_focal_length: {standard_deviation: 20 um}
        right_focal_length: {standard_deviation: 20 um}
        right_principal_point_x: {standard_deviation: 20 um}
      target:
        views: 8
        columns: 4
        rows: 4
        spacing: 100 mm
        distances: [0.8 m, 2.5 m]
        half_field_angle: 6 deg
        tilt: 17 deg
        corner_noise: 0.1 px
        max_steps: 700
  r5:
    kind: focused-plenoptic
    title: R5
    main_lens: &lens {focal_length: 12.5 mm, f_number: 3.8}
    sensor: &sensor {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, types: 3}
    focus: {total_covering_plane: 150 mm, relay: keplerian}
    depth: {estimator: same-type-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors: &array
        mla_distance: {standard_deviation: 5 um}
        focal_length: {standard_deviation: 5 um}
        microlens_gap: {standard_deviation: 2 um}
      target: {views: 8, columns: 4, rows: 4, spacing: 20 mm, distances: [160 mm, 600 mm], half_field_angle: 6 deg,
        tilt: 17 deg, corner_noise: 0.1 px, max_steps: 100}
  views:
    kind: unfocused-plenoptic
    title: Unfocused
    main_lens: *lens
    sensor: *sensor
    microlenses: {layout: hexagonal, pitch: 126.5 um, focal_length: 0.432 mm, f_number: 3.8}
    focus: {distance: 150 mm}
    depth: {estimator: outermost-views, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors: *array
      target: {views: 8, columns: 5, rows: 5, spacing: 20 mm, distances: [130 mm, 300 mm], half_field_angle: 6 deg,
        tilt: 17 deg, corner_noise: 0.1 px, max_steps: 1000}
scene:
  distances: {from: 0.3 m, to: 2 m, points: 3, spacing: log}
  wavelength: 550 nm
propagation: {field_places: [50 %]}
sensitivity: {at: [1 m]}
"""
"""By chance of the few steps the chains of the R5 are too short, and those of the others long enough."""
