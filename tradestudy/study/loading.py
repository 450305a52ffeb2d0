"""Read a study file and check all of it: its declarations, readings, sweeps and questions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from tradestudy.cameras.declaration import DepthCameraDeclaration
from tradestudy.errors import Problem, StudyError, TradestudyError
from tradestudy.study.camera_files.importing import ONE_CAMERA
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import DICTIONARY, OUTSIDE, Document, Entry, MappingEntry, Place, Value, dotted
from tradestudy.study.edits import in_si, overridden
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.claims import expectation_bounds
from tradestudy.study.schema.questions import AssumptionPart, SolvePart
from tradestudy.study.shared_cameras import SharedCameras, kind_of, load_entries
from tradestudy.study.source import UnreadableError, compose, entry_of_value
from tradestudy.study.varying import Varying, sweep_axes
from tradestudy.units import NUMBER

_FREE_TEXT = ("title", "note", "says", "question")
_INFERRED_ANEW = (
    "the calibration of {0} is a fit that depends on this, so every value would need a new fit; vary "
    "something on which it does not depend, such as {0}.calibration.stability"
)
Change = tuple[tuple[str | int, ...], dict[str, Value | Entry]]


def load_prepared(path: Path, overrides: tuple[str, ...] = ()) -> PreparedStudy:
    """Read a study file with ``path=value`` overrides; check it, its readings, and both ends of every varied range.

    Raises
    ------
    StudyError
        With every mistake found, at its place.
    """
    return PreparedStudy(checked(read(path, overrides)))


def read(path: Path, overrides: Sequence[str] = ()) -> Document:
    """Read a study file and everything that it refers to.

    Parameters
    ----------
    path
        A YAML 1.2 file.
    overrides
        ``path=value`` texts; the path is dotted, ``cameras.`` may be omitted, and the value is YAML. They are applied
        after ``from`` and ``like``, so that only the named camera changes; overrides name those that keep the replaced
        value.

    Returns
    -------
    Document
        It contains mistakes that still leave a tree; `validate` reports them together with its own.

    Raises
    ------
    StudyError
        If there is no tree: the file is missing, larger than 1 MB, binary, empty, or broken YAML.
    """
    place = Place(str(path), 1, 1)
    document = _document(lambda: load_entries(path), place, path.parent)
    return overridden(document, overrides)


def read_text(text: str, name: str) -> Document:
    """Read the text of a study; ``name`` is that of its file, from whose folder other files are read.

    Raises
    ------
    StudyError
        If there is no tree.
    """
    place = Place(name, 1, 1)
    return _document(lambda: compose(text, place), place, Path(name).parent)


def read_values(values: Mapping[str, Value]) -> Document:
    """Read a study given as a dictionary: its numbers are in SI, and files are read from the current folder.

    Raises
    ------
    StudyError
        If there are too many or too deeply nested values.
    """
    return in_si(_document(lambda: entry_of_value(values, DICTIONARY), DICTIONARY, Path()))


def _document(entries: Callable[[], tuple[Entry, list[Problem]]], place: Place, folder: Path) -> Document:
    """Assemble a study from its entries, with files from a folder."""
    try:
        entry, problems = entries()
    except UnreadableError as error:
        raise StudyError(error.problems) from None
    if not isinstance(entry, MappingEntry):
        problems.append(entry.place.problem((), f"a study is a mapping of keys to values, not {kind_of(entry)}"))
        raise StudyError(problems)
    if "kind" in entry.members and "cameras" not in entry.members:
        what = "this is a camera, not a study; a study names it under cameras, as in my-camera: {from: FILE}"
        raise StudyError([*problems, entry.place.problem(("kind",), what)])
    cameras = SharedCameras(folder=folder, root=replace(entry, place=place))
    root = cameras.resolved()
    return Document(
        root=root,
        problems=(*problems, *cameras.problems),
        broken=frozenset(cameras.broken),
        imported=tuple(cameras.imported),
        like=cameras.like,
    )


def checked(document: Document) -> StudyDefinition:
    """Check a document, its readings, and both ends of every varied range.

    Raises
    ------
    StudyError
        With every mistake found, at its place.
    """
    try:
        definition = StudyDefinition.of(document)
    except StudyError as error:
        problems = _stated_once(document, [*error.problems, *_single_cameras(document, error)])
        raise StudyError([_with_cause(document, problem) for problem in problems]) from None
    return with_questions_checked(definition)


def with_questions_checked(definition: StudyDefinition) -> StudyDefinition:
    """Check what a study varies, asks and claims; its declarations are checked.

    Raises
    ------
    StudyError
        With every mistake found, at its place.
    """
    problems: list[Problem] = []
    try:
        definition.readings  # noqa: B018 - built here so that `check` sees their mistakes
    except StudyError as error:
        problems += error.problems
    for search in (_problems_of_changes, _problems_of_claims, _problems_of_corners, _problems_of_measurements):
        try:
            problems += search(PreparedStudy(definition))
        except StudyError as error:
            problems += error.problems
    if problems:
        raise StudyError([_with_cause(definition.document, problem) for problem in dict.fromkeys(problems)])
    return definition


def _with_cause(document: Document, problem: Problem) -> Problem:
    """The problem of a part, with the values in it that were set from outside and may cause it."""
    assignments = [f"{dotted(override.path)}={override.text or 'null'}" for override in document.overrides]
    inside = [assignment for assignment in assignments if problem.path and assignment.startswith(f"{problem.path}.")]
    # With a single override, a problem at the override itself needs no cause.
    if not inside or (problem.file == OUTSIDE.file and len(assignments) == 1):
        return problem
    return replace(problem, what=f"{problem.what}; set for this run: {', '.join(inside)}")


def _stated_once(document: Document, problems: Sequence[Problem]) -> list[Problem]:
    """The problems; one that cameras inherit is reported once, at the camera that the others are like."""
    cameras = document.tree.get("cameras")
    # Names may contain dots, so that one can begin like a path in another: the longest that fits is the camera's.
    names = sorted(cameras, key=len, reverse=True) if isinstance(cameras, dict) else []
    reported: list[Problem] = []
    by_content: dict[tuple[str, str], dict[str, Problem]] = {}
    for problem in problems:
        name = next((name for name in names if f"{problem.path}.".startswith(f"cameras.{name}.")), None)
        shared = by_content.setdefault((problem.path.removeprefix(f"cameras.{name}"), problem.what), {})
        if name is None or name in shared:
            reported.append(problem)
        else:
            shared[name] = problem
    for shared in by_content.values():
        origins = {name: _origin(document, name, shared) for name in shared}
        for origin in dict.fromkeys(origins.values()):
            also = [f"cameras.{name}" for name, camera_origin in origins.items() if name != origin == camera_origin]
            what = shared[origin].what + (f" (also in {', '.join(also)})" if also else "")
            reported.append(replace(shared[origin], what=what))
    return reported


def _origin(document: Document, name: str, shared: Mapping[str, Problem]) -> str:
    """The camera from which a camera inherits a shared problem; itself if it inherits none."""
    place, origin = _place(shared[name]), document.like.get(name, "")
    if origin in shared and place in (_place(shared[origin]), document.locate(("cameras", name))):
        return _origin(document, origin, shared)
    # Cameras from one file share its mistakes although none is like another.
    return next((camera for camera in shared if _place(shared[camera]) == place and camera not in document.like), name)


def _place(problem: Problem) -> Place:
    return Place(problem.file, problem.line, problem.column)


def _single_cameras(document: Document, error: StudyError) -> Iterator[Problem]:
    """A note for every camera with mistakes that was imported as a single camera: its rig may need two files."""
    for reading in document.imported:
        path = ("cameras", reading.camera)
        is_wrong = any(problem.path.startswith(".".join(path)) for problem in error.problems)
        if reading.said[-1][1] == ONE_CAMERA and is_wrong:
            yield document.locate((*path, "kind")).problem((*path, "from"), f"gives {ONE_CAMERA}")


def _problems_of_changes(study: PreparedStudy) -> Iterator[Problem]:
    """Mistakes of the choices or of the ends of each sweep axis, and of the ends of questions and assumptions."""
    changes: list[Change] = []
    keys = study.definition.posterior_keys
    try:
        for axis in sweep_axes(study):
            ends = (axis.values[0], axis.values[-1])  # between which choices need not be valid, nor counts whole
            entries = axis.values if axis.dimension in (None, NUMBER) else ends
            changes += [(("sweep", axis.path), {axis.path: entry}) for entry in entries]
    except TradestudyError as error:
        yield study.document.problem(("sweep",), str(error))
    for where, question in _varied(study):
        changes += [((*where, "vary"), dict.fromkeys(question.paths, end)) for end in (question.low, question.high)]
        try:
            varying = Varying.of(study, question)
        except TradestudyError as error:
            yield study.document.problem((*where, "low"), str(error))
            continue
        if where[0] == "solve":
            changes.append(((*where, "vary"), {**varying.changes(varying.at_share(0.5))}))
    for at, values in changes:
        place = study.document.locate(at)
        if at[0] != "sweep" and (text := [path for path in values if path.rpartition(".")[2] in _FREE_TEXT]):
            yield place.problem(at, f"{text[0]}: is text; vary a number")
            continue
        try:
            changed = study.with_values(values)
        except StudyError as error:
            yield from (place.problem(at, f"{problem.path}: {problem.what}") for problem in error.problems)
            continue
        for camera, _ in keys.items() - changed.definition.posterior_keys.items() if at[0] != "sweep" else ():
            # Inverse questions can plan a calibration by a target; corners are already measured.
            part = changed.file.cameras[camera]
            is_planned = isinstance(part, DepthCameraDeclaration) and part.calibration.target is not None
            if not (at[0] == "solve" and is_planned):
                yield place.problem(at, _INFERRED_ANEW.format(camera))


def _varied(study: PreparedStudy) -> Iterator[tuple[tuple[str, ...], SolvePart | AssumptionPart]]:
    """Inverse questions and assumptions that vary a value between two ends, with their paths."""
    for name, question in study.file.solve.items():
        yield ("solve", name), question
    part = study.file.value_of_information
    for name, assumption in part.assumptions.items() if part is not None else ():
        if assumption.readings is None:
            yield ("value_of_information", "assumptions", name), assumption


def _problems_of_claims(study: PreparedStudy) -> Iterator[Problem]:
    """Expectations that have the wrong dimension."""
    for name, claim in study.file.claims.items():
        try:
            expectation_bounds(claim)
        except TradestudyError as error:
            where = ("claims", name, "expect")
            yield study.document.problem(where, str(error))


def _problems_of_measurements(study: PreparedStudy) -> Iterator[Problem]:
    """Tables of measurements that cannot be read."""
    for name, part in study.file.measurements.items():
        from tradestudy.calibration.measured_table import read_measurements

        path = ("measurements", name, "file")
        try:
            read_measurements(study.document.folder_of(path) / part.file)
        except TradestudyError as error:
            yield study.document.problem(path, str(error))


def _problems_of_corners(study: PreparedStudy) -> Iterator[Problem]:
    """Corner files that cannot be read, or that contradict the declared sensor."""
    forms = {"": study, **study.readings}
    parts = [part for form in forms.values() for part in form.file.cameras.values()]
    if not any(isinstance(part, DepthCameraDeclaration) and part.calibration.source == "corners" for part in parts):
        return
    from tradestudy.calibration.posteriors import CornersToInfer, corners_of  # loads all of calibration

    seen: set[str] = set()
    for reading, form in forms.items():
        for key, request in form.definition.calibrations_to_infer().items():
            if key in seen or not isinstance(request, CornersToInfer):
                continue
            seen.add(key)
            try:
                corners_of(request)
            except TradestudyError as error:
                path = ("cameras", request.name, "calibration", "corners", "file")
                where = ("readings", reading) if reading else path
                what = f"{'.'.join(path)}: {error}" if reading else str(error)
                yield study.document.problem(where, what)
