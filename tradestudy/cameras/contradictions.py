"""Over-determined inputs held against each other: what a source states and what its other values imply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.optics.depth_of_field import hyperfocal_distance
from tradestudy.units import ANGLE, LENGTH, Dimension, pretty

if TYPE_CHECKING:  # pydantic is not needed to compute with a camera
    from tradestudy.cameras.stated_declaration import StatedPart

# Values printed with three or four digits agree better than this.
PRINTED_TOLERANCE = 5e-3
_ANGLE_TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Two values of one quantity that cannot both be right."""

    what: str
    stated: str
    implied: str
    used: str


def lens_contradictions(lens: Lens, sensor: Sensor, stated: StatedPart | None) -> list[Contradiction]:
    """Field of view and hyperfocal distance as stated, against those of focal length, aperture and sensor."""
    if stated is None:
        return []
    found = []
    if stated.field_of_view is not None:
        across, diagonal = lens.field_of_view(sensor.width), lens.field_of_view(sensor.diagonal)
        if not any(math.isclose(stated.field_of_view, angle, rel_tol=_ANGLE_TOLERANCE) for angle in (across, diagonal)):
            found.append(
                Contradiction(
                    what="field of view against focal length and sensor",
                    stated=show(stated.field_of_view, ANGLE),
                    implied=f"{show(across, ANGLE)} across, {show(diagonal, ANGLE)} on the diagonal",
                    used=f"focal length {show(lens.focal_length, LENGTH)}",
                )
            )
    if stated.hyperfocal_distance is not None:
        implied = float(hyperfocal_distance(lens.focal_length, lens.pupil_diameter, sensor.pixel_pitch))
        if not math.isclose(stated.hyperfocal_distance, implied, rel_tol=PRINTED_TOLERANCE):
            found.append(
                Contradiction(
                    what="hyperfocal distance against focal length, aperture and pixel",
                    stated=show(stated.hyperfocal_distance, LENGTH),
                    implied=f"{show(implied, LENGTH)} for a blur of one pixel",
                    used="focal length and f-number",
                )
            )
    return found


def show(value: float, dimension: Dimension) -> str:
    """A value with as many digits as tell contradicting ones apart."""
    return pretty(value, dimension, digits=4)
