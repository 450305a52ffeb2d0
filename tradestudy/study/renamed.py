"""Keys that a study of format 1 has and one of format 2 has not, and what to write instead."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from tradestudy.cameras.kinds import DEPTH_PARAMETERS
from tradestudy.errors import Problem
from tradestudy.study.document import Document, Entry, ListEntry, MappingEntry, Path, ScalarEntry, child, walk

_CAMERA = "cameras.{}.calibration"
# Path of the old key, * for any name; the message has {} for each of these names in turn, or for the first one.
_INSTEAD: Final = {
    "cameras.*.axes_meet_at": "format 1 called this axes_meet_at; format 2: convergence_distance",
    "cameras.*.thermal_expansion": f"format 2: housing_expansion of {_CAMERA}.stability, beside its temperature",
    "cameras.*.depth.lenses": "format 1 called this lenses; format 2: microlenses",
    "cameras.*.calibration.correlation": f"format 2: {_CAMERA}.correlations: {{{{mla_distance: {{{{focal_length: 0.9}}}}}}}}",
    "cameras.*.calibration.errors.pixel_noise": "the noise of one measurement is cameras.{}.depth.disparity_error",
    "cameras.*.calibration.corners.declared_baseline": "format 2: cameras.{}.baseline, with which the fit is compared",
    "scene.temperature": f"format 2: temperature of {_CAMERA}.stability, for each camera".replace("{}", "NAME"),
    "scene.picture.window": "format 1 called this window; format 2: matching_window",
    "scene.picture.bits": "format 1 called this bits; format 2: bit_depth",
    "scene.picture.pixel_fill": "format 1 called this pixel_fill; format 2: linear_fill_factor",
    "accuracy.relative": "format 1 called this relative; format 2: tolerance",
    "accuracy.budget": "format 1 called this budget; format 2: time_limit",
    "effects.temperature": "format 2: effects.calibration, of which temperature is a part",
    "usable": "format 1 called this usable; format 2: usable_range",
    "criteria": "format 1 called this criteria; format 2: relief",
    "depth_of_field.scene": "format 1 called this scene; format 2: range",
    "depth_of_field.sharp": "format 1 called this sharp; format 2: criteria",
    "solve.*.way": "format 1 called this way; format 2: errors",
    "claims.*.way": "format 1 called this way; format 2: errors",
    "claims.*.of": "format 1 called this of; format 2: quantity",
    "light_spot.array_distance": "format 1 called this array_distance; format 2: mla_distance",
    "light_spot.microlenses.across": "format 1 called this across; format 2: lenses_across",
    "light_spot.microlenses.gaps": "format 1 called this gaps; format 2: interstices",
    "light_spot.published": "format 1 called this published; format 2: published_times",
    "point_spread.standing_wavelength": "format 1 called this standing_wavelength; format 2: reference_wavelength",
    "point_spread.elements.*.published_minimum": "format 1 called this so; format 2: published_minimum_f_number",
    "fresnel_validity.elements.*.published_minimum": "format 1 called this so; format 2: published_minimum_f_number",
    "calibration.seed": "move this to propagation.seed",
    "calibration.distances": "take it out: scene.distances are those of every answer, and sensitivity.at of sensitivity",
    "calibration.edge": "move this to propagation.field_places, a list: [70 %]",
    "calibration.accuracy": "move this to accuracy.depth_uncertainty, the tolerance of every depth uncertainty",
    "calibration.budget": "move this to propagation.max_draws",
    "calibration.compare": "move this to decision.compare",
    "calibration.questions": "move these to solve: vary is the path of what is varied, between low and high; way is errors",
    "calibration.surroundings.calibrated_at_temperature": "move this to stability.calibrated_at.temperature of each camera's "
    "calibration",
    "calibration.surroundings.calibrated_at_pressure": "move this to stability.calibrated_at.pressure of each camera's "
    "calibration",
    "calibration.surroundings.temperature_change": "move this to stability.temperature of each camera's calibration",
    "calibration.surroundings.pressure_change": "move this to stability.pressure of each camera's calibration",
    "calibration.cameras.*.errors": f"move these to {_CAMERA}.errors; a normal or uniform error needs no shape",
    "calibration.cameras.*.joint": f"move these to {_CAMERA}.correlations, for each pair: {{{{yaw: {{{{roll: 0.5}}}}}}}}",
    "calibration.cameras.*.body": f"move these to {_CAMERA}.stability",
    "calibration.cameras.*.file": f"move this to {_CAMERA}.posterior.file",
    "calibration.cameras.*.target": f"move this to {_CAMERA}.target; half_field is half_field_angle, maximum_steps is "
    "max_steps",
    "calibration.cameras.*.corners": f"move this to {_CAMERA}.corners; maximum_steps is max_steps",
}  # fmt: skip
_PATTERNS: Final = {tuple(pattern.split(".")): message for pattern, message in _INSTEAD.items()}
_UNDER_ERRORS: Final = "calibration errors stand under {}.calibration.errors in format 2"
_FORMAT: Final = "this is a study of format 1; change what is listed here, and write format: 2"
_REFOCUSED: Final = "format 1 called this every-object; format 2: autofocus"


def renamed_keys(document: Document) -> list[Problem]:
    """Everything that format 1 called otherwise, where it is written; also in paths of readings, sweeps and questions."""
    found = [*_of_keys(document), *_of_paths(document)]
    by_place = {(one.file, one.line, one.column, one.what): one for one in reversed(found)}
    return sorted(by_place.values(), key=lambda one: (one.file, one.line, one.column))


def _of_keys(document: Document) -> Iterator[Problem]:
    format_entry = document.entry("format")
    if isinstance(format_entry, ScalarEntry) and format_entry.text == "1":
        yield format_entry.place.problem(("format",), _FORMAT)
    for path, entry in walk(document.root, ()):
        if (what := _instead(path)) is not None:
            yield document.locate_key(path).problem(path, what)
        elif len(path) == 3 and path[::2] == ("cameras", "focus_distance") and _is(entry, "every-object"):
            yield entry.place.problem(path, _REFOCUSED)


def _of_paths(document: Document) -> Iterator[Problem]:
    """Paths that are written as keys of readings and sweeps, or as values of questions."""
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


def _instead(path: Path) -> str | None:
    """What to write instead of a key at a path; None where it is none of format 1 alone."""
    if len(path) == 4 and path[::2] == ("cameras", "calibration") and path[3] in DEPTH_PARAMETERS:
        return _UNDER_ERRORS.format(path[1])
    for pattern, message in _PATTERNS.items():
        if len(pattern) == len(path) and all(a in ("*", b) for a, b in zip(pattern, path, strict=True)):
            return message.format(*(b for a, b in zip(pattern, path, strict=True) if a == "*"))
    return None


def _is(entry: Entry, text: str) -> bool:
    return isinstance(entry, ScalarEntry) and entry.value == text


def _names(entry: Entry | None) -> list[str]:
    return list(entry.members) if isinstance(entry, MappingEntry) else []
