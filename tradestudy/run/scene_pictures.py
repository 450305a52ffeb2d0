"""The pictures of a study's scene and the depth that is measured in them: taken once, kept as files and in memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tradestudy.execution import Steps
from tradestudy.run.depth_maps import MeasuredDepth, measure_depth, set_up_readers, write_depth
from tradestudy.run.pictures import Rendering, render_scene, write_pictures
from tradestudy.study.definition import StudyDefinition


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenScene:
    """What came of a study's scene.

    Parameters
    ----------
    rendering
        All pictures.
    depths
        Measured in those of each camera; none where nobody asked for it.
    written
        Files of the pictures.
    """

    rendering: Rendering
    depths: Sequence[MeasuredDepth]
    written: Sequence[Path]


def take_scene(definition: StudyDefinition, directory: Path | None, steps: Steps, *, depth: bool) -> TakenScene:
    """Render every picture of the study's scene, measure depth in them where that is asked for, and write both.

    Parameters
    ----------
    definition
        A study with ``scene.image``, its calibrations inferred.
    directory
        Where to: a folder for each camera, with its pictures, their depth, ``camera.json`` and its depth map; None
        writes nothing.
    steps
        How tiles and maps are computed.
    depth
        Whether depth is measured.

    Raises
    ------
    StudyError
        For a study that declares no scene to render, or one that cannot be.
    UnaffordableError
        Where the pictures do not fit into the memory that is free, before anything is rendered.
    OutOfRangeError
        Where a camera cannot measure depth in its pictures, before anything is rendered.
    """
    readers = set_up_readers(definition) if depth else []
    rendering = render_scene(definition, steps)
    written = write_pictures(rendering, directory) if directory is not None else []
    depths = measure_depth(rendering, readers, steps)
    if directory is not None:
        for one in depths:
            write_depth(one, directory / one.camera, rendering.image.depth_format)
    return TakenScene(rendering=rendering, depths=depths, written=written)
