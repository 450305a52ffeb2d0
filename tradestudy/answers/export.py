"""Export a camera of a study, declared or fitted, to formats of other programs and to a posterior file of this one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.calibration.calibration_file import CalibrationDraws
from tradestudy.calibration.corners.rig_measurement import pair_found
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.imported import ImportedCamera, ImportedRig
from tradestudy.errors import TradestudyError
from tradestudy.optics.lens_families import FAMILIES
from tradestudy.study.camera_files.importing import FORMATS
from tradestudy.study.camera_files.located import Format, UnsupportedLensError
from tradestudy.study.prepared import PreparedStudy
from tradestudy.uncertainty.sources import ErrorClass, Sources
from tradestudy.uncertainty.streams import point_generator
from tradestudy.units import significant
from tradestudy.wording import listed

POSTERIOR: Final = "posterior"
WORDS: Final = (*(file_format.word for file_format in FORMATS if file_format.write is not None), POSTERIOR)
"""The formats that can be requested."""
SUFFIXES: Final = ("*.yaml", "*.yml", "*.cameramodel", f"{POSTERIOR}.nc")
"""Patterns of what follows the camera's name and a hyphen in the names of the files."""
_PLACES: Final = 33  # across and down a picture, its corners included
_DRAWS: Final = 4096  # of declared errors; gives their standard deviations to 1 %


class ExportError(TradestudyError):
    """A camera cannot be written in a format."""

    exit_status = 2


@dataclass(frozen=True, kw_only=True)
class Export:
    """The files to write.

    Parameters
    ----------
    texts
        Files of other programs by name.
    posterior
        The uncertain parameters, for a file of this program; None if nothing is uncertain or it was not requested.
    left_out
        What the files do not contain, in words.
    """

    texts: Mapping[str, str]
    posterior: CalibrationDraws | None
    left_out: tuple[str, ...]


def export(study: PreparedStudy, camera_name: str, words: Sequence[str], *, lossy: bool) -> Export:
    """Export a camera in the given formats, or in all if none is given.

    Lengths are in metres. Calibrations from corners and targets are fitted first, and the files contain the fit.

    Parameters
    ----------
    study
        The study.
    camera_name
        Name of the camera.
    words
        Formats, from `WORDS`.
    lossy
        Whether to leave out what a format cannot represent, instead of refusing.

    Raises
    ------
    ExportError
        There is no such camera, or a format cannot represent it.
    """
    camera = study.case.all_cameras.get(camera_name)
    if not isinstance(camera, DepthCamera):
        measuring = [key for key, other in study.case.all_cameras.items() if isinstance(other, DepthCamera)]
        problem = "no camera of the study has this name" if camera is None else "this camera measures no depth"
        raise ExportError(problem, value=camera_name, limit=", ".join(measuring), remedy="name one of these")
    if unknown := [word for word in words if word not in WORDS]:
        raise ExportError("unknown format", value=", ".join(unknown), limit=", ".join(WORDS), remedy="use one of these")
    requested = words or WORDS
    posterior = _inferred(study, camera_name)
    texts: dict[str, str] = {}
    left_out: list[str] = []
    refused: list[str] = []
    formats = [
        file_format for file_format in FORMATS if file_format.word in requested and file_format.write is not None
    ]
    fitted = None if posterior is None or posterior.best is None else pair_found(posterior.best, posterior.lens)
    rig = camera.exported(fitted) if formats else None
    if formats and rig is None:
        listed_formats = listed([file_format.name for file_format in formats])
        refused.append(f"{listed_formats} cannot describe a camera of family {camera.family}")
        formats = []
    for file_format in formats:
        assert rig is not None
        for written, missing in _written(file_format, rig, camera_name):
            texts |= written
            refused += missing
    if POSTERIOR in requested:
        session = [group.name for group in camera.calibration.groups if group.error_class is ErrorClass.SESSION]
        refused += [f"a posterior cannot contain {error}: this error arose after the calibration" for error in session]
        posterior = posterior or _declared(study, camera, camera_name)
        if posterior is None:
            left_out.append("posterior: no parameter of the camera is declared uncertain")
    exported = Export(
        texts=texts, posterior=posterior if POSTERIOR in requested else None, left_out=(*left_out, *refused)
    )
    if not texts and exported.posterior is None:
        others = [] if rig is None else _whole(rig, camera_name)
        remedy = f"choose --format {' or '.join(others)}; nothing was written" if others else "nothing was written"
        raise ExportError("\n".join(exported.left_out), remedy=remedy)
    if refused and not lossy:
        others = [] if rig is None else _whole(rig, camera_name)
        choice = f", or choose --format {' or '.join(others)}" if others else ""
        remedy = f"give --lossy (in Python, lossy=True) to leave it out{choice}; nothing was written"
        raise ExportError("\n".join(refused), remedy=remedy)
    return exported


