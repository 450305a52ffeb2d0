"""Depth of field: the answer for the first page, numbers by every criterion, and a comparison of the cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import (
    Block,
    Column,
    Heading,
    Paragraph,
    Table,
    Text,
    pictures_of,
    say,
)
from tradestudy.report.words import length, share
from tradestudy.results.views.depth import SharpCamera, by_first_criterion, sharp_cameras, sharp_ranges
from tradestudy.results.views.groups import camera_titles, group, has
from tradestudy.units import PIXELS, pretty, significant
from tradestudy.wording import span, within

_MOST_ROWS = 12  # cameras on the first page
_SPOT = {
    "none": "defocus alone",
    "fwhm": "with diffraction (width at half maximum)",
    "airy-diameter": "with diffraction (Airy diameter)",
}


def describe_sharp_answer(tree: xr.DataTree) -> Iterator[Block]:
    """Say which camera keeps the scene sharp, at what resolution, with how many exposures and moving parts."""
    if not has(tree, "depth_of_field", "scene_share"):
        return
    rows = sharp_cameras(tree)
    yield Heading(text="What stays sharp", anchor="sharp-answer")
    yield _answer_table(tree, rows)


def _scene(tree: xr.DataTree) -> str:
    data = group(tree, "depth_of_field")
    return f"{length(float(data.attrs['scene_near']))} to {length(float(data.attrs['scene_far']))}"


def _criterion_words(criterion: xr.Dataset) -> str:
    return f"{pretty(float(criterion['blur_px']), PIXELS)}, {_SPOT[str(criterion['diffraction'].item())]}"


def _ends(ranges: tuple[tuple[float, float], ...]) -> str:
    return " and ".join(span(*within(*ends)) for ends in ranges) or "nowhere"


def _answer_table(tree: xr.DataTree, rows: Sequence[SharpCamera]) -> Table:
    first = by_first_criterion(tree)
    most = _MOST_ROWS if len(rows) > _MOST_ROWS + 1 else len(rows)

    def cells(row: SharpCamera) -> tuple[Text, ...]:
        sharp = share(row.share) if row.share > 0.0 else "none"
        return (
            row.title,
            say("**{sharp}**", sharp="all") if row.keeps_all else sharp,
            _ends(row.stretches),
            length(row.resolution) if row.share > 0.0 else "—",
            length(row.diffraction) if row.share > 0.0 else "—",
            str(row.images) if row.images else "—",
            row.moving_parts,
        )

    return Table(
        name="sharp-table",
        caption=say(
            "Sharp part of the scene, {scene}, by the criterion “{criterion}”. Cameras that keep all of it sharp come "
            "first.",
            scene=_scene(tree),
            criterion=_criterion_words(first),
        ),
        columns=(
            Column(title="Camera", weight=8),
            Column(title="Scene sharp", align="right", weight=4),
            Column(title="Sharp from – to", align="right", weight=8),
            Column(title="Resolves in scene", align="right", weight=5),
            Column(title="Diffraction spot", align="right", weight=5),
            Column(title="Exposures", align="right"),
            Column(title="Moving parts", align="right", weight=4),
        ),
        rows=tuple(cells(row) for row in rows[:most]),
        notes=(
            *([f"{len(rows) - most} more cameras: section “Depth of field”."] if len(rows) > most else []),
            "Resolves in scene: the largest of sampling interval, defocus blur and radius of the Airy disc on the "
            "object, where it is coarsest within the scene. Diffraction spot: width at half maximum on the object. "
            "Distances are from the principal plane.",
        ),
    )


def describe_depth_of_field(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the depth of field by every criterion and at equal resolution, and the lateral resolution."""
    if not has(tree, "depth_of_field", "scene_share"):
        return
    yield Heading(text="Depth of field", anchor="depth-of-field-results")
    yield Paragraph(
        say(
            "A point is sharp where its geometric blur *g* and the diffraction spot *d*, added in quadrature, do not "
            "exceed the criterion *c*: *g*² + *d*² ≤ *c*². For a camera without microlenses, the near and far limits "
            "are those of a thin lens, without approximation. The virtual depth *v* is the distance from the "
            "microlens array to the image that the main lens forms, divided by the gap between array and sensor; it is "
            "*v*~0~ in focus. A microlens of diameter *D* blurs a point by *D*\u00a0|\N{WORD JOINER}1/*v*\u00a0−\u00a0"
            "1/*v*~0~|. Its depth of field is therefore symmetric in 1/*v*; the main lens maps the limits "
            "to object distances. Each view of an unfocused plenoptic camera is treated as the picture of a lens as "
            "wide as its part of the pupil. It has one sample per microlens, so that *c* counts microlenses instead of "
            "pixels."
        )
    )
    yield _criteria_of_sharpness(tree)
    yield from _slices(tree)
    yield from _equal_resolution(tree)
    yield from pictures_of(drawings, "lateral-resolution")
    yield from _coverage(tree)


