"""How much light is left away from the axis."""

from __future__ import annotations

import math

from tradestudy.errors import OutOfRangeError


def field_illumination(field_angle: float, *, pupil_diameter: float, stop_separation: float) -> float:
    """Illumination over that on the axis: ``cos⁴θ · (2/π)(arccos s − s √(1 − s²)), s = L tan θ / A``.

    The fourth power of the cosine is that of a lens whose pupil looks the same from everywhere; the rest is what two
    equal round stops a distance apart leave of the pupil.

    Parameters
    ----------
    field_angle
        θ of the chief ray against the axis [rad], from 0 to below 90°.
    pupil_diameter
        A [m].
    stop_separation
        L [m] between pupil and the second stop, along the axis; 0: none.

    Raises
    ------
    OutOfRangeError
        For an angle or a length that cannot be.
    """
    require_field_and_stops(field_angle, stop_separation)
    s = min(stop_separation * math.tan(field_angle) / pupil_diameter, 1.0)
    return math.cos(field_angle) ** 4 * (2.0 / math.pi) * (math.acos(s) - s * math.sqrt(1.0 - s * s))


def require_field_and_stops(field_angle: float, stop_separation: float) -> None:
    """Refuse an angle or a length that cannot be, as `field_illumination` does.

    Raises
    ------
    OutOfRangeError
        For an angle outside 0° to below 90°, or a separation that is negative or not finite.
    """
    if not 0.0 <= field_angle < math.pi / 2.0:
        raise OutOfRangeError("field angle", value=f"{math.degrees(field_angle):g}°", limit="0° to below 90°")
    if not (math.isfinite(stop_separation) and stop_separation >= 0.0):
        raise OutOfRangeError("separation of the stops", value=f"{stop_separation:g} m", limit="0 m or more")
