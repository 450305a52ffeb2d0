"""The camera of libpleno and COMPOTE as JSON: a focused plenoptic camera in millimetres, with numbers as text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedPlenoptic
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import CameraFile, Format, Located, Request
from tradestudy.study.camera_files.pairs import rotation_of
from tradestudy.study.camera_files.parts import SAME_PITCH, lattice_rotation, nearest_node
from tradestudy.units import ANGLE, LENGTH, pretty

_INVERSES: Final = ("distortions_inverse", "invdistortions")
_HEINZE: Final = 1  # its number among libpleno's models of depth distortion; 0 is none
_LAYOUTS: Final[dict[str, Literal["square", "hexagonal"]]] = {"0": "square", "1": "hexagonal", "2": "hexagonal"}
_MODES: Final = {"0": "unfocused", "1": "keplerian", "2": "galilean"}
IGNORED: Final = "values that pictures ignore"
"""Name of the convention that lists values that change pictures and are not used."""
ARRAY_POSE: Final = "pose of the array"
"""Name of the convention that states how the pose of the microlens array and distortion are read."""
RELAY: Final = "relay"
"""Name of the convention that states the relay, and a mode of the file that contradicts it."""
_ROUNDING: Final = 1e-7  # rad, from the cosine of a small angle


def read(files: Sequence[CameraFile], request: Request) -> Imported:
    """Read the camera; d is the distance from array to sensor (the gap), D that from main lens to array.

    The relay of a type of microlenses is Keplerian if its focal length is below d, else Galilean. It does not follow
    from D and the focal length of the main lens, which may be focused closer. Microlenses without focal lengths are
    pinholes. Poses and distortion become known values of the calibration, in the frame of upright pictures.

    Raises
    ------
    CameraFileError
        A value is missing or invalid, or the parts do not form a camera.
    """
    top = files[0].top
    lens, sensor, array = top.need("main_lens"), top.need("sensor"), top.need("mla")
    mesh, focal_lengths = array.need("mesh"), array.find("focal_lengths")
    behind, plane = _depth(mesh), _depth(sensor)
    metre, unit = request.metres(behind, stated="mm", why="the convention of libpleno")
    if behind.number() * plane.number() < 0.0:
        raise plane.fail(
            f"{plane.number():g} and the z of the microlens array, {behind.number():g}, have different signs: the main "
            "lens would lie between array and sensor; give both the same sign"
        )
    pitch, geometry = mesh.need("pitch"), mesh.need("geometry")
    pitches = pitch.numbers(1, 2)
    if abs(pitches[0] - pitches[-1]) > SAME_PITCH * pitches[0]:
        raise pitch.fail("different horizontal and vertical pitches of microlenses are not supported")
    if geometry.text() not in _LAYOUTS:
        raise geometry.fail(f"the geometry {geometry.text()[:20]} is unknown; one of {', '.join(_LAYOUTS)} is expected")
    scale, width, height = sensor.need("scale"), sensor.need("width"), sensor.need("height")
    focal_length, aperture = lens.need("f"), lens.need("aperture")
    _refuse_moved_lens(lens)
    layout, size = _LAYOUTS[geometry.text()], np.array([width.count(), height.count()]) * scale.number()
    poses = _Poses.of(mesh, sensor, size, pitches[0], layout, turned=geometry.text() == "2")
    mla_distance, gap = poses.mla_distance * metre, poses.gap * metre
    if not gap > 0.0:
        raise plane.fail("the sensor lies in front of the microlens array; it must lie behind the array")
    lengths = () if focal_lengths is None else tuple(length * metre for length in focal_lengths.numbers())
    relay = "pinholes" if focal_lengths is None or not lengths else _relay(focal_lengths, lengths, gap)
    mode = top.find("mode")
    mode_text = "" if mode is None else _MODES.get(mode.text(), mode.text()[:20].lower())
    known, distortion = poses.known(metre), top.find("distortions")
    _compare_distances(top, abs(behind.number()), abs(plane.number()))
    if distortion is not None:
        known |= _distortion(distortion, poses, float(np.hypot(*size)) / 2.0, metre)
    scaling = top.find("scaling")
    disagrees = mode is not None and mode_text != relay
    conventions = (
        Convention(name="format", says="libpleno camera", key=top.key),
        Convention(
            name=RELAY,
            says=(
                f"{relay}: microlens focal length {pretty(lengths[0], LENGTH)}, gap {pretty(gap, LENGTH)}"
                + (f"; the file's mode, {mode_text}, is not used" if disagrees else "")
                if lengths
                else "microlenses without focal lengths are pinholes"
            ),
            key=array.key if focal_lengths is None else focal_lengths.key,
        ),
        Convention(
            name=ARRAY_POSE,
            says="poses are those of the upright picture, in which x and y of the file are reversed",
            key=mesh.key,
        ),
        *_ignored(top, poses),
        unit,
    )
    return ImportedPlenoptic(
        focal_length=focal_length.number() * metre,
        f_number=aperture.number(),
        pixels=(width.count(), height.count()),
        pixel_pitch=scale.number() * metre,
        layout=layout,
        pitch=float(np.mean(pitches)) * metre,
        focal_lengths=lengths,
        gap=gap,
        mla_distance=mla_distance,
        scaling=None if scaling is None else _scaling(scaling, metre),
        known=known,
        conventions=conventions,
        keys={
            "focal_length": focal_length.key,
            "f_number": aperture.key,
            "pixels": width.key,
            "pixel_pitch": scale.key,
            "layout": geometry.key,
            "pitch": pitch.key,
            "focal_lengths": array.key if focal_lengths is None else focal_lengths.key,
            "gap": plane.key,
            "mla_distance": behind.key,
            "scaling": top.key if scaling is None else scaling.key,
            "known": mesh.key,
            "distortion": mesh.key if distortion is None else distortion.key,
        },
    )


def _scaling(value: Located, metre: float) -> tuple[float, float, float]:
    """Coefficients a, b, c of metric depth ``a Z² + b Z + c`` [1/m, 1, m]; the file's Z is in its unit of length."""
    a, b, c = (value.need(key) for key in ("a", "b", "c"))
    if not b.number() > 0.0:
        raise b.fail("metric depth must grow with the depth by the camera's design; a number above 0 is expected")
    return a.number() / metre, b.number(), c.number() * metre


