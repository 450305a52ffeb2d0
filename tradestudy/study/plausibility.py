"""Warnings about possible but implausible input whose basis the study does not state."""

from __future__ import annotations

import math
import re
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.camera import Contradiction, digitiser_contradictions
from tradestudy.cameras.declaration import CalibratedCameraPart, DepthCameraDeclaration, SensorPart
from tradestudy.cameras.imported import FITTED_LENS, NOMINAL_PITCH, PICTURE_SIZE
from tradestudy.effects import OFF
from tradestudy.errors import ImplausibleValueWarning, Problem
from tradestudy.imaging.models import mean_electrons
from tradestudy.study.camera_files.libpleno import IGNORED
from tradestudy.study.camera_files.pairs import (
    EXCHANGED_NAMES,
    FOLDING_LENS,
    INEXACT_ROTATION,
    OFF_CENTRE,
    UNUSUAL_BASELINE,
    UNUSUAL_MATRIX,
    UNUSUAL_NOISE,
    UNUSUAL_SIGN,
    off_centre,
)
from tradestudy.study.document import DICTIONARY, OUTSIDE, Document, Path, ScalarEntry, dotted, text_of, walk
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.varying import question_ends
from tradestudy.uncertainty.joint import JointDraws
from tradestudy.units import (
    ANGLE,
    ELECTRONS,
    EXPANSION,
    FRACTION,
    LENGTH,
    NUMBER,
    PIXELS,
    TEMPERATURE_DIFFERENCE,
    Dimension,
    UnitError,
    parse,
    pretty,
)
from tradestudy.wording import listed

_SILENCED: Final = "; stating a basis silences this warning"


@dataclass(frozen=True, kw_only=True)
class _Range:
    """The usual range of a key in study files; ``below`` restricts it to keys inside that part.

    Of several ranges of a key, the first that fits holds.
    """

    key: str
    dimension: Dimension
    low: float
    high: float
    below: str = ""


