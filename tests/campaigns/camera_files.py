"""Mutated calibration files of every format, through `check`.

    python -m tests.campaigns.camera_files --inputs 2000

Whatever stands in a calibration file, `check` reads the camera or refuses it in words at its place: never another
exception or a warning, never longer than ten seconds of processor time, never beyond a gigabyte, never
writing or starting anything.
Figures go to camera_files.md beside this file; an input that breaks a rule is kept.
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.campaigns import record
from tests.campaigns.fuzz import Tally, Watch, feed, limits
from tests.study.camera_files import devices, everybody, plenoptic_files, written
from tradestudy import api
from tradestudy.errors import StudyError

PLENOPTIC = "depth: {estimator: adjacent-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}"
NASTY = (
    *("nan", ".nan", "inf", "-inf", "1e999", "-1e308", "1e-320", "0", "-0.0", "9" * 400, "9" * 5000, "0x1F", "1,5"),
    *("''", '""', "null", "None", "true", "True", "[]", "{}", "[[[[[]]]]]", "٣", "\u202e1", "ß" * 300, "1_000", "1e5j"),
    *("!!python/name:os.system", "&a [*a]", "*nothing", "<<", "__import__('os').system('true')", "(lambda: 1)()"),
    *("open('executed','w')", "f'{1}'", "b'x'", "..", "<x/>", "&amp;", "&#0;", "]]>", "%", "#", "\x00", "\x1b[31m"),
)
BOMBS = (
    "[" * 5000,
    "{" * 400 + "}" * 400,
    '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    + "]><opencv_storage><M1>&i;</M1></opencv_storage>",
    '<?xml version="1.0"?><!DOCTYPE x SYSTEM "file:///etc/passwd"><opencv_storage/>',
    "<opencv_storage>" + "<a>" * 3000,
    "%YAML:1.0\n---\na: &a [1]\n"
    + "\n".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)),
    "{'lensmodel': " + "-" * 5000 + "1}",
    "{'lensmodel': " + "(" * 300 + ")" * 300 + "}",
    "{'lensmodel': " + "9" * 5000 + "}",
)
TOKEN = re.compile(r"[^\s{}\[\](),:<>\"']+")


def sources(folder: Path) -> dict[str, tuple[list[Path], str]]:
    """For every format its files, and what a camera says to read them."""
    left, right = written.camera_info_pair(folder)
    first, second = devices.cameramodels(folder)
    return {
        "OpenCV YAML": ([written.opencv(folder / "rig.yml")], "from: rig.yml, length_unit: mm"),
        "OpenCV XML": ([written.opencv(folder / "rig.xml")], "from: rig.xml, length_unit: mm"),
        "OpenCV JSON": ([written.opencv(folder / "rig.json")], "from: rig.json, length_unit: mm"),
        "ROS camera_info": ([left, right], "from: [left.yaml, right.yaml]"),
        "Kalibr camchain": ([written.camchain(folder / "chain.yaml")], "from: chain.yaml"),
        "mrcal cameramodel": ([first, second], "from: [left.cameramodel, right.cameramodel]"),
        "DepthAI calibration": ([devices.device(folder / "oak.json")], "from: oak.json"),
        "libpleno camera": ([devices.plenoptic(folder / "r12.js")], f"from: r12.js, {PLENOPTIC}"),
        **{
            name: ([write(folder / file)], f"from: {file}, {said}")
            for name, (write, file, said) in plenoptic_files.WRITERS.items()
        },
        **{name: _written(folder / name, write) for name, write in {**everybody.RAW, **everybody.RECTIFIED}.items()},
    }


def _written(folder: Path, write: Callable[[Path], str]) -> tuple[list[Path], str]:
    folder.mkdir()
    said = write(folder)
    return sorted(folder.iterdir()), said


def mutated(original: bytes, rng: random.Random) -> bytes:
    """A file with one to three mutations: tokens, lines, spans, bytes; now and then something made to break readers."""
    is_text = b"\0" not in original
    encoding, errors = ("utf-8", "surrogatepass") if is_text else ("latin-1", "replace")
    text = original.decode(encoding)
    if rng.random() < 0.03:
        return rng.choice(BOMBS).encode()
    for _ in range(rng.randint(1, 3)):
        text = rng.choice(_MUTATIONS)(text, rng)
    content = text.encode(encoding, errors)
    if rng.random() < 0.1 and content:
        place = rng.randrange(len(content))
        content = content[:place] + bytes([rng.randrange(256)]) + content[place + rng.randint(0, 1) :]
    if rng.random() < 0.02:
        content = text.encode("utf-16", "surrogatepass")
    return content


def _token(text: str, rng: random.Random) -> str:
    """Another token in place of one."""
    found = list(TOKEN.finditer(text))
    if not found:
        return text
    one = rng.choice(found)
    instead = rng.choice(NASTY) if rng.random() < 0.6 else rng.choice(found).group()
    return text[: one.start()] + instead + text[one.end() :]


def _span(text: str, rng: random.Random) -> str:
    """A span taken out, repeated, or put elsewhere."""
    start = rng.randrange(len(text) + 1)
    span = text[start : start + rng.choice((1, 5, 40, 400))]
    rest = text[:start] + text[start + len(span) :]
    place = rng.randrange(len(rest) + 1)
    return rng.choice(
        (rest, text[:start] + span * rng.randint(2, 6) + text[start:], rest[:place] + span + rest[place:])
    )


def _line(text: str, rng: random.Random) -> str:
    """A line taken out, repeated or put elsewhere."""
    lines = text.split("\n")
    line = lines.pop(rng.randrange(len(lines)))
    if rng.random() < 0.7:
        for _ in range(rng.randint(1, 2)):
            lines.insert(rng.randrange(len(lines) + 1), line)
    return "\n".join(lines)


def _cut(text: str, rng: random.Random) -> str:
    """The beginning alone."""
    return text[: rng.randrange(len(text) + 1)]


def _sign(text: str, rng: random.Random) -> str:
    """A number of the other sign, or with its point elsewhere."""
    found = list(re.finditer(r"\d+\.\d+", text))
    if not found:
        return text
    one = rng.choice(found)
    changed = rng.choice((f"-{one.group()}", one.group().replace(".", ""), f"{one.group()}e9", f"{one.group()}e-9"))
    return text[: one.start()] + changed + text[one.end() :]


_MUTATIONS: tuple[Callable[[str, random.Random], str], ...] = (
    *[_token] * 8, *[_sign] * 6, *[_span] * 2, *[_line] * 2, _cut,
)  # fmt: skip


def _outcome(path: Path, _overrides: tuple[str, ...]) -> str:
    try:
        assert api.load(path).check_summary().strip()
    except StudyError as error:
        if not error.problems or any(not one.what.strip() or one.line < 1 for one in error.problems):
            raise AssertionError(f"refused without a word or a place: {error}") from error
        return "refused"
    return "read"


def campaign(folder: Path, *, inputs: int, seed: int, keep: Callable[[Path, str, int], None]) -> Mapping[str, Tally]:
    """Feed so many inputs of each format."""
    watch, found = Watch(), {}
    for name, (files, said) in sources(folder).items():
        tally, rng = Tally(), random.Random(f"{seed} {name}")
        originals = {file: file.read_bytes() for file in files}
        study = written.study(files[0].parent, rig=said)
        with limits():
            for _ in range(inputs):
                file = rng.choice(files)
                file.write_bytes(mutated(originals[file], rng))
                before = len(tally.findings)
                feed(tally, watch, study, (), name, _outcome)
                if len(tally.findings) > before:
                    keep(file, name, tally.inputs)
                file.write_bytes(originals[file])
        found[name] = tally
    return found


def main() -> None:
    """Run the campaign and keep its figures."""
    parser = argparse.ArgumentParser(description="Feed mutated calibration files to check, in bulk.")
    parser.add_argument("--inputs", type=int, default=2000, help="of each format")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    kept = Path(tempfile.mkdtemp(prefix="camera-file-findings-"))

    def keep(path: Path, name: str, number: int) -> None:
        shutil.copy(path, kept / f"{name.replace(' ', '-')}-{number}{path.suffix}")

    with tempfile.TemporaryDirectory() as folder:
        found = campaign(Path(folder), inputs=asked.inputs, seed=asked.seed, keep=keep)
    kinds = ("read", "refused", "traceback", "hang", "memory", "reaches out")
    path = record.write(
        "camera_files",
        "Mutated calibration files: what was fed to `check`, and how it ended",
        f"python -m tests.campaigns.camera_files --inputs {asked.inputs} --seed {asked.seed}",
        ("Format", "inputs", *kinds, "slowest"),
        [
            (name, one.inputs, *(one.outcomes[kind] for kind in kinds), f"{one.slowest:.2f} s")
            for name, one in found.items()
        ],
    )
    findings = [line for one in found.values() for line in one.findings]
    print("\n".join([path.read_text(encoding="utf-8"), *findings[:40]]))
    if findings:
        raise SystemExit(f"{len(findings)} findings; inputs are kept in {kept}")


if __name__ == "__main__":
    main()