def _criteria_of_sharpness(tree: xr.DataTree) -> Table:
    data, titles = group(tree, "depth_of_field"), camera_titles(tree)
    rows: list[tuple[Text, ...]] = []
    for criterion in data["sharp"].values:
        by_criterion = data.sel(sharp=criterion)
        rows.append((f"Criterion: {_criterion_words(by_criterion)}",))
        for key, title in titles.items():
            camera = by_criterion.sel(camera=key)
            ranges = sharp_ranges(camera, "sharp")
            gaps = sharp_ranges(camera, "gap")
            rows.append(
                (
                    title,
                    _ends(ranges),
                    length(float(camera["extent"])) if ranges else "—",
                    share(float(camera["scene_share"])) if ranges else "—",
                    str(int(camera["images"])) if ranges and int(camera["images"]) else "—",
                    ("gaps: " * bool(gaps) + "; ".join(span(*within(*gap, math.floor, math.ceil)) for gap in gaps))
                    or str(camera["reason"].item()).split(";")[0].removesuffix(": nothing is sharp"),
                )
            )
    return Table(
        name="depth-of-field-table",
        caption="Depth of field by every criterion of the study.",
        columns=(
            Column(title="Camera", weight=3),
            Column(title="Sharp", weight=3),
            Column(title="Depth of field", align="right"),
            Column(title="Scene sharp", align="right"),
            Column(title="Exposures", align="right"),
            Column(title="Gaps, or why nothing is sharp", weight=4),
        ),
        rows=tuple(rows),
    )


def _slices(tree: xr.DataTree) -> Iterator[Block]:
    """List the slices of cameras that have several."""
    data, titles = by_first_criterion(tree), camera_titles(tree)
    rows: list[tuple[Text, ...]] = []
    for key, title in titles.items():
        camera = data.sel(camera=key)
        names = [str(slice_name) for slice_name in camera["slice_name"].values if str(slice_name)]
        if len(names) > 1:
            limits = zip(camera["slice_near"].values, camera["slice_far"].values, strict=True)
            parts = [
                f"{slice_name}: {_ends(((float(near), float(far)),))}"
                if np.isfinite(near)
                else f"{slice_name}: nowhere"
                for slice_name, (near, far) in zip(names, limits, strict=False)
            ]
            overlaps = _ends(sharp_ranges(camera, "overlap")) if sharp_ranges(camera, "overlap") else "none"
            rows.append((title, "; ".join(parts), overlaps))
    if rows:
        yield Table(
            name="slice-table",
            caption="Depth of field of each image of a stack and each type of microlens, by the criterion "
            f"“{_criterion_words(data)}”.",
            columns=(
                Column(title="Camera", weight=2),
                Column(title="Depths of field", weight=5),
                Column(title="Overlaps", weight=3),
            ),
            rows=tuple(rows),
        )


def _equal_resolution(tree: xr.DataTree) -> Iterator[Block]:
    data, titles = group(tree, "depth_of_field"), camera_titles(tree)
    if "resolved_near" not in data:
        return
    size = length(float(data.attrs["equal_resolution"]))
    unresolved = any(str(reason) for reason in data["resolved_reason"].values)
    yield Table(
        name="equal-resolution-table",
        caption=f"Comparison at equal lateral resolution: distances at which {size} on the object is resolved.",
        columns=(
            Column(title="Camera", weight=3),
            Column(title="Resolved", weight=3),
            Column(title="Depth of field", align="right"),
            Column(title="Scene resolved", align="right"),
            *((Column(title="Why nowhere resolved", weight=4),) if unresolved else ()),
        ),
        notes=(
            "Here a detail counts as resolved if one picture resolves it; measuring its depth also requires that two "
            "microlenses, views or lenses see it.",
        ),
        rows=tuple(
            (
                title,
                _ends(sharp_ranges(data.sel(camera=key), "resolved")),
                length(float(data["resolved_extent"].sel(camera=key))),
                share(float(data["resolved_scene_share"].sel(camera=key))),
                *((str(data["resolved_reason"].sel(camera=key).item()),) if unresolved else ()),
            )
            for key, title in titles.items()
        ),
    )


def _coverage(tree: xr.DataTree) -> Iterator[Block]:
    """List how many microlenses see a point of the scene."""
    data, titles = group(tree, "depth_of_field"), camera_titles(tree)
    ends = (float(data.attrs["scene_near"]), float(data.attrs["scene_far"]))
    rows = []
    for key, title in titles.items():
        seeing = data["microlenses_seeing"].sel(camera=key)
        if np.isfinite(seeing.values).any():
            counts = (float(seeing.sel(distance=end, method="nearest")) for end in ends)
            plane = float(data["total_covering_plane"].sel(camera=key))
            cells = (significant(count) if np.isfinite(count) else "—" for count in counts)
            rows.append((title, length(plane) if np.isfinite(plane) else "—", *cells))
    if rows:
        yield Table(
            name="coverage-table",
            caption="Mean number of microlenses that see a point, at each end of the scene: the light reaches their "
            "centres, or they receive the share of it that depth.least_lit_share declares. At the total covering "
            "plane, the magnitude of the virtual depth is 2.",
            columns=(
                Column(title="Camera", weight=2),
                Column(title="Total covering plane", align="right", weight=1),
                *(Column(title=f"at {length(end)}", align="right", weight=1) for end in ends),
            ),
            rows=tuple(rows),
        )
