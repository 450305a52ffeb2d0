"""Corner files: corners of a flat board seen by two cameras, read and checked before any fit."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from tradestudy.calibration.corners.corner_noise import CornerNoise
from tradestudy.calibration.projection import RADIAL_LENS, FreeLens
from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.provenance import require_regular_file

MINIMUM_CORNERS = 6  # four determine the pose of a plane; two more reveal a wrong corner
MOST_ROWS = 50_000
MINIMUM_VIEWS = 3  # at two conditions per view, two views determine four intrinsic parameters; one more checks them

_IMAGE_COLUMNS = ("left_x_px", "left_y_px", "right_x_px", "right_y_px")
_COLUMNS: Final = {"view", "corner", "board_x_mm", "board_y_mm", "board_x_m", "board_y_m", *_IMAGE_COLUMNS}
_LARGEST_COORDINATE = 1e6  # px or mm; more is a mistake
_SMALLEST_SPREAD = 1e-6  # m or px
_BOARD_UNITS = {"mm": 1e-3, "m": 1.0}
_SEEN: Final = re.compile(
    r"^(?!(.*_)?(not|no|non|un|never)_)(.*_)?(detected|visible|valid|found|seen)(_|$)", re.IGNORECASE
)
_TRUTHS: Final = {"1": True, "1.0": True, "true": True, "yes": True} | dict.fromkeys(("0", "0.0", "false", "no"), False)
_CONSTANT: Final = (
    (
        re.compile(r"^board_z(_|$)", re.IGNORECASE),
        "says that the board is not flat",
        "remove the column if the board is nearly flat; the fit determines how it is bent",
    ),
    (
        re.compile(
            r"(^|_)(sigma|std|stddev|deviation|uncertainty|variance|covariance|cov|weight)s?(_|$)", re.IGNORECASE
        ),
        "weights the corners differently, but weights are not read",
        "remove the column; the fit determines the weights from how far the corners scatter",
    ),
)
"""Columns that would change the fit unless all their values are equal: pattern, what they say, and remedy."""
_NARROWEST = 1e-3  # width over length from which on corners do not lie on a line


class CornerFileError(TradestudyError):
    """A corner file is unreadable or inconsistent."""

    exit_status = 2


@dataclass(frozen=True, kw_only=True)
class StereoCorners:
    """Corners of a board in both images of every view, padded to the view with the most corners.

    Parameters
    ----------
    views : tuple of int, length V
        Numbers of the views in the file.
    board : array (V, N, 2)
        Corners on the board [m]: x to the right and y downwards, seen from the front of the board.
    left, right : array (V, N, 2)
        Corners in the images [px].
    present : bool array (V, N)
        False where a view lacks the corner; its coordinates are then zero.
    heights : array (V, N)
        Distance of the corners behind the plane of the board, seen from its front [m]; None for a flat board.
    noise
        Noise model that whitens the residuals; None for independent and equal noise.
    lens
        Lens model to fit to both cameras.
    unit, unused
        Unit of positions on the board in the file, and its columns that are not used.
    left_out
        How many rows of the file are left out, and by which columns; empty if none are.
    """

    views: tuple[int, ...]
    board: FloatArray
    left: FloatArray
    right: FloatArray
    present: BoolArray
    heights: FloatArray | None = None
    noise: CornerNoise | None = None
    lens: FreeLens = RADIAL_LENS
    unit: str = "m"
    unused: tuple[str, ...] = ()
    left_out: str = ""

    @property
    def points(self) -> FloatArray:
        """Corners of the board in its own frame, shape (V, N, 3) [m]."""
        heights = np.zeros(self.present.shape) if self.heights is None else self.heights
        return np.concatenate([self.board, heights[..., None]], axis=-1)

    @property
    def corner_count(self) -> int:
        """Number of corners over all views."""
        return int(self.present.sum())


def read_corners(path: str | Path) -> StereoCorners:
    """Read and check a corner file.

    Parameters
    ----------
    path : path
        CSV in UTF-8, with commas between fields and decimal points in numbers. The columns, in any order, are ``view,
        corner, board_x_mm, board_y_mm, left_x_px, left_y_px, right_x_px, right_y_px``; for the board, ``_m`` may
        replace ``_mm``. On the board, seen from its front, and in images, x points to the right and y downwards.
        Lines that begin with ``#`` are comments, except one that names the columns. A corner counts only if every
        column such as ``detected`` or ``right_visible`` is true in its row. `StereoCorners.unused` names other columns,
        among them opposites such as ``not_detected``.

    Returns
    -------
    StereoCorners
        Corners in metres and pixels.

    Raises
    ------
    CornerFileError
        The file cannot be read; a column is missing, or occurs twice or in two units; a column of positions z on the
        board, or of weights, is not constant; a row has surplus fields, for example from decimal commas; a cell
        is not a number, or a coordinate is beyond ±10⁶; corners are marked as not detected by (−1, −1) or (0, 0); a
        view is not a whole number; a corner occurs twice; a view has
        too few corners, has all of them on a line or at one point, or repeats another view; there are too few views;
        the board or an image is mirrored, or x and y columns are swapped. ``bundle_adjustment.check_rig`` finds
        exchanged left and right columns, and ``rig_geometry`` contradictions with the declared rig.
    UnaffordableError
        The file has more than `MOST_ROWS` rows.
    """
    path = Path(path)
    try:
        require_regular_file(path)
        with suppress(OSError), path.open("rb") as stream:  # a file that cannot be opened is reported below
            if stream.read(2) in (b"\xff\xfe", b"\xfe\xff"):
                raise CornerFileError(f"{path.name} is UTF-16 text", limit="UTF-8", remedy="save it as CSV in UTF-8")
        _require_affordable(path)
        return _corners_in(path.name, path.read_bytes().decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CornerFileError(
            f"{path.name} cannot be read",
            value=getattr(error, "strerror", None) or "not UTF-8 text",
            remedy="check its path; corner files are CSV",
        ) from None


@lru_cache(maxsize=4)  # a study's camera, its calibration and its plan read the same file
def _corners_in(name: str, text: str) -> StereoCorners:
    """The corners in the text of a file; read-only, since callers share them."""
    table, unit, unused, left_out = _read_table(name, text)
    groups = _group_views(table)
    size = max(len(group) for group in groups.values())
    board, left, right = (np.zeros((len(groups), size, 2)) for _ in range(3))
    present = np.zeros((len(groups), size), dtype=bool)
    for row, group in enumerate(groups.values()):
        count = len(group)
        board[row, :count] = group[:, 2:4] * _BOARD_UNITS[unit]
        left[row, :count], right[row, :count] = group[:, 4:6], group[:, 6:8]
        present[row, :count] = True
    for shared in (board, left, right, present):
        shared.flags.writeable = False
    corners = StereoCorners(
        views=tuple(groups),
        board=board,
        left=left,
        right=right,
        present=present,
        unit=unit,
        unused=unused,
        left_out=left_out,
    )
    _check_counts(corners)
    _check_handedness(corners)
    return corners


def _require_affordable(path: Path) -> None:
    """Refuse files whose fit would take more than a few minutes, before parsing them."""
    with path.open("rb") as stream:
        rows = sum(block.count(b"\n") for block in iter(lambda: stream.read(1 << 20), b"")) - 1
    if rows > MOST_ROWS:
        raise UnaffordableError(
            f"{path.name} has too many rows to fit",
            value=f"{rows:,} rows",
            limit=f"{MOST_ROWS:,}",
            remedy=f"keep one view in {-(-rows // MOST_ROWS)}; additional views hardly improve depth",
        )


def _read_table(name: str, text: str) -> tuple[FloatArray, str, tuple[str, ...], str]:
    """Rows of the file in the canonical order of columns, the board's unit, and the columns and rows not used."""
    reader = csv.reader(map(_without_comment, io.StringIO(text, newline="")))
    lines = ((reader.line_num, fields) for fields in reader if fields)
    first, header = next(lines, (1, []))
    lower = [column.strip().lower() for column in header]
    header = [low if low in _COLUMNS else column.strip() for low, column in zip(lower, header, strict=True)]
    unit, required = _required(f"{name}:{first}", header)
    truth_columns = [column for column in header if _SEEN.search(column)]
    rows, texts, total = [], [], 0
    false: Counter[str] = Counter()
    for line, fields in lines:
        where = f"{name}:{line}"
        if len(fields) > len(header):
            raise CornerFileError(
                f"{where}: there are more fields than columns",
                value=f"{len(fields)} fields",
                limit=f"{len(header)} as in the first line",
                remedy="write decimal points, not commas, and remove surplus fields",
            )
        row = dict(zip(header, fields, strict=False))
        unseen = [column for column in truth_columns if not _is_true(where, column, row.get(column, ""))]
        false.update(unseen)
        total += 1
        if not unseen:
            rows.append(_numbers(where, row, required))
            texts.append(row)
    why = " and ".join(f"{column} is false in {count}" for column, count in false.items())
    left_out = f"{total - len(rows)} of {total} rows: {why}" if why else ""
    if not rows:
        raise CornerFileError(
            f"{name} has no corners",
            value=f"left out are {left_out}" if left_out else "0 rows",
            limit=">= 1",
            remedy="write one row per corner and view",
        )
    table = np.array(rows)
    for side, seen_at in (("left", table[:, 4:6]), ("right", table[:, 6:8])):
        for mark in (-1.0, 0.0):
            if (count := int(np.sum(np.all(seen_at == mark, axis=1)))) > 1:
                raise CornerFileError(
                    f"{name}: several corners lie at ({mark:g}, {mark:g}) in the {side} picture, which seems to mark "
                    "corners that were not detected",
                    value=f"{count} rows",
                    limit="detected corners",
                    remedy="remove these rows",
                )
    unused = tuple(column for column in header if column and column not in (*required, *truth_columns))
    for column in unused:
        for pattern, says, remedy in _CONSTANT:
            different = {_number(row.get(column, "")) for row in texts} if pattern.search(column) else ()
            if len(different) > 1:
                values = sorted(value if isinstance(value, str) else f"{value:g}" for value in different)
                raise CornerFileError(
                    f"{name}: the column {column} {says}",
                    value=f"{values[0] or 'nothing'} and {values[-1]}",
                    limit="the same value in every row",
                    remedy=remedy,
                )
    return table, unit, unused, left_out


