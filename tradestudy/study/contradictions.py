"""Over-determined inputs held against each other: what a source states and what its other values imply."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.stereo import StereoRig
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.cameras import StatedPart
from tradestudy.units import ANGLE, LENGTH, Dimension, pretty

# Values printed with three or four digits agree better than this.
_TOLERANCE = 5e-3
# f-number matching is a rule of thumb of lens design; a few percent neither wastes nor mixes pixels.
_MATCHING_TOLERANCE = 0.05


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
    for name, camera in definition.case.cameras.items():
        stated = definition.file.cameras[name].stated
        if isinstance(camera, FocusedPlenoptic):
            found += _of_lens(name, camera.main_lens, camera.sensor, stated)
            found += _of_plenoptic(name, camera, stated)
        elif isinstance(camera, StereoRig):
            found += _of_lens(name, camera.lens, camera.sensor, stated)
    return tuple(found)


def _of_lens(name: str, lens: Lens, sensor: Sensor, stated: StatedPart | None) -> list[Contradiction]:
    if stated is None or stated.field_of_view is None:
        return []
    across, diagonal = lens.field_of_view(sensor.width), lens.field_of_view(sensor.diagonal)
    if any(math.isclose(stated.field_of_view, angle, rel_tol=_TOLERANCE / 5.0) for angle in (across, diagonal)):
        return []
    return [
        Contradiction(
            camera=name,
            what="field of view against focal length and sensor",
            stated=_show(stated.field_of_view, ANGLE),
            implied=f"{_show(across, ANGLE)} across, {_show(diagonal, ANGLE)} on the diagonal",
            used=f"focal length {_show(lens.focal_length, LENGTH)}",
        )
    ]


def _of_plenoptic(name: str, camera: FocusedPlenoptic, stated: StatedPart | None) -> list[Contradiction]:
    found = []
    pairs = (
        ("microlens gap", stated.microlens_gap if stated else None, camera.microlenses.gap),
        ("distance from main lens to array", stated.mla_distance if stated else None, camera.mla_distance),
    )
    for what, value, used in pairs:
        if value is not None and not math.isclose(value, used, rel_tol=_TOLERANCE):
            found.append(
                Contradiction(
                    camera=name,
                    what=what,
                    stated=_show(value, LENGTH),
                    implied=_show(used, LENGTH),
                    used="the implied value",
                )
            )
    matched = camera.microlenses.pitch * camera.mla_distance / camera.main_lens.pupil_diameter
    if not math.isclose(matched, camera.microlenses.gap, rel_tol=_MATCHING_TOLERANCE):
        micro, main = (
            camera.microlenses.gap / camera.microlenses.pitch,
            camera.mla_distance / camera.main_lens.pupil_diameter,
        )
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


def _show(value: float, dimension: Dimension) -> str:
    return pretty(value, dimension, digits=4)