_USUAL: Final = (
    _Range(key="baseline", dimension=LENGTH, low=1e-4, high=10.0, below="cameras"),
    _Range(key="focal_length", dimension=LENGTH, low=5e-6, high=1e-2, below="microlenses"),
    _Range(key="focal_lengths", dimension=LENGTH, low=5e-6, high=1e-2, below="microlenses"),
    _Range(key="focal_length", dimension=LENGTH, low=1e-4, high=1.0, below="cameras"),
    _Range(key="gap", dimension=LENGTH, low=1e-5, high=1e-2, below="microlenses"),
    _Range(key="pitch", dimension=LENGTH, low=1e-6, high=1e-2, below="microlenses"),
    _Range(key="pixel_pitch", dimension=LENGTH, low=0.3e-6, high=200e-6),
    _Range(key="wavelength", dimension=LENGTH, low=200e-9, high=20e-6),
    _Range(key="wavelengths", dimension=LENGTH, low=200e-9, high=20e-6),
    _Range(key="contrast", dimension=FRACTION, low=1e-4, high=1.0),
    _Range(key="f_number", dimension=NUMBER, low=0.7, high=200.0),
    _Range(key="relative_uncertainty", dimension=FRACTION, low=0.0, high=0.99, below="usable_range"),
    _Range(key="below_relative", dimension=FRACTION, low=0.0, high=0.99),
    _Range(key="relative", dimension=FRACTION, low=0.0, high=0.99, below="solve"),
    _Range(key="factor", dimension=NUMBER, low=1.0, high=10.0, below="matcher"),
    _Range(key="floor", dimension=PIXELS, low=0.0, high=1.0, below="matcher"),
    _Range(key="false_matches", dimension=FRACTION, low=0.0, high=0.5, below="matcher"),
    _Range(key="disparity_error", dimension=PIXELS, low=0.002, high=2.0),
    _Range(key="discrimination_step", dimension=PIXELS, low=0.002, high=2.0),
    _Range(key="corner_noise", dimension=PIXELS, low=0.002, high=2.0),
    _Range(key="matching_window", dimension=PIXELS, low=3.0, high=301.0),
    _Range(key="blur", dimension=PIXELS, low=0.1, high=100.0, below="usable_range"),
    _Range(key="correlation_length", dimension=LENGTH, low=1e-6, high=1.0, below="texture"),
    _Range(key="read_noise", dimension=ELECTRONS, low=0.1, high=1000.0),
    _Range(key="full_well", dimension=ELECTRONS, low=100.0, high=1e7),
    _Range(key="from", dimension=LENGTH, low=1e-3, high=1e5, below="distances"),
    _Range(key="to", dimension=LENGTH, low=1e-3, high=1e5, below="distances"),
    _Range(key="focus_distance", dimension=LENGTH, low=1e-3, high=math.inf, below="cameras"),
    _Range(key="convergence_distance", dimension=LENGTH, low=1e-3, high=math.inf, below="cameras"),
    *(
        _Range(key=f"{part}_expansion", dimension=EXPANSION, low=-100e-6, high=300e-6)
        for part in ("housing", "baseline", "array", "sensor", "focal_length")
    ),
    *(
        _Range(key=key, dimension=dimension, low=0.0, high=high, below=below)
        for key in ("standard_deviation", "half_width")
        for dimension, high, below in (
            (ANGLE, math.radians(2.0), "errors"),
            (ANGLE, math.radians(2.0), "ageing"),
            (LENGTH, 5e-3, "errors"),
            (LENGTH, 5e-3, "ageing"),
            (TEMPERATURE_DIFFERENCE, 100.0, "temperature"),
        )
    ),
)
_OTHER_UNITS: Final = {LENGTH: ("nm", "um", "mm", "m"), ANGLE: ("deg", "mrad", "rad"), EXPANSION: ("ppm/K",)}
"""Units that people confuse."""
_OF_IMPORTS: Final = {
    UNUSUAL_BASELINE: "the baseline is {}",
    UNUSUAL_NOISE: "the corners scatter by {}; detectors reach 0.02 to 0.3 px, so the lens may need another "
    "calibration.corners.lens_model",
    FOLDING_LENS: "depth cannot be measured in {}; check the distortion coefficients",
    UNUSUAL_MATRIX: "{}; check the camera matrix",
    OFF_CENTRE: "{}; check the size and the camera matrix",
    IGNORED: "pictures and depth are computed without {} of the file",
    EXCHANGED_NAMES: "{}; check the names of the cameras, and the sign of the translation between them",
    UNUSUAL_SIGN: "{}; check the sign, and which camera is the left one",
    INEXACT_ROTATION: "{}; give more digits",
}
_NUMBER: Final = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_OF_QUESTION: Final = ("solve", "relative")
_LARGE_TOLERANCE: Final = 0.05  # at or above this, a tolerance without a unit was probably meant in per cent


def implausible(study: PreparedStudy) -> tuple[Problem, ...]:
    """Warnings about unusual values, one for each place; values with a stated basis are exempt."""
    problems = [
        *_equal_titles(study),
        *_outside_the_usual(study),
        *_light(study),
        *_unequal_pixels(study),
        *_beside_the_spectrum(study),
        *_declared_outside(study),
        *_imported(study),
        *_off_centre(study),
        *_not_inherited(study),
        *_assumed_pitches(study),
        *_idle_matcher(study),
        *_tolerances(study),
        *_posteriors(study),
        *_unused_corners(study),
        *_beyond_the_scene(study),
        *_contradictory(study),
        *_refocusing(study),
    ]
    distinct: dict[tuple[str, int, int, str], Problem] = {}
    for problem in problems:
        distinct.setdefault((problem.file, problem.line, problem.column, problem.what), problem)
    return tuple(distinct.values())


def contradictions(study: PreparedStudy) -> list[tuple[str, Contradiction]]:
    """Cross-check the inputs of every camera of a study."""
    tolerance = study.file.accuracy.asked().tolerances["depth_uncertainty"]
    picture = None if study.file.scene is None else study.file.scene.picture
    pairs = []
    for name, camera in study.case.all_cameras.items():
        of_camera = [*camera.contradictions(study.file.cameras[name].stated, tolerance)]
        if picture is not None:
            noise = picture.noise(camera.sensor)
            of_camera += digitiser_contradictions(camera.sensor, noise.full_well_electrons, noise.bits)
        pairs += [(name, contradiction) for contradiction in of_camera]
    return pairs


