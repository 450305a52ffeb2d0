"""/fresnel_validity, /images, /point_spread: results of wave optics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import PAPER, ROUNDING, Variable

_MEASURED = f"{PAPER}, Figure 6, whose measure, window and wavelength are not stated"
_ELEMENT = ("element", "wavelength")


def _f_number(dims: tuple[str, ...], long_name: str, reference: str, error: str = ROUNDING) -> Variable:
    return Variable(dims=dims, units="1", long_name=long_name, symbol="F", reference=reference, error=error)


FRESNEL_VALIDITY: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("element",), units="", long_name="name of the lens in figures and tables"),
    "focal_length": Variable(
        dims=("element",), units="m", long_name="focal length", symbol="f", error="none: declared"
    ),
    "object_distance": Variable(
        dims=("element",),
        units="m",
        long_name="distance of the object in focus from the lens",
        symbol="a",
        error="none: declared",
    ),
    "image_distance": Variable(
        dims=("element",), units="m", long_name="in-focus image distance", symbol="b", error=ROUNDING
    ),
    "camera_f_number": _f_number(("element",), "f-number at which the camera uses the lens", "", "none: declared"),
    "published_f_number": _f_number(("element",), "f-number of a published error; NaN if none", "", "none: declared"),
    "published_error": Variable(
        dims=("element",),
        units="1",
        long_name="published error at published_f_number; NaN if none",
        error="as its source states it",
    ),
    "published_minimum": _f_number(
        ("element",), "published minimum f-number for Fresnel; NaN if none", f"{PAPER}, section 5.3", "as printed"
    ),
    "psf_error": Variable(
        dims=("element", "lens_phase", "wavelength", "f_number", "metric", "window"),
        units="1",
        long_name="error of Fresnel's point-spread function against Kirchhoff's, in focus on the axis",
        reference=_MEASURED,
        error="see psf_error_numerical",
    ),
    "psf_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "f_number", "metric", "window"),
        units="1",
        long_name="numerical error of psf_error",
        error="itself an estimate",
    ),
    "off_axis_error": Variable(
        dims=("element", "lens_phase", "f_number", "metric", "window"),
        units="1",
        long_name="psf_error at the field angle in fresnel_validity.off_axis, in a window about the thin-lens image",
        reference=_MEASURED,
        error="see off_axis_error_numerical",
    ),
    "off_axis_error_numerical": Variable(
        dims=("element", "lens_phase", "f_number", "metric", "window"),
        units="1",
        long_name="numerical error of off_axis_error",
        error="itself an estimate",
    ),
    "published_point_error": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="error of Fresnel's point-spread function on axis at the f-number of the published error, or, where "
        "none is published, of the camera",
        reference=_MEASURED,
        error="see published_point_error_numerical",
    ),
    "published_point_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="numerical error of published_point_error",
        error="itself an estimate",
    ),
    "camera_point_error": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="error of Fresnel's point-spread function on axis at the f-number of the camera",
        error="see camera_point_error_numerical",
    ),
    "camera_point_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="numerical error of camera_point_error",
        error="itself an estimate",
    ),
    "off_axis_camera_error": Variable(
        dims=("element", "lens_phase", "metric", "window"),
        units="1",
        long_name="camera_point_error at the field angle in fresnel_validity.off_axis",
        error="see off_axis_camera_error_numerical",
    ),
    "off_axis_camera_error_numerical": Variable(
        dims=("element", "lens_phase", "metric", "window"),
        units="1",
        long_name="numerical error of off_axis_camera_error",
        error="itself an estimate",
    ),
    "limit_f_number": _f_number(
        ("element", "lens_phase", "wavelength", "metric", "window"),
        "smallest f-number above which the error on axis stays below the study's limit; 0 where it does so at all "
        "compared f-numbers, infinite where it exceeds the limit even at the largest one",
        _MEASURED,
        "1e-4, relative, of the root; in addition, the error of psf_error divided by its slope",
    ),
    "paper_eq27_f_number": _f_number(
        (*_ELEMENT, "zero"),
        "both zeros of the paper's criterion, eq. 27, as printed; not to be trusted, see paper_eq27_condition",
        f"{PAPER}, eq. 27",
    ),
    "paper_eq27_condition": Variable(
        dims=_ELEMENT,
        units="1",
        long_name="relative change of the fractional part of 4 (a + b)/λ, on which the zeros of eq. 27 depend, per "
        "relative change of a length",
        reference=f"{PAPER}, eq. 27",
        error=ROUNDING,
    ),
    "paper_eq27_sweep": _f_number(
        (*_ELEMENT, "zero", "quarter_wave"),
        "zeros of eq. 27 as printed while the sum of object and image distance grows by a quarter wavelength",
        f"{PAPER}, eq. 27",
    ),
    "path_error_f_number": _f_number(
        (*_ELEMENT, "path_error"),
        "minimum f-number at which the optical path that Fresnel omits stays within path_error",
        "(f/2) [(1/a³ + 1/b³)/(8 λ ε)]^¼; the next term is smaller by a factor of r²/(2 b²) for a pupil of radius r",
    ),
    "goodman_f_number": _f_number(
        _ELEMENT,
        "minimum f-number at which Fresnel omits at most 1 rad of phase on each leg (object to lens, "
        "lens to image) alone",
        "Goodman 2005, section 4.2.2",
    ),
    "southwell_f_number": _f_number(
        _ELEMENT,
        "minimum f-number at which, for a plane wave behind an empty aperture as large as the pupil, the error on the "
        "axis at the image distance is at most the study's limit",
        "after Southwell (1981)",
    ),
}

IMAGES: Final[Mapping[str, Variable]] = {
    "image": Variable(
        dims=("propagator", "row", "column"),
        units="1",
        long_name="fraction of the power in the pupil of the main lens that falls on a pixel",
        reference=f"{PAPER}, Figure 7 and eqs. 14, 16, 22, 25 as corrected",
        error="see numerical_error",
    ),
    "numerical_error": Variable(
        dims=("propagator",),
        units="1",
        long_name="numerical error of the image: relative L2 error over the pixels",
        error="itself an estimate",
    ),
    "power": Variable(
        dims=("propagator",),
        units="1",
        long_name="fraction of the power in the pupil of the main lens that falls on the detector",
        error="at most numerical_error relative",
    ),
    "lit_pixels": Variable(
        dims=("propagator",),
        units="1",
        long_name="number of pixels with more than a hundredth of the light of the brightest pixel",
        error="none: a count",
    ),
    "outside_geometric": Variable(
        dims=("propagator",),
        units="1",
        long_name="fraction of the light on the detector that falls on pixels that no ray reaches",
        error="at most numerical_error",
    ),
    "difference": Variable(
        dims=("propagator", "against"),
        units="1",
        long_name="sum over the pixels of the absolute difference between two images, divided by the sum over "
        "the pixels of the second one",
        error="at most the sum of the numerical errors of both images; less where they share errors",
    ),
    "difference_l2": Variable(
        dims=("propagator", "against"),
        units="1",
        long_name="difference between two images in the L2 norm over the pixels, relative to the second one",
        error="at most the sum of the numerical errors of both images; less where they share errors",
    ),
    "chosen": Variable(
        dims=("propagator",),
        units="1",
        long_name="1 for the methods that the tolerance requires, 0 for others",
        error="exact",
    ),
    "chosen_image": Variable(
        dims=("row", "column"),
        units="1",
        long_name="image by the models chosen for the tolerance, named in the attributes",
        reference=f"{PAPER}, Figure 7 and eqs. 14, 16, 22, 25 as corrected",
        error="see chosen_error, and the bounds of the omitted effects",
    ),
    "chosen_error": Variable(
        dims=(),
        units="1",
        long_name="relative L2 numerical error of chosen_image over the pixels",
        error="itself an estimate",
    ),
    "spectral_share": Variable(
        dims=("wavelength",),
        units="1",
        long_name="fraction of the light that has this wavelength",
        error="none: declared",
    ),
    "microlens_x": Variable(
        dims=("microlens",), units="m", long_name="position of the centre of a microlens, along a row", error=ROUNDING
    ),
    "microlens_y": Variable(
        dims=("microlens",),
        units="m",
        long_name="position of the centre of a microlens, perpendicular to the rows",
        error=ROUNDING,
    ),
    "microlens_focal_length": Variable(
        dims=("microlens",), units="m", long_name="focal length of a microlens", symbol="f_L", error="none: declared"
    ),
    "benchmark_error": Variable(
        dims=("benchmark",),
        units="1",
        long_name="relative L2 error that each timed computation states for its intensities; its computing time "
        "is in run.json",
        error="itself an estimate",
    ),
    "published_seconds": Variable(
        dims=("propagator",), units="s", long_name="published computing time; NaN if none", error="as published"
    ),
    "published_words": Variable(
        dims=("propagator",), units="", long_name="published time in the words of its source; empty if none"
    ),
    "published_source": Variable(dims=("propagator",), units="", long_name="source of the published time"),
}

_SPREAD = ("element", "propagator", "varied", "step")


def _spread(name: str, units: str, long_name: str, reference: str = "") -> Mapping[str, Variable]:
    return {
        name: Variable(dims=_SPREAD, units=units, long_name=long_name, reference=reference, error=f"see {name}_error"),
        f"{name}_error": Variable(
            dims=_SPREAD, units=units, long_name=f"numerical error of {name}", error="itself an estimate"
        ),
    }


POINT_SPREAD: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("element",), units="", long_name="name of the lens in figures and tables"),
    "airy_radius": Variable(
        dims=("element",),
        units="m",
        long_name="radius of the Airy disc of the lens at its declared values",
        error=ROUNDING,
    ),
    "value": Variable(
        dims=("element", "varied", "step"),
        units="mixed",
        long_name="value of the varied input, in the unit given by varied_units; NaN where this input has fewer "
        "values than another",
        error="none: declared",
    ),
    "chosen": Variable(
        dims=("propagator",),
        units="1",
        long_name="1 for the method that the tolerance requires, 0 for others",
        error="exact",
    ),
    "varied_units": Variable(dims=("varied",), units="", long_name="SI unit of the varied input"),
    "standing": Variable(
        dims=("element", "varied"),
        units="mixed",
        long_name="value of this input while another input is varied",
        error="none: declared",
    ),
    **_spread(
        "full_width",
        "m",
        "full width at half maximum of the image of a point, in the sagittal direction",
    ),
    **_spread(
        "half_energy_radius",
        "m",
        "radius of the circle about the thin-lens image that contains 50 % of the pupil's power",
    ),
    **_spread(
        "energy_radius_80",
        "m",
        "radius of the circle about the thin-lens image that contains 80 % of the pupil's power; NaN "
        "where the window contains less",
    ),
    **_spread(
        "rms_width",
        "m",
        "root-mean-square distance of the light from the thin-lens image, within point_spread.rms_radius",
    ),
    **_spread("strehl_ratio", "1", "largest intensity, relative to that of the same pupil without aberration"),
    **_spread("transfer_half_nyquist", "1", "modulation transfer at half the Nyquist frequency of the pixels"),
    **_spread(
        "outside_geometric",
        "1",
        "fraction of the pupil's power outside the disc that paraxial rays fill; 1 in focus, where the disc is a point",
    ),
    **_spread("neighbour_share", "1", "fraction of the pupil's power on the eight pixels around the central one"),
}
