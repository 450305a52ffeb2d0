"""What the slots of a picture are weighed with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from tradestudy.accuracy import Quantity
from tradestudy.effects.base import Bound, EffectCriterion, Model, SlotName

# Trials are made at some of the distances and with one slot changed at a time; what lies in between, and what two
# slots do together beyond the sum of each, has to fit into this factor.
MARGIN: Final = 2.0


@dataclass(frozen=True, kw_only=True)
class Worst:
    """The worst value over all places, and the distance where it stands [m]; NaN where it belongs to none."""

    value: float
    at: float = math.nan


@dataclass(frozen=True, kw_only=True)
class PictureTrial:
    """How a derived disparity error moves with each model, and the numbers that tell why.

    Parameters
    ----------
    change
        Relative change of the disparity error, the largest over usable distances and variants of the study, if one
        slot takes a model in place of the most complete one that is in closed form.
    blur_px
        Largest geometric blur [samples].
    main_lens_airy_px, microlens_airy_px
        Largest radius of the first dark ring of either lens on the sensor [samples]; NaN without such a stage.
    lens_phases
        ``parabolic`` or ``perfect``: how lenses bend light by Kirchhoff's model, under some variant of the study.
    aberration_waves
        Largest path [waves] by which the exact spherical waves of the main lens, and of a microlens, depart from the
        parabolic ones of Fresnel at the rim.
    paraxial_change
        Relative change of the disparity error that these waves make as a defocus, for either lens.
    obliquity
        ``sin² θ`` of the rays at the rim of either lens on their way to its picture: what amplitude loses from axis to
        rim.
    electrons
        Fewest per pixel.
    illumination
        cos⁴ and stops at the field angle asked for; 1 on the axis.
    read_noise_share, quantisation_share
        Of the noise power, the largest.
    spectrum_width
        (longest − shortest wavelength)/central.
    microlens_reach_airy
        Half a micro-image over the Airy radius of a microlens, the smallest; infinite without microlenses.
    depth_change
        Relative change of the depth uncertainty that such a one of the disparity error makes at most, the largest over
        every distance that counts: more than it where the far end of depth runs away, infinite where that is lost.
    seconds
        Predicted cost [s] of a model by name.
    lattice_seconds
        What Kirchhoff's transfer takes beforehand for either lens [s].
    """

    change: Callable[[SlotName, str], float]
    blur_px: Worst
    main_lens_airy_px: Worst
    microlens_airy_px: Worst
    lens_phases: Sequence[str]
    aberration_waves: tuple[Worst, Worst]
    paraxial_change: tuple[float, float]
    obliquity: tuple[float, float]
    electrons: Worst
    illumination: float
    read_noise_share: float
    quantisation_share: float
    spectrum_width: float
    microlens_reach_airy: Worst
    depth_change: Callable[[float], float]
    seconds: Callable[[str], float]
    lattice_seconds: tuple[float, float]


def weighed(trial: PictureTrial, slot: SlotName, name: str, criterion: EffectCriterion, reason: str) -> Model:
    """A model whose bound is its trial with the margin."""
    return bounded(trial, name, MARGIN * trial.change(slot, name), criterion, reason)


def bounded(
    trial: PictureTrial, name: str, change: float, criterion: EffectCriterion, reason: str, *, beforehand: float = 0.0
) -> Model:
    """A model whose bound on the disparity error was found otherwise, with what it takes beforehand [s]."""
    quantity: Quantity = "depth_uncertainty"
    found = trial.depth_change(change)
    if math.isinf(found) and math.isfinite(change):
        reason += f"; a disparity error off by {100 * change:.0f} %, its bound, loses the far end of depth somewhere"
    bound = Bound(relative_change=found, criterion=criterion, reason=reason)
    return Model(name=name, bounds={quantity: bound}, seconds=trial.seconds(name) + beforehand)
