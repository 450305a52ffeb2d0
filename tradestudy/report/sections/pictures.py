"""Pictures of the study's scene."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Column, Heading, Paragraph, Table, pictures_of, say
from tradestudy.report.words import length, share
from tradestudy.results.views.groups import camera_titles, group, has


def describe_pictures(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show the pictures of the scene, and say how they were made; nothing for a study without any."""
    if not has(tree, "pictures", "brightness"):
        return
    data, titles = group(tree, "pictures"), camera_titles(tree)
    yield Heading(text="Pictures of the scene", anchor="pictures")
    yield Paragraph(
        say(
            "The pictures are rendered through every lens, with diffraction where that effect is simulated. "
            "The folder `pictures` beside this report contains them in full, with the true depth in each pixel and the "
            "parameters of each camera."
        )
    )
    yield from pictures_of(drawings, "scene_pictures")
    yield Table(
        name="scene-pictures-table",
        caption="The pictures. Sampling error: relative root-mean-square difference from a picture with 16 times as "
        "many rays and, with diffraction, with four times as many point-spread functions; both without noise.",
        columns=(
            Column(title="Camera", weight=3),
            Column(title="Picture", weight=2),
            Column(title="Pixels", align="right"),
            Column(title="Pixel pitch", align="right"),
            Column(title="Saturated pixels", align="right"),
            Column(title="Sampling error", align="right"),
        ),
        rows=tuple(
            (
                titles[str(camera)],
                str(name).removeprefix(f"{camera} "),
                f"{int(columns)} × {int(rows)}",
                length(float(pitch)),
                str(int(full)),
                share(float(error), digits=2),
            )
            for name, camera, columns, rows, pitch, full, error in zip(
                data["picture"].values,
                *(
                    data[key].values
                    for key in ("camera_of", "columns", "rows", "pixel_pitch", "saturated", "sampling_error")
                ),
                strict=True,
            )
        ),
    )