def _whole(rig: ImportedRig, stem: str) -> list[str]:
    """The formats that can represent a whole rig."""
    writing = [file_format for file_format in FORMATS if file_format.write is not None]
    return [
        file_format.word
        for file_format in writing
        if not any(missing for _, missing in _written(file_format, rig, stem))
    ]


def _written(file_format: Format, rig: ImportedRig, stem: str) -> Iterator[tuple[Mapping[str, str], list[str]]]:
    """The files of a format, and what they lack; no files if the format cannot represent the lens at all."""
    assert file_format.write is not None
    missing: list[str] = []
    # Each round leaves out the refused coefficients, until the rest can be written or nothing more can be left out.
    while True:
        try:
            yield file_format.write(rig, stem), missing
        except UnsupportedLensError as error:
            smaller = replace(rig, left=_without(rig.left, error.names), right=_without(rig.right, error.names))
            if smaller == rig:
                yield {}, [*missing, f"{file_format.name} cannot represent {listed(list(error.names))}"]
                return
            moved = max(_largest_shift(rig.left, smaller.left), _largest_shift(rig.right, smaller.right))
            omission = f"{listed(list(error.names))}, without which points move by up to {significant(moved, 2)} px"
            missing, rig = [*missing, f"{file_format.name} cannot represent {omission}"], smaller
        else:
            return


def _without(camera: ImportedCamera, names: Sequence[str]) -> ImportedCamera:
    kept = {coefficient: value for coefficient, value in camera.coefficients.items() if coefficient not in names}
    return replace(camera, coefficients=kept)


def _largest_shift(camera: ImportedCamera, smaller: ImportedCamera) -> float:
    """Largest distance between the images of one direction with all coefficients and with fewer [px].

    Where the size of the picture is unknown, the principal point is taken as its centre.
    """
    size, focal, centre = (np.array(vector) for vector in (camera.pixels, camera.focal_lengths, camera.centre))
    last = size - 1.0 if camera.pixels is not None else 2.0 * centre
    places = np.stack(np.meshgrid(*(np.linspace(0.0, end, _PLACES) for end in last)), axis=-1)
    whole, reduced = (FAMILIES[imported.lens_model](**imported.coefficients) for imported in (camera, smaller))
    image = (places - centre) / focal
    shift = (reduced.project(whole.unproject(image)) - image) * focal
    return float(np.nanmax(np.linalg.norm(shift, axis=-1)))


def _inferred(study: PreparedStudy, camera_name: str) -> CalibrationDraws | None:
    """The posterior of a calibration from corners or a target; None for other calibrations."""
    key = study.definition.posterior_keys.get(camera_name)
    if key is None:
        return None
    from tradestudy.calibration.posteriors import infer

    return infer(study.definition.calibrations_to_infer()[key]).posterior


def _declared(study: PreparedStudy, camera: DepthCamera, camera_name: str) -> CalibrationDraws | None:
    """Draws of the declared errors, or of a posterior that the study reads from a file."""
    groups = tuple(group for group in camera.calibration.groups if group.error_class is ErrorClass.RIG)
    if not groups:
        return None
    sources = Sources(groups=groups)
    rng = point_generator(seed=study.file.propagation.seed, point=f"export/{camera_name}", replicate=0)
    drawn = sources.draw(rng.standard_normal((sources.dimensions, _DRAWS)))
    names = tuple(drawn)
    columns = np.concatenate([np.broadcast_to(drawn[parameter], (_DRAWS, 1)) for parameter in names], axis=1)
    return CalibrationDraws(names=names, draws=columns, reference=np.zeros(len(names)))


def write_export(exported: Export, folder: Path, camera_name: str) -> list[Path]:
    """Write the files of an export to a folder and return their paths."""
    from tradestudy.calibration.posterior_file import write_posterior
    from tradestudy.results.storage import list_written, replace_file, replacing

    list_written(folder, [*exported.texts, *(() if exported.posterior is None else (f"{camera_name}-posterior.nc",))])
    written = []
    for file, text in exported.texts.items():
        replace_file(folder / file, text.encode())
        written.append(folder / file)
    if exported.posterior is not None:
        path = folder / f"{camera_name}-posterior.nc"
        with replacing(path) as temporary:
            write_posterior(temporary, exported.posterior)
        written.append(path)
    return written
