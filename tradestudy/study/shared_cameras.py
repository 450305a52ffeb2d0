"""Assemble the cameras of a study from their own files, calibration files or other cameras."""

from __future__ import annotations

import stat
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from tradestudy.cameras.imported import CATALOGUE, PICTURE_SIZE, size_words
from tradestudy.cameras.kinds import KINDS
from tradestudy.catalogue import PREFIX, entry_names, entry_path, revision
from tradestudy.declarations.lens_models import FittedLensModel
from tradestudy.declarations.part import Part, nearest_name
from tradestudy.errors import Problem, StudyError, nearest
from tradestudy.study import document as tree
from tradestudy.study.camera_files import lytro
from tradestudy.study.camera_files.binary import MAGIC
from tradestudy.study.camera_files.importing import imported, known_formats, recognised
from tradestudy.study.camera_files.importing import nearest as nearest_formats
from tradestudy.study.camera_files.located import CameraFile, CameraFileError, NoLengthUnitError, Request, wrong_request
from tradestudy.study.document import (
    Document,
    Entry,
    ListEntry,
    MappingEntry,
    Member,
    Place,
    Reading,
    ScalarEntry,
    child,
    count_values,
    merged,
    plain,
)
from tradestudy.study.schema.types import key_names
from tradestudy.study.schema.validation import validate
from tradestudy.study.source import MOST_VALUES, UnreadableError, compose

MOST_BYTES = 1_000_000
_MOST_BYTES_OF_LITERALS, _HEAD = 32_000_000, 4000
LONGEST_CHAIN = 50
SHARING = ("from", "like")
_MOST_PIXELS = 1_000_000  # along one side of a picture
OF_IMPORTS = (
    "length_unit",
    "pair",
    "pictures",
    "lens_model",
)  # keys allowed beside from: when it names calibration files


def load_entries(path: Path) -> tuple[Entry, list[Problem]]:
    """Read a file into entries, or refuse it."""
    return compose(_text(path), Place(str(path), 1, 1))


def _text(path: Path) -> str:
    """Read the text of a file, or refuse it."""
    content = _text_or_bytes(path)
    if isinstance(content, bytes):
        raise refused(Place(str(path), 1, 1), "it is a binary file; text is expected")
    return content


