"""Hard cases of study files: extreme but legal values, and files made to exhaust the machine or to read other files."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any, Final

from tradestudy.errors import StudyError
from tradestudy.study.loading import load_prepared
from tradestudy.verification.case import Family, OutcomeCase
from tradestudy.wording import counted

LONGEST_SECONDS: Final = 10.0

_CAMERA: Final = (
    "{kind: stereo, title: A rig, lenses: {focal_length: 8 mm, f_number: 8}, "
    "sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}, baseline: 300 mm, convergence_distance: infinity, "
    "focus_distance: 2 m, depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}, "
    "calibration: {errors: {yaw: {standard_deviation: 0.05 deg}}}}"
)
_SCENE: Final = "{distances: [1 m, 2 m], wavelength: 550 nm}"


def study(
    *, name: str = "hard", cameras: str = f"{{rig: {_CAMERA}}}", scene: str = _SCENE, title: str = "T", more: str = ""
) -> str:
    """A small valid study with one hard part."""
    return f"format: 2\nstudy: {name}\ntitle: {title}\nquestion: Q\ncameras: {cameras}\nscene: {scene}\n{more}\n"


def _case(name: str, law: str, text: str, *expected: str) -> OutcomeCase:
    return OutcomeCase(
        name=name,
        law=law,
        naive=lambda: _plainly(text),
        ours=lambda: _checked(text),
        expected=expected,
    )


def _legal() -> tuple[OutcomeCase, ...]:
    hundred = ", ".join(f"rig-{index}: {_CAMERA}" for index in range(100))
    unicode = f"{{Übersicht_β: {_CAMERA}, カメラ: {_CAMERA}}}"
    far = "{distances: [1 um, 100000 km], wavelength: 10 nm}"
    log = "{distances: {from: 10 mm, to: 10 m, points: 100000}, wavelength: 550 nm}"
    return (
        _case(
            "100 000 distances",
            "accepted: a study may have that many",
            study(scene=log),
            "accepted",
            "100000 distances",
        ),
        _case(
            "100 cameras",
            "accepted: a study may have that many",
            study(cameras=f"{{{hundred}}}"),
            "accepted: 100 cameras",
        ),
        _case(
            "names in other scripts",
            "accepted: names may have letters of any script",
            study(cameras=unicode),
            "accepted: 2 cameras",
        ),
        _case("distances from 1 µm to 10⁸ m, λ = 10 nm", "accepted: extreme but legal", study(scene=far), "accepted"),
        _case(
            "a length of half a million digits",
            "accepted: read as the number it is",
            study(scene=f"{{distances: [1.{'0' * 500_000}1 m, 2 m], wavelength: 550 nm}}"),
            "accepted",
        ),
    )


def _too_much() -> tuple[OutcomeCase, ...]:
    more = ", ".join(f"rig-{index}: {_CAMERA}" for index in range(101))
    log = "{distances: {from: 10 mm, to: 10 m, points: 100001}, wavelength: 550 nm}"
    levels = "\n".join(f"x{n}: &x{n} [{', '.join([f'*x{n - 1}'] * 9)}]" for n in range(1, 11))
    return (
        _case(
            "101 cameras",
            "refused, with the limit stated",
            study(cameras=f"{{{more}}}"),
            "refused",
            "100",
        ),
        _case("100 001 distances", "refused, with the limit stated", study(scene=log), "refused", "100000"),
        _case(
            "a file over 1 MB",
            "refused before it is parsed",
            study(more="# " + "x" * 1_000_000),
            "refused",
            "larger than 1 MB",
        ),
        _case(
            "two hundred nested brackets",
            "refused beyond the depth that any study needs",
            study(more="sweep: " + "[" * 200 + "]" * 200),
            "refused",
            "nested more than",
        ),
        _case(
            "anchors that expand to billions",
            "refused before they are expanded",
            f"x0: &x0 [a]\n{levels}\n{study()}",
            "refused",
            "repetitions by '*' included",
        ),
        _case(
            "an anchor inside itself",
            "refused: its expansion is endless",
            study(more="sweep: &s {a: *s}"),
            "refused",
            "without end",
        ),
    )


def _outward() -> tuple[OutcomeCase, ...]:
    names = ("../outside", "/etc/outside", "..", ".hidden", '"a\\0b"', '"a\\nb"', "n" * 200)
    inside = f'{{"../../etc": {_CAMERA}}}'
    return (
        *(
            _case(
                f"a study called {name}" if len(name) < 20 else "a study with a name of 200 letters",
                "refused: the results folder would have this name",
                study(name=name),
                "refused",
            )
            for name in names
        ),
        _case(
            "a camera called '../../etc'",
            "refused: not a name",
            study(cameras=inside),
            "refused",
            "this is not a valid name",
        ),
        _case(
            "a camera from /etc/passwd",
            "read as a camera or refused; its content is never shown",
            study(cameras="{rig: {from: ../../../../../../../../etc/passwd}}"),
            "refused",
        ),
        _case(
            "a camera from a device",
            "refused: it could be endless",
            study(cameras="{rig: {from: /dev/zero}}"),
            "refused",
            "not a regular file",
        ),
    )


def _not_what_they_seem() -> tuple[OutcomeCase, ...]:
    return (
        _case(
            "a tag that makes an object",
            "refused: tags have no meaning in a study",
            study(title="!!python/object/apply:os.system [id]"),
            "refused",
            "tags",
        ),
        _case(
            "a key twice",
            "refused: neither value is dropped silently",
            study(more="title: Again"),
            "refused",
            "duplicate key",
        ),
        _case("the title 'no'", "accepted as text: in YAML 1.2, no is not a boolean", study(title="no"), "accepted"),
        _case(
            "a wavelength of 1e400 m",
            "refused: an overflowing number is not read as infinite",
            study(scene="{distances: [1 m, 2 m], wavelength: 1e400 m}"),
            "refused",
        ),
        _case(
            "a distance that is not a number",
            "refused: it is not a length",
            study(scene="{distances: [.nan m, 2 m], wavelength: 550 nm}"),
            "refused",
        ),
        _case("an empty file", "refused, and the remedy is named", "", "refused", "tradestudy new"),
    )


def _checked(text: str) -> str:
    """The program's answer to a text in a file; wrong if it takes too long or leaves other files behind."""
    with tempfile.TemporaryDirectory(prefix="tradestudy-") as folder:
        path = Path(folder) / "study.yaml"
        path.write_text(text, encoding="utf-8")
        begin = time.perf_counter()
        answer = _check(path)
        seconds = time.perf_counter() - begin
        left_behind = sorted(entry.name for entry in Path(folder).iterdir() if entry != path)
    if seconds > LONGEST_SECONDS:
        return f"slow: {seconds:.0f} s"
    return f"wrote {', '.join(left_behind)}" if left_behind else _short(answer.replace(f"{folder}/", ""))