def _without_comment(line: str) -> str:
    """The line, empty if it is a comment; NumPy writes the names of the columns behind ``#``."""
    if not line.lstrip().startswith("#"):
        return line
    names = line.lstrip("# \t")
    return names if {"view", "corner"} <= {column.strip().lower() for column in names.split(",")} else "\n"


def _required(where: str, header: Sequence[str]) -> tuple[str, tuple[str, ...]]:
    """The unit in the names of the board's columns, mm if there is none, and all columns that are read."""
    units = [unit for unit in _BOARD_UNITS if {f"board_x_{unit}", f"board_y_{unit}"} <= {*header}]
    unit = units[0] if units else "mm"
    required = ("view", "corner", f"board_x_{unit}", f"board_y_{unit}", *_IMAGE_COLUMNS)
    missing = [column for column in required if column not in header]
    for separator, plural in ((";", "semicolons"), ("\t", "tabs")) if missing else ():
        if not any(separator in column for column in header):
            continue
        raise CornerFileError(
            f"{where}: {plural} separate the columns",
            value=header[0][:40],
            limit="commas, and decimal points in the numbers",
            remedy="save it as CSV with commas",
        )
    if missing:
        stems = tuple(column.removesuffix(f"_{unit}").removesuffix("_px") for column in missing if "_" in column)
        alike = [column for column in header if column.startswith(stems)]
        advice = f"positions are read in mm or m on the board, and in px in pictures; convert {', '.join(alike)}"
        raise CornerFileError(
            f"{where.rpartition(':')[0]} lacks columns",
            value=", ".join(missing),
            limit=", ".join(required),
            remedy=advice if alike else "name the columns in the first line",
        )
    if len(units) > 1 or len(set(header)) < len(header):
        twice = [column for column in header if header.count(column) > 1] or [f"board_x_{unit}" for unit in units]
        raise CornerFileError(
            f"{where}: columns give the same value twice",
            value=", ".join(dict.fromkeys(twice)),
            limit="each column once, and positions in one unit",
            remedy="remove one of them",
        )
    return unit, required


