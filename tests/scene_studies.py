"""Text of small studies whose scene is rendered, for tests of pictures and of depth in them."""

from __future__ import annotations

STUDY = """
format: 2
study: small
title: Small pictures
question: What do they show?
{effects}
cameras:
{cameras}
scene:
  distances: {{{distances}}}
  wavelength: 550 nm
  picture:
    texture: {{contrast: {contrast}, correlation_length: {length}}}
    matching_window: {window}
    light: {{electrons: 8000 electrons, {light}}}
    read_noise: 10 electrons
    full_well: 40000 electrons
    bit_depth: 12
  image:
    surfaces: [{surfaces}]
    {more}
"""
BY_RAYS = "effects: {main_lens_diffraction: 'off', microlens_diffraction: 'off'}"
PAIR = """
  {name}:
    kind: stereo
    title: {title}
    lenses: {{focal_length: 8 mm, f_number: 8}}
    sensor: {{pixels: {pixels}, pixel_pitch: 10 um}}
    baseline: {baseline}
    convergence_distance: {convergence}
    focus_distance: 150 mm
    principal_distance: focused
    depth: {{estimator: disparity, disparity_error: {error}, discrimination_step: 0.1 px}}
"""
PLENOPTIC = """
  plenoptic:
    kind: focused-plenoptic
    title: Plenoptic
    main_lens: {{focal_length: 12.5 mm, f_number: 3.8}}
    sensor: {{pixels: {pixels}, pixel_pitch: 5.5 um}}
    microlenses: {{layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, types: 3}}
    focus: {{total_covering_plane: 135 mm, relay: keplerian}}
    depth: {{estimator: {estimator}, {lenses}disparity_error: 0.1 px, discrimination_step: 0.1 px}}
"""


def scene_study(
    cameras: str,
    surfaces: str,
    *,
    distances: str,
    window: str,
    light: str,
    contrast: str = "15 %",
    length: str = "1 mm",
    more: str = "",
    effects: str = BY_RAYS,
) -> str:
    """A study of cameras that take a scene."""
    return STUDY.format(
        cameras=cameras,
        surfaces=surfaces,
        distances=distances,
        window=window,
        light=light,
        contrast=contrast,
        length=length,
        more=more,
        effects=effects,
    )
