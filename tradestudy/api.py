"""The Python interface: load a study, run it, look at its results, write its report.

>>> import tradestudy
>>> result = tradestudy.load("studies/plenoptic_vs_stereo.yaml").run()
>>> result.data["depth"]
>>> result.figure("whole_range")
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from tradestudy import provenance
from tradestudy.loaded_study import Study, load
from tradestudy.models import DEFAULT_BUDGET
from tradestudy.result import Result, open_result, report, shown, tables_left_out, write_parts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tradestudy.comparison import Comparison
    from tradestudy.execution import Executor
    from tradestudy.execution.steps import Progress
    from tradestudy.imaging.estimation import DepthScore
    from tradestudy.study.document import Document


__all__ = [
    "RenderedScene",
    "Result",
    "Study",
    "compare",
    "cost",
    "export",
    "load",
    "open_result",
    "render",
    "report",
    "run",
    "schema",
    "tables_left_out",
]


def _refuse_file(directory: Path) -> None:
    """Refuse an output folder at the path of a file."""
    nearest = next((path for path in (directory, *directory.absolute().parents) if path.exists()), directory)
    if nearest.exists() and not nearest.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(nearest))


def run(
    study: Study,
    directory: Path,
    *,
    fresh: bool = False,
    pdf: bool = True,
    large_tables: bool = False,
    with_cost: bool = False,
    progress: Progress = lambda _s, _p: None,
    executor: Executor | None = None,
) -> Result:
    """Run a study into a folder, reusing what a finished or interrupted run left there.

    Unless ``fresh``, results of the same study and code are not computed again, nor are finished points of an
    interrupted run; the report is always written, its tables above 50 MB only if ``large_tables``. The cost of accuracy
    is measured only ``with_cost``.
    """
    from tradestudy import report as renderer
    from tradestudy.execution import Checkpoints
    from tradestudy.results import storage

    _refuse_file(directory)  # before anything is computed
    storage.refuse_foreign(directory, storage.RUN_FILES)
    if study.file.scene is not None and study.file.scene.image is not None:
        from tradestudy.answers.scene import files_of_pictures

        storage.refuse_foreign(directory / storage.PICTURES, files_of_pictures(study.prepared))
    result = None if fresh else _finished(study, directory)
    measuring = with_cost and (result is None or "cost" not in result.data.children)
    if measuring:
        from tradestudy.answers.cost import require_prices

        require_prices(study.prepared)  # before anything is computed

    def reported(share: float) -> None:
        progress("report", share)

    pictures = storage.beside(directory / storage.PICTURES)  # those of an earlier run stay until this one is complete
    with closing(Checkpoints(directory, fresh=fresh)) as checkpoints:
        if result is None or measuring:
            try:
                if result is None:
                    result = study.run(progress, executor=executor, checkpoints=checkpoints, pictures=pictures)
                if measuring:
                    result = result.with_cost(study.cost(progress, executor=executor, checkpoints=checkpoints))
                reported(0.0)
                rendered = pictures if pictures.is_dir() else None
                result.write(directory, pdf=pdf, large_tables=large_tables, pictures=rendered, progress=reported)
            finally:
                shutil.rmtree(pictures, ignore_errors=True)
        else:
            reported(0.0)
            storage.remove_abandoned(directory)
            write_parts(result.data, directory)
            record = result.run_record
            renderer.write(result.data, record, directory, pdf=pdf, large_tables=large_tables, progress=reported)
        checkpoints.remove()
    reported(1.0)
    return result


@dataclass(frozen=True, kw_only=True)
class RenderedScene:
    """What `render` has rendered and written.

    Parameters
    ----------
    arrays
        Pictures and depths by camera and by the name of their file without its ending, such as
        ``arrays["rig"]["left"]``; shape (rows, columns), upright. Pictures are in digital numbers or, without
        quantisation, in electrons. ``left_depth`` is the true depth along the axis in the pixels of ``left`` [m]. If
        depth was requested, there are also ``depth_map``, its standard deviation ``depth_map_deviation`` and the true
        depth in its pixels, ``depth_map_true`` [m].
    pictures
        Files of the pictures; beside each is its true depth, and for each camera ``camera.json`` and its depth map.
    depths
        Comparison of each camera's depth map with the true depth; empty unless depth was requested.
    """

    arrays: Mapping[str, Mapping[str, NDArray[Any]]]
    pictures: Sequence[Path]
    depths: Mapping[str, DepthScore]

    def __repr__(self) -> str:
        names = "; ".join(f"{camera}: {', '.join(arrays)}" for camera, arrays in self.arrays.items())
        return f"RenderedScene({names})"


def render(
    study: Study,
    directory: str | Path,
    *,
    depth: bool = False,
    fresh: bool = False,
    progress: Progress = lambda _s, _p: None,
    executor: Executor | None = None,
) -> RenderedScene:
    """Render and write only the pictures of the study's scene, with their true depth and a description of each camera.

    Unless ``fresh``, an interrupted rendering resumes.

    Parameters
    ----------
    study, directory
        The study, and the folder in which the files are written, in ``pictures/CAMERA``.
    depth
        Whether to measure depth in the pictures, too, and write the depth maps beside them.
    fresh
        Whether to discard what an interrupted rendering has left.
    progress, executor
        As for `Study.run`.

    Returns
    -------
    RenderedScene
        The pictures and depths as arrays, the paths of the pictures, and the scores of measured depth.

    Raises
    ------
    StudyError
        If the study has no ``scene.image``.
    UnaffordableError
        If the pictures do not fit into the free memory.
    OutOfRangeError
        If a camera cannot measure depth in its pictures, or a matcher is not installed.
    PlaceError
        If a file would be replaced that this program did not write.
    """
    from tradestudy.answers.calibration import infer_calibrations
    from tradestudy.answers.scene import files_of_pictures, take_scene
    from tradestudy.execution import Checkpoints, Serial, Steps
    from tradestudy.models.rendered_scene import declared_image
    from tradestudy.results.storage import refuse_foreign

    declared_image(study.prepared)  # before calibrations are inferred
    folder = Path(directory) / "pictures"
    refuse_foreign(folder, files_of_pictures(study.prepared))
    with closing(Checkpoints(folder, fresh=fresh)) as checkpoints:
        steps = Steps(executor=executor or Serial(), checkpoints=checkpoints, progress=progress)
        prepared, *_ = infer_calibrations(study.prepared, steps)
        taken = take_scene(prepared, folder, steps, depth=depth)
        checkpoints.remove()
    scores = {measured.camera: measured.score for measured in taken.depths}
    return RenderedScene(arrays=taken.arrays, pictures=taken.written, depths=scores)


def asked_of_camera(document: Document) -> dict[str, str]:
    """By key, what the study of one imported camera still has to say because the camera's file does not.

    It is empty if the study has mistakes, which `load` reports.
    """
    from tradestudy.study.schema.root import StudyFile
    from tradestudy.study.schema.validation import asked_values

    problems = () if document.problems else asked_values(document, StudyFile)
    return {problem.path.split(".", 2)[2]: problem.what.partition("; ")[2] for problem in problems}


def refocuses(document: Document) -> bool:
    """Whether the camera in the study of one imported camera is of a kind that can be refocused."""
    from tradestudy.cameras.kinds import KINDS
    from tradestudy.study.document import ScalarEntry

    kind = document.entry(("cameras", "rig", "kind"))
    kinds = [
        kind_name
        for declaration in KINDS
        if declaration.camera.refocuses
        for kind_name in get_args(declaration.model_fields["kind"].annotation)
    ]
    return isinstance(kind, ScalarEntry) and kind.text in kinds


def usable_span(study: Study) -> tuple[float, float] | None:
    """The longest stretch from 2 cm to 1 km where the only camera of a study is usable [m]; None if there is none."""
    import numpy as np

    from tradestudy.depth.usable import usable_intervals

    ((camera,), criteria) = study.prepared.case.cameras.values(), study.prepared.case.criteria
    intervals = usable_intervals(camera, criteria, np.geomspace(0.02, 1e3, 121))
    longest = max(intervals, key=lambda interval: interval.far / interval.near, default=None)
    if longest is None:
        return None
    return 1.05 * longest.near, longest.far  # within it after rounding to two digits, too


def export(
    study: Study, camera: str, directory: Path, *, formats: Sequence[str] = (), lossy: bool = False
) -> tuple[list[Path], tuple[str, ...]]:
    """Write a declared or fitted camera as calibration files of other programs and as a posterior.

    Parameters
    ----------
    study
        The study.
    camera
        Name of the camera.
    directory
        Output folder.
    formats
        Any of opencv, ros, kalibr, mrcal and posterior; empty means all.
    lossy
        Whether to leave out what a format cannot represent, instead of refusing.

    Returns
    -------
    list of Path, tuple of str
        The files, and what they leave out, in words.

    Raises
    ------
    TradestudyError
        If there is no such camera, a format cannot represent it, its calibration cannot be fitted, or a file would be
        replaced that this program did not write.
    """
    from tradestudy.answers.export import SUFFIXES, export, write_export
    from tradestudy.results.storage import refuse_foreign

    refuse_foreign(directory, [f"{escape(camera)}-{suffix}" for suffix in SUFFIXES])
    exported = export(study.prepared, camera, formats, lossy=lossy)
    return write_export(exported, directory, camera), exported.left_out


def _finished(study: Study, directory: Path) -> Result | None:
    """Results of an earlier run in a folder, if they are complete and from this study and this code."""
    from tradestudy.errors import ResultsError
    from tradestudy.results.storage import read_run

    hashes = {"study_hash": study.hash, "code_hash": provenance.code_hash()}
    try:
        record = read_run(directory)
        return open_result(directory) if hashes.items() <= record.items() else None
    except ResultsError:
        return None


def cost(
    study: Study, directory: Path, *, budget: float = DEFAULT_BUDGET, progress: Progress = lambda _s, _p: None
) -> list[str]:
    """Measure what accuracy costs and write ``cost.json`` and ``cost.svg``, which are not part of a run.

    Returns
    -------
    list of str
        A sentence for each camera and picture of the study, and the path of the figure.
    """
    from xarray import DataTree

    from tradestudy import figures
    from tradestudy.answers.cost import cost_json
    from tradestudy.report.document import plain_text
    from tradestudy.report.sections.program import answers
    from tradestudy.results.storage import list_written, refuse_foreign, replace_file

    refuse_foreign(directory, ["cost.json", "cost.svg"])
    costs = study.cost(progress, budget=budget)
    drawings = figures.build(DataTree.from_dict({"/cost": costs}))
    written = {"cost.json": cost_json(study.name, study.hash, costs).encode()}
    written |= {f"{name}.svg": drawing.draw().svg() for name, drawing in drawings.items()}
    list_written(directory, written)
    for name, content in written.items():
        replace_file(directory / name, content)
    return [*(plain_text(answer) for answer in answers(costs)), str(directory / list(written)[-1])]


def compare(directories: Sequence[str | Path | Result]) -> Comparison:
    """Find conclusions and inputs that differ between finished runs, and results that differ by more than their errors.

    Parameters
    ----------
    directories
        Folders of the runs, their ``results.nc``, or results, at least two.

    Returns
    -------
    Comparison
        The differences. ``print`` shows them as text, ``html()`` returns them as a page, and ``overlay`` is a figure of
        the curves that differ, or None.

    Raises
    ------
    OutOfRangeError
        If there are fewer than two folders.
    ResultsError
        If a folder contains no readable run, or the run lacks data because another version of the program wrote it.
    """
    from tradestudy.comparison import compare_runs

    results = [source if isinstance(source, Result) else open_result(source) for source in directories]
    names = [
        f"{source.data.attrs['study']} ({number})" if isinstance(source, Result) else str(source)
        for number, source in enumerate(directories, start=1)
    ]
    with shown(dict(zip(names, results, strict=True))):
        return compare_runs(names, [result.run_record for result in results], [result.data for result in results])


def schema() -> dict[str, Any]:
    """Return the JSON Schema of study files.

    Returns
    -------
    dict
        The schema, for editors and validators.
    """
    from tradestudy.study.schema.editor import editor_schema
    from tradestudy.study.schema.root import StudyFile

    return editor_schema(StudyFile)
