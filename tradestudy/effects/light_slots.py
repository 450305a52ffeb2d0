"""Slots of the picture of a light spot: every model of every effect, and what it may change in the pixels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.effects.base import COMPLETE, OFF, Bound, EffectCriterion, Model, Slot
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.picture_change import (
    aperture_transfer,
    bound_of,
    diffraction_width,
    edge_wave,
    frequencies,
    fresnel_law,
    interference_change,
    law_change,
    light_behind_neighbours,
    lit_transfer,
    peak_change,
    picture_change,
    pixel_transfer,
    rim_light,
    rim_share,
    source_transfer,
)
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.hybrid import LEAST_ZONES

# Factors of safety; see `picture_change`.
_RAYS, _FRESNEL_AT_MAIN_LENS, _FRESNEL_AT_MICROLENSES = 1.5, 1.8, 1.2
_CROSSTALK, _PIXELS, _SOURCE, _SPECTRUM = 1.5, 2.5, 1.2, 2.0
# Errors of a boundary wave per W/N, and at W = 0: tests/campaigns/light_bounds.md.
_LEADING_AT_MAIN_LENS, _LEADING_AT_MICROLENSES = (2.0, 1e-3), (1.5, 5e-4)
_HARDLY_ANY: Final = 1e-9  # Fresnel zones: the array in the main image, for which no bound is stated


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
    moved = law_change(scene, law) + picture_change(scene, 4.0 * rim * turned * lit_transfer(scene))
    wave = picture_change(scene, 2.0 * rim * lit_transfer(scene))
    per_zone = scene.rim_path_waves / max(scene.main_fresnel_number, _HARDLY_ANY)
    leading = min(1.0, _LEADING_AT_MAIN_LENS[0] * per_zone + _LEADING_AT_MAIN_LENS[1])
    return Slot(
        name="main_lens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _RAYS * (wave + interference_change(scene)),
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
            fresnel_law(
                scene, law, _FRESNEL_AT_MAIN_LENS * moved, lens="main lens", aberration="aberration of the main lens"
            ),
            Model(name="kirchhoff", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


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
    moved = law_change(scene, law) + 2.0 * rim * law_change(scene, scene.rim_detector_law)
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
                    _RAYS * spread,
                    criterion=diffraction_width(scene),
                    reason="rays leave out the spread by the aperture of a microlens: it counts unless it is far "
                    "narrower than a pixel, or than the image of the source",
                ),
            ),
            *((_boundary_wave(scene),) if scene.path.microlenses.aperture == "circular" else ()),
            fresnel_law(
                scene, law, _FRESNEL_AT_MICROLENSES * moved, lens="array", aberration="aberration behind the array"
            ),
            Model(name="kirchhoff", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


def _boundary_wave(scene: LightScene) -> Model:
    """Rays and the waves from the rims of microlenses; in focus Kirchhoff's integral itself."""
    per_zone = scene.microlens_rim_path_waves / max(scene.microlens_fresnel_number, LEAST_ZONES)
    leading = min(1.0, _LEADING_AT_MICROLENSES[0] * per_zone + _LEADING_AT_MICROLENSES[1])
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


