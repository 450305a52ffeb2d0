"""Who is compared: the cameras of a study, with what follows from their inputs."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from tradestudy.report.document import Block, Bullets, Column, Heading, Table, say
from tradestudy.results.views.cameras import camera_families, camera_titles
from tradestudy.results.views.groups import group, has, records


def describe_cameras(tree: xr.DataTree) -> Iterator[Block]:
    """Write one line per camera and a table of their derived properties, one per family."""
    rows = records(tree, "cameras", "camera")
    if not rows:
        return
    yield Heading(text="Cameras", anchor="cameras")
    yield Bullets(
        tuple(
            say("**{title}** ({kind}). {note}", title=str(r["title"]), kind=str(r["kind"]), note=str(r.get("note", "")))
            for r in rows
        )
    )
    families = camera_families(tree)
    for family in dict.fromkeys(families.values()):
        yield from _properties(tree, family, [key for key, other in families.items() if other == family])


def _properties(tree: xr.DataTree, family: str, keys: list[str]) -> Iterator[Block]:
    """Write the derived properties of the cameras of one family side by side."""
    if not has(tree, "cameras", "property_camera", "property_name", "property_value"):
        return
    data, titles = group(tree, "cameras"), camera_titles(tree)
    values = {
        (str(camera), str(name)): str(value)
        for camera, name, value in zip(
            data["property_camera"].values, data["property_name"].values, data["property_value"].values, strict=True
        )
    }
    names = list(dict.fromkeys(name for camera, name in values if camera in keys))
    if names:
        yield Table(
            name=f"properties-{family}",
            caption=f"What follows from the inputs of the {family} cameras.",
            columns=(Column(title="Property", weight=3), *(Column(title=titles[key], weight=2) for key in keys)),
            rows=tuple((name, *(values.get((key, name), "—") for key in keys)) for name in names),
        )