def _contradictory(study: PreparedStudy) -> Iterator[Problem]:
    """Inputs that determine one quantity differently, unless the one that `check` names has a basis."""
    for name, contradiction in contradictions(study):
        path = ("cameras", name, *contradiction.path)
        chosen = contradiction.path == ("principal_distance",) and _chooses_principal_distance(study, name)
        if chosen or _has_basis(study.document, path):
            continue
        end = contradiction.consequence or f"used: {contradiction.used}"
        what = f"{contradiction.what}: {contradiction.stated}, but {contradiction.implied}; {end}"
        yield study.document.problem(path, what)


def _chooses_principal_distance(study: PreparedStudy, name: str) -> bool:
    """Whether the rule for a principal distance is written, or implied by a focal length in pixels or a calibration."""
    declared = study.document.tree["cameras"][name]
    in_pixels = str(declared.get("lenses", {}).get("focal_length", "")).endswith("px")
    return in_pixels or "principal_distance" in declared or declared.get("geometry") is not None


def _refocusing(study: PreparedStudy) -> Iterator[Problem]:
    """Lenses declared to refocus, by more than the tolerance, although one principal distance is used throughout."""
    tolerance = study.file.accuracy.asked().tolerances["depth_uncertainty"]
    for name, camera in study.case.cameras.items():
        path = ("cameras", name, "focus_distance")
        # As the default, it only leaves blur out.
        refocused = study.document.entry(path)
        declared = isinstance(refocused, ScalarEntry) and refocused.value == "autofocus"
        if not declared or _chooses_principal_distance(study, name) or _has_basis(study.document, path):
            continue
        nearest, lens = float(study.case.distance[0]), camera.gathering_lens
        if not camera.images(study.case.distance[:1]).all():
            continue
        focused = lens.principal_distance(camera.depth_behind_lens(nearest))
        longer = focused / lens.focal_length - 1.0
        if longer > tolerance:
            what = (
                f"at {pretty(nearest, LENGTH)}, lenses that refocus have a principal distance of "
                f"{pretty(focused, LENGTH)}, longer by {pretty(longer, FRACTION)}, but depth uses "
                f"{pretty(lens.focal_length, LENGTH)} at every focus; give the focus_distance of fixed lenses, or "
                "principal_distance: focal_length if the rig is calibrated for every focus"
            )
            yield study.document.problem(path, what)


def _equal_titles(study: PreparedStudy) -> Iterator[Problem]:
    """Cameras with one title, which differ by their keys in every output."""
    for name, camera in study.file.cameras.items():
        path = ("cameras", name, "title")
        if isinstance(entry := study.document.entry(path), ScalarEntry) and entry.value != camera.title:
            what = f"is the title of another camera too, so that {name} is called {camera.title}; give it its own title"
            yield study.document.problem(path, what)


def _outside_the_usual(study: PreparedStudy) -> Iterator[Problem]:
    for path, entry in walk(study.document.root, ()):
        keys = [step for step in path if isinstance(step, str)]
        if not isinstance(entry, ScalarEntry) or entry.value is None or _has_basis(study.document, path):
            continue
        if what := unusual(keys, entry.text):
            yield study.document.problem(path, what)


def unusual(keys: Sequence[str], text: str) -> str:
    """Why a value is unusual for its key, the last one; empty if it is not."""
    for usual in _USUAL:
        if usual.key not in keys[-1:] or (usual.below and usual.below not in keys):
            continue
        try:
            value = parse(text, usual.dimension)
        except UnitError:
            continue
        if usual.low <= value <= usual.high:
            return ""
        ends = f"{pretty(usual.low, usual.dimension)} to {pretty(usual.high, usual.dimension)}"
        return f"{pretty(value, usual.dimension)} is unusual ({ends} is common){_meant(text, usual)}{_SILENCED}"
    return ""


