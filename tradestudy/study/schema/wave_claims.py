"""Checks of claims about light: the study must have the lenses and methods that they name."""

from __future__ import annotations

from collections.abc import Mapping

from tradestudy.declarations.part import MistakeAt, nearest_name
from tradestudy.study.schema.light_spot import LightSpotPart
from tradestudy.study.schema.questions import (
    ClaimPart,
    CriterionFNumberClaim,
    FresnelFNumberClaim,
    ImageDifferenceClaim,
    LitPixelsClaim,
    PsfErrorClaim,
)
from tradestudy.study.schema.wave_optics import FresnelValidityPart


def wave_claim_mistakes(
    claims: Mapping[str, ClaimPart], fresnel: FresnelValidityPart | None, spot: LightSpotPart | None
) -> list[MistakeAt]:
    """Claims that name lenses or methods missing from the study."""
    elements = () if fresnel is None else tuple(fresnel.elements)
    methods = () if spot is None else spot.methods
    found: list[MistakeAt] = []
    for key, claim in claims.items():
        if isinstance(claim, PsfErrorClaim | FresnelFNumberClaim | CriterionFNumberClaim):
            if claim.element not in elements:
                what = f"fresnel_validity has no element {claim.element!r}{nearest_name(claim.element, elements)}"
                found.append(MistakeAt(("claims", key, "element"), what))
        elif isinstance(claim, ImageDifferenceClaim | LitPixelsClaim):
            found += [
                MistakeAt(("claims", key, word), f"{name!r} is not one of light_spot.methods")
                for word, name in (("method", claim.method), ("reference", claim.reference))
                if name not in methods
            ]
    return found
