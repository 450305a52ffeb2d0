"""Claims about light: Fresnel compared with Kirchhoff, criteria, and images of the spot."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from tradestudy.analysis.fresnel_errors import (
    goodman_f_number,
    limit_f_number,
    paper_zeros,
    path_error_f_number,
    psf_differences,
)
from tradestudy.analysis.spot_images import image_difference, lit_pixels, spot_image
from tradestudy.light_methods import short_title
from tradestudy.study.schema.claims import (
    CriterionFNumberClaim,
    FresnelFNumberClaim,
    ImageDifferenceClaim,
    LitPixelsClaim,
    PsfErrorClaim,
)
from tradestudy.study.schema.wave_optics import FresnelValidityPart, LightSpotPart, listed
from tradestudy.units import FRACTION, LENGTH, pretty, significant

WaveClaim = PsfErrorClaim | FresnelFNumberClaim | CriterionFNumberClaim | ImageDifferenceClaim | LitPixelsClaim
PartT = TypeVar("PartT")
_METRIC_WORDS = {"peak": "peak error", "l1": "L1 error", "largest": "largest error"}
_CRITERION_WORDS = {
    "path-error": "a neglected path",
    "goodman": "Goodman's condition",
    "paper-eq27-first-zero": "the smaller zero of eq. 27",
    "paper-eq27-second-zero": "the larger zero of eq. 27",
}


def wave_claim_value(claim: WaveClaim, fresnel: FresnelValidityPart | None, spot: LightSpotPart | None) -> float:
    """The value of a claim about light; the schema ensures that the part it refers to exists."""
    match claim:
        case PsfErrorClaim():
            return _psf_error(claim, _present(fresnel), claim.f_number)
        case FresnelFNumberClaim():
            asked = _present(fresnel)
            return limit_f_number(lambda f: _psf_error(claim, asked, f), listed(asked.f_numbers), claim.error)
        case CriterionFNumberClaim():
            return _criterion(claim, _present(fresnel))
        case ImageDifferenceClaim() | LitPixelsClaim():
            image, reference = (spot_image(_present(spot), name).pixels for name in (claim.method, claim.reference))
            if isinstance(claim, ImageDifferenceClaim):
                return image_difference(image, reference)
            return lit_pixels(image, claim.above) / lit_pixels(reference, claim.above)


def wave_claim_words(claim: WaveClaim) -> str:
    """The quantity that answers a claim about light, in words."""
    match claim:
        case PsfErrorClaim():
            place = f"{_words(claim.element)} at f/{significant(claim.f_number)}"
            return f"{_measure(claim)} of Fresnel's point-spread function for the {place}"
        case FresnelFNumberClaim():
            limit = f"{pretty(claim.error, FRACTION)} (0 if it does at every f-number compared)"
            element = _words(claim.element)
            return f"smallest f-number above which the {_measure(claim)} for the {element} stays below {limit}"
        case CriterionFNumberClaim():
            bound = f" of {significant(claim.path_error)} waves" if claim.path_error is not None else ""
            return f"smallest f-number for the {_words(claim.element)} by {_CRITERION_WORDS[claim.criterion]}{bound}"
        case ImageDifferenceClaim():
            pictures = f"{_title(claim.method)} and by {_title(claim.reference)}"
            return f"summed difference between the pictures by {pictures}, relative to the latter"
        case LitPixelsClaim():
            pictures = f"by {_title(claim.method)}, relative to that by {_title(claim.reference)}"
            return f"number of pixels above {pretty(claim.above, FRACTION)} of the brightest in the picture {pictures}"


def _words(element: str) -> str:
    return element.replace("-", " ")


def _title(method: str) -> str:
    """The short title of a method, capitalised only where it begins with a name."""
    title = short_title(method)
    return title if title.startswith(("Kirchhoff", "Fresnel")) else title[0].lower() + title[1:]


def _present(part: PartT | None) -> PartT:
    assert part is not None  # the schema ensures it
    return part


def _psf_error(claim: PsfErrorClaim | FresnelFNumberClaim, asked: FresnelValidityPart, f_number: float) -> float:
    found = psf_differences(
        asked.elements[claim.element],
        f_number=f_number,
        field_angle=0.0,
        wavelength=claim.wavelength,
        lens_phases=(claim.lens_phase,),
        windows=(claim.window,),
        tolerance=asked.tolerance,
    )
    return float(getattr(found[claim.lens_phase], claim.metric)[0])


def _criterion(claim: CriterionFNumberClaim, asked: FresnelValidityPart) -> float:
    element = asked.elements[claim.element]
    match claim.criterion:
        case "path-error":
            return float(path_error_f_number(element, claim.wavelength, np.float64(claim.path_error or 0.0)))
        case "goodman":
            return float(goodman_f_number(element, claim.wavelength))
        case "paper-eq27-first-zero":
            return float(paper_zeros(element, (claim.wavelength,))[0][0, 0])
        case "paper-eq27-second-zero":
            return float(paper_zeros(element, (claim.wavelength,))[0][0, 1])


def _measure(claim: PsfErrorClaim | FresnelFNumberClaim) -> str:
    window = "" if claim.metric == "peak" else f" over {significant(claim.window)} Airy radii"
    return f"{_METRIC_WORDS[claim.metric]}{window} ({claim.lens_phase} lens phase, {pretty(claim.wavelength, LENGTH)})"
