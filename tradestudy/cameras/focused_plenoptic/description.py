"""Derived properties of a focused plenoptic camera."""

from __future__ import annotations

import math

from tradestudy.cameras.camera import Properties
from tradestudy.cameras.focused_plenoptic.depth_scaling import DepthScaling
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.cameras.plenoptic import fill_factor
from tradestudy.optics.microlens_coverage import (
    covering_microlens_object_distance,
    covering_radius_over_pitch,
)
from tradestudy.optics.thin_lens import object_distance
from tradestudy.units import ANGLE, LENGTH, NUMBER, pretty


def properties_of(
    lens: Lens,
    array: MicrolensArray,
    sensor: Sensor,
    *,
    mla_distance: float,
    total_covering_plane: float,
    virtual_depth_at_infinity: float,
    depth_scaling: DepthScaling,
) -> Properties:
    """Distances, microlenses, coverage and field of view."""
    at_infinity = math.isnan(total_covering_plane) and math.isclose(abs(virtual_depth_at_infinity), 2.0)
    plane = math.inf if at_infinity else total_covering_plane
    scaled = () if depth_scaling.is_identity else (("metric depth of the depth Z by eq. 8", depth_scaling.words),)
    return (
        *scaled,
        ("distance from main lens to array, z", pretty(mla_distance, LENGTH, 5)),
        ("microlens gap, b_L", pretty(array.gap, LENGTH, 4)),
        ("microlens focal lengths, f_L", ", ".join(pretty(f, LENGTH, 4) for f in array.focal_lengths)),
        ("pupil diameter", pretty(lens.pupil_diameter, LENGTH, 4)),
        ("microlens f-number, gap/pitch", pretty(array.gap / array.pitch, NUMBER, 4)),
        ("pixels per microlens", pretty(array.pitch / sensor.pixel_pitch, NUMBER, 4)),
        ("fill factor of the array", fill_factor(array)),
        ("virtual depth at infinity", pretty(virtual_depth_at_infinity, NUMBER, 4)),
        (
            "total covering plane, where |virtual depth| is 2",
            "none" if math.isnan(plane) else pretty(plane, LENGTH, 4),
        ),
        (
            "distances, exact for this lattice, at which two or more microlenses of any type see every point",
            _covered(lens, array, mla_distance, depth_scaling),
        ),
        ("horizontal field of view, focused at infinity", pretty(lens.field_of_view(sensor.width), ANGLE, 4)),
        ("diagonal field of view, focused at infinity", pretty(lens.field_of_view(sensor.diagonal), ANGLE, 4)),
    )


def _covered(lens: Lens, array: MicrolensArray, mla_distance: float, depth_scaling: DepthScaling) -> str:
    """Exact distances at which two microlenses of any type see every point, on both sides of the array.

    Light behind the array (Galilean) covers it up to a distance, and light in front (Keplerian) from a distance on,
    whatever the focal lengths of the microlenses.
    """
    needed = covering_radius_over_pitch(at_least=2, layout=array.layout)
    found = []
    for keplerian in (False, True):
        if not keplerian and 2.0 * needed * array.pitch > lens.pupil_diameter:
            continue
        a_L = float(
            covering_microlens_object_distance(
                needed,
                mla_distance=mla_distance,
                pupil_diameter=lens.pupil_diameter,
                microlens_pitch=array.pitch,
                keplerian=keplerian,
            )
        )
        shift = mla_distance - a_L - lens.focal_length
        if shift > 0.0:
            covering = depth_scaling.metric(object_distance(shift, lens.focal_length))
            distance = pretty(float(covering), LENGTH, 4)
            found.append(f"from {distance}" if keplerian else f"up to {distance}")
        elif not keplerian:
            return "everywhere"
    return " and ".join(found) or "nowhere"
