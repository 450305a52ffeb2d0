"""Derived values of a camera that a reader of a report wants beside the declared ones."""

from __future__ import annotations

import math

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.conventional import ConventionalCamera
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.parts import MicrolensArray
from tradestudy.cameras.stereo import StereoRig
from tradestudy.cameras.unfocused_plenoptic import UnfocusedPlenoptic
from tradestudy.optics.microlens_coverage import covering_microlens_object_distance, covering_radius_over_pitch
from tradestudy.optics.thin_lens import object_distance
from tradestudy.units import ANGLE, FRACTION, LENGTH, NUMBER, pretty

_CELL_OVER_PITCH_SQUARED = {"hexagonal": math.sqrt(3.0) / 2.0, "square": 1.0}


def camera_properties(camera: Camera) -> tuple[tuple[str, str], ...]:
    """Name and value of each derived property, in reading order."""
    if isinstance(camera, FocusedPlenoptic):
        return _of_plenoptic(camera)
    if isinstance(camera, StereoRig):
        return _of_stereo(camera)
    if isinstance(camera, UnfocusedPlenoptic):
        return _of_unfocused(camera)
    if isinstance(camera, ConventionalCamera):
        return _of_conventional(camera)
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
        ("fill factor of the array", _fill_factor(array)),
        ("virtual depth at infinity", pretty(v, NUMBER, 4)),
        ("two lenses see every point from", _covered_from(camera)),
        ("field of view across", pretty(lens.field_of_view(camera.sensor.width), ANGLE, 4)),
        ("field of view on the diagonal", pretty(lens.field_of_view(camera.sensor.diagonal), ANGLE, 4)),
    )


def _of_stereo(rig: StereoRig) -> tuple[tuple[str, str], ...]:
    # Beside the principal distance, so that a reader sees how far the two lie apart where the rule makes them differ.
    sensor = "changes" if rig.focus_distance is None else pretty(rig.sensor_distance(rig.focus_distance), LENGTH, 4)
    return (
        ("focal length", pretty(rig.lens.focal_length, LENGTH, 4)),
        ("principal distance", pretty(rig.principal_distance, LENGTH, 4)),
        ("thin lens to sensor, as focused", sensor),
        ("pupil diameter", pretty(rig.lens.pupil_diameter, LENGTH, 4)),
        ("field of view across", pretty(rig.field_of_view, ANGLE, 4)),
        ("field of view on the diagonal", pretty(rig.view_of(rig.sensor.diagonal), ANGLE, 4)),
        ("baseline", pretty(rig.baseline, LENGTH, 4)),
    )


def _of_unfocused(camera: UnfocusedPlenoptic) -> tuple[tuple[str, str], ...]:
    array, lens = camera.microlenses, camera.main_lens
    return (
        ("main lens to array z", pretty(camera.mla_distance, LENGTH, 5)),
        ("microlens focal lengths f_L", pretty(array.gap, LENGTH, 4)),
        ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
        ("microlens f-number b_L/p", pretty(array.gap / array.pitch, NUMBER, 4)),
        ("image-side f-number of the main lens", pretty(camera.mla_distance / lens.pupil_diameter, NUMBER, 4)),
        ("pixels per microlens", pretty(array.pitch / camera.sensor.pixel_pitch, NUMBER, 4)),
        ("fill factor of the array", _fill_factor(array)),
        ("micro-image of the pupil", pretty(camera.micro_image_diameter, LENGTH, 4)),
        ("views", f"{camera.views}, {camera.views_across} across"),
        ("pupil of one view", pretty(camera.view_pupil_diameter, LENGTH, 4)),
        ("refocus distance, shift of one microlens nearer", pretty(float(camera.refocus_distance(1.0)), LENGTH, 4)),
        ("refocus distance, shift of one microlens farther", pretty(float(camera.refocus_distance(-1.0)), LENGTH, 4)),
        ("field of view across", pretty(lens.field_of_view(camera.sensor.width), ANGLE, 4)),
        ("field of view on the diagonal", pretty(lens.field_of_view(camera.sensor.diagonal), ANGLE, 4)),
    )


def _of_conventional(camera: ConventionalCamera) -> tuple[tuple[str, str], ...]:
    lens, single = camera.lens, camera.single_image
    rows = [
        ("focal length", pretty(lens.focal_length, LENGTH, 4)),
        ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
        ("focused at, from the principal plane", pretty(camera.focus_distance, LENGTH, 4)),
        ("working f-number", pretty(single.working_f_number, NUMBER, 4)),
        ("field of view across", pretty(lens.field_of_view(camera.sensor.width), ANGLE, 4)),
        ("field of view on the diagonal", pretty(lens.field_of_view(camera.sensor.diagonal), ANGLE, 4)),
    ]
    if math.isfinite(camera.focus_distance):
        scale = float(single.lateral_resolution(camera.focus_distance))
        rows.insert(3, ("image scale in focus, per pixel", pretty(scale, LENGTH, 4)))
    if camera.front_to_principal_plane is not None:
        working = camera.focus_distance - camera.front_to_principal_plane
        rows.insert(3, ("working distance, from the front of the lens", pretty(working, LENGTH, 4)))
    if camera.stack is not None:
        ends = " to ".join(pretty(end, LENGTH) for end in (camera.stack.near, camera.stack.far))
        rows.append(("focus stack", f"up to {camera.stack.most_images} images, {ends}"))
    return tuple(rows)


def _fill_factor(array: MicrolensArray) -> str:
    """Share of the array that passes light, and the diameters behind it."""
    aperture, pitch = array.aperture_diameter, array.pitch
    area = math.pi / 4.0 * aperture**2 / (_CELL_OVER_PITCH_SQUARED[array.layout] * pitch**2)
    return f"{pretty(area, FRACTION)} ({pretty(aperture, LENGTH, 4)} on {pretty(pitch, LENGTH, 4)})"


def _covered_from(camera: FocusedPlenoptic) -> str:
    """Exact distance from which (Keplerian), or up to which (Galilean), two lenses of any type see every point."""
    array = camera.microlenses
    keplerian = array.gap >= array.focal_lengths[0]
    needed = covering_radius_over_pitch(at_least=2, layout=array.layout)
    if not keplerian and 2.0 * needed * array.pitch > camera.main_lens.pupil_diameter:
        return "nowhere"
    a_L = float(
        covering_microlens_object_distance(
            needed,
            mla_distance=camera.mla_distance,
            pupil_diameter=camera.main_lens.pupil_diameter,
            microlens_pitch=array.pitch,
            keplerian=keplerian,
        )
    )
    shift = camera.mla_distance - a_L - camera.main_lens.focal_length
    if shift <= 0.0:
        return "nowhere" if keplerian else "everywhere"
    distance = pretty(float(object_distance(shift, camera.main_lens.focal_length)), LENGTH, 4)
    return distance if keplerian else f"the lens to {distance}"
