"""The measured corner file is read; every mistake that a user makes in one is named."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tradestudy.calibration.corners.bundle_adjustment import check_rig, fit_camera, fit_pair
from tradestudy.calibration.corners.corner_file import CornerFileError, read_corners
from tradestudy.calibration.corners.real_rig import fit_rig
from tradestudy.errors import TradestudyError

FILE = Path(__file__).parents[2] / "studies" / "data" / "stereo_chessboard_corners.csv"


def rows():
    with FILE.open(newline="") as stream:
        return list(csv.DictReader(stream))


def write(path, table):
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    return path


def changed(tmp_path, change):
    return write(tmp_path / "corners.csv", [change(dict(row)) for row in rows()])


def fit(path):
    corners = read_corners(path)
    left = fit_camera(corners.board, corners.left, corners.present)
    right = fit_camera(corners.board, corners.right, corners.present)
    return fit_pair(corners, left, right)


def swap(row, first, second):
    row[first], row[second] = row[second], row[first]
    return row


def test_the_measured_file_is_read():
    corners = read_corners(FILE)
    assert len(corners.views) == 29
    assert corners.corner_count == 29 * 54
    # 9 × 6 corners, 24.23 mm squares
    np.testing.assert_allclose(corners.board[3].max(axis=0), [8 * 24.23e-3, 5 * 24.23e-3], rtol=1e-12)
    np.testing.assert_array_equal(corners.left[0, 0], [239.9044, 121.8881])
    np.testing.assert_array_equal(corners.right[0, 0], [151.0777, 108.5824])


def test_metres_and_any_order_of_columns_read_alike(tmp_path):
    def in_metres(row):
        turned = dict(reversed(row.items()))
        for axis in "xy":
            turned[f"board_{axis}_m"] = float(turned.pop(f"board_{axis}_mm")) * 1e-3
        return turned

    corners, expected = read_corners(changed(tmp_path, in_metres)), read_corners(FILE)
    np.testing.assert_allclose(corners.board, expected.board, rtol=1e-15)
    np.testing.assert_array_equal(corners.right, expected.right)


def test_views_with_missing_corners_fit(tmp_path):
    table = [row for row in rows() if (int(row["view"]) + 3 * int(row["corner"])) % 7]
    corners = read_corners(write(tmp_path / "corners.csv", table))
    assert corners.corner_count == len(table)
    thin = fit_camera(corners.board, corners.left, corners.present)
    whole = read_corners(FILE)
    full = fit_camera(whole.board, whole.left, whole.present)
    deviation = np.sqrt(np.diag(thin.covariance))
    assert np.all(np.abs(thin.intrinsics - full.intrinsics) < 1.5 * deviation)
    assert thin.corner_rms_px == pytest.approx(full.corner_rms_px, rel=0.05)
    # an absent corner must not count: one seventh fewer corners, larger deviations by (7/6)^½
    ratio = deviation / np.sqrt(np.diag(full.covariance))
    np.testing.assert_allclose(ratio, np.sqrt(7.0 / 6.0), rtol=0.06)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda row: swap(row, "left_x_px", "left_y_px"), "columns left_x_px and left_y_px are swapped"),
        (lambda row: swap(row, "right_x_px", "right_y_px"), "columns right_x_px and right_y_px are swapped"),
        (lambda row: row | {"left_x_px": 639 - float(row["left_x_px"])}, "the left image is mirrored"),
        (lambda row: row | {"right_x_px": 639 - float(row["right_x_px"])}, "the right image is mirrored"),
        (lambda row: row | {"board_y_mm": -float(row["board_y_mm"])}, "the board is mirrored"),
        (lambda row: row | {"board_x_mm": 193.84 - float(row["board_x_mm"])}, "the board is mirrored"),
        (lambda row: swap(row, "board_x_mm", "board_y_mm"), "the board is mirrored.*exchange its x and y"),
        (
            lambda row: row | ({"board_x_mm": -float(row["board_x_mm"])} if row["view"] == "4" else {}),
            "mirrored in view 4",
        ),
        (lambda row: row | ({"left_x_px": ""} if row["corner"] == "7" else {}), "corners.csv:9: left_x_px"),
        (lambda row: row | {"corner": "1"}, "view 1 names a corner more than once: corner 1"),
        (lambda row: row | {"left_y_px": row["left_x_px"]}, r"\(left\) lie on a line"),
    ],
)
def test_contradictory_rows_are_named(tmp_path, change, word):
    with pytest.raises(CornerFileError, match=word) as caught:
        read_corners(changed(tmp_path, change))
    assert caught.value.value
    assert caught.value.limit
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("left_x_px", "1e7", "left_x_px is too large: '1e7'"),
        ("board_x_mm", "1e308", "board_x_mm is too large"),
        ("view", "1.5", "view is not a whole number: '1.5'"),
    ],
)
def test_impossible_cells_are_named(tmp_path, column, value, says):
    table = [dict(row) for row in rows()]
    table[3][column] = value
    with pytest.raises(CornerFileError, match=f":5: {says}"):
        read_corners(write(tmp_path / "corners.csv", table))


@pytest.mark.parametrize("factor", [0.0, 1e-300])
def test_a_board_without_size_is_named(tmp_path, factor):
    table = [{**row, **{key: str(float(row[key]) * factor) for key in ("board_x_mm", "board_y_mm")}} for row in rows()]
    with pytest.raises(CornerFileError, match=r"\(on the board\) .* m apart .*1e-06 m.*columns"):
        read_corners(write(tmp_path / "corners.csv", table))


def test_a_corner_far_outside_the_picture_does_not_crash_the_fit(tmp_path):
    table = [dict(row) for row in rows()]
    table[3]["left_x_px"] = "100000"
    with pytest.raises(TradestudyError):
        fit_rig(read_corners(write(tmp_path / "corners.csv", table)))


def test_too_few_corners_and_views_are_named(tmp_path):
    few = [row for row in rows() if row["view"] != "3" or int(row["corner"]) % 11 == 0]
    with pytest.raises(CornerFileError, match="view 3 has too few corners: 5 "):
        read_corners(write(tmp_path / "corners.csv", few))
    with pytest.raises(CornerFileError, match=r"too few views.*: 2 "):
        read_corners(write(tmp_path / "corners.csv", [row for row in rows() if int(row["view"]) < 3]))


def test_missing_columns_and_empty_files_are_named(tmp_path):
    table = [{k: v for k, v in row.items() if k != "right_y_px"} for row in rows()]
    with pytest.raises(CornerFileError, match="lacks columns: right_y_px"):
        read_corners(write(tmp_path / "corners.csv", table))
    empty = tmp_path / "empty.csv"
    empty.write_text(",".join(rows()[0]) + "\n")
    with pytest.raises(CornerFileError, match="has no corners"):
        read_corners(empty)


def test_left_and_right_exchanged_are_named(tmp_path):
    exchanged = fit(changed(tmp_path, lambda r: swap(swap(r, "left_x_px", "right_x_px"), "left_y_px", "right_y_px")))
    with pytest.raises(CornerFileError, match="left and right columns are exchanged"):
        check_rig(exchanged)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_one_column_swapped_between_the_cameras_is_named(tmp_path, axis):
    # near parallel cameras fit such a file to 0.25 px: only the comparison shows it
    path = changed(tmp_path, lambda row: swap(row, f"left_{axis}_px", f"right_{axis}_px"))
    with pytest.raises(CornerFileError, match=r"columns is swapped.*0\.33.* px rms, and 0\.23"):
        fit_rig(read_corners(path))


def test_a_view_numbered_from_the_other_end_is_named(tmp_path):
    reversed_view = {int(r["corner"]): r for r in rows() if r["view"] == "5"}

    def turn(row):
        if row["view"] == "5":
            other = reversed_view[53 - int(row["corner"])]
            row |= {"right_x_px": other["right_x_px"], "right_y_px": other["right_y_px"]}
        return row

    with pytest.raises(CornerFileError, match=r"view 5 .*rotation .*by 1[78]"):
        fit(changed(tmp_path, turn))


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "no-such.csv cannot be read: No such file"), (b"\xff\xfe\x00\x01", r"allowed: UTF-8")],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, content, words):
    path = tmp_path / "no-such.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CornerFileError, match=words):
        read_corners(path)
    with pytest.raises(CornerFileError, match="cannot be read: Is a directory"):
        read_corners(tmp_path)


def test_one_view_is_too_few(tmp_path):
    with pytest.raises(CornerFileError, match=r"too few views.*: 1 \(allowed: >= 3\); add views"):
        read_corners(write(tmp_path / "corners.csv", [row for row in rows() if row["view"] == "5"]))


def test_a_byte_order_mark_is_not_part_of_the_first_column(tmp_path):
    path = tmp_path / "corners.csv"
    path.write_bytes(b"\xef\xbb\xbf" + FILE.read_bytes())
    np.testing.assert_array_equal(read_corners(path).left, read_corners(FILE).left)


def test_decimal_commas_and_semicolons_are_named(tmp_path):
    path = tmp_path / "corners.csv"
    head, *lines = FILE.read_text().splitlines()
    path.write_text("\n".join([head, *(line.replace(".", ",") for line in lines)]))
    with pytest.raises(CornerFileError, match=r"corners.csv:2: there are more fields than columns: 14 fields.*decimal"):
        read_corners(path)
    path.write_text("\n".join(line.replace(",", ";").replace(".", ",") for line in [head, *lines]))
    with pytest.raises(CornerFileError, match="semicolons separate the columns"):
        read_corners(path)
    path.write_text(FILE.read_text().replace(",", "\t"))
    with pytest.raises(CornerFileError, match="tabs separate the columns"):
        read_corners(path)


def test_names_of_columns_may_be_in_upper_case(tmp_path):
    head, rest = FILE.read_text().split("\n", 1)
    for comment in ("", "# "):
        (tmp_path / "corners.csv").write_text(f"{comment}{head.upper()}\n{rest}")
        found = read_corners(tmp_path / "corners.csv")
        np.testing.assert_array_equal(found.left, read_corners(FILE).left)
        assert found.unused == ()


@pytest.mark.parametrize("mark", ["-1", "0.0"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_marks_of_corners_that_were_not_detected_are_named(tmp_path, mark, side):
    def marked(row):
        return row | ({f"{side}_x_px": mark, f"{side}_y_px": mark} if row["corner"] == "7" else {})

    says = rf"at \({float(mark):g}, {float(mark):g}\) in the {side} picture.*: 29 rows .*remove these rows"
    with pytest.raises(CornerFileError, match=says):
        read_corners(changed(tmp_path, marked))


def test_ten_identical_views_are_one(tmp_path):
    view = [row for row in rows() if row["view"] == "5"]
    table = [row | {"view": str(number)} for number in range(10) for row in view]
    with pytest.raises(CornerFileError, match=r"view 1 repeats view 0 .*54 "):
        read_corners(write(tmp_path / "corners.csv", table))


def test_a_view_with_one_corner_beside_a_line_is_named(tmp_path):
    table = rows()
    view = table[0]["view"]
    own = [row for row in table if row["view"] == view]
    line = {row["corner"] for row in own if row["board_y_mm"] == own[0]["board_y_mm"]}
    beside = next(row["corner"] for row in own if row["corner"] not in line)
    kept = [row for row in table if row["view"] != view or row["corner"] in {*line, beside}]
    with pytest.raises(CornerFileError, match=rf"view {view}: all corners but one lie on a line"):
        read_corners(write(tmp_path / "corners.csv", kept))
    assert read_corners(write(tmp_path / "more.csv", [*kept, next(r for r in own if r not in kept)])).views


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        (
            "board_z_mm",
            lambda n: n % 3,
            "corners.csv: the column board_z_mm says that the board is not flat: 0 and 2",
        ),
        ("left_sigma_px", lambda n: 0.1 + n % 2, "column left_sigma_px weights the corners differently.*: 0.1 and 1.1"),
        ("weight", lambda n: "" if n else 1, "column weight weights the corners differently.*: nothing and 1"),
        ("detected", lambda n: "maybe", "corners.csv:2: detected is neither true nor false: 'maybe'"),
        ("board_x_m", lambda n: 0.0, None),
    ],
)
def test_columns_that_would_change_the_fit_are_refused(tmp_path, column, value, says):
    path = write(tmp_path / "corners.csv", [row | {column: value(n)} for n, row in enumerate(rows())])
    if says is None:
        assert read_corners(path).unused == (column,)
        path = write(tmp_path / "corners.csv", [row | {"board_x_m": 0.0, "board_y_m": 0.0} for row in rows()])
        says = "columns give the same value twice: board_x_mm, board_x_m"
    with pytest.raises(CornerFileError, match=says) as caught:
        read_corners(path)
    assert caught.value.remedy


def test_columns_that_change_nothing_are_named_as_not_used(tmp_path):
    further = {"board_z_mm": "0", "left_sigma_px": "0.1", "image_width": "640", "note": "a"}
    corners = read_corners(changed(tmp_path, lambda row: row | further))
    assert corners.unused == tuple(further)
    np.testing.assert_array_equal(corners.left, read_corners(FILE).left)
    assert read_corners(FILE).unused == ()


def test_corners_that_were_not_seen_are_left_out(tmp_path):
    kept = [row for row in rows() if (int(row["view"]) + 3 * int(row["corner"])) % 7]
    found = read_corners(write(tmp_path / "marked.csv", [marked_row(row) for row in rows()]))
    expected = read_corners(write(tmp_path / "kept.csv", kept))
    np.testing.assert_array_equal(found.right, expected.right)
    np.testing.assert_array_equal(found.present, expected.present)
    assert found.unused == ()
    count = len(rows()) - len(kept)
    assert found.left_out == f"{count} of {len(rows())} rows: right_visible is false in {count}"
    assert expected.left_out == ""
    with pytest.raises(CornerFileError, match="no corners: left out are 1566 of 1566 rows: seen is false in 1566"):
        read_corners(changed(tmp_path, lambda row: row | {"seen": "0"}))


@pytest.mark.parametrize("column", ["not_detected", "left_not_visible", "no_corner_found", "UN_SEEN", "undetected"])
def test_opposites_of_seen_leave_no_row_out(tmp_path, column):
    found = read_corners(changed(tmp_path, lambda row: row | {column: str(int(int(row["corner"]) % 7 == 0))}))
    np.testing.assert_array_equal(found.left, read_corners(FILE).left)
    assert (found.unused, found.left_out) == ((column,), "")


def marked_row(row):
    """The row with columns that say whether the corner was seen; a missed one has no position."""
    missed = (int(row["view"]) + 3 * int(row["corner"])) % 7 == 0
    return (
        row
        | {"left_detected": "TRUE", "right_visible": "0" if missed else "1"}
        | ({"right_x_px": ""} if missed else {})
    )


@pytest.mark.parametrize("head", ['# 24.23 mm, "A3" board\n#\n', "\n", "# "])  # NumPy comments out the names of columns
def test_comments_are_skipped_and_lines_counted_as_in_the_file(tmp_path, head):
    path, text = tmp_path / "corners.csv", FILE.read_text()
    path.write_text(head + text)
    np.testing.assert_array_equal(read_corners(path).left, read_corners(FILE).left)
    path.write_text(head + text.replace("\n1,1,", "\n# left out: 1,0\n1,x,"))
    with pytest.raises(CornerFileError, match=rf"corners.csv:{4 + head.count(chr(10))}: corner is not a finite number"):
        read_corners(path)


def test_other_units_and_repeated_columns_are_named(tmp_path):
    path, text = tmp_path / "corners.csv", FILE.read_text()
    path.write_text(text.replace("board_x_mm,board_y_mm", "board_x_in,board_y_in"))
    with pytest.raises(
        CornerFileError, match=r"lacks columns: board_x_mm.*read in mm or m.*convert board_x_in, board_y_in"
    ):
        read_corners(path)
    path.write_text(text.replace("left_y_px", "left_x_px", 1))
    with pytest.raises(CornerFileError, match="lacks columns: left_y_px"):
        read_corners(path)
    path.write_text("\n".join(f"{line},{'left_x_px' if n == 0 else 0}" for n, line in enumerate(text.splitlines())))
    with pytest.raises(CornerFileError, match="the same value twice: left_x_px"):
        read_corners(path)


def test_a_flag_that_is_given_twice_is_refused(tmp_path):
    """The last of two columns would decide alone which corners were seen."""
    first, *rows = FILE.read_text(encoding="utf-8").splitlines()
    path = tmp_path / "corners.csv"
    path.write_text("\n".join([f"{first},detected,detected", *(f"{row},0,1" for row in rows)]), encoding="utf-8")
    with pytest.raises(CornerFileError, match="columns give the same value twice: detected"):
        read_corners(path)
