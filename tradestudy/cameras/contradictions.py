"""Checks of over-determined inputs: the values that a source states against those that its other values imply."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.optics.depth_of_field import hyperfocal_distance
from tradestudy.units import ANGLE, ELECTRONS, LENGTH, PHOTONS, Dimension, pretty

if TYPE_CHECKING:  # pydantic is not needed to compute with a camera
    from tradestudy.cameras.stated_declaration import StatedPart

# Values printed with three or four digits agree within this.
PRINTED_TOLERANCE = 5e-3
_ANGLE_TOLERANCE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Two values of one quantity that cannot both be right.

    Parameters
    ----------
    what, stated, implied, used
        The quantity, its two values, and the one that the program uses, in words.
    path
        Keys in the declaration of the camera that `check` names.
    consequence
        What it does to the camera's answers, as a clause such as "its micro-images overlap"; empty if they do not
        suffer.
    """

    what: str
    stated: str
    implied: str
    used: str
    path: tuple[str, ...]
    consequence: str = ""


def lens_contradictions(
    lens: Lens, sensor: Sensor, stated: StatedPart | None, views: tuple[float, float] | None = None
) -> list[Contradiction]:
    """Check stated field of view, hyperfocal distance and sensitivity against focal length, aperture and sensor.

    ``views`` are the fields of view across and on the diagonal [rad] of a lens that is no pinhole.
    """
    if stated is None:
        return []
    found = _sensitivity_contradictions(sensor, stated.absolute_sensitivity_threshold)
    if stated.field_of_view is not None:
        across, diagonal = views or (lens.field_of_view(sensor.width), lens.field_of_view(sensor.diagonal))
        if not any(math.isclose(stated.field_of_view, angle, rel_tol=_ANGLE_TOLERANCE) for angle in (across, diagonal)):
            found.append(
                Contradiction(
                    what="field of view against focal length and sensor",
                    stated=show(stated.field_of_view, ANGLE),
                    implied=f"{show(across, ANGLE)} across, {show(diagonal, ANGLE)} on the diagonal",
                    used=f"focal length {show(lens.focal_length, LENGTH)}",
                    path=("stated", "field_of_view"),
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
                    path=("stated", "hyperfocal_distance"),
                )
            )
    return found


def digitiser_contradictions(sensor: Sensor, full_well: float, bits: int) -> list[Contradiction]:
    """Check that the system gain maps the full well [electrons] to at most the last digital number."""
    gain = sensor.system_gain
    if gain is None or full_well * gain <= 2.0**bits * (1.0 + PRINTED_TOLERANCE):
        return []
    return [
        Contradiction(
            what="saturation capacity against system gain and bit depth",
            stated=show(full_well, ELECTRONS),
            implied=f"{show(2.0**bits / gain, ELECTRONS)} at the largest of 2^{bits} digital numbers",
            used="whichever ends first",
            path=("sensor", "system_gain"),
        )
    ]


def _sensitivity_contradictions(sensor: Sensor, stated: float | None) -> list[Contradiction]:
    """Check the threshold ``μ_p.min = (√(σ² + 1/4) + 1/2)/η, σ² = σ_d² + 1/(12 K²)``, formerly ``(σ + 1/2)/η``.

    Source: EMVA 1288, releases 4.0 and 3.1. Without quantum efficiency and dark noise, there is nothing to check.
    """
    efficiency, dark = sensor.quantum_efficiency, sensor.temporal_dark_noise
    if stated is None or efficiency is None or dark is None:
        return []
    noise = math.hypot(dark, 0.0 if sensor.system_gain is None else 1.0 / (math.sqrt(12.0) * sensor.system_gain))
    implied = (math.hypot(noise, 0.5) + 0.5) / efficiency, (noise + 0.5) / efficiency
    if any(math.isclose(stated, one, rel_tol=PRINTED_TOLERANCE) for one in implied):
        return []
    return [
        Contradiction(
            what="absolute sensitivity threshold against quantum efficiency, dark noise and system gain",
            stated=show(stated, PHOTONS),
            implied=show(implied[0], PHOTONS),
            used="quantum efficiency, dark noise and system gain",
            path=("stated", "absolute_sensitivity_threshold"),
        )
    ]


def show(value: float, dimension: Dimension) -> str:
    """A value with enough digits to distinguish contradictory values."""
    return pretty(value, dimension, digits=4)
