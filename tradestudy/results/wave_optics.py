"""/fresnel_validity, /images, /point_spread: results of wave optics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import DECLARED, ESTIMATE, EXACT, PAPER, ROUNDING, Variable

_MEASURED = f"{PAPER}, Figure 6, which states neither measure nor window nor wavelength"
_ELEMENT = ("element", "wavelength")


def _f_number(dims: tuple[str, ...], long_name: str, reference: str, error: str = ROUNDING) -> Variable:
    return Variable(dims=dims, units="1", long_name=long_name, symbol="F", reference=reference, error=error)


FRESNEL_VALIDITY: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("element",), units="", long_name="name of the lens in figures and tables"),
    "focal_length": Variable(
        dims=("element",), units="m", long_name="focal length of the lens", symbol="f", error=DECLARED
    ),
    "object_distance": Variable(
        dims=("element",),
        units="m",
        long_name="distance from the lens to the point source, on which it is focused",
        symbol="a",
        error=DECLARED,
    ),
    "image_distance": Variable(
        dims=("element",),
        units="m",
        long_name="distance from the lens to the thin-lens image of the point source",
        symbol="b",
        error=ROUNDING,
    ),
    "camera_f_number": _f_number(("element",), "f-number at which the camera uses the lens", "", "none: declared"),
    "published_f_number": _f_number(
        ("element",), "f-number to which published_error refers; NaN if none is declared", "", "none: declared"
    ),
    "published_error": Variable(
        dims=("element",),
        units="1",
        long_name="published error of Fresnel's approximation at published_f_number; NaN if none is declared",
        error=DECLARED,
    ),
    "published_minimum": _f_number(
        ("element",),
        "published minimum f-number for Fresnel's approximation; NaN if none is declared",
        f"{PAPER}, section 5.3",
        DECLARED,
    ),
    "psf_error": Variable(
        dims=("element", "lens_phase", "wavelength", "f_number", "metric", "window"),
        units="1",
        long_name="difference, according to each 'metric', between the point-spread functions that Fresnel's "
        "approximation and Kirchhoff's integral give for a point source on the axis",
        reference=_MEASURED,
        error="see psf_error_numerical",
    ),
    "psf_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "f_number", "metric", "window"),
        units="1",
        long_name="numerical error of psf_error",
        error=ESTIMATE,
    ),
    "off_axis_error": Variable(
        dims=("element", "lens_phase", "f_number", "metric", "window"),
        units="1",
        long_name="as psf_error, but at the field angle and the wavelength of fresnel_validity.off_axis",
        reference=_MEASURED,
        error="see off_axis_error_numerical",
    ),
    "off_axis_error_numerical": Variable(
        dims=("element", "lens_phase", "f_number", "metric", "window"),
        units="1",
        long_name="numerical error of off_axis_error",
        error=ESTIMATE,
    ),
    "published_point_error": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="as psf_error, but at published_f_number or, if none is declared, at camera_f_number",
        reference=_MEASURED,
        error="see published_point_error_numerical",
    ),
    "published_point_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="numerical error of published_point_error",
        error=ESTIMATE,
    ),
    "camera_point_error": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="as psf_error, but at camera_f_number",
        error="see camera_point_error_numerical",
    ),
    "camera_point_error_numerical": Variable(
        dims=("element", "lens_phase", "wavelength", "metric", "window"),
        units="1",
        long_name="numerical error of camera_point_error",
        error=ESTIMATE,
    ),
    "off_axis_camera_error": Variable(
        dims=("element", "lens_phase", "metric", "window"),
        units="1",
        long_name="as off_axis_error, but at camera_f_number",
        error="see off_axis_camera_error_numerical",
    ),
    "off_axis_camera_error_numerical": Variable(
        dims=("element", "lens_phase", "metric", "window"),
        units="1",
        long_name="numerical error of off_axis_camera_error",
        error=ESTIMATE,
    ),
    "limit_f_number": _f_number(
        ("element", "lens_phase", "wavelength", "metric", "window"),
        "f-number above which psf_error stays below fresnel_validity.error_limit; 0 if it does so at all values of "
        "fresnel_validity.f_numbers, infinite if it exceeds the limit even at the largest value",
        _MEASURED,
        "1e-4, relative, plus the error of psf_error divided by the slope of psf_error with respect to the f-number",
    ),
    "paper_eq27_f_number": _f_number(
        (*_ELEMENT, "zero"),
        "minimum f-number by eq. 27 of the paper as printed; not to be trusted, because a tiny change in a length "
        "can change it considerably (see paper_eq27_condition); 'first' is infinite where the fractional part of "
        "4 (a + b)/λ is 0",
        f"{PAPER}, eq. 27",
    ),
    "paper_eq27_condition": Variable(
        dims=_ELEMENT,
        units="1",
        long_name="condition number of eq. 27: relative change of the fractional part of 4 (a + b)/λ, which decides "
        "the solutions, per relative change of a length; infinite where this part is 0",
        reference=f"{PAPER}, eq. 27",
        error=ROUNDING,
    ),
    "paper_eq27_sweep": _f_number(
        (*_ELEMENT, "zero", "quarter_wave"),
        "paper_eq27_f_number for values of a + b that increase through a quarter of a wavelength (along quarter_wave); "
        "'first' is infinite where quarter_wave is 0",
        f"{PAPER}, eq. 27",
    ),
    "path_error_f_number": _f_number(
        (*_ELEMENT, "path_error"),
        "smallest f-number at which the optical path that Fresnel's approximation neglects is at most path_error "
        "wavelengths",
        "(f/2) [(1/a³ + 1/b³)/(8 λ ε)]^¼, with path_error ε, from the quartic term of this path; for distant "
        "objects, the next term is about r²/(2 b²) times this one, with the radius r of the pupil",
    ),
    "goodman_f_number": _f_number(
        _ELEMENT,
        "smallest f-number at which Fresnel's approximation neglects at most 1 rad of phase between the object and the "
        "lens, and at most 1 rad between the lens and the image",
        "Goodman 2005, section 4.2.2",
    ),
    "southwell_f_number": _f_number(
        _ELEMENT,
        "smallest f-number at which the error of Fresnel's approximation on the axis is at most "
        "fresnel_validity.error_limit for a plane wave that is diffracted by a clear aperture of the size of the pupil "
        "and observed at image_distance",
        "after Southwell (1981)",
    ),
}

IMAGES: Final[Mapping[str, Variable]] = {
    "image": Variable(
        dims=("propagator", "row", "column"),
        units="1",
        long_name="fraction of the power in the pupil of the main lens that falls on a pixel",
        reference=f"{PAPER}, Figure 7 and eqs. 14, 16, 22, 25, corrected for the errata listed in "
        "docs/explanation/paper.md",
        error="see numerical_error",
    ),
    "numerical_error": Variable(
        dims=("propagator",),
        units="1",
        long_name="relative numerical error of 'image', in the L2 norm over its pixels",
        error=ESTIMATE,
    ),
    "power": Variable(
        dims=("propagator",),
        units="1",
        long_name="fraction of the power in the pupil of the main lens that falls on the detector",
        error="relative: at most κ times numerical_error, with κ = √n ‖I‖/Σ I for the n pixels of the image I",
    ),
    "lit_pixels": Variable(
        dims=("propagator",),
        units="1",
        long_name="number of pixels with more than 1 % of the light of the brightest pixel",
        error="not estimated: numerical errors of the intensities can move pixels across the threshold of 1 %",
    ),
    "outside_geometric": Variable(
        dims=("propagator",),
        units="1",
        long_name="fraction of the light on the detector that falls on pixels that the method 'geometric' leaves dark",
        error="at most κ times numerical_error, with κ as for 'power'",
    ),
    "difference": Variable(
        dims=("propagator", "against"),
        units="1",
        long_name="L1 difference Σ|I − J|/Σ J of two images over their pixels: I by the method along 'propagator', "
        "J by the method along 'against'",
        error="at most (1 + 'difference') times the sum, over both images, of κ times numerical_error, with κ as for "
        "'power'; less where they share errors",
    ),
    "difference_l2": Variable(
        dims=("propagator", "against"),
        units="1",
        long_name="L2 difference ‖I − J‖/‖J‖ of two images over their pixels: I by the method along 'propagator', J "
        "by the method along 'against'",
        error="at most (1 + difference_l2) times the sum of numerical_error over both images; less where they share "
        "errors",
    ),
    "chosen": Variable(
        dims=("propagator",),
        units="1",
        long_name="whether this method computes chosen_image",
        error=EXACT,
    ),
    "chosen_image": Variable(
        dims=("row", "column"),
        units="1",
        long_name="as 'image', by the models that accuracy.pixel_intensity requires; the group's attributes whose "
        "names begin with 'chosen_' say which models these are",
        reference=f"{PAPER}, Figure 7 and eqs. 14, 16, 22, 25, corrected for the errata listed in "
        "docs/explanation/paper.md",
        error="see chosen_error; the effects left out add a further error, joint_change of /effects",
    ),
    "chosen_error": Variable(
        dims=(),
        units="1",
        long_name="relative numerical error of chosen_image, in the L2 norm over its pixels",
        error=ESTIMATE,
    ),
    "spectral_share": Variable(
        dims=("wavelength",),
        units="1",
        long_name="fraction of the light at this wavelength",
        error=DECLARED,
    ),
    "microlens_x": Variable(
        dims=("microlens",),
        units="m",
        long_name="position of the centre of a microlens along the rows of the array, relative to the optical axis",
        error=ROUNDING,
    ),
    "microlens_y": Variable(
        dims=("microlens",),
        units="m",
        long_name="position of the centre of a microlens across the rows of the array, relative to the optical axis",
        error=ROUNDING,
    ),
    "microlens_focal_length": Variable(
        dims=("microlens",), units="m", long_name="focal length of a microlens", symbol="f_L", error=DECLARED
    ),
    "benchmark_error": Variable(
        dims=("benchmark",),
        units="1",
        long_name="relative numerical error of the intensities that a benchmark computes, in the L2 norm",
        error=ESTIMATE,
    ),
    "published_seconds": Variable(
        dims=("propagator",),
        units="s",
        long_name="published computing time of the method; NaN if none is declared as a number",
        error=DECLARED,
    ),
    "published_words": Variable(
        dims=("propagator",),
        units="",
        long_name="published computing time in the words of its source; empty if none is declared",
    ),
    "published_source": Variable(
        dims=("propagator",), units="", long_name="source of the published computing time; empty if none is declared"
    ),
}

_SPREAD = ("element", "propagator", "varied", "step")


def _spread(name: str, units: str, long_name: str, reference: str = "") -> Mapping[str, Variable]:
    return {
        name: Variable(
            dims=_SPREAD,
            units=units,
            long_name=f"{long_name} for indices after the last value of the varied input",
            reference=reference,
            error=f"see {name}_error",
        ),
        f"{name}_error": Variable(
            dims=_SPREAD,
            units=units,
            long_name=f"numerical error of {name}; NaN where {name} is NaN",
            error=ESTIMATE,
        ),
    }


POINT_SPREAD: Final[Mapping[str, Variable]] = {
    "title": Variable(dims=("element",), units="", long_name="name of the lens in figures and tables"),
    "airy_radius": Variable(
        dims=("element",),
        units="m",
        long_name="radius of the first dark ring of the Airy pattern, at the declared f-number and "
        "point_spread.reference_wavelength",
        error=ROUNDING,
    ),
    "value": Variable(
        dims=("element", "varied", "step"),
        units="mixed",
        long_name="value of the varied input, in the unit given by varied_units; NaN beyond its last value",
        error=DECLARED,
    ),
    "chosen": Variable(
        dims=("propagator",),
        units="1",
        long_name="1 if the program uses this method, because the tolerance accuracy.psf_width requires it or the key "
        "'effects' prescribes it; 0 otherwise",
        error=EXACT,
    ),
    "varied_units": Variable(
        dims=("varied",),
        units="",
        long_name="SI unit of the varied input, except for defocus, whose unit is 'wave': one wavelength of optical "
        "path",
    ),
    "standing": Variable(
        dims=("element", "varied"),
        units="mixed",
        long_name="value of the input while another one varies, in the unit given by varied_units",
        error=DECLARED,
    ),
    **_spread(
        "full_width",
        "m",
        "full width at half maximum, perpendicular to the plane of the field angle (sagittal); NaN where the half "
        "maximum lies outside the computed square, and",
    ),
    **_spread(
        "half_energy_radius",
        "m",
        "radius of the circle that contains 50 % of the pupil's power; NaN where the computed square contains less, "
        "and",
    ),
    **_spread(
        "energy_radius_80",
        "m",
        "radius of the circle that contains 80 % of the pupil's power; NaN where the computed square contains less, "
        "and",
    ),
    **_spread(
        "rms_width",
        "m",
        "root-mean-square distance of the light from the thin-lens image, within point_spread.rms_radius; NaN where "
        "this radius reaches beyond the computed square, and",
    ),
    **_spread(
        "strehl_ratio",
        "1",
        "Strehl ratio: largest intensity, relative to that of the same pupil without aberration or defocus; NaN",
    ),
    **_spread(
        "transfer_half_nyquist",
        "1",
        "modulation transfer at half the Nyquist frequency of pixels with point_spread.pixel_pitch; NaN",
    ),
    **_spread(
        "outside_geometric",
        "1",
        "fraction of the pupil's power outside the disc that paraxial rays fill; 1 in focus, where this disc is a "
        "point; NaN where the disc is not within the computed square, and",
    ),
    **_spread(
        "neighbour_share",
        "1",
        "fraction of the pupil's power on the eight pixels around the one that is centred on the thin-lens image; NaN "
        "where they reach beyond the computed square, and",
    ),
}