def warn(*messages: str) -> None:
    """Warn users of Python, at their own line: the first one outside this program."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("tradestudy."):
        frame, level = frame.f_back, level + 1
    for message in messages:
        warnings.warn(message, ImplausibleValueWarning, stacklevel=level)


def _meant(text: str, usual: _Range) -> str:
    """The same number in the only other unit in which it would be usual."""
    number = _NUMBER.match(text)
    if number is None:
        return ""
    candidates = [f"{number[0]} {unit}" for unit in _OTHER_UNITS.get(usual.dimension, ())]
    fits = [candidate for candidate in candidates if usual.low < parse(candidate, usual.dimension) <= usual.high]
    return f"; did you mean {fits[0]}?" if len(fits) == 1 else ""


def _has_basis(document: Document, path: Path) -> bool:
    """Whether a basis is stated for a value or for the list that contains it."""
    notes = (document.annotations.get(path[:count]) for count in range(1, len(path) + 1))
    return any(note is not None and note.basis is not None for note in notes)


def _light(study: PreparedStudy) -> Iterator[Problem]:
    """More electrons, by a camera's own exposure and f-number, than the full well of its pixels holds."""
    picture = None if study.file.scene is None else study.file.scene.picture
    path = ("scene", "picture", "light", "electrons")
    declared = study.document.entry(path)
    if picture is None or not isinstance(declared, ScalarEntry) or _has_basis(study.document, path):
        return
    overfull = {}
    for name, camera in study.case.cameras.items():
        f_numbers, full = camera.picture_geometry(study.case.distance).light_f_number, picture.noise(camera.sensor)
        most = float(
            np.nanmax(mean_electrons(picture.light.light(camera.sensor), f_numbers, camera.sensor.pixel_pitch))
        )
        if most > full.full_well_electrons:
            overfull[name] = (most, full.full_well_electrons)
    if overfull:
        most, well = max(overfull.values(), key=lambda pair: pair[0] / pair[1])
        what = f"the pixels of {listed(list(overfull))} collect up to {pretty(most, ELECTRONS)} on the axis, more than "
        yield study.document.problem(path, f"{what}the full well of {pretty(well, ELECTRONS)}{_SILENCED}")


def _unequal_pixels(study: PreparedStudy) -> Iterator[Problem]:
    """Light that gives pixels of different sizes equally many electrons."""
    scene = study.file.scene
    if scene is None or scene.picture is None or scene.picture.light.at_pixel_pitch is not None:
        return
    pitches = {
        camera.sensor.pixel_pitch
        for camera in study.file.cameras.values()
        if isinstance(camera, DepthCameraDeclaration) and camera.depth.declared_error_px is None
    }
    if len(pitches) > 1:
        path = ("scene", "picture", "light")
        sizes = " and ".join(pretty(pitch, LENGTH) for pitch in sorted(pitches))
        what = f"pixels of {sizes} are taken to collect equal light; with at_pixel_pitch, larger ones collect more"
        yield study.document.problem(path, what)


def _beside_the_spectrum(study: PreparedStudy) -> Iterator[Problem]:
    """A wavelength of the scene outside the spectrum of its light."""
    scene = study.file.scene
    if scene is None or scene.picture is None or scene.picture.spectrum is None:
        return
    if study.file.effects.forced().get("spectrum") == OFF:  # the whole study is at the wavelength
        return
    lines = [line.wavelength for line in scene.picture.spectrum]
    # Rounding by conversions of units must not exclude a value that equals an end; likewise below.
    if not min(lines) * (1.0 - 1e-9) <= scene.wavelength <= max(lines) * (1.0 + 1e-9):
        ends = " to ".join(pretty(end, LENGTH) for end in sorted({min(lines), max(lines)}))
        wavelength = pretty(scene.wavelength, LENGTH)
        what = (
            f"{wavelength} lies outside scene.picture.spectrum ({ends}), which derived disparity errors use; all other "
            f"answers, such as lateral resolution, depth of field and rendered pictures, use {wavelength}"
        )
        yield study.document.problem(("scene", "wavelength"), what)


