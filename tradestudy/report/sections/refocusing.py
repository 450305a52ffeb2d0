"""Refocusing of unfocused plenoptic cameras: the finding, one figure, and one table of planes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, Text, pictures_of, say
from tradestudy.report.words import interval, length
from tradestudy.results.views.refocusing import refocused_cameras, refocusing_words
from tradestudy.units import PIXELS, pretty, significant
from tradestudy.wording import counted, distance

_MOST_ROWS: Final = 25  # of a camera


def describe_refocusing(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Say on what each camera can refocus, and how deep its pictures are sharp."""
    cameras = list(refocused_cameras(tree))
    if not cameras:
        return
    yield Heading(text="Refocusing", anchor="refocused-planes")
    yield Paragraph(". ".join(refocusing_words(tree)) + ".")
    yield Paragraph(
        say(
            "By blur, the sum of all shifted views is sharp where its blur is at most {blur} (1 px is one microlens); "
            "by rays, up to where rays of the outermost views from the edges of pixels through the edges of "
            "microlenses meet, as C. Hahne defines it (Optics Express 24, 2016). Neither contains diffraction or "
            "errors of the calibration. Shifts are those between neighbouring views, in microlenses.",
            blur=pretty(float(cameras[0][1].attrs["blur_px"]), PIXELS),
        )
    )
    yield from pictures_of(drawings, "refocusing")
    yield _table(cameras)


def _table(cameras: list[tuple[str, xr.Dataset]]) -> Table:
    rows: list[tuple[Text, ...]] = []
    for title, camera in cameras:
        rows.append((f"{title}: {_pairs(camera)}",))
        rows += [_row(camera, k) for k in _some(camera)]
    left = sum(camera.sizes["plane"] - len(_some(camera)) for _, camera in cameras)
    return Table(
        name="refocusing-table",
        caption="Refocused planes, and the depth of field of a picture refocused on each, by blur and by rays; "
        "disparity of a point there between the outermost pair of views.",
        columns=(
            Column(title="Shift", align="right"),
            Column(title="Distance", align="right"),
            Column(title="Sharp by blur", align="right", weight=3),
            Column(title="Sharp by rays", align="right", weight=3),
            Column(title="From entrance pupil", align="right", weight=2),
            Column(title="From array", align="right", weight=2),
            Column(title="Disparity", unit="px", align="right"),
        ),
        rows=tuple(rows),
        notes=(
            *([f"{counted(left, 'more plane')}: results.nc, group refocusing."] if left else []),
            "Distances count from the first principal plane. PlenoptiSign counts refocused distances from the array, "
            "and triangulated ones from the entrance pupil. Baselines are distances in the entrance pupil.",
        ),
    )


def _some(camera: xr.Dataset) -> list[int]:
    """Indices of planes that the table lists, from the nearest, spread evenly if there are many."""
    count = camera.sizes["plane"]
    return [int(k) for k in np.unique(np.linspace(0, count - 1, min(count, _MOST_ROWS)).round())][::-1]


def _pairs(camera: xr.Dataset) -> str:
    pairs = zip(camera["pair_pixels"].values, camera["pair_baseline"].values, strict=True)
    words = [f"{length(base)} ({significant(pixels)} px apart)" for pixels, base in pairs if np.isfinite(pixels)]
    return f"baselines of pairs of views {', '.join(words)}"


def _row(camera: xr.Dataset, k: int) -> tuple[Text, ...]:
    refocused, pupil, array = (
        float(camera[variable][k]) for variable in ("refocused_distance", "from_pupil", "from_array")
    )
    sharp = [interval(float(camera[f"{by}_near"][k]), float(camera[f"{by}_far"][k])) for by in ("blur", "ray")]
    disparity = significant(float(np.nanmax(camera["pair_pixels"].values)) * float(camera["shift"][k]))
    return (
        significant(float(camera["shift"][k])),
        distance(refocused),
        *sharp,
        distance(pupil),
        distance(array),
        disparity,
    )
