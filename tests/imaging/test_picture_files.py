"""Pictures and depth maps from files that nobody should be able to make the program stumble over."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tradestudy.calibration.calibration_file import CalibrationFileError, read_calibration
from tradestudy.calibration.corners.corner_file import CornerFileError, read_corners
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.scenes.pattern import read_depths, read_picture
from tradestudy.provenance import file_hash


def png(width: int, height: int, *, bits: int = 8, kind: int = 0, pixels: bytes = b"") -> bytes:
    """A PNG file of grey (kind 0) or RGB (2) that claims a size and by default has no pixels."""
    header = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(pixels)), (b"IEND", b""))
    parts = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def npy(header: str) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


ENORMOUS = npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10000000, 10000000), }")
FILES = {
    "huge.png": (png(20_000, 20_000), "cannot be read|size of a picture"),
    "large.png": (png(12_000, 10_000), "120,000,000 values .*allowed: 1 to 100,000,000"),
    "damaged.png": (png(4, 4), "cannot be read"),
    "empty.png": (b"", "cannot be read"),
    "empty.npy": (b"", "cannot be read"),
    "claim.npy": (ENORMOUS, "cannot be read"),
    "header.npy": (npy("{" + " " * 60_000 + "}"), "cannot be read"),
}
ARRAYS = {
    "none": (np.zeros((0, 5)), "0 values"),
    "structured": (np.zeros((4, 4), [("a", "f4"), ("b", "f4")]), "type of an array"),
    "complex": (np.ones((4, 4), complex), "type of an array"),
    "text": (np.full((4, 4), "1"), "type of an array"),
    "large": (np.full((4, 4), 1e300), "1e\\+300 .*allowed: 1e\\+12"),
    "line": (np.ones(5), "shape of a"),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_pictures_are_refused_with_the_reason(tmp_path: Path, name: str) -> None:
    content, reason = FILES[name]
    (tmp_path / name).write_bytes(content)
    for read in (read_picture, lambda file: read_depths(file, 1.0)):
        with pytest.raises(OutOfRangeError, match=reason):
            read(tmp_path / name)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_that_are_no_pictures_are_refused_with_the_reason(tmp_path: Path, name: str) -> None:
    values, reason = ARRAYS[name]
    np.save(tmp_path / "one.npy", values)
    for read in (read_picture, lambda file: read_depths(file, 1.0)):
        with pytest.raises(OutOfRangeError, match=reason):
            read(tmp_path / "one.npy")


def test_pictures_that_viewers_show_otherwise_are_refused(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:48, :64]
    grey = (120 + 60 * np.sin(columns / 3)).astype(np.uint8)
    clear = np.where(columns > 40, 0, 255).astype(np.uint8)
    color = Image.fromarray(np.dstack([grey, grey // 2, grey // 3]))
    turned = color.getexif()
    turned[0x0112] = 3
    pages = [Image.fromarray((start + 0.002 * columns).astype(np.float32)) for start in (0.9, 1.9)]
    Image.fromarray(np.dstack([grey, grey // 2, grey // 3, clear])).save(tmp_path / "rgba.png")
    Image.fromarray(np.dstack([grey, clear])).save(tmp_path / "la.png")
    Image.fromarray((3000 + rows).astype(np.uint16)).save(tmp_path / "value.png", transparency=3005)
    color.quantize(8).save(tmp_path / "palette.png", transparency=1)
    color.save(tmp_path / "turned.jpg", exif=turned)
    pages[0].save(tmp_path / "turned.tif", tiffinfo={0x0112: 6})
    color.convert("CMYK").save(tmp_path / "cmyk.jpg")
    color.convert("LAB").save(tmp_path / "lab.tif")
    pages[0].save(tmp_path / "pages.tif", save_all=True, append_images=pages[1:])
    frames = [Image.fromarray(grey), Image.fromarray(grey.T)]
    for name in ("frames.gif", "frames.png"):
        frames[0].save(tmp_path / name, save_all=True, append_images=[frames[1].resize((64, 48))])
    for names, reason in (
        (("rgba.png", "la.png", "value.png", "palette.png"), "opacity .*down to 0.*; save it without"),
        (("turned.jpg", "turned.tif"), "EXIF orientation.*allowed: 1, upright"),
        (("cmyk.jpg", "lab.tif"), "colours.*(CMYK|LAB).*; convert it to RGB"),
        (("pages.tif", "frames.gif", "frames.png"), "pages .*2 in .*allowed: 1"),
    ):
        for name in names:
            for read in (read_picture, lambda file: read_depths(file, 1.0)):
                with pytest.raises(OutOfRangeError, match=reason):
                    read(tmp_path / name)


def test_samples_that_would_be_read_otherwise_than_stored_are_refused(tmp_path: Path) -> None:
    (tmp_path / "rgb.png").write_bytes(png(4, 2, bits=16, kind=2, pixels=2 * (b"\0" + bytes(range(24)))))
    (tmp_path / "grey.png").write_bytes(png(4, 2, bits=16, pixels=2 * (b"\0" + bytes(range(8)))))
    (tmp_path / "few.png").write_bytes(png(4, 2, bits=4, pixels=2 * b"\0\x12\x34"))
    grey = Image.fromarray(np.full((4, 4), 7, np.uint16))
    grey.save(tmp_path / "black.tif")
    white = (
        (tmp_path / "black.tif")
        .read_bytes()
        .replace(struct.pack("<HHII", 0x0106, 3, 1, 1), struct.pack("<HHII", 0x0106, 3, 1, 0))
    )
    (tmp_path / "white.tif").write_bytes(white)
    for name, reason, readers in (
        ("rgb.png", "bits of each colour.*16 in .*convert to 16-bit grey or 8-bit colour", (read_picture,)),
        ("few.png", "bits of each depth.*4 in .*8 or 16", (lambda file: read_depths(file, 1.0),)),
        ("white.tif", "zero.*white", (read_picture, lambda file: read_depths(file, 1.0))),
    ):
        for read in readers:
            with pytest.raises(OutOfRangeError, match=reason):
                read(tmp_path / name)
    np.testing.assert_array_equal(read_picture(tmp_path / "grey.png")[0, 0], [0x0001, 0x0203, 0x0405, 0x0607])
    np.testing.assert_array_equal(read_depths(tmp_path / "black.tif", 1.0), np.full((4, 4), 7.0))
    assert read_picture(tmp_path / "few.png").shape == (1, 2, 4)


def test_opaque_alpha_changes_nothing(tmp_path: Path) -> None:
    color = np.arange(4 * 5 * 3, dtype=np.uint8).reshape(4, 5, 3) + np.uint8(1)
    opaque = np.full((4, 5, 1), 255, np.uint8)
    Image.fromarray(np.dstack([color, opaque])).save(tmp_path / "color.png")
    Image.fromarray(np.dstack([color[..., :1], opaque])).save(tmp_path / "grey.png")
    np.testing.assert_array_equal(read_picture(tmp_path / "color.png"), np.moveaxis(color, -1, 0))
    np.testing.assert_array_equal(read_depths(tmp_path / "grey.png", 2.0), 2.0 * color[..., 0])
    np.save(tmp_path / "four.npy", np.dstack([color, opaque]))
    with pytest.raises(OutOfRangeError, match=r"shape of a picture.*\(4, 5, 4\)"):
        read_picture(tmp_path / "four.npy")


def test_pipes_are_refused_instead_of_waited_for(tmp_path: Path) -> None:
    for name in ("map.npy", "map.png", "rig.csv", "rig.nc"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(OutOfRangeError, match="not a regular file"):
        read_depths(tmp_path / "map.npy", 1.0)
    with pytest.raises(OutOfRangeError, match="not a regular file"):
        read_picture(tmp_path / "map.png")
    with pytest.raises(CornerFileError, match="not a regular file"):
        read_corners(tmp_path / "rig.csv")
    for name in ("rig.csv", "rig.nc"):
        with pytest.raises(CalibrationFileError, match="not a regular file"):
            read_calibration(tmp_path / name)
    assert file_hash(tmp_path / "map.npy") == ""


def test_depths_that_jpeg_has_changed_are_refused(tmp_path: Path) -> None:
    grey = Image.fromarray(np.add.outer(np.arange(48), 90 + np.arange(64)).astype(np.uint8))
    grey.save(tmp_path / "map.jpg")
    grey.save(tmp_path / "map.tif", compression="jpeg")
    grey.save(tmp_path / "whole.tif", compression="tiff_deflate")
    for name in ("map.jpg", "map.tif"):
        with pytest.raises(OutOfRangeError, match=r"compression of a depth map: JPEG in .*export the map anew as PNG"):
            read_depths(tmp_path / name, 1.0)
        assert read_picture(tmp_path / name).shape == (1, 48, 64)
    np.testing.assert_array_equal(read_depths(tmp_path / "whole.tif", 1.0), np.asarray(grey))


def test_netpbm_files_are_read_as_stored_or_refused(tmp_path: Path) -> None:
    depths = np.array([[1, 50, 100], [25, 33, 7]])
    wide = np.array([[1, 1000, 4095], [2, 2047, 3333]])
    words = " ".join(map(str, wide.ravel()))
    for largest, values, content in (
        (100, depths, b"P5\n3 2\n100\n" + depths.astype(np.uint8).tobytes()),
        (4095, wide, b"P5\n3 2\n4095\n" + wide.astype(">u2").tobytes()),
        (65535, wide, b"P5\n3 2\n65535\n" + wide.astype(">u2").tobytes()),
        (4095, wide, f"P2\n3 2\n4095\n{words}\n".encode()),
        (1, wide, b"Pf\n3 2\n-1.0\n" + wide[::-1].astype("<f4").tobytes()),
    ):
        (tmp_path / "map.pgm").write_bytes(content)
        np.testing.assert_array_equal(read_depths(tmp_path / "map.pgm", 1.0), values, err_msg=str(largest))
    (tmp_path / "few.ppm").write_bytes(b"P6\n2 1\n15\n" + bytes([1, 2, 3, 15, 9, 7]))
    np.testing.assert_array_equal(read_picture(tmp_path / "few.ppm")[:, 0], [[1, 15], [2, 9], [3, 7]])
    for content, reason in (
        (b"P6\n3 1\n4095\n" + bytes(18), "bits of each colour.*12 in .*convert to 16-bit grey or 8-bit colour"),
        (b"Pf\n2 2\n-0.004\n" + bytes(16), "scale of a PFM file.*0.004 in .*multiply the values by it"),
        (b"P4\n2 2\n" + bytes(2), "bits of each depth.*1 in .*8 or 16"),
    ):
        (tmp_path / "map.ppm").write_bytes(content)
        with pytest.raises(OutOfRangeError, match=reason):
            read_depths(tmp_path / "map.ppm", 1.0)
    Image.fromarray(np.full((4, 4), 7, np.uint8)).save(tmp_path / "map.sgi")
    with pytest.raises(OutOfRangeError, match=r"cannot be read.*PNG, TIFF"):
        read_depths(tmp_path / "map.sgi", 1.0)