@dataclass(frozen=True, kw_only=True, eq=False)
class _Poses:
    """The poses of array and sensor in libpleno's frame, whose z axis points to the object, in the unit of the file.

    Behind the lens, pictures are upside down in that frame; ``upright`` turns its x and y into right and down in the
    upright picture. Numbers of a matrix are stored by columns.

    Parameters
    ----------
    mla_distance, gap
        At the centre of the array: the microlens nearest to the middle of the sensor.
    tilt, offset, axis
        Slopes of the array, its centre from the middle of the sensor, and the axis of the main lens from that centre.
    rotation
        Of the lattice relative to the rows of pixels [rad], in the range in which lattices differ.
    upright
        Shape (2, 2).
    leaning
        Angle between the sensor and the plane perpendicular to the axis [rad].
    """

    mla_distance: float
    gap: float
    tilt: FloatArray
    offset: FloatArray
    axis: FloatArray
    rotation: float
    upright: FloatArray
    leaning: float

    @classmethod
    def of(
        cls,
        mesh: Located,
        sensor: Located,
        size: FloatArray,
        pitch: float,
        layout: Literal["square", "hexagonal"],
        *,
        turned: bool,
    ) -> _Poses:
        """Read the poses of the mesh and the sensor; ``turned`` for neighbours along columns instead of rows."""
        (array, start), (plane, corner) = (_pose(part) for part in (mesh, sensor))
        upright = -plane[:2, :2].T
        middle = (size - sensor.need("scale").number()) / 2.0  # pixel centres lie at whole numbers
        across = upright @ array[:2, 0]
        rotation = lattice_rotation(math.atan2(across[1], across[0]) + (math.pi / 2.0 if turned else 0.0), layout)
        # From the middle of the sensor, upright: the axis, and the first node of the mesh.
        axis = upright @ -corner[:2] + middle
        half = 0.5 * pitch * (layout == "hexagonal" and not turned)  # by which the first row is shifted
        first = upright @ (start[:2] + half * array[:2, 0]) + axis
        offset = first - nearest_node(first, pitch, layout, rotation)
        slope = array[:2, 2] / array[2, 2]
        # Either sign of z is read, as array and sensor lie behind the lens in any case.
        away = math.copysign(1.0, start[2])
        on_axis = away * (start[2] + slope @ start[:2])
        tilt = -away * (upright @ slope)
        mla_distance = on_axis - tilt @ (axis - offset)
        return cls(
            mla_distance=float(mla_distance),
            gap=float(abs(corner[2]) - mla_distance),
            tilt=tilt,
            offset=offset,
            axis=axis - offset,
            rotation=rotation,
            upright=upright,
            leaning=math.acos(min(abs(plane[2, 2]), 1.0)),
        )

    def known(self, metre: float) -> dict[str, float]:
        """Known values of the pose, in SI."""
        values = {"array_rotation": self.rotation}
        for index, axis in enumerate("xy"):
            values[f"array_tilt_{axis}"] = float(self.tilt[index])
            values[f"array_offset_{axis}"] = float(self.offset[index]) * metre
            values[f"principal_point_{axis}"] = float(self.axis[index]) * metre
        return values


