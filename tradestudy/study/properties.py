"""Derived values of a camera that a reader of a report wants beside the declared ones."""

from __future__ import annotations

import math

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.stereo import StereoRig
from tradestudy.units import ANGLE, LENGTH, NUMBER, pretty


def camera_properties(camera: DepthCamera) -> tuple[tuple[str, str], ...]:
    """Name and value of each derived property, in reading order."""
    if isinstance(camera, FocusedPlenoptic):
        return _of_plenoptic(camera)
    if isinstance(camera, StereoRig):
        return _of_stereo(camera)
    return ()


def _of_plenoptic(camera: FocusedPlenoptic) -> tuple[tuple[str, str], ...]:
    array, lens = camera.microlenses, camera.main_lens
    v = float(camera.virtual_depth(math.inf))
    return (
        ("main lens to array z", pretty(camera.mla_distance, LENGTH, 5)),
        ("microlens gap b_L", pretty(array.gap, LENGTH, 4)),
        ("microlens focal lengths f_L", ", ".join(pretty(f, LENGTH, 4) for f in array.focal_lengths)),
        ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
        ("microlens f-number b_L/p", pretty(array.gap / array.pitch, NUMBER, 4)),
        ("pixels per microlens", pretty(array.pitch / camera.sensor.pixel_pitch, NUMBER, 4)),
        ("virtual depth at infinity", pretty(v, NUMBER, 4)),
        ("field of view across", pretty(lens.field_of_view(camera.sensor.width), ANGLE, 4)),
        ("field of view on the diagonal", pretty(lens.field_of_view(camera.sensor.diagonal), ANGLE, 4)),
    )


def _of_stereo(rig: StereoRig) -> tuple[tuple[str, str], ...]:
    return (
        ("focal length", pretty(rig.lens.focal_length, LENGTH, 4)),
        ("pupil diameter", pretty(rig.lens.pupil_diameter, LENGTH, 4)),
        ("field of view across", pretty(rig.field_of_view, ANGLE, 4)),
        ("field of view on the diagonal", pretty(rig.lens.field_of_view(rig.sensor.diagonal), ANGLE, 4)),
        ("baseline", pretty(rig.baseline, LENGTH, 4)),
    )
