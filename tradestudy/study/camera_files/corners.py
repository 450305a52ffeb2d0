"""Import of corner files: a fit gives the design, and the calibration is inferred from the same corners."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from typing import Final

import numpy as np

from tradestudy.cameras.imported import FITTED_LENS, Convention, Imported, ImportedCorners
from tradestudy.declarations.lens_models import fitted_words
from tradestudy.errors import TradestudyError
from tradestudy.study.camera_files.located import UNUSED, CameraFile, Format, Request
from tradestudy.study.camera_files.pairs import (
    OFF_CENTRE,
    UNUSUAL_BASELINE,
    UNUSUAL_NOISE,
    baseline_problem,
    is_usual,
    off_centre,
)
from tradestudy.units import LENGTH, pretty, significant

_MOST_USUAL_NOISE_PX: Final = 0.5  # of one coordinate; detectors reach 0.02 to 0.3 px


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """The pair fitted to the corners.

    Raises
    ------
    CameraFileError
        The corners are inconsistent, do not determine a pair, or indicate a wrong unit of length.
    """
    from tradestudy.calibration.corners.view_blocks import TRANSLATION, cameras_of
    from tradestudy.calibration.posteriors import fit_of_file

    top = files[0].top
    try:
        path = files[0].path
        fit = fit_of_file(path, sha256(path.read_bytes()).hexdigest(), request.fitted_lens, few=False)
    except TradestudyError as error:
        raise top.fail(str(error)) from None
    unit, columns = fit.corners.unit, ", ".join(fit.corners.unused)
    unused = "; ".join(filter(None, (columns and f"columns {columns}", fit.corners.left_out)))
    shared, lens = fit.explained.shared, fit.corners.lens
    baseline = float(np.linalg.norm(shared[TRANSLATION]))
    if problem := baseline_problem(baseline):
        other = "mm" if baseline > 1.0 else "m"
        raise top.fail(f"{problem}; name the columns board_x_{other} and board_y_{other} if that is their unit")
    checked = f"{pretty(baseline, LENGTH)}; check that positions on the board are in {unit}"
    unusual = () if is_usual(baseline) else (Convention(name=UNUSUAL_BASELINE, says=checked, key=top.key),)
    if (noise := fit.explained.noise_px) > _MOST_USUAL_NOISE_PX:
        says = f"{significant(noise, 2)} px, by a fit of the lens model {fitted_words(request.fitted_lens)}"
        unusual = (*unusual, Convention(name=UNUSUAL_NOISE, says=says, key=top.key))
    interiors = cameras_of(shared)
    centres = {side: interior[2:4] for side, interior in zip(("left", "right"), interiors, strict=True)}
    if far := off_centre({side: ((float(x), float(y)), request.pixels) for side, (x, y) in centres.items()}):
        unusual = (*unusual, Convention(name=OFF_CENTRE, says=far, key=top.key))
    return ImportedCorners(
        file=files[0].name,
        focal_length=float(np.mean([interior[:2] * lens.at(interior[4:]).scale_on_axis for interior in interiors])),
        noise=noise,
        baseline=baseline,
        conventions=(
            Convention(name="format", says="corners of a board", key=top.key),
            Convention(name="length unit", says=f"{unit}, by the name of the column board_x_{unit}", key=top.key),
            Convention(name=FITTED_LENS, says=fitted_words(request.fitted_lens), key=top.key),
            Convention(name="pictures", says="raw: as taken, before rectification", key=top.key),
            Convention(name="order of cameras", says="left and right as the columns are named", key=top.key),
            *unusual,
            *((Convention(name=UNUSED, says=unused, key=top.key),) if unused else ()),
        ),
        key=top.key,
    )


FORMAT: Final = Format(
    name="corner file",
    whole="a corner file contains both cameras",
    recognises=lambda file: file.syntax == "corners",
    read=read,
)
