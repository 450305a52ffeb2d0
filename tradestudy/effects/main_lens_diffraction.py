"""Diffraction at the main lens: none, the boundary wave, Fresnel's law or Kirchhoff's."""

from __future__ import annotations

import math
from typing import Final

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.interference import interference_change
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    bound_of,
    complete,
    fresnel_law,
    law_change,
    lit_transfer,
    picture_change,
    rim_light,
)

_SAFETY: Final = {"rays": 1.5, "fresnel": 1.8}  # see `picture_change`
_HARDLY_ANY: Final = 1e-9  # Fresnel zones: the array in the main image, for which no bound is stated
_LEADING_TERM: Final = (2.0, 1e-3)  # errors of a boundary wave per W/N, and at W = 0: tests/campaigns/light_bounds.md


def main_lens_diffraction_in_picture(scene: LightScene) -> Slot:
    """Law of the leg from the main lens to the array, and what it may change in the pixels of a picture.

    Fresnel: rays of the exact paths land up to δ elsewhere, which turns the transfer function by at most 2π f δ; the
    cosines that Fresnel takes for one add to it. The wave from the rim of the pupil, the share η of the field on the
    array, has another phase by exact paths. Rays of exact directions leave that wave out, and the interference of
    microlenses; the boundary wave is its leading term, which aberration of W waves over N Fresnel zones spoils.
    """
    law = scene.main_law
    rim = rim_light(scene)
    turned = min(1.0, math.pi * scene.rim_path_waves)
    fresnel = law_change(scene, law) + picture_change(scene, 4.0 * rim * turned * lit_transfer(scene))
    fresnel *= _SAFETY["fresnel"]
    wave = picture_change(scene, 2.0 * rim * lit_transfer(scene))
    per_zone = scene.rim_path_waves / max(scene.main_fresnel_number, _HARDLY_ANY)
    leading = min(1.0, _LEADING_TERM[0] * per_zone + _LEADING_TERM[1])
    rays = _SAFETY["rays"] * (wave + interference_change(scene))
    return Slot(
        name="main_lens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    rays,
                    criterion=EffectCriterion(
                        words="Fresnel number of the pupil from the array",
                        definition="N = R²/λ |1/z − 1/b|; R the radius of the pupil, z from the main lens to the "
                        "array, b to the main image",
                        value=scene.main_fresnel_number,
                    ),
                    reason="rays leave out the wave from the rim of the pupil, which falls only as the fourth root of "
                    "this number, and microlenses that interfere: both count unless pixel and source average them",
                ),
            ),
            Model(
                name="boundary_wave",
                bounds=bound_of(
                    scene,
                    leading * wave,
                    criterion=EffectCriterion(
                        words="waves of aberration per Fresnel zone of the pupil",
                        definition="W/N; W the change of path in waves, exact against paraxial, from the rim of the "
                        "pupil against that of the ray, root mean square; N the Fresnel number of the pupil",
                        value=per_zone,
                    ),
                    reason="the leading term of the wave from the rim of the pupil errs by a thousandth of that wave "
                    "and twice this number",
                ),
            ),
            fresnel_law(scene, law, fresnel, lens="main lens", aberration="aberration of the main lens"),
            Model(name="kirchhoff", bounds=complete()),
        ),
    )