def _declared_outside(study: PreparedStudy) -> Iterator[Problem]:
    """Declared values outside the range of the assumption that varies them."""
    part = study.file.value_of_information
    for name, assumption in part.assumptions.items() if part is not None else ():
        for path in assumption.paths:
            entry, (dimension, low, high) = study.document.entry(path), question_ends(assumption)
            try:
                value = math.nan if entry is None else parse(text_of(entry), dimension)
            except UnitError:  # such as "derived"
                continue
            if value < low * (1.0 - 1e-9) or value > high * (1.0 + 1e-9):
                what = (
                    f"{assumption.low} to {assumption.high} does not include the declared value of {path}, "
                    f"{pretty(value, dimension)}; only values within the range are drawn"
                )
                place = ("value_of_information", "assumptions", name, "low" if value < low else "high")
                yield study.document.problem(place, what)


def _imported(study: PreparedStudy) -> Iterator[Problem]:
    """Calibration files with an unusual unit of length, lens model, camera matrix or principal point."""
    for name, camera in study.file.cameras.items():
        path = ("cameras", name, "from")
        for convention, template in _OF_IMPORTS.items():
            if says := camera.read_as.get(convention):
                yield study.document.problem(path, template.format(says))


def _off_centre(study: PreparedStudy) -> Iterator[Problem]:
    """Principal points far from the middle of pictures whose size is in the study, and in no calibration file."""
    for name, camera in study.file.cameras.items():
        geometry, sensor = getattr(camera, "geometry", None), getattr(camera, "sensor", None)
        parts = {side: getattr(geometry, side, None) for side in ("left", "right")} | {name: geometry}
        if PICTURE_SIZE in camera.read_as or not isinstance(sensor, SensorPart):
            continue
        centres = {side: part.principal_point for side, part in parts.items() if isinstance(part, CalibratedCameraPart)}
        right_sensor = getattr(camera, "right_sensor", None) or sensor
        sizes = {side: right_sensor.pixels if side == "right" else sensor.pixels for side in centres}
        if says := off_centre({side: (centre, sizes[side]) for side, centre in centres.items()}):
            path = ("cameras", name, "sensor", "pixels")
            yield study.document.problem(path, _OF_IMPORTS[OFF_CENTRE].format(says))


def _not_inherited(study: PreparedStudy) -> Iterator[Problem]:
    """Values set from outside for a camera that others are like: these keep the study's value unless it is set too."""
    document = study.document
    set_paths = {override.path for override in document.overrides}
    for override in document.overrides:
        present = [name for name in override.kept_by if name in study.file.cameras]
        unchanged = [name for name in present if (override.path[0], name, *override.path[2:]) not in set_paths]
        if unchanged:
            like = f"{listed(unchanged)}, declared like {override.path[1]}"
            yield document.problem(override.path, f"does not change {like}; set it there too if it should")


def _assumed_pitches(study: PreparedStudy) -> Iterator[Problem]:
    """Imported cameras whose blur or diffraction depends on a pixel pitch that their file does not give."""
    for name, camera in study.file.cameras.items():
        inside = ("cameras", name)
        pitch = study.document.entry((*inside, "sensor", "pixel_pitch"))
        if not isinstance(pitch, ScalarEntry) or NOMINAL_PITCH not in str(pitch.annotation and pitch.annotation.note):
            continue
        derived = isinstance(camera, DepthCameraDeclaration) and camera.depth.declared_error_px is None
        refocused = getattr(camera, "focus_distance", "autofocus") == "autofocus"  # and so never blurred
        if derived or (study.file.usable_range.blur is not None and not refocused):
            path = (*inside, "from")
            what = f"the file gives no pixel pitch; {pitch.text} is assumed, but blur and diffraction depend on it"
            yield study.document.problem(path, f"{what}; give sensor: {{pixel_pitch: ...}}")


def _idle_matcher(study: PreparedStudy) -> Iterator[Problem]:
    """A matcher of the scene that no camera uses because all disparity errors are declared."""
    scene, cameras = study.file.scene, study.file.cameras.values()
    if scene is None or scene.picture is None or scene.picture.matcher is None:
        return
    measuring = [camera for camera in cameras if isinstance(camera, DepthCameraDeclaration)]
    if all(camera.depth.declared_error_px is not None for camera in measuring):
        path = ("scene", "picture", "matcher")
        what = "has no effect: it adds to derived disparity errors, and every camera declares its disparity error"
        yield study.document.problem(path, what)


