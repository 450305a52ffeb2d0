"""Unused keys of calibration files: refused if they would change the meaning of what is read, else listed."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, Imported, ImportedCamera, ImportedCorners, ImportedRig
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.camera_files.located import NOT_SET, SET, UNUSED, YES, CameraFile, Located, Request
from tradestudy.study.camera_files.pairs import as_filed
from tradestudy.study.camera_files.second_poses import epipolar_problem, rotation_problem, translation_problem
from tradestudy.study.document import Entry, ListEntry, MappingEntry, Path, ScalarEntry, dotted
from tradestudy.units import LENGTH, UnitError, parse
from tradestudy.wording import listed

_LENS: Final = re.compile(
    r"distor|dist_?coef|^dist(_?[0-9lr]|_left|_right)?$|^d_?([0-9lr]|left|right)?$|radial|tangential|^xi_?[0-9lr]?$"
    r"|^tau|^alpha_?c|prism|fisheye|skew|(?-i:^[kp][1-6]$)",
    re.IGNORECASE,
)
_OTHER_MATRIX: Final = re.compile(r"^(new|optimal)|[_0-9]new$", re.IGNORECASE)
_SCALE: Final = re.compile(
    r"^(image|img|picture)?_?(scale|scaling)(_?factor|_?percent)?(_?[xy])?$|^(re|down)_?(scal|sampl|siz)(e|ed|ing)|^binning|^zoom",
    re.IGNORECASE,
)
_PART: Final = re.compile(
    r"^(valid)?_?(pix)?_?roi_?([0-9lr]|left|right)?$|^crop|_crop$|^[xy]_?offset$|^offset_?[xy]$", re.IGNORECASE
)
_SIZE: Final = re.compile(
    r"(resolution|(full|orig|original|native|calib|calibration|calibrated|image|img|picture|frame|video)_?"
    r"(image|img|picture|frame)?_?(width|height|size|resolution))_?(px|pixels?)?_?([0-9lr]|left|right)?",
    re.IGNORECASE,
)
_SIDE: Final = r"((?:cam(?:era)?_?)?[0-9lr]|left|right)?"
_PINHOLE: Final = re.compile(rf"{_SIDE}_?([fc])_?([xy])_?{_SIDE}", re.IGNORECASE)
_WORD: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_UNIT_WORDS: Final = {"unit", "units"}
_NOT_OF_LENGTHS: Final = {
    "time", "timestamp", "temperature", "temp", "rate",
    "frequency", "exposure", "id", "serial", "name", "number", "version",
    "error", "rms", "noise",
}  # fmt: skip
"""Words of keys whose unit does not concern what is read, or that name a device as unit."""
_IN_PIXELS: Final = {
    "focal", "fx", "fy", "cx", "cy", "k", "m", "camera", "matrix", "intrinsic", "intrinsics", "principal",
}  # fmt: skip
_IN_RADIANS: Final = {"r", "rotation", "angle", "angles", "om", "rvec"}
_LENGTHS: Final = {"t", "translation", "baseline", "length", "lengths", "world", "distance", "distances"}
_NAMED_UNITS: Final = {"px": ("px", "pixel", "pixels"), "rad": ("rad", "radian", "radians")}
_SCALES: Final = {
    "scale",
    "scaling",
    "scaled",
    "factor",
    "multiplier",
    "resize",
    "resized",
    "binning",
    "zoom",
    "decimation",
    "subsampling",
}
_UNSET: Final = ("", *NOT_SET, "none", "null", "normal", "auto")
_TURNED: Final = {
    "flip",
    "flipped",
    "mirror",
    "mirrored",
    "rotate",
    "rotated",
    "rotation",
    "orientation",
    "half",
    "binned",
    "cropped",
}
_CONVENTIONS: Final = {
    "convention", "conventions", "handedness", "inverse", "inverted", "transposed", "direction", "origin", "degrees",
    "coordinate", "coordinates", "based", "order",
}  # fmt: skip
_ROTATIONS: Final = {"rotation", "rot", "euler", "rpy", "quaternion", "quat", "om", "rvec", "roll", "pitch", "yaw"}
_TRANSLATIONS: Final = {"translation", "tvec", "baseline", "tx"}
_EPIPOLAR: Final = {"e", "f", "essential", "fundamental"}
_ELSEWHERE: Final = re.compile("rectif|imu|housing|spec|body|board|target|cameraData", re.IGNORECASE)
"""Parts of files with rotations or translations of something else than the pair."""
_SPREAD: Final = {"error", "errors", "uncertainty", "std", "stddev", "sigma", "deviation", "tolerance", "covariance"}
_AGREES: Final = 1e-3  # relative, of a focal length or principal point
_LENSES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("pinhole", "perspective"), ("rational", "kannala-brandt", "fov")),
    **dict.fromkeys(
        ("plumbbob", "radtan", "brown", "brownconrady", "rational", "rationalpolynomial", "radialtangential"),
        ("rational",),
    ),
    **dict.fromkeys(("fisheye", "equidistant", "kannalabrandt", "kannalabrandt4", "kb", "kb4"), ("kannala-brandt",)),
    **dict.fromkeys(("fov", "atan"), ("fov",)),
    **dict.fromkeys(("omni", "omnidirectional", "mei", "unified", "ucm"), ("omni",)),
    **dict.fromkeys(("ds", "doublesphere"), ("double-sphere",)),
    "eucm": ("eucm",),
    "stereographic": ("stereographic",),
    **dict.fromkeys(("lonlat", "equirectangular", "spherical"), ("longitude-latitude",)),
    **dict.fromkeys(("ftheta", "division", "equisolid", "orthographic", "scaramuzza", "ocam", "cylindrical"), ()),
}
"""Lens models as read that agree with a name; letters and digits of the name."""
_SHOWN_LENSES: Final = {"rational": "pinhole", "kannala-brandt": "fisheye (Kannala–Brandt)"}
_FLAG_WORDS: Final = {"is", "use", "fisheye", "model", "lens", "camera", "left", "right", "0", "1", "2", "l", "r"}


@dataclass(frozen=True, kw_only=True)
class _Reading:
    """What was read, and how."""

    request: Request
    imported: Imported  # a pair as in the files: from their first to their second camera, pictures as taken
    is_reversed: bool  # the first camera of the files is the right one

    @property
    def cameras(self) -> tuple[ImportedCamera, ...]:
        if isinstance(self.imported, ImportedRig):
            return self.imported.left, self.imported.right
        return (self.imported,) if isinstance(self.imported, ImportedCamera) else ()

    @property
    def pixels(self) -> tuple[int, int] | None:
        camera = self.imported.left if isinstance(self.imported, ImportedRig) else self.imported
        return None if isinstance(camera, ImportedCorners) else camera.pixels

    @property
    def unit(self) -> str:
        """Unit of lengths of the files; empty if no length was read."""
        stated = (convention.says for convention in self.imported.conventions if convention.name == "length unit")
        return next(stated, "").split(",")[0]

    @property
    def is_raw(self) -> bool:
        stated = (convention.says for convention in self.imported.conventions if convention.name == "pictures")
        return self.request.pictures == "raw" and not any(says.startswith("rect") for says in stated)


def unused_keys(files: Sequence[CameraFile], request: Request, imported: Imported) -> Iterator[Convention]:
    """The keys that are not used, in words; none if all are.

    A second value of what was read, such as a baseline beside T, counts as used if it agrees.

    Parameters
    ----------
    files
        Files whose values have been read.
    request
        How they were read: rectified pictures have no distortion, and no other camera matrix than that of their file.
    imported
        What was read.

    Raises
    ------
    CameraFileError
        Nothing in a file is used; or a key would change the meaning of what was read: it looks like a part of the lens
        model, another camera matrix, a scale other than 1, a part of the picture, another unit or convention, or
        contradicts the lens model, the baseline, the rotation, or the size and the matrix of the pictures.
    """
    is_reversed = isinstance(imported, ImportedRig) and bool(request.pair) and _is_reversed(files, imported)
    filed = as_filed(imported, is_reversed) if isinstance(imported, ImportedRig) else imported
    reading = _Reading(request=request, imported=filed, is_reversed=is_reversed)
    # A list, since checks mark values that agree with what was read as used.
    for value in [value for file in files for value in file.unused()]:
        if not value.path:
            raise value.fail("nothing in this file is needed beside the other files; remove it from from:")
        for part in _parts(value) if value.path not in value.file.beside else ():
            if problem := next(
                filter(None, (check(part, _words_of(part.path[-1:]), reading) for check in _CHECKS)), ""
            ):
                raise part.fail(problem)
    if unused := [value for file in files for value in file.unused()]:
        names = dict.fromkeys(dotted(value.path) for value in unused)
        yield Convention(name=UNUSED, says=", ".join(names), key=unused[0].key)


def _is_reversed(files: Sequence[CameraFile], rig: ImportedRig) -> bool:
    """Whether the files give the right camera first: in an earlier file, or by a lower number in one file."""
    places = [
        [camera.keys["focal_lengths"].startswith(f"{file.label}: ") for file in files].index(True)
        for camera in (rig.left, rig.right)
    ]
    names = rig.left.name, rig.right.name  # such as cam2 and cam10
    return (places[0], len(names[0]), names[0]) > (places[1], len(names[1]), names[1])


def _parts(value: Located) -> Iterator[Located]:
    """A value and all values below it that have keys."""
    entry = value.entry
    if isinstance(value.path[-1], str) and not (isinstance(entry, ScalarEntry) and entry.value is None):
        yield value
    below: list[tuple[str | int, Entry]] = []
    if isinstance(entry, MappingEntry):
        below = [(key, member.entry) for key, member in entry.members.items()]
    elif isinstance(entry, ListEntry):
        below = [*enumerate(entry.items)]
    for key, inner in below:
        yield from _parts(Located(file=value.file, entry=inner, path=(*value.path, key)))


def _words_of(path: Path) -> tuple[str, ...]:
    """Words of keys, which underscores or capitals separate, in small letters."""
    return tuple(word.lower() for key in path for word in _WORD.findall(str(key)))


def _numbers_in(entry: Entry) -> Iterator[float]:
    if isinstance(entry, MappingEntry):
        below = [member.entry for key, member in entry.members.items() if key not in ("rows", "cols", "sizes")]
    elif isinstance(entry, ListEntry):
        below = [*entry.items]
    else:
        try:
            # Flags are no numbers here; checks judge them by their text.
            yield 0.0 if entry.value is None or isinstance(entry.value, bool) else float(entry.value)
        except (ValueError, OverflowError):  # a text
            return
        return
    for inner in below:
        yield from _numbers_in(inner)


def _texts(value: Located) -> tuple[str, ...]:
    """A single value, or those of a list, as texts; none for a mapping."""
    entries = value.entry.items if isinstance(value.entry, ListEntry) else (value.entry,)
    return tuple(entry.text.strip() for entry in entries if not isinstance(entry, ListEntry | MappingEntry))


def _changes_pictures(value: Located, _words: tuple[str, ...], reading: _Reading) -> str:
    """Keys of lens models, other matrices, scales and parts of the picture."""
    key, numbers = value.last, {*_numbers_in(value.entry)}
    size, is_set = _size_named(value, reading), any(text.lower() in YES for text in _texts(value))
    if reading.is_raw and _LENS.search(key) and any(numbers):
        return (
            "this key looks like a part of the lens model, but no such key is known here; rename it as the format "
            "names it, or remove it if it does not belong to these pictures"
        )
    if reading.is_raw and _OTHER_MATRIX.search(key) and any(numbers):
        return (
            "this key looks like the camera matrix of undistorted pictures, but is not used; remove it or, if depth is "
            "measured in undistorted pictures, write it as the camera matrix, and zeros as distortion"
        )
    if _SCALE.search(key) and (is_set or not _is_neutral(value, reading)):
        return (
            "this key looks like a scale of the pictures, but is not used; remove it if the camera matrix holds for "
            "the pictures in which depth is measured; if not, first multiply fx, fy, cx, cy and the size by the scale"
        )
    # The whole picture is given by its size, or by its last column and row.
    whole = ({0.0}, {0.0, *size}, {0.0, *(side - 1.0 for side in size)})
    if _PART.search(key) and (is_set or {0.0, *numbers} not in whole):
        return (
            "this key looks like a part of the picture, but is not used; remove it if the pictures in which depth is "
            "measured are not cropped to it; if they are, first subtract its corner from cx and cy, and write its size "
            "as that of the pictures"
        )
    return ""


def _is_neutral(value: Located, reading: _Reading) -> bool:
    """Whether a scale changes nothing: 1, 100 %, or the size that the pictures have."""
    numbers = {*_numbers_in(value.entry)}
    unscaled = 100.0 if "percent" in value.last.lower() else 1.0
    return numbers <= {0.0, unscaled} or _size_in(value) == _size_named(value, reading)


def _scales(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    if not _SCALES & {*words} or isinstance(value.entry, MappingEntry):
        return ""
    unread = [text for text in _texts(value) if not _is_number(text) and text.lower() not in (*_UNSET, "full")]
    if not unread and _is_neutral(value, reading):
        return ""
    return "this key looks like a scale, but is not used; multiply the values that it scales by it, and remove it"


def _units(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    words = (*_words_of(value.path[-2:-1]), *words)  # as in units: {length: m} and baseline: {unit: m}
    if not _UNIT_WORDS & {*words} or _NOT_OF_LENGTHS & {*words}:
        return ""
    subject = {*words} - _UNIT_WORDS - {"of"}
    metre = parse(f"1 {reading.unit}", LENGTH) if reading.unit else None
    for text in filter(None, _texts(value)):
        kind = next((unit for unit, forms in _NAMED_UNITS.items() if text.lower() in forms), "")
        length = _metres_of(text)
        expected = "px" if subject & _IN_PIXELS else "rad" if subject & _IN_RADIANS else reading.unit
        if expected == reading.unit:  # of lengths, or of something in the pictures
            agrees = length is not None and metre is not None and math.isclose(length, metre)
            harmless = (length is not None and metre is None) or bool(kind and subject and not subject & _LENGTHS)
        else:
            agrees, harmless = kind == expected, False
        if not (agrees or harmless):
            what = "lengths are" if expected == reading.unit else "this is"
            wrong = f"the unit in which {what} read, {expected}" if expected else "a known unit"
            return f"{text[:40]} is not {wrong}; convert the values, and remove this key"
        if agrees:
            value.use()
    return ""


def _metres_of(text: str) -> float | None:
    """A unit of length, or a number that stands for one, in metres; None for any other text."""
    for unit in (text, text.lower()):
        with suppress(UnitError):
            return parse(f"1 {unit}", LENGTH)
    return float(text) if _is_number(text) else None


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _lens_models(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    """Lens models named under any key, and flags such as ``is_fisheye``."""
    models = {camera.lens_model for camera in reading.cameras}
    if not reading.is_raw or not models:
        return ""
    shown = " and ".join(_SHOWN_LENSES.get(model, model) for model in sorted(models))
    contradicts = f"contradicts the lens model that is read, {shown}; correct it, or remove it"
    is_flag = "fisheye" in words and {*words} <= _FLAG_WORDS
    for text in _texts(value):
        if is_flag and text.lower() in (*SET, *_UNSET):
            if (text.lower() in SET) != (models == {"kannala-brandt"}):
                return f"{text} {contradicts}"
            value.use()
            continue
        letters = re.sub("[^a-z0-9]", "", text.lower()).removeprefix("opencv").removeprefix("cv")
        if letters in _LENSES:
            if not models <= {*_LENSES[letters]}:
                return f"{text[:40]} {contradicts}"
            value.use()
        elif {"distortion", "projection"} & {*words} and {"model", "type"} & {*words} and text:
            return f"the lens model '{text[:40]}' is unknown, and {shown} is read; correct it, or remove it"
    return ""


def _prepared(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    """Flags of rectified, turned or mirrored pictures, and of conventions other than those of the format."""
    if isinstance(value.entry, ListEntry | MappingEntry):
        return ""
    text = value.entry.text.strip().lower()
    if {"rectified", "undistorted"} & {*words} and text in SET and reading.is_raw:
        return (
            "the calibration is read as that of raw pictures; remove this key or, if depth is measured in rectified "
            "pictures, give pictures: rectified beside from: where the format allows it"
        )
    if text in _UNSET or (_is_number(text) and float(text) == 0.0):
        return ""
    if _TURNED & {*words} and not _SPREAD & {*words}:
        return (
            "this key looks like a change of the pictures, such as a rotation, but is not used; calibrate the pictures "
            "in which depth is measured, or remove this key if it does not concern them"
        )
    if _CONVENTIONS & {*words}:
        return (
            "this key looks like a convention, but the file is read by the conventions of its format; convert the "
            "values to those, and remove this key"
        )
    return ""


def _poses(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    """A baseline, translation, rotation or epipolar geometry beside the one that is read."""
    rig, numbers = reading.imported, [*_numbers_in(value.entry)]
    is_elsewhere = any(_ELSEWHERE.search(step) for step in value.path if isinstance(step, str))
    if not isinstance(rig, ImportedRig) or is_elsewhere or (_SPREAD | _UNIT_WORDS) & {*words}:
        return ""
    is_parallel = not reading.is_raw  # to the baseline, while T and R are those of the cameras as they stand
    if value.last == "P2" and len(numbers) == 12 and numbers[0] > 0.0:  # by stereoRectify, P₂ = K′ [1, t]
        numbers, words = [numbers[3] / numbers[0], numbers[7] / numbers[0], 0.0], ("translation",)
        is_parallel = True
    if value.last == "Q" and len(numbers) == 16 and numbers[14] != 0.0:  # by stereoRectify, Q₄₃ = −1/t
        numbers, words = [1.0 / numbers[14]], ("baseline",)
    quantity = {*words} - {"deg", "degree", "degrees", "matrix", "mat", "m", "cm", "mm", "um"}
    rotation, problem, agrees = np.array(rig.rotation), "", False
    if _TRANSLATIONS & {*words} or quantity == {"t"}:
        metre = parse(f"1 {next(filter(_is_unit, words), reading.unit)}", LENGTH)
        lengths = [number * metre for number in numbers]
        with suppress(UnitError):
            lengths = lengths or [parse(text, LENGTH) for text in _texts(value)]
        if not lengths and "baseline" in words and isinstance(value.entry, ScalarEntry):
            return f"'{value.entry.text[:40]}' is not a length; correct it, or remove it"
        if len(lengths) not in (1, 3) or not any(lengths):
            return ""
        problem = translation_problem(lengths, words, rig.translation, is_parallel=is_parallel)
        agrees = not problem
    elif len(quantity) == 1 and quantity <= _EPIPOLAR and len(numbers) == 9 and reading.is_raw:
        matrices = [] if quantity <= {"e", "essential"} else [_matrix_of(camera) for camera in reading.cameras]
        problem, agrees = epipolar_problem(numbers, rotation, rig.translation, matrices)
    elif (_ROTATIONS & {*words} or quantity == {"r"}) and any(numbers) and reading.is_raw:
        problem, agrees = rotation_problem(numbers, words, rotation)
    if agrees:
        value.use()
    return problem


def _matrix_of(camera: ImportedCamera) -> FloatArray:
    (fx, fy), (cx, cy) = camera.focal_lengths, camera.centre
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def _is_unit(word: str) -> bool:
    return word in ("m", "cm", "mm", "um")


def _sides(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    """Keys that name the second camera as the left one, or the first as the right one."""
    texts = [text.lower() for text in _texts(value)]
    named = {*words} - {"camera", "cam", "id", "index", "number"}
    wrong = (({"1"}, "right"), ({"2"}, "left"), ({"left"}, "2"))
    if reading.request.pair or not any(named == key and texts == [text] for key, text in wrong):
        return ""
    return (
        "the first camera of the file is read as the left one; give pair: [2, 1] beside from: if camera 2 is the left "
        "one, or remove this key"
    )


def _size_in(value: Located) -> tuple[float, ...]:
    """Numbers of a size, width first; also of a text such as 640x480."""
    if value.has("width", "height") and isinstance(members := value.entry, MappingEntry):
        return tuple(number for key in ("width", "height") for number in _numbers_in(members.members[key].entry))
    numbers, text = tuple(_numbers_in(value.entry)), " ".join(_texts(value))
    return numbers or tuple(map(float, re.findall(r"\d+", text) if re.match(r"\d+ *[x×*,] *\d+", text) else ()))


def _size_named(value: Located, reading: _Reading) -> tuple[float, ...]:
    """The width, the height or both, as a key names them; empty if no size is read."""
    key, size = value.last.lower(), tuple(map(float, reading.pixels or ()))
    return size[:1] if "width" in key else size[1:] if "height" in key else size


def _cameras_of(value: Located, reading: _Reading) -> tuple[ImportedCamera, ...]:
    """The camera whose file, mapping or name a key shares, or whose side or number it names; all if none is told."""
    cameras = reading.cameras
    prefixes = [re.sub(r"[^.:]*$", "", camera.keys["focal_lengths"]) for camera in cameras]
    sharing = [camera for camera, prefix in zip(cameras, prefixes, strict=True) if value.key.startswith(prefix)]
    if len(cameras) < 2 or len(sharing) == 1:
        return (*sharing,) or cameras
    # If the first camera of the files is the right one, left and right do not tell the order of the files.
    sides = {"1": 0, "2": 1} if reading.is_reversed else {"1": 0, "2": 1, "left": 0, "l": 0, "right": 1, "r": 1}
    names = [{*_words_of((camera.name,))} for camera in cameras]
    sides |= {word: side for side in (0, 1) for word in names[side] - names[1 - side]}
    match = _PINHOLE.fullmatch(value.last)
    words = {*_words_of((*value.path[:-1], *(match.groups("")[::3] if match else (value.last,))))}
    if "0" in words or _counts_from_zero(value):
        sides |= {"0": 0, "1": 1, "2": 2}
    told = {sides[word] for word in words if word in sides}
    return (cameras[told.pop()],) if len(told) == 1 and told <= {0, 1} else cameras


def _counts_from_zero(value: Located) -> bool:
    """Whether a list, or a key with 0 for the 1 of a key that leads to the value, shows that cameras count from 0."""
    mapping = value.file.top
    for step in value.path:
        if isinstance(step, int) or ("1" in step and mapping.has(step.replace("1", "0"))):
            return True
        mapping = mapping.need(step)
    return False


def _second_values(value: Located, words: tuple[str, ...], reading: _Reading) -> str:
    """A size of the pictures, focal length or principal point beside the one that is read."""
    if reading.pixels is not None and _SIZE.fullmatch(value.last):
        size, stated = _size_named(value, reading), _size_in(value)
        times, rest = divmod(len(stated), len(size))
        if stated and stated == size * times:
            value.use()
        elif (stated and not rest) or not {*stated} <= {*size}:
            what = next((f"a {side} of " for side in ("width", "height") if side in value.last.lower()), "")
            return (
                f"{what}{' × '.join(f'{number:g}' for number in stated)} px contradicts the size that is read, "
                f"{reading.pixels[0]} × {reading.pixels[1]} px; correct one"
            )
    is_pinhole = _PINHOLE.fullmatch(value.last) or {"principal", "point"} <= {*words}
    if reading.is_raw and reading.cameras and is_pinhole and not (_SPREAD | _UNIT_WORDS) & {*words}:
        return _pinhole_problem(value, words, _cameras_of(value, reading))
    return ""


def _pinhole_problem(value: Located, words: tuple[str, ...], cameras: Sequence[ImportedCamera]) -> str:
    """How a focal length or a principal point contradicts those of the cameras that it may concern."""
    match, numbers = _PINHOLE.fullmatch(value.last), [*_numbers_in(value.entry)]
    axis = match[3].lower() if match else next((word for word in words if word in ("x", "y")), "")
    pairs = [camera.focal_lengths if match and match[2] in "fF" else camera.centre for camera in cameras]
    by_camera = [(pair["xy".index(axis)],) if axis else pair for pair in pairs]
    if len(numbers) != len(by_camera[0]):
        return ""
    for number, values in zip(numbers, zip(*by_camera, strict=True), strict=True):
        if not any(math.isclose(number, expected, rel_tol=_AGREES) for expected in values):
            shown = listed([f"{value:g} px of {camera.name}" for value, camera in zip(values, cameras, strict=True)])
            return f"{number:g} contradicts the camera matrix that is read, {shown}; correct one, or remove this key"
    if all(math.isclose(*pair, rel_tol=_AGREES) for row in by_camera for pair in zip(numbers, row, strict=True)):
        value.use()  # else it agrees with one of the cameras, and does not say which it concerns
    return ""


_CHECKS: Final[tuple[Callable[[Located, tuple[str, ...], _Reading], str], ...]] = (
    _units, _lens_models, _prepared, _changes_pictures, _scales, _poses, _sides, _second_values,
)  # fmt: skip
