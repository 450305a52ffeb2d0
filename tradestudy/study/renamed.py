"""Keys of format 1 that format 2 lacks, and what to write instead."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Final

from tradestudy.cameras.kinds import DEPTH_PARAMETERS
from tradestudy.errors import Problem, StudyError
from tradestudy.study.document import Document, Entry, ListEntry, MappingEntry, Path, ScalarEntry, child, walk
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.validation import validate

# Path of the old key, with * for any name → what to write instead, with {} for these names in order.
_CALLED: Final = {
    "cameras.*.axes_meet_at": "convergence_distance",
    "cameras.*.depth.lenses": "microlenses",
    "scene.picture.window": "matching_window",
    "scene.picture.bits": "bit_depth",
    "scene.picture.pixel_fill": "linear_fill_factor",
    "accuracy.relative": "tolerance",
    "accuracy.budget": "time_limit",
    "usable": "usable_range",
    "criteria": "relief",
    "depth_of_field.scene": "range",
    "depth_of_field.sharp": "criteria",
    "solve.*.way": "errors",
    "claims.*.way": "errors",
    "claims.*.of": "quantity",
    "light_spot.array_distance": "mla_distance",
    "light_spot.microlenses.across": "lenses_across",
    "light_spot.microlenses.gaps": "interstices",
    "light_spot.published": "published_times",
    "point_spread.standing_wavelength": "reference_wavelength",
    "point_spread.elements.*.published_minimum": "published_minimum_f_number",
    "fresnel_validity.elements.*.published_minimum": "published_minimum_f_number",
}
_INSTEAD: Final = {
    "cameras.*.thermal_expansion": "format 2: cameras.{}.calibration.stability.housing_expansion, beside temperature",
    "cameras.*.calibration.correlation": "format 2: correlations beside errors, {{mla_distance: {{focal_length: …}}}} "
    "with this value; leave out a correlation of 0",
    "cameras.*.calibration.errors.pixel_noise": "the noise of one measurement is cameras.{}.depth.disparity_error",
    "cameras.*.calibration.errors.*.drawn": "remove this; how often an error is drawn follows from its kind",
    "cameras.*.calibration.corners.declared_baseline": "format 2 compares the fit with cameras.{}.baseline",
    "scene.temperature": "format 2: stability.temperature of the calibration of each camera",
    "effects.temperature": "format 2: effects.calibration, which includes temperature",
    "calibration.seed": "format 2: propagation.seed",
    "calibration.distances": "remove this; depth is computed at scene.distances, sensitivities at sensitivity.at",
    "calibration.edge": "format 2: propagation.field_places, a list: [70 %]",
    "calibration.accuracy": "format 2: accuracy.depth_uncertainty; if both are given, write the tighter one",
    "calibration.budget": "format 2: propagation.max_draws",
    "calibration.compare": "format 2: decision.compare",
    "calibration.questions": "format 2: solve; write parameter as a path in vary, with low and high as the ends of "
    "its range, and way as errors; camera, equal, relative and at stay",
    "calibration.surroundings.calibrated_at_temperature": "format 2: stability.calibrated_at of each calibration",
    "calibration.surroundings.calibrated_at_pressure": "format 2: stability.calibrated_at of each calibration",
    "calibration.surroundings.temperature_change": "format 2: calibration.stability.temperature of each camera",
    "calibration.surroundings.pressure_change": "format 2: calibration.stability.pressure of each camera",
    "calibration.cameras.*.errors": "format 2: cameras.{}.calibration.errors; normal and uniform ones need no shape",
    "calibration.cameras.*.joint": "format 2: cameras.{}.calibration.correlations, by pairs: {{yaw: {{roll: 0.5}}}}",
    "calibration.cameras.*.body": "format 2: cameras.{}.calibration.stability",
    "calibration.cameras.*.file": "format 2: cameras.{}.calibration.posterior.file",
    "calibration.cameras.*.target": "format 2: cameras.{}.calibration.target; half_field is half_field_angle, "
    "an angle instead of its tangent (16.7 deg for 0.3), "
    "maximum_steps is max_steps",
    "calibration.cameras.*.corners": "format 2: cameras.{}.calibration.corners; maximum_steps is max_steps",
}
_PATTERNS: Final = {
    **{
        tuple(old.split(".")): f"format 1 called this {old.split('.')[-1]}; format 2: {new}"
        for old, new in _CALLED.items()
    },
    **{tuple(old.split(".")): message for old, message in _INSTEAD.items()},
}
_UNDER_ERRORS: Final = "format 2: calibration errors belong under calibration.errors"
_FORMAT: Final = "this is a study of format 1; change everything listed here, then write format: 2"
_REFOCUSED: Final = "format 1 called this every-object; format 2: autofocus"


def validated(document: Document) -> StudyFile:
    """Validate a study; keys of format 1 are reported as such, in a study of format 1 only those.

    Raises
    ------
    StudyError
        With every mistake found.
    """
    renamed = renamed_keys(document)
    if renamed and is_format_1(document):
        raise StudyError([*document.problems, *renamed])
    reported = {(one.file, one.line, one.column) for one in renamed}
    try:
        valid = validate(document, StudyFile)
    except StudyError as error:
        others = [one for one in error.problems if (one.file, one.line, one.column) not in reported]
        raise StudyError([*others, *renamed]) from None
    if renamed:
        raise StudyError(renamed)
    return valid


def renamed_keys(document: Document) -> list[Problem]:
    """Renamed keys of format 1, at their places, including those in paths of readings, sweeps and questions."""
    found = [*_of_keys(document), *_of_paths(document)]
    by_place = {(one.file, one.line, one.column): one for one in reversed(found)}
    return [by_place[place] for place in sorted(by_place)]


def is_format_1(document: Document) -> bool:
    """Whether a study declares format 1."""
    entry = document.entry("format")
    return isinstance(entry, ScalarEntry) and entry.text == "1"


def _of_keys(document: Document) -> Iterator[Problem]:
    if is_format_1(document):
        yield document.locate("format").problem(("format",), _FORMAT)
    for path, entry in walk(document.root, ()):
        if (what := _instead(path)) is not None:
            yield document.locate_key(path).problem(path, what)
        elif len(path) == 3 and path[::2] == ("cameras", "focus_distance") and _is(entry, "every-object"):
            yield entry.place.problem(path, _REFOCUSED)


def _of_paths(document: Document) -> Iterator[Problem]:
    """Renamed paths in the keys of readings and sweeps, and in the values of questions."""
    readings, solve = document.entry("readings"), document.entry("solve")
    for mapping in (document.entry("sweep"), *(child(child(readings, name), "set") for name in _names(readings))):
        if isinstance(mapping, MappingEntry):
            for key, member in mapping.members.items():
                path = document.path_of(key)
                if (what := _instead_of_part(path)) is not None:
                    yield member.key_place.problem(path, what)
                elif path[-1] == "focus_distance" and _is(member.entry, "every-object"):
                    yield member.entry.place.problem(path, _REFOCUSED)
    for name in _names(solve):
        vary = child(child(solve, name), "vary")
        for entry in vary.items if isinstance(vary, ListEntry) else (vary,):
            if isinstance(entry, ScalarEntry) and isinstance(entry.value, str):
                path = document.path_of(entry.value)
                if (what := _instead_of_part(path)) is not None:
                    yield entry.place.problem(("solve", name, "vary"), what)


def _instead_of_part(path: Path) -> str | None:
    return next((what for length in range(1, len(path) + 1) if (what := _instead(path[:length])) is not None), None)


@lru_cache(maxsize=4096)  # keys share the paths above them, and studies share keys
def _instead(path: Path) -> str | None:
    """What to write instead of the key at a path; None if format 2 has the key."""
    if len(path) == 4 and path[::2] == ("cameras", "calibration") and path[3] in DEPTH_PARAMETERS:
        return _UNDER_ERRORS
    for pattern, message in _PATTERNS.items():
        if len(pattern) == len(path) and all(a in ("*", b) for a, b in zip(pattern, path, strict=True)):
            return message.format(*(b for a, b in zip(pattern, path, strict=True) if a == "*"))
    return None


def _is(entry: Entry, text: str) -> bool:
    return isinstance(entry, ScalarEntry) and entry.value == text


def _names(entry: Entry | None) -> list[str]:
    return list(entry.members) if isinstance(entry, MappingEntry) else []