def _tolerances(study: PreparedStudy) -> Iterator[Problem]:
    """Tolerances and relative bounds without a unit that are large as fractions but usual in per cent."""
    for path, entry in walk(study.document.root, ()):
        relative = path[:1] == ("accuracy",) and path[-1] != "time_limit"
        relative |= path[-1:] in (("below_relative",), ("relative_uncertainty",)) or path[:1] + path[2:] == _OF_QUESTION
        relative &= entry.place.file != DICTIONARY.file  # whose numbers are fractions
        if relative and isinstance(entry, ScalarEntry) and not _has_basis(study.document, path):
            yield from (study.document.problem(path, what + _SILENCED) for what in _large(entry.text))
    if study.definition.tolerance is not None:
        for what in _large(study.definition.tolerance):
            place = OUTSIDE._replace(file="--tolerance")
            yield place.problem(("accuracy", "tolerance"), what)


def _posteriors(study: PreparedStudy) -> Iterator[Problem]:
    """Posteriors of parameters instead of errors, or of so few draws that the tolerance exceeds what they know."""
    tolerance = study.file.accuracy.asked().tolerances["depth_uncertainty"]
    for name, camera in study.case.cameras.items():
        path = ("cameras", name, "calibration", "posterior", "file")
        if camera.calibration.remark:
            yield study.document.problem(path, camera.calibration.remark)
        for group in camera.calibration.groups if camera.calibration.source == "posterior" else ():
            # The standard deviation of n normal draws has a relative standard error of 1/√(2 n).
            if isinstance(group, JointDraws) and (error := (2.0 * len(group.draws)) ** -0.5) > 2.0 * tolerance:
                what = (
                    f"{len(group.draws)} draws determine a standard deviation to about {pretty(error, FRACTION, 2)}; "
                    "the errors stated in results do not include this, so give more draws or a covariance"
                )
                yield study.document.problem(path, what)


def _unused_corners(study: PreparedStudy) -> Iterator[Problem]:
    """Columns and rows of corner files that are not used; what is read of imported ones names them."""
    for name, camera in study.file.cameras.items():
        path = ("cameras", name, "calibration", "corners", "file")
        file = study.definition.data_files.get(dotted(path))
        if file is None or FITTED_LENS in camera.read_as:
            continue
        from tradestudy.calibration.corners.corner_file import read_corners  # loads all of calibration

        corners = read_corners(file)
        if corners.unused:
            yield study.document.problem(path, f"columns of this file are not used: {listed(corners.unused)}")
        if corners.left_out:
            yield study.document.problem(path, f"rows of this file are not used: {corners.left_out}")


def _large(text: str) -> Iterator[str]:
    try:
        value = float(text)  # with a unit, its meaning is clear
    except ValueError:
        return
    if value >= _LARGE_TOLERANCE:
        yield f"{text} means {pretty(value, FRACTION)}; write '{text} %' for {pretty(value / 100.0, FRACTION)}"


def _beyond_the_scene(study: PreparedStudy) -> Iterator[Problem]:
    """Requirements that reach beyond the distances of the scene, and distances of the decision there."""
    distance, file = study.case.distance, study.file
    judged: list[tuple[Path, tuple[float, ...], str]] = [
        (
            ("requirements", name, requirement.quantity, "over" if requirement.over[0] < requirement.over[1] else "at"),
            requirement.over,
            "the requirement is evaluated",
        )
        for name, requirement in file.requirements.items()
        if requirement.over
    ]
    for index, at in enumerate(file.decision.at if file.decision else ()):
        judged.append((("decision", "at", index), (at, at), "the cameras are compared"))
    for path, (near, far), judgement in judged:
        if distance.size and not distance[0] * (1.0 - 1e-9) <= near <= far <= distance[-1] * (1.0 + 1e-9):
            yield study.document.problem(
                path,
                f"{'reaches' if near < far else 'lies'} beyond the distances of the scene, {distance[0]:g} m to "
                f"{distance[-1]:g} m: {judgement} there too, but figures and tables end with the scene",
            )
