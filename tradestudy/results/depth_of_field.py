"""/depth_of_field: where every camera is sharp, and how finely it resolves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from tradestudy.results.variable import PAPER, ROUNDING, Variable

_THIN_LENS = "exact thin lens; see tradestudy.optics.depth_of_field"
_RESOLUTION = "larger of lateral sample and geometric blur on the object; see tradestudy.optics.lateral_resolution"


def _length(dims: tuple[str, ...], long_name: str, symbol: str = "", reference: str = _THIN_LENS) -> Variable:
    return Variable(dims=dims, units="m", long_name=long_name, symbol=symbol, reference=reference, error=ROUNDING)


DEPTH_OF_FIELD: Final[Mapping[str, Variable]] = {
    "blur_px": Variable(
        dims=("sharp",),
        units="px",
        long_name="largest blur that counts as sharp, in pixels; for an unfocused plenoptic camera, in microlenses",
        symbol="c",
        error="none: declared",
    ),
    "diffraction": Variable(
        dims=("sharp",),
        units="",
        long_name="width of the diffraction spot that counts in addition to defocus: none, fwhm or airy-diameter",
    ),
    "slice_name": Variable(
        dims=("camera", "sharp", "slice"),
        units="",
        long_name="name of a slice (an image of a focus stack, a microlens type, or the lens); empty if there "
        "are fewer slices",
    ),
    "slice_near": _length(
        ("camera", "sharp", "slice"), "near limit of sharpness of a slice; NaN where nothing is sharp"
    ),
    "slice_far": _length(
        ("camera", "sharp", "slice"),
        "far limit of sharpness of a slice; infinite from the hyperfocal distance on; NaN where nothing is sharp",
    ),
    "sharp_near": _length(
        ("camera", "sharp", "stretch"), "near end of a range that is sharp in some slice; NaN if there are fewer ranges"
    ),
    "sharp_far": _length(
        ("camera", "sharp", "stretch"),
        "far end of a range that is sharp in some slice; infinite where a far limit is; NaN if there are fewer ranges",
    ),
    "gap_near": _length(
        ("camera", "sharp", "gap"),
        "near end of a gap between slices, where nothing is sharp; NaN if there are fewer gaps",
    ),
    "gap_far": _length(
        ("camera", "sharp", "gap"),
        "far end of a gap between slices, where nothing is sharp; NaN if there are fewer gaps",
    ),
    "overlap_near": _length(
        ("camera", "sharp", "overlap"),
        "near end of a range that is sharp in two or more slices; NaN if there are fewer ranges",
    ),
    "overlap_far": _length(
        ("camera", "sharp", "overlap"),
        "far end of a range that is sharp in two or more slices; infinite where a far limit is; NaN if "
        "there are fewer ranges",
    ),
    "extent": _length(("camera", "sharp"), "total length of all sharp ranges; infinite where a far limit is"),
    "scene_share": Variable(
        dims=("camera", "sharp"),
        units="1",
        long_name="fraction of depth_of_field.range in which the camera is sharp",
        error=ROUNDING,
    ),
    "images": Variable(
        dims=("camera", "sharp"),
        units="1",
        long_name="number of images that the camera takes of the scene; 0 where no number of images suffices",
        error="none: a count",
    ),
    "reason": Variable(
        dims=("camera", "sharp"),
        units="",
        long_name="why nothing is sharp, or why a slice is not; empty if all slices are",
    ),
    "lateral_resolution": _length(
        ("camera", "distance"),
        "size of the smallest detail on the object that is resolved geometrically",
        "r",
        _RESOLUTION,
    ),
    "diffraction_width": _length(
        ("camera", "distance"),
        "full width at half maximum of the diffraction spot, projected to the object",
        "1.03 λ N_w/m",
        "Airy pattern of the limiting pupil: lens, microlens, or part of the pupil of one view",
    ),
    "scene_resolution": _length(
        ("camera",), "coarsest geometric resolution on the object within depth_of_field.range", "r", _RESOLUTION
    ),
    "scene_diffraction": _length(("camera",), "largest diffraction_width within depth_of_field.range", "", _RESOLUTION),
    "microlenses_seeing": Variable(
        dims=("camera", "distance"),
        units="1",
        long_name="mean number of microlenses that see a point; NaN for all but focused plenoptic cameras",
        symbol="π r²/cell",
        reference=f"{PAPER}, section 2.2; area of the pupil's shadow divided by that of a cell",
        error=ROUNDING,
    ),
    "total_covering_plane": _length(
        ("camera",),
        "distance at which the magnitude of the virtual depth is 2; NaN where there is none, or for "
        "other kinds of camera",
        reference="from there on, with matched f-numbers, two microlenses see every point",
    ),
    "resolved_near": _length(
        ("camera", "resolved"),
        "near end of a range in which the camera resolves depth_of_field.equal_resolution",
        "",
        _RESOLUTION,
    ),
    "resolved_far": _length(
        ("camera", "resolved"),
        "far end of a range in which the camera resolves depth_of_field.equal_resolution",
        "",
        _RESOLUTION,
    ),
    "resolved_extent": _length(
        ("camera",),
        "total length of the ranges in which the camera resolves depth_of_field.equal_resolution",
        "",
        _RESOLUTION,
    ),
    "resolved_scene_share": Variable(
        dims=("camera",),
        units="1",
        long_name="fraction of depth_of_field.range in which the camera resolves depth_of_field.equal_resolution",
        error=ROUNDING,
    ),
    "resolved_reason": Variable(
        dims=("camera",),
        units="",
        long_name="why the camera resolves depth_of_field.equal_resolution nowhere; empty where it does somewhere",
    ),
}