def _check(path: Path) -> str:
    """The answer of `check` to a study file: the numbers of cameras and distances, or the first mistakes."""
    try:
        case = load_prepared(path).case
    except StudyError as error:
        return f"refused: {'; '.join(problem.what for problem in error.problems[:2])}"
    return f"accepted: {counted(len(case.all_cameras), 'camera')}, {counted(len(case.distance), 'distance')}"


def _plainly(text: str) -> str:
    """The answer of a plain YAML parser: the number of values that it returns, or its exception."""
    from ruamel.yaml import YAML

    try:
        loaded = YAML(typ="safe", pure=True).load(text)
    except RecursionError:
        return "RecursionError"
    except Exception as error:
        return type(error).__name__
    count = _count(loaded, {})
    return f"accepted: {count:.3g} values" if count >= 1e6 else f"accepted: {counted(int(count), 'value')}"


def _count(value: Any, known: dict[int, float]) -> float:
    """Number of values in a structure, with shared parts counted at each use; infinite if it contains itself."""
    if not isinstance(value, dict | list):
        return 1
    if id(value) not in known:
        known[id(value)] = float("inf")  # stays infinite if the structure contains itself
        parts = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_count(part, known) for part in parts)
    return known[id(value)]


def _short(text: str) -> str:
    return text if len(text) <= 240 else f"{text[:239]}…"


STUDY_FILES: Final = Family(
    name="study-files",
    title="Study files",
    cases=(*_legal(), *_too_much(), *_outward(), *_not_what_they_seem()),
)