def crosstalk_in_picture(scene: LightScene) -> Slot:
    """Whether a pixel takes light of the nearest microlens alone, or of all, added as fields.

    Left out are the light that leaves its cell and its interference with what is there.
    """
    return Slot(
        name="crosstalk",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _CROSSTALK * (light_behind_neighbours(scene) + interference_change(scene)),
                    criterion=EffectCriterion(
                        words="pixels between the outermost ray and the neighbour's cell",
                        definition="least distance of a ray on the detector from the border of its microlens's cell, "
                        "over the pixel pitch; negative behind a neighbour",
                        value=float(np.min(scene.margins, initial=np.inf)) / scene.path.pixels.pitch,
                    ),
                    reason="diffraction carries 0.2 of its width λ b/w over a ray's distance from the border of its "
                    "cell across, where it may interfere: unless all rays stay many such widths away, it counts",
                ),
            ),
            Model(name="coherent", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


def pixel_integration_in_picture(scene: LightScene) -> Slot:
    """One sample at the middle of a pixel, or the integral over its square.

    A sample keeps of every frequency 1 − sinc more than the integral does, spread over the picture or, for an image
    below a pixel, at its peak; fringes between microlenses, which the integral averages, it keeps whole.
    """
    kept = lit_transfer(scene, pixels=False) * (1.0 - pixel_transfer(scene, frequencies(scene)))
    change = max(picture_change(scene, kept), peak_change(scene, kept))
    return Slot(
        name="pixel_integration",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _PIXELS * change + interference_change(scene, pixels=False),
                    criterion=diffraction_width(scene),
                    reason="one sample at the centre stands for the whole pixel: it counts unless diffraction, defocus "
                    "or the source make the picture smooth over many pixels",
                ),
            ),
            Model(name="square", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


def source_extent_in_picture(scene: LightScene) -> Slot:
    """A point in the middle of the source, or the whole disc.

    A point lacks the disc's blur, 1 − 2J₁(x)/x of every frequency. It lights the array through one shadow of the
    pupil; the disc averages over shadows apart by s z/a, across which the wave from the rim turns by k R/z s z/a and
    the shadow moves by as much of its width.
    """
    point = lit_transfer(scene, source=False)
    blur = 1.0 - source_transfer(scene, frequencies(scene))
    moved = scene.source.diameter / 2.0 * scene.path.array_distance / scene.source.distance
    turn = 2.0 * math.pi / scene.wavelength * scene.path.main_lens.radius / scene.path.array_distance * moved
    averaged = min(1.0, turn**2 / 4.0)
    shadow = averaged * (2.0 * rim_share(scene) + min(1.0, moved / max(scene.blur_on_array, 1e-9)))
    return Slot(
        name="source_extent",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SOURCE * (picture_change(scene, blur * point) + picture_change(scene, shadow * point)),
                    criterion=EffectCriterion(
                        words="image of the source over pixel",
                        definition="diameter of the source's image behind one microlens by rays, no wider than that of "
                        "the pupil, over the pixel pitch",
                        value=2.0 * scene.spot_radius / scene.path.pixels.pitch,
                    ),
                    reason="a point has neither the width of the source nor its averaged shadows: they count unless "
                    "this is well below 1",
                ),
            ),
            Model(name="disc", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


def spectrum_in_picture(scene: LightScene, *, wavelengths: FloatArray, weights: FloatArray) -> Slot:
    """Light of the scene's wavelength alone, or of several with their weights; one model where there is but one.

    The mean wavelength's transfer function differs from the weighted one by what the cutoff moves; the wave from a rim
    with N Fresnel zones turns by π N δλ/λ against the rest, and rings wash out by the square of that.
    """
    if wavelengths.size == 1:
        return Slot(name="spectrum", models=(Model(name=OFF, bounds={"pixel_intensity": COMPLETE}),))
    f, share = frequencies(scene), weights / weights.sum()
    moved = sum(
        s * aperture_transfer(replace(scene, wavelength=float(w)), f) for s, w in zip(share, wavelengths, strict=True)
    )
    width = math.sqrt(float(share @ (wavelengths / scene.wavelength - 1.0) ** 2))
    rims = (
        (rim_light(scene), scene.main_fresnel_number),
        (edge_wave(scene.microlens_fresnel_number), scene.microlens_fresnel_number),
    )
    washed = sum(rim * min(1.0, (math.pi * (zones + 0.5) * width) ** 2 / 2.0) for rim, zones in rims)
    passed = source_transfer(scene, f) * pixel_transfer(scene, f)
    change = np.abs(moved - aperture_transfer(scene, f)) * passed + washed * lit_transfer(scene)
    return Slot(
        name="spectrum",
        models=(
            Model(
                name=OFF,
                bounds=bound_of(
                    scene,
                    _SPECTRUM * picture_change(scene, change),
                    criterion=EffectCriterion(
                        words="width of the spectrum over its mean wavelength",
                        definition="√(Σ s (λ/λ_mean − 1)²); s the share of the light at the wavelength λ",
                        value=width,
                    ),
                    reason="the rings of one wavelength stand for those of all, which wash out by the square of π "
                    "times this number times the Fresnel number: they count unless that product is well below 1",
                ),
            ),
            Model(name="weighted", bounds={"pixel_intensity": COMPLETE}),
        ),
    )


TOLERANCES: Final = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)


def sampling() -> Slot:
    """Numerical tolerances from the loosest to the tightest: a model leaves out what lies between its nodes.

    Each is the bound of what it may change.
    """
    return Slot(
        name="sampling",
        models=tuple(
            Model(
                name=f"{100.0 * tolerance:.6g} %",
                bounds={
                    "pixel_intensity": Bound(
                        relative_change=tolerance,
                        criterion=EffectCriterion(
                            words="numerical tolerance",
                            definition="relative error that the nodes of all integrals are placed for",
                            value=tolerance,
                        ),
                        reason="nodes are placed to meet it, and every result states what it reached",
                    )
                },
            )
            for tolerance in TOLERANCES
        ),
    )


def tolerance_of(model: Model) -> float:
    """The tolerance that a model stands for."""
    (bound,) = model.bounds.values()
    return bound.relative_change
