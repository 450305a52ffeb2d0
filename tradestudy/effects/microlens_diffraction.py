"""Diffraction at the microlenses: none, the boundary wave, Fresnel's law or Kirchhoff's."""

from __future__ import annotations

from typing import Final

from tradestudy.effects.base import OFF, EffectCriterion, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    aperture_transfer,
    bound_of,
    complete,
    diffraction_width,
    edge_wave,
    frequencies,
    fresnel_law,
    law_change,
    picture_change,
    pixel_transfer,
    rim_light,
    source_transfer,
)
from tradestudy.optics.propagation.hybrid import LEAST_ZONES

_SAFETY: Final = {"rays": 1.5, "fresnel": 1.2}  # see `picture_change`
_LEADING_TERM: Final = (1.5, 5e-4)  # errors of a boundary wave per W/N, and at W = 0: tests/campaigns/light_bounds.md


def microlens_diffraction_in_picture(scene: LightScene) -> Slot:
    """Law of the leg from the array to the detector, and what it may change in the pixels of a picture.

    Rays leave out the finite width of the lens: the transfer function loses at most 1 − T(f), T that of the lit width
    without aberration (for any defocus, as the ray sum runs over the whole aperture and the wave's over its overlap);
    far from focus it is the wave from the rim, η of the field at either side. Fresnel's law moves rays, and those that
    the rim of the main pupil diffracts by more than others, for they arrive at steeper angles. The boundary wave of
    circular microlenses is the leading term of the wave from their rims, which aberration of W waves over N Fresnel
    zones spoils; in focus it is Kirchhoff's integral itself, and nowhere it is cheaper, for light that is no sphere is
    left to that.
    """
    law = scene.detector_law
    rim = rim_light(scene)
    fresnel = law_change(scene, law) + 2.0 * rim * law_change(scene, scene.rim_detector_law)
    fresnel *= _SAFETY["fresnel"]
    f = frequencies(scene)
    lost = (1.0 - aperture_transfer(scene, f)) * source_transfer(scene, f) * pixel_transfer(scene, f)
    spread = picture_change(scene, lost)
    if scene.microlens_fresnel_number > 1.0:
        spread = min(spread, 2.0 * edge_wave(scene.microlens_fresnel_number))
    return Slot(
        name="microlens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SAFETY["rays"] * spread,
                    criterion=diffraction_width(scene),
                    reason="rays leave out the spread by the aperture of a microlens: it counts unless it is far "
                    "narrower than a pixel, or than the image of the source",
                ),
            ),
            *((_boundary_wave(scene),) if scene.path.microlenses.aperture == "circular" else ()),
            fresnel_law(scene, law, fresnel, lens="array", aberration="aberration behind the array"),
            Model(name="kirchhoff", bounds=complete()),
        ),
    )


def _boundary_wave(scene: LightScene) -> Model:
    """Rays and the waves from the rims of microlenses; in focus Kirchhoff's integral itself."""
    per_zone = scene.microlens_rim_path_waves / max(scene.microlens_fresnel_number, LEAST_ZONES)
    leading = min(1.0, _LEADING_TERM[0] * per_zone + _LEADING_TERM[1])
    in_focus = scene.largest_microlens_fresnel_number < LEAST_ZONES
    return Model(
        name="boundary_wave",
        bounds=bound_of(
            scene,
            0.0 if in_focus else 2.0 * leading * edge_wave(max(scene.microlens_fresnel_number, LEAST_ZONES)),
            criterion=EffectCriterion(
                words="waves of aberration per Fresnel zone of a microlens",
                definition="W/N; W the change of path in waves, exact against paraxial, from the rim of a microlens "
                "against that of the ray, root mean square; N = (w/2)²/λ |1/a + 1/b − 1/f|, w the width that is lit, "
                f"a the main image before the array, b the detector behind it, but at least {LEAST_ZONES:g}",
                value=per_zone,
            ),
            reason="in focus all light is left to Kirchhoff's integral"
            if in_focus
            else "the leading term of the wave from the rim of a microlens errs by 0.0005 of that wave and 1.5 times "
            "this number",
        ),
    )