def _is_true(where: str, column: str, text: str) -> bool:
    """Whether a cell says that the corner was seen."""
    if (truth := _TRUTHS.get(text.strip().lower())) is None:
        raise CornerFileError(
            f"{where}: {column} is neither true nor false",
            value=repr(text),
            limit="1, true or yes; 0, false or no",
            remedy="correct the value, or remove the column",
        )
    return truth


def _number(text: str) -> float | str:
    """A number, or the text if it is none."""
    with suppress(ValueError):
        return float(text)
    return text.strip()


def _numbers(where: str, row: Mapping[str, str], required: Sequence[str]) -> list[float]:
    """Cells of one row as finite numbers."""
    numbers = []
    for name in required:
        try:
            number = float(row.get(name, ""))
        except ValueError:
            number = float("nan")
        if not np.isfinite(number):
            raise CornerFileError(
                f"{where}: {name} is not a finite number",
                value=repr(row.get(name)),
                limit="a number",
                remedy="correct the number, or remove the row if the corner was not detected",
            )
        if name == "view" and number != round(number):
            raise CornerFileError(
                f"{where}: view is not a whole number",
                value=repr(row.get(name)),
                limit="a whole number",
                remedy="number the views 1, 2, 3, …",
            )
        if name not in ("view", "corner") and abs(number) > _LARGEST_COORDINATE:
            raise CornerFileError(
                f"{where}: {name} is too large",
                value=repr(row.get(name)),
                limit=f"-{_LARGEST_COORDINATE:.0e} to {_LARGEST_COORDINATE:.0e}",
                remedy="correct the number, or remove the row",
            )
        numbers.append(number)
    return numbers


