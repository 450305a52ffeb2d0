"""/depth_of_field: where every camera is sharp, and how finely it resolves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import COUNTED, DECLARED, PAPER, ROUNDING, Variable

_THIN_LENS = "thin-lens equation; see tradestudy.optics.depth_of_field"


def _length(dims: tuple[str, ...], long_name: str, symbol: str = "", reference: str = _THIN_LENS) -> Variable:
    return Variable(dims=dims, units="m", long_name=long_name, symbol=symbol, reference=reference, error=ROUNDING)


DEPTH_OF_FIELD: Final[Mapping[str, Variable]] = {
    "blur_px": Variable(
        dims=("sharp",),
        units="px",
        long_name="largest blur that counts as sharp; for an unfocused plenoptic camera, 1 px is one microlens",
        symbol="c",
        error=DECLARED,
    ),
    "diffraction": Variable(
        dims=("sharp",),
        units="",
        long_name="which width of the diffraction spot counts in addition to defocus blur: 'none', 'fwhm' (full "
        "width at half maximum) or 'airy-diameter'",
    ),
    "slice_name": Variable(
        dims=("camera", "sharp", "slice"),
        units="",
        long_name="name of a slice; empty for indices after the last slice",
    ),
    "slice_near": _length(
        ("camera", "sharp", "slice"),
        "near limit of a slice; NaN where the slice is sharp nowhere, and for indices after the last slice",
    ),
    "slice_far": _length(
        ("camera", "sharp", "slice"),
        "far limit of a slice; infinite if the slice is focused at or beyond the hyperfocal distance; NaN "
        "where the slice is sharp nowhere, and for indices after the last slice",
    ),
    "sharp_near": _length(
        ("camera", "sharp", "stretch"),
        "near end of a range in which at least one slice is sharp; NaN for indices after the last range",
    ),
    "sharp_far": _length(
        ("camera", "sharp", "stretch"),
        "far end of a range in which at least one slice is sharp; may be infinite; NaN for indices after the last "
        "range",
    ),
    "gap_near": _length(
        ("camera", "sharp", "gap"),
        "near end of a gap between two slices, in which nothing is sharp; NaN for indices after the last gap",
    ),
    "gap_far": _length(
        ("camera", "sharp", "gap"),
        "far end of a gap between two slices, in which nothing is sharp; NaN for indices after the last gap",
    ),
    "overlap_near": _length(
        ("camera", "sharp", "overlap"),
        "near end of a range in which at least two slices are sharp; NaN for indices after the last range",
    ),
    "overlap_far": _length(
        ("camera", "sharp", "overlap"),
        "far end of a range in which at least two slices are sharp; may be infinite; NaN for indices after the last "
        "range",
    ),
    "extent": _length(
        ("camera", "sharp"), "depth of field: total length of all sharp ranges; infinite where sharp_far is infinite"
    ),
    "scene_share": Variable(
        dims=("camera", "sharp"),
        units="1",
        long_name="fraction of depth_of_field.range in which the camera is sharp",
        error=ROUNDING,
    ),
    "images": Variable(
        dims=("camera", "sharp"),
        units="1",
        long_name="number of images: for a focus stack, as many as cover the range declared for the stack, but no more "
        "than the key 'images' of the stack allows; for a camera that focuses on every object, as many as it needs to "
        "cover depth_of_field.range; for either, 0 if no number makes the range sharp; 1 for any other camera",
        error=COUNTED,
    ),
    "reason": Variable(
        dims=("camera", "sharp"),
        units="",
        long_name="why one or more slices are sharp nowhere; empty if every slice is sharp somewhere",
    ),
    "lateral_resolution": _length(
        ("camera", "distance"),
        "size of the smallest detail on the object that the camera resolves: the largest of resolution_of_sampling, "
        "resolution_of_blur and resolution_of_diffraction; if the camera takes a focus stack, its images are assumed "
        "to be spaced for a blur of 1 px; NaN where the camera forms no image",
        "r",
        "Rayleigh's criterion, unless sample or blur is larger; see tradestudy.optics.lateral_resolution",
    ),
    "resolution_of_sampling": _length(
        ("camera", "distance"),
        "pixel pitch (or microlens pitch) projected to the object; NaN where the camera forms no image",
        "p/m",
    ),
    "resolution_of_blur": _length(
        ("camera", "distance"),
        "geometric blur of defocus projected to the object; NaN where the camera forms no image",
        "A |a − a₀|/a₀",
    ),
    "resolution_of_diffraction": _length(
        ("camera", "distance"),
        "radius of the Airy disc projected to the object, whether or not a blur criterion includes diffraction; NaN "
        "where the camera forms no image",
        "1.22 λ N_w/m",
        "Rayleigh's criterion; N_w and m as for diffraction_width",
    ),
    "diffraction_width": _length(
        ("camera", "distance"),
        "full width at half maximum of the diffraction spot, projected to the object; NaN where the "
        "camera forms no image",
        "1.03 λ N_w/m",
        "Airy pattern for the wavelength λ, the working f-number N_w of the limiting aperture (the pupil, a microlens, "
        "or the part of the pupil that one view uses) and the magnification m from object to sensor",
    ),
    "scene_resolution": _length(("camera",), "largest lateral_resolution within depth_of_field.range", "r", ""),
    "scene_diffraction": _length(("camera",), "largest diffraction_width within depth_of_field.range", reference=""),
    "microlenses_seeing": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="mean number of microlenses that see a point of the object; NaN for all but focused plenoptic "
        "cameras",
        symbol="π r²/cell",
        reference=f"{PAPER}, section 2.2: area of the light cone on the array, of radius r, divided by the area of "
        "one lattice cell",
        error=ROUNDING,
    ),
    "total_covering_plane": _length(
        ("camera",),
        "distance of the total covering plane; NaN if there is none, as for all but focused plenoptic cameras",
        reference="",
    ),
    "resolved_near": _length(
        ("camera", "resolved"),
        "near end of a range in which the camera resolves a detail of size depth_of_field.equal_resolution; "
        "if the camera takes a focus stack, its images are assumed to be spaced for this resolution; NaN for indices "
        "after the last range",
        reference="",
    ),
    "resolved_far": _length(
        ("camera", "resolved"),
        "far end of the range that begins at resolved_near; NaN for indices after the last range",
        reference="",
    ),
    "resolved_extent": _length(
        ("camera",),
        "total length of the ranges from resolved_near to resolved_far",
        reference="",
    ),
    "resolved_scene_share": Variable(
        dims=("camera",),
        units="1",
        long_name="fraction of depth_of_field.range that the ranges from resolved_near to resolved_far cover",
        error=ROUNDING,
    ),
    "resolved_reason": Variable(
        dims=("camera",),
        units="",
        long_name="why the camera resolves depth_of_field.equal_resolution nowhere; empty if it does somewhere",
    ),
}
