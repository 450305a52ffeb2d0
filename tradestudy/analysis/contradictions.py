"""Over-determined inputs held against each other: what a source states and what its other values imply."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tradestudy.cameras.conventional import ConventionalCamera
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo import StereoRig
from tradestudy.cameras.unfocused_plenoptic import UnfocusedPlenoptic
from tradestudy.optics.depth_of_field import hyperfocal_distance
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.cameras import StatedPart
from tradestudy.units import ANGLE, FRACTION, LENGTH, Dimension, pretty

# Values printed with three or four digits agree better than this.
_TOLERANCE = 5e-3
_ANGLE_TOLERANCE = 1e-3
# f-number matching is a rule of thumb of lens design; a few percent neither wastes nor mixes pixels.
_MATCHING_TOLERANCE = 0.05
# A thin lens in place of a real one, at a focus rounded to two digits.
_DEPTH_OF_FIELD_TOLERANCE = 0.1


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Two values of one quantity that cannot both be right."""

    camera: str
    what: str
    stated: str
    implied: str
    used: str


def find_contradictions(definition: StudyDefinition) -> tuple[Contradiction, ...]:
    """Cross-check every camera of a study."""
    found: list[Contradiction] = []
    tolerance = definition.file.accuracy.wanted().relative["depth_uncertainty"]
    for name, camera in definition.case.all_cameras.items():
        stated = definition.file.cameras[name].stated
        if isinstance(camera, FocusedPlenoptic):
            found += _of_lens(name, camera.main_lens, camera.sensor, stated)
            found += _of_array(name, camera, stated)
        elif isinstance(camera, StereoRig):
            found += _of_lens(name, camera.lens, camera.sensor, stated)
            found += _of_principal_distance(name, camera, tolerance)
        elif isinstance(camera, UnfocusedPlenoptic):
            found += _of_lens(name, camera.main_lens, camera.sensor, stated)
            found += _of_array(name, camera, stated)
        elif isinstance(camera, ConventionalCamera):
            found += _of_lens(name, camera.lens, camera.sensor, stated)
            found += _of_conventional(name, camera, stated)
    return tuple(found)


def _of_lens(name: str, lens: Lens, sensor: Sensor, stated: StatedPart | None) -> list[Contradiction]:
    if stated is None:
        return []
    found = []
    if stated.field_of_view is not None:
        across, diagonal = lens.field_of_view(sensor.width), lens.field_of_view(sensor.diagonal)
        if not any(math.isclose(stated.field_of_view, angle, rel_tol=_ANGLE_TOLERANCE) for angle in (across, diagonal)):
            found.append(
                Contradiction(
                    camera=name,
                    what="field of view against focal length and sensor",
                    stated=_show(stated.field_of_view, ANGLE),
                    implied=f"{_show(across, ANGLE)} across, {_show(diagonal, ANGLE)} on the diagonal",
                    used=f"focal length {_show(lens.focal_length, LENGTH)}",
                )
            )
    if stated.hyperfocal_distance is not None:
        implied = float(hyperfocal_distance(lens.focal_length, lens.pupil_diameter, sensor.pixel_pitch))
        if not math.isclose(stated.hyperfocal_distance, implied, rel_tol=_TOLERANCE):
            found.append(
                Contradiction(
                    camera=name,
                    what="hyperfocal distance against focal length, aperture and pixel",
                    stated=_show(stated.hyperfocal_distance, LENGTH),
                    implied=f"{_show(implied, LENGTH)} for a blur of one pixel",
                    used="focal length and f-number",
                )
            )
    return found


def _of_principal_distance(name: str, rig: StereoRig, tolerance: float) -> list[Contradiction]:
    """Depth measured on the scale of the focal length, beside a picture blurred on the longer one of the focus.

    The two differ by the magnification ``f/(a − f)`` of the focus distance a, and so do disparity and its noise.
    """
    if rig.principal_distance_rule != "focal_length" or rig.focus_distance is None or math.isinf(rig.focus_distance):
        return []
    f, focused = rig.lens.focal_length, rig.sensor_distance(rig.focus_distance)
    magnification = focused / rig.focus_distance
    if magnification <= tolerance:
        return []
    return [
        Contradiction(
            camera=name,
            what="principal distance against focus distance",
            stated=f"{_show(f, LENGTH)}, the focal length",
            implied=f"{_show(focused, LENGTH)} as focused at {_show(rig.focus_distance, LENGTH)}: longer by "
            f"{pretty(magnification, FRACTION)}, the magnification f/(a − f); wanted of depth: "
            f"{pretty(tolerance, FRACTION)}",
            used=f"{_show(f, LENGTH)} from disparity to depth, {_show(focused, LENGTH)} for blur; principal_distance: "
            "focused takes one for both, unless the focal length comes from a calibration in pixels",
        )
    ]


def _of_array(
    name: str, camera: FocusedPlenoptic | UnfocusedPlenoptic, stated: StatedPart | None
) -> list[Contradiction]:
    """Distances of a plenoptic camera as stated, and the f-numbers of its microlenses and its main lens."""
    pairs = (
        ("microlens gap", stated.microlens_gap if stated else None, camera.microlenses.gap),
        ("distance from main lens to array", stated.mla_distance if stated else None, camera.mla_distance),
    )
    found = [
        Contradiction(
            camera=name,
            what=what,
            stated=_show(value, LENGTH),
            implied=_show(used, LENGTH),
            used="the implied value",
        )
        for what, value, used in pairs
        if value is not None and not math.isclose(value, used, rel_tol=_TOLERANCE)
    ]
    micro = camera.microlenses.gap / camera.microlenses.pitch
    main = camera.mla_distance / camera.main_lens.pupil_diameter
    if not math.isclose(micro, main, rel_tol=_MATCHING_TOLERANCE):
        found.append(
            Contradiction(
                camera=name,
                what="f-number matching of microlenses and main lens",
                stated=f"main lens f/{main:.3g} on the image side",
                implied=f"microlenses f/{micro:.3g} by pitch and gap",
                used=f"gap {_show(camera.microlenses.gap, LENGTH)}; micro-images "
                + ("leave pixels dark" if micro < main else "overlap"),
            )
        )
    return found


def _of_conventional(name: str, camera: ConventionalCamera, stated: StatedPart | None) -> list[Contradiction]:
    """A stated depth of field against that of the thin lens; what a data sheet counts as sharp is seldom said."""
    if stated is None or stated.depth_of_field is None:
        return []
    one_pixel = BlurCriterion(blur_px=1.0, measure="none", wavelength=1e-6)  # λ does not enter
    extent = camera.single_image.sharp_range(one_pixel).extent
    if math.isclose(stated.depth_of_field, extent, rel_tol=_DEPTH_OF_FIELD_TOLERANCE):
        return []
    return [
        Contradiction(
            camera=name,
            what="depth of field against lens and sensor",
            stated=_show(stated.depth_of_field, LENGTH),
            implied=f"{_show(extent, LENGTH)} for a blur of one pixel; {_show(stated.depth_of_field, LENGTH)} would be "
            f"{stated.depth_of_field / extent:.2g} px",
            used="the blur criteria of the study",
        )
    ]


def _show(value: float, dimension: Dimension) -> str:
    return pretty(value, dimension, digits=4)