def _group_views(table: FloatArray) -> dict[int, FloatArray]:
    """Rows by view; refuses repeated corners."""
    groups = {}
    for view in np.unique(table[:, 0]):
        group = table[table[:, 0] == view]
        numbers, counts = np.unique(group[:, 1], return_counts=True)
        if np.any(counts > 1):
            raise CornerFileError(
                f"view {view:g} names a corner more than once",
                value=f"corner {numbers[counts > 1][0]:g}",
                limit="each corner once per view",
                remedy="remove the repeated row",
            )
        groups[int(view)] = group
    _refuse_repeated(groups)
    return groups


def _refuse_repeated(groups: dict[int, FloatArray]) -> None:
    """Refuse a view that occurs twice, because it would count as two measurements."""
    first_views: dict[bytes, int] = {}
    for view, group in groups.items():
        first = first_views.setdefault(np.ascontiguousarray(group[:, 1:]).tobytes(), view)
        if first != view:
            raise CornerFileError(
                f"view {view} repeats view {first} exactly",
                value=f"{len(group)} identical corners",
                limit="each view once",
                remedy="remove the repeated views",
            )


def _on_a_line_but_one(board: FloatArray) -> bool:
    """Whether all corners (N, 2), or all but one, lie on a line; two of any three corners then lie on it."""
    for first, second in ((0, 1), (0, 2), (1, 2)):
        along = board[second] - board[first]
        across = (board - board[first]) @ np.array([-along[1], along[0]]) / max(float(along @ along), 1e-300)
        if np.count_nonzero(np.abs(across) > _NARROWEST) <= 1:
            return True
    return False