def _text_or_bytes(path: Path) -> str | bytes:
    """Read the text of a file, or the bytes of a binary calibration file, or refuse it."""
    place = Place(str(path), 1, 1)
    try:
        content = _content(path, place)
    except FileNotFoundError:
        raise refused(place, f"there is no such file{_nearest_file(path)}") from None
    except (OSError, ValueError) as error:  # ValueError: the operating system does not allow this name
        raise refused(place, f"it cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise refused(place, "it is text in UTF-16; save it as UTF-8")
    if content.startswith(MAGIC):
        return content
    if b"\0" in content:
        raise refused(place, "it is a binary file; text is expected")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line, column = before.count(b"\n") + 1, len(before) - (before.rfind(b"\n") + 1) + 1
        raise refused(
            Place(str(path), line, column), f"the byte 0x{content[error.start]:02x} is not UTF-8; save it as UTF-8"
        ) from None


def _content(path: Path, place: Place) -> bytes:
    """Read the bytes of a regular file of limited size; devices and pipes might never end."""
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise refused(place, "it is a folder; a file is expected")
    if not stat.S_ISREG(mode):
        raise refused(place, "it is not a regular file; a file is expected")
    with path.open("rb") as file:
        # One byte beyond the limit is enough to tell that a file is too large.
        content = file.read(MOST_BYTES + 1)
        if content.startswith(lytro.CONTAINER):
            try:
                return lytro.frame_metadata(file, path.stat().st_size)
            except lytro.ContainerError as error:
                raise refused(place, f"this picture cannot be read: {error}") from None
        # A file of mrcal, NumPy or MATLAB may contain the data from which its camera was calibrated.
        most = _MOST_BYTES_OF_LITERALS if b"lensmodel" in content[:_HEAD] or content.startswith(MAGIC) else MOST_BYTES
        content += file.read(most + 1 - len(content))
    if len(content) > most:
        raise refused(
            place,
            f"it is larger than {most // 1_000_000} MB; a study file is at most 1 MB, and data belong in separate "
            "files",
        )
    return content


def refused(place: Place, what: str) -> UnreadableError:
    """The error for a text without a tree."""
    return UnreadableError([place.problem((), what)])


def _nearest_file(path: Path) -> str:
    """For messages: the file with the most similar name in the same folder; empty if there is none."""
    try:
        # A folder may have so many files that reading all their names would take long.
        names = [entry.name for entry, _ in zip(path.parent.iterdir(), range(1000), strict=False)]
        names = [name for name in names if name != path.name]  # that of a broken link
    except OSError:
        return ""
    close = nearest(path.name, names)
    return f"; nearest: '{path.parent / close}'" if close else ""


class SharedCameras:
    """Assembles cameras from files and other cameras; a camera with a mistake stays as written."""

    def __init__(self, *, folder: Path, root: MappingEntry) -> None:
        self.folder, self.root = folder, root
        self.problems: list[Problem] = []
        self.broken: list[tree.Path] = []
        self.imported: list[Reading] = []
        self.like: dict[str, str] = {}
        self.done: dict[str, Entry | None] = {}
        self.files: dict[str, tuple[Entry, list[Problem]]] = {}
        self.values = 0

    def resolved(self) -> MappingEntry:
        """The study with every camera assembled."""
        written = self.root.members.get("cameras")
        if written is None or not isinstance(written.entry, MappingEntry):
            return self.root
        self.written = written.entry
        members = {
            name: Member(member.key_place, self.camera(name, ()) or member.entry)
            for name, member in self.written.members.items()
        }
        cameras = Member(written.key_place, replace(self.written, members=members))
        return replace(self.root, members={**self.root.members, "cameras": cameras})

    def camera(self, name: str, chain: tuple[str, ...]) -> Entry | None:
        """One assembled camera, or None after noting the mistake."""
        if name not in self.done:
            try:
                self.done[name] = self.assemble(name, chain)
            except CameraFileError as error:
                self.note(name, error.problem)
                self.done[name] = None
            if self.done[name] is None:
                self.broken.append(("cameras", name))
        return self.done[name]

    def assemble(self, name: str, chain: tuple[str, ...]) -> Entry | None:
        """A camera as written, or its own values merged into those of a file or another camera.

        It is None if its mistake is already known.

        Raises
        ------
        CameraFileError
            The camera, its file or the camera that it is like cannot be used.
        """
        own_values = self.written.members[name].entry
        if not isinstance(own_values, MappingEntry) or not own_values.members.keys() & set(SHARING):
            return own_values
        if own_values.members.keys() >= set(SHARING):
            place = own_values.members["like"].key_place
            raise CameraFileError(place.problem(("like",), "a camera may have from: or like:, not both"))
        key = "from" if "from" in own_values.members else "like"
        if key == "like" and "mode" in own_values.members:
            what = (
                "a camera that is like another has its mode; to choose one, write from: and the file instead of like:"
            )
            raise CameraFileError(own_values.members["mode"].key_place.problem(("mode",), what))
        source = own_values.members[key].entry
        if key == "from":
            try:
                if files := self.calibration_files(source):
                    return self.from_calibration(name, own_values, files)
            except CameraFileError:
                self.note_unknown_keys(name, own_values)
                raise
        if not (isinstance(source, ScalarEntry) and isinstance(source.value, str)):
            expected = "the name of a file" if key == "from" else "the name of a camera"
            raise CameraFileError(source.place.problem((key,), f"{expected} is expected"))
        load = self.from_file if key == "from" else self.like_camera
        below = load(name, source.value, source.place, (*chain, name))
        if below is None or self.values > MOST_VALUES:  # reported at the camera that exceeded the limit
            return None
        self.values += count_values(below)
        if self.values > MOST_VALUES:
            what = f"the cameras together contain more than {MOST_VALUES} values"
            raise CameraFileError(source.place.problem((key,), what))
        return self.with_own_values(below, own_values, name, (*SHARING, *(("mode",) if key == "from" else ())))

    def with_own_values(self, below: Entry, own_values: MappingEntry, name: str, but: Sequence[str]) -> Entry:
        """Merge a camera's own values, except some keys, into those of a file or another camera."""
        kept = {key: member for key, member in own_values.members.items() if key not in but}
        changed = replace(own_values, members=kept)
        self.problems += problems_of_removals(below, changed, ("cameras", name))
        return merged(below, changed)

    def from_calibration(self, name: str, own_values: MappingEntry, files: Sequence[CameraFile]) -> Entry | None:
        """Merge the study's values of a camera into those of its calibration files."""
        request = self.request(own_values)
        try:
            below, said = imported(files, request)
        except NoLengthUnitError as error:
            self.note(name, error.problem)
            return self.read_in_any_unit(name, own_values, files, request)
        self.imported.append(Reading(camera=name, said=said))
        return self.with_own_values(below, _without_size(own_values, below, request), name, (*SHARING, *OF_IMPORTS))

    def read_in_any_unit(
        self, name: str, own_values: MappingEntry, files: Sequence[CameraFile], request: Request
    ) -> Entry | None:
        """A camera read in some possible unit of length, so that its mistakes beside the missing unit are found too."""
        unknown = self.note_unknown_keys(name, own_values)
        for unit in ("m", "cm", "mm"):
            with suppress(CameraFileError):  # the baseline is impossible in this unit
                below, _ = imported(files, replace(request, length_unit=unit))
                own_values = _without_size(own_values, below, request)
                return self.with_own_values(below, own_values, name, (*SHARING, *OF_IMPORTS, *unknown))
        return None

    def calibration_files(self, entry: Entry) -> list[CameraFile]:
        """The calibration files that a camera names; empty if it names a camera file."""
        named = entry.items if isinstance(entry, ListEntry) else (entry,)
        if not all(isinstance(item, ScalarEntry) and isinstance(item.value, str) for item in named):
            return []
        files: list[CameraFile] = []
        for item in named:
            path = self.folder / plain(item)
            try:
                file = recognised(path, _text_or_bytes(path), plain(item))
            except UnreadableError as error:
                if item is entry:
                    return []  # `from_file` reports the reason
                what = f"'{error.problems[0].file}': {error.problems[0].what}"
                raise CameraFileError(item.place.problem(("from",), what)) from None
            if file is not None:
                files.append(file)
            elif item is not entry:
                what = f"'{path}' is not a calibration file; a list may name only calibration files"
                raise CameraFileError(item.place.problem(("from",), what))
        return files

    def request(self, own_values: MappingEntry) -> Request:
        """Options of the study for reading the calibration files."""
        options: dict[str, str | tuple[str, ...]] = {}
        for key in OF_IMPORTS:
            if key not in own_values.members:
                continue
            entry = own_values.members[key].entry
            value = plain(entry)
            problem = wrong_request(key, value)
            if problem:
                raise CameraFileError(entry.place.problem((key,), problem))
            options[key] = tuple(map(str, value)) if key == "pair" else value
        return Request(**options, pixels=_pixels(own_values), fitted_lens=_fitted_lens(own_values))  # type: ignore[arg-type]

    def from_file(self, name: str, file: str, place: Place, _chain: tuple[str, ...]) -> Entry | None:
        """Read a camera's own file."""
        expected = f"a camera or a calibration file ({known_formats()}) is expected"
        try:
            path = self.path_of(file, place)
            if file not in self.files and not _text(path).strip():
                raise CameraFileError(place.problem(("from",), f"'{file}' is empty; {expected}"))
            entry, problems = self.files[file] if file in self.files else load_entries(path)
        except UnreadableError as error:
            first, *others = error.problems
            # A mistake at the first character concerns the file as a whole, and is reported where the study names the
            # file.
            if others or not first.line == first.column == 1:
                self.problems += error.problems
                return None
            raise CameraFileError(place.problem(("from",), f"'{first.file}': {first.what}")) from None
        for problem in problems:
            self.note(name, problem)
        self.files[file] = (entry, [])  # the next camera of this file does not report its mistakes again
        if not isinstance(entry, MappingEntry):
            raise CameraFileError(entry.place.problem((), f"{expected}, not {kind_of(entry)}"))
        if isinstance(cameras := child(entry, "cameras"), MappingEntry):
            what = f"is a study, not a camera; copy its camera {' or '.join(cameras.members)} to a separate file"
            raise CameraFileError(place.problem(("from",), f"'{file}' {what}"))
        if not entry.members.keys() & _keys_of_cameras().keys():
            what = f"is neither a camera nor a calibration file ({known_formats()}){nearest_formats(entry)}"
            raise CameraFileError(place.problem(("from",), f"'{file}' {what}"))
        for key in SHARING:
            if key in entry.members:
                what = f"a camera file must be complete; write {key}: in the study"
                raise CameraFileError(entry.members[key].key_place.problem((key,), what))
        own_values = self.written.members[name].entry
        assert isinstance(own_values, MappingEntry)
        entry, mode = in_mode(entry, child(own_values, "mode"), file)
        # `path_of` leads elsewhere only for entries of the catalogue.
        return entry if path == self.folder / file else of_catalogue(entry, path.stem, mode)

    def path_of(self, file: str, place: Place) -> Path:
        """The file that the key ``from`` names: beside the study, or an entry of the catalogue."""
        path, entry = self.folder / file, file.removeprefix(PREFIX)
        if entry == file:
            return path
        is_file = False
        with suppress(OSError):  # the operating system does not allow this name
            is_file = path.exists()
        if is_file:
            if entry in entry_names():
                what = f"both a file and an entry of the catalogue are called '{file}'; for the file, write ./{file}"
                raise CameraFileError(place.problem(("from",), what))
            return path
        if entry not in entry_names():
            what = f"the catalogue has no '{entry}'{nearest_name(entry, entry_names())}; `cameras` lists its entries"
            raise CameraFileError(place.problem(("from",), what))
        return entry_path(entry)

    def like_camera(self, name: str, other: str, place: Place, chain: tuple[str, ...]) -> Entry | None:
        """The assembled camera that another is like."""
        what = ""
        if other in chain:
            circle = " → ".join((*chain[chain.index(other) :], other))
            what = f"the cameras refer to each other in a circle: {circle}"
        elif len(chain) >= LONGEST_CHAIN:
            what = f"more than {LONGEST_CHAIN} cameras refer to each other in a chain"
        elif other not in self.written.members:
            declared = [camera for camera in self.written.members if camera != name]
            what = f"no camera is called '{other}'{nearest_name(other, declared)}"
        if what:
            raise CameraFileError(place.problem(("like",), what))
        self.like[name] = other
        below = self.camera(other, chain)
        return below if isinstance(below, MappingEntry) else None

    def note_unknown_keys(self, name: str, own_values: MappingEntry) -> list[str]:
        """Report unknown keys beside calibration files that could not be read: a misspelt option may be the cause."""
        known = dict.fromkeys((*OF_IMPORTS, *_keys_of_cameras()))
        unknown = [key for key in own_values.members if key not in known]
        for key in unknown:
            what = f"unknown key{nearest_name(key, known)}"
            self.note(name, own_values.members[key].key_place.problem((key,), what))
        return unknown

    def note(self, name: str, problem: Problem) -> None:
        """Record a mistake of a camera, whose path begins below the camera."""
        self.problems.append(replace(problem, path=f"cameras.{name}.{problem.path}".removesuffix(".")))


def in_mode(entry: MappingEntry, mode_entry: Entry | None, file: str) -> tuple[MappingEntry, str]:
    """The camera of a file in one of its modes, and the mode; the first one if none is asked for, "" without modes.

    Raises
    ------
    CameraFileError
        There is no such mode.
    """
    written = child(entry, "modes")
    if written is None and mode_entry is None:
        return entry, ""
    modes = written.members if isinstance(written, MappingEntry) else {}
    if not modes:
        where = entry.members["modes"].key_place if written is not None else mode_entry.place  # type: ignore[union-attr]
        what = f"'{file}' has no modes; remove this key" if written is None else "modes by their names are expected"
        raise CameraFileError(where.problem(("mode" if written is None else "modes",), what))
    mode = next(iter(modes)) if mode_entry is None else tree.text_of(mode_entry)
    if mode_entry is not None and mode not in modes:
        what = f"'{file}' has no mode '{mode}', but {', '.join(modes)}"
        raise CameraFileError(mode_entry.place.problem(("mode",), what))
    rest = {key: member for key, member in entry.members.items() if key != "modes"}
    if not isinstance(modes[mode].entry, MappingEntry):
        raise CameraFileError(
            modes[mode].key_place.problem(("modes", mode), "values of the camera are expected, or {}")
        )
    chosen = merged(replace(entry, members=rest), modes[mode].entry)
    assert isinstance(chosen, MappingEntry)
    title = chosen.members.get("title")
    if title is not None and isinstance(title.entry, ScalarEntry) and len(modes) > 1:
        named = f"{title.entry.text} at {mode}"
        members = {**chosen.members, "title": Member(title.key_place, replace(title.entry, value=named, text=named))}
        chosen = replace(chosen, members=members)
    return chosen, mode


def of_catalogue(entry: MappingEntry, name: str, mode: str) -> MappingEntry:
    """The camera of an entry of the catalogue, which says so."""
    says = ", ".join((name, *((f"mode {mode}",) if mode else ()), f"revision {revision(name)}"))
    said = ScalarEntry(place=entry.place, value=says, text=says)
    read_as = MappingEntry(place=entry.place, members={CATALOGUE: Member(entry.place, said)})
    return replace(entry, members={**entry.members, "read_as": Member(entry.place, read_as)})


def _keys_of_cameras() -> dict[str, None]:
    """Keys of cameras of all kinds, in their usual order."""
    return dict.fromkeys((*SHARING, *(key for kind in KINDS for key in key_names(kind))))


def problems_of_removals(below: Entry, above: Entry, path: tree.Path) -> list[Problem]:
    """Mistakes of nulls that remove keys that do not exist."""
    return [
        place.problem(where, nothing_to_remove(where[-1], members))
        for where, place, members in tree.removals_of_nothing(below, above, path)
    ]


def nothing_to_remove(key: str | int, members: Mapping[str, Member]) -> str:
    """Message for a null that removes nothing."""
    return f"null removes a value, but there is no '{key}' here{nearest_name(str(key), members)}"


def kind_of(entry: Entry) -> str:
    """What an entry is, in words."""
    if isinstance(entry, ScalarEntry):
        return "a single value" if entry.text else "nothing"
    return "a list" if isinstance(entry, ListEntry) else "a mapping"


def _pixels(own_values: MappingEntry) -> tuple[int, int] | None:
    """The size of the pictures that a study states; None if it states none, or not one."""
    sensor = child(own_values, "sensor")
    value = child(sensor, "pixels") if isinstance(sensor, MappingEntry) else None
    size: object = None if value is None else plain(value)
    if not (isinstance(size, list) and len(size) == 2):
        return None
    columns, rows = size
    if all(type(count) is int and 0 < count <= _MOST_PIXELS for count in (columns, rows)):
        return columns, rows
    return None


def _without_size(own_values: MappingEntry, below: Entry, request: Request) -> MappingEntry:
    """A camera's own values without a size of pictures that is that of the files, which may be rotated in ``below``."""
    said = child(child(below, "read_as"), PICTURE_SIZE)
    if request.pixels is None or said is None or not plain(said).startswith(size_words(request.pixels)):
        return own_values
    sensor = own_values.members["sensor"]
    assert isinstance(sensor.entry, MappingEntry)
    kept = {key: member for key, member in sensor.entry.members.items() if key != "pixels"}
    without = Member(sensor.key_place, replace(sensor.entry, members=kept))
    return replace(own_values, members={**own_values.members, "sensor": without})


class _FittedLens(Part):
    """The lens model to fit to corners, checked before the rest of a study, because an import depends on it."""

    lens_model: FittedLensModel | None = None


def _fitted_lens(own_values: MappingEntry) -> FittedLensModel | None:
    """The lens model that a camera declares for the fit to its corners; None without one.

    Raises
    ------
    CameraFileError
        The model is not valid.
    """
    entry: Entry | None = own_values
    for key in ("calibration", "corners"):
        entry = child(entry, key) if isinstance(entry, MappingEntry) else None
    if not isinstance(entry, MappingEntry) or "lens_model" not in entry.members:
        return None
    alone = replace(entry, members={"lens_model": entry.members["lens_model"]})
    try:
        return validate(Document(root=alone), _FittedLens).lens_model
    except StudyError as error:
        first = error.problems[0]
        raise CameraFileError(replace(first, path=f"calibration.corners.{first.path}")) from None
