"""The pictures of a study's scene and the depth measured in them, computed once and written as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from tradestudy.execution import Steps
from tradestudy.results.storage import list_written
from tradestudy.run import pictures
from tradestudy.run.depth_maps import MeasuredDepth, measure_depth, set_up_readers, write_depth
from tradestudy.run.pictures import Rendering, render_scene, write_pictures
from tradestudy.study.definition import StudyDefinition


@dataclass(frozen=True, kw_only=True, eq=False)
class TakenScene:
    """The pictures of a study's scene, with the depth measured in them.

    Parameters
    ----------
    rendering
        All pictures.
    depths
        Depth measured by each camera; empty if not requested.
    written
        Paths of the picture files.
    """

    rendering: Rendering
    depths: Sequence[MeasuredDepth]
    written: Sequence[Path]


def files_of_pictures(definition: StudyDefinition) -> list[str]:
    """Patterns of the files that `take_scene` writes."""
    names = definition.case.all_cameras
    return [f"{escape(name)}/*.{ending}" for name in names for ending in ("png", "tiff", "npy", "json")]


def take_scene(definition: StudyDefinition, directory: Path | None, steps: Steps, *, depth: bool) -> TakenScene:
    """Render every picture of the study's scene, measure depth in them if requested, and write both.

    Parameters
    ----------
    definition
        A study with ``scene.image``, its calibrations inferred.
    directory
        Output folder, with a subfolder for each camera: its pictures, their depth, ``camera.json`` and its depth map;
        None writes nothing.
    steps
        How tiles and maps are computed.
    depth
        Whether to measure depth.

    Raises
    ------
    StudyError
        The study declares no scene to render, or its scene cannot be rendered.
    UnaffordableError
        The pictures do not fit into the free memory; raised before anything is rendered.
    OutOfRangeError
        A camera cannot measure depth in its pictures; raised before anything is rendered.
    """
    steps.progress(pictures.STEP, 0.0)
    readers = set_up_readers(definition) if depth else []
    rendering = render_scene(definition, steps)
    written = write_pictures(rendering, directory) if directory is not None else []
    depths = measure_depth(rendering, readers, steps)
    if directory is not None:
        for one in depths:
            write_depth(one, directory / one.camera, rendering.image.depth_format)
        files = [path for pattern in files_of_pictures(definition) for path in sorted(directory.glob(pattern))]
        list_written(directory, [path.relative_to(directory).as_posix() for path in files])
    return TakenScene(rendering=rendering, depths=depths, written=written)