def _check_counts(corners: StereoCorners) -> None:
    """Refuse too few views, views with too few corners, and views with all corners, or all but one, on a line."""
    if len(corners.views) < MINIMUM_VIEWS:
        raise CornerFileError(
            "too few views for a calibration",
            value=str(len(corners.views)),
            limit=f">= {MINIMUM_VIEWS}",
            remedy="add views with the board tilted differently",
        )
    for row, view in enumerate(corners.views):
        count = int(corners.present[row].sum())
        if count < MINIMUM_CORNERS:
            raise CornerFileError(
                f"view {view} has too few corners",
                value=str(count),
                limit=f">= {MINIMUM_CORNERS}",
                remedy="remove the view or add corners",
            )
        for what, plane in (("on the board", corners.board), ("left", corners.left), ("right", corners.right)):
            spread = np.linalg.svd(plane[row, :count] - plane[row, :count].mean(axis=0), compute_uv=False)
            if spread[0] < _SMALLEST_SPREAD:
                unit = "m" if plane is corners.board else "px"
                raise CornerFileError(
                    f"view {view}: the corners ({what}) all lie at one point",
                    value=f"{spread[0]:.1e} {unit} apart",
                    limit=f">= {_SMALLEST_SPREAD:g} {unit}",
                    remedy="check the columns and their unit",
                )
            if spread[1] < _NARROWEST * spread[0]:
                raise CornerFileError(
                    f"view {view}: the corners ({what}) lie on a line",
                    value=f"width/length {spread[1] / spread[0]:.1e}",
                    limit=f">= {_NARROWEST:g}",
                    remedy="check the columns, or remove the view",
                )
        if _on_a_line_but_one(corners.board[row, :count]):
            raise CornerFileError(
                f"view {view}: all corners but one lie on a line of the board, and do not determine its pose",
                limit="at least two corners beside any line",
                remedy="remove the view or add corners",
            )


def handedness(board: FloatArray, image: FloatArray, present: BoolArray) -> FloatArray:
    """Sign of the determinant of the affine map from board to image, per view, shape (V,); −1 means a mirror image."""
    signs = np.empty(len(board))
    for row, exists in enumerate(present):
        design = np.column_stack([board[row, exists], np.ones(int(exists.sum()))])
        affine = np.linalg.lstsq(design, image[row, exists], rcond=None)[0][:2]
        signs[row] = np.sign(np.linalg.det(affine))
    return signs


def _check_handedness(corners: StereoCorners) -> None:
    """Refuse mirrored boards and images, which a fit to a plane cannot detect."""
    left = handedness(corners.board, corners.left, corners.present) < 0
    right = handedness(corners.board, corners.right, corners.present) < 0
    if not (left.any() or right.any()):
        return
    total = len(corners.views)
    value = f"{int(left.sum())} of {total} views in the left image, {int(right.sum())} in the right"
    limit = "board x to the right, board y downwards as seen from the front; image y downwards"
    if left.all() and right.all():
        what = "the board is mirrored"
        remedy = "change the sign of the board's y, or exchange its x and y columns if they are swapped"
    elif left.all() and not right.any():
        what, remedy = _mirrored_image("left", corners.left, corners.right, corners.present)
    elif right.all() and not left.any():
        what, remedy = _mirrored_image("right", corners.right, corners.left, corners.present)
    else:
        views = [v for v, bad in zip(corners.views, left | right, strict=True) if bad]
        what = f"the order of the corners is mirrored in view {', '.join(map(str, views[:5]))}"
        remedy = "number the corners in the same order in every view, or remove these views"
    raise CornerFileError(what, value=value, limit=limit, remedy=remedy)


def _mirrored_image(side: str, image: FloatArray, reference: FloatArray, present: BoolArray) -> tuple[str, str]:
    """Swapped columns or a mirrored picture, whichever brings the two images closer together."""
    flipped = image.copy()
    flipped[..., 0] = image[present][:, 0].max() + image[present][:, 0].min() - image[..., 0]
    swapped_fits = _shape_mismatch(image[..., ::-1], reference, present)
    flipped_fits = _shape_mismatch(flipped, reference, present)
    if swapped_fits < flipped_fits:
        return (
            f"the columns {side}_x_px and {side}_y_px are swapped",
            f"exchange {side}_x_px and {side}_y_px",
        )
    return (
        f"the {side} image is mirrored",
        f"turn off the {side} camera's mirror mode, or subtract {side}_x_px from the image width",
    )


def _shape_mismatch(first: FloatArray, second: FloatArray, present: BoolArray) -> float:
    """Mean square distance between the corners of both images, after centring each view [px²]."""
    weight = present[..., None] / present.sum(axis=1)[:, None, None]
    difference = first - second
    difference = difference - (difference * weight).sum(axis=1, keepdims=True)
    return float((difference**2 * weight).sum() / len(present))