def _pose(value: Located) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation of a pose; without a rotation, none."""
    pose = value.need("pose")
    turned, moved = pose.find("rotation"), np.array([component.number() for component in _translation(value)])
    return np.eye(3) if turned is None else rotation_of(turned, turned.numbers(9)).T, moved


def _distortion(value: Located, poses: _Poses, corner: float, metre: float) -> dict[str, float]:
    """Known values of the distortion, whose lengths are those of the image, for an image on the array.

    Raises
    ------
    CameraFileError
        Depth distortion has another model than that of Heinze.
    """
    parts = {key: part.numbers() for key in ("radial", "tangential", "depth") if (part := value.find(key))}
    # A file may omit the last coefficients.
    padded = {key: (*numbers, 0.0, 0.0, 0.0) for key, numbers in parts.items()}
    values = {}
    z = poses.mla_distance
    # On the array, a length of the image is a slope times z.
    for power, coefficient in enumerate(padded.get("radial", ())[:3], start=1):
        values[f"distortion_k{power}"] = coefficient * z ** (2 * power)
    if "tangential" in padded:
        p2, p1 = poses.upright @ np.array(padded["tangential"][:2]) * z
        values |= {"distortion_p1": float(p1), "distortion_p2": float(p2)}
    model = value.find("model")
    number = _HEINZE if model is None else int(model.number())
    if "depth" in padded and any(padded["depth"]) and number:
        if number != _HEINZE:
            raise value.need("depth").fail(
                f"model {number} of depth distortion is not supported; model {_HEINZE} is. For the camera without it, "
                "write zeros"
            )
        d0, d1, d2 = padded["depth"][:3]
        values |= {
            "depth_distortion_d0": -d0 * z,
            "depth_distortion_d1": -d1 * corner**2 * metre,
            "depth_distortion_d2": -d2 * corner**4 * metre,
        }
    return values


def _compare_distances(top: Located, array: float, sensor: float) -> None:
    """Refuse distances D and d that differ by more than 1 % of the gap from those of the poses, which are read."""
    for key, posed in (("D", array), ("d", sensor - array)):
        value = top.find(key)
        if value is not None and not abs(value.number() - posed) <= 0.01 * (sensor - array):
            raise value.fail(
                f"{value.number():g} contradicts the distance by the poses of mla and sensor, {posed:g}; correct one"
            )


def _refuse_moved_lens(lens: Located) -> None:
    """Refuse a main lens elsewhere than at the origin, from which the poses of array and sensor are measured."""
    if (pose := lens.find("pose")) is None:
        return
    moved, turned = pose.find("translation"), pose.find("rotation")
    if moved is not None and any(moved.numbers(3)):
        raise moved.fail(
            "the main lens must be at the origin; subtract its translation from those of mla and sensor, and write 0"
        )
    if turned is not None and not np.array_equal(np.reshape(turned.numbers(9), (3, 3)), np.eye(3)):
        raise turned.fail(
            "a rotated main lens is not supported; express the poses of mla and sensor in its frame, and write the "
            "identity matrix"
        )


def _ignored(top: Located, poses: _Poses) -> Iterator[Convention]:
    """The values of this camera that would change its pictures and are not used."""
    ignored = []
    for inverse in [top.need(key) for key in _INVERSES if top.find(key) is not None]:
        inverse.use()
        if not top.has("distortions"):
            ignored.append(f"the distortion of the main lens, given only by its inverse, {inverse.last}")
    if poses.leaning > _ROUNDING:
        ignored.append(f"the tilt of the sensor by {pretty(poses.leaning, ANGLE)}")
    if ignored:
        yield Convention(name=IGNORED, says=" and ".join(ignored), key=top.key)


def _depth(value: Located) -> Located:
    """The third component of the translation of a pose."""
    return _translation(value)[2]


def _translation(value: Located) -> tuple[Located, ...]:
    """The components of the translation of a pose."""
    translation = value.need("pose").need("translation")
    rows = tuple(translation.items())
    components = tuple(rows[0].items()) if len(rows) == 1 else rows
    if len(components) != 3:
        raise translation.fail("three components are expected")
    return components


def _relay(value: Located, lengths: tuple[float, ...], gap: float) -> str:
    """Galilean for each type with f_i above d, Keplerian for the others."""
    if min(lengths) <= 0.0:
        raise value.fail("one positive focal length for each microlens type is expected")
    sides = ["galilean" if length > gap else "keplerian" for length in lengths]
    if len({*sides}) == 1:
        return sides[0]
    return ", ".join(f"type {number} {side}" for number, side in enumerate(sides, start=1))


FORMAT: Final = Format(
    name="libpleno camera",
    options=("length_unit",),
    whole="a libpleno file contains one camera",
    recognises=lambda file: file.top.has("main_lens", "sensor", "mla"),
    read=read,
)
