"""Wrong study files: every mistake is reported at once, at its place, with a remedy."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tradestudy import load
from tradestudy.errors import StudyError

HERE = Path(__file__).parent / "wrong"

# file in wrong/ → every mistake in it: its position and path, and what its message must contain
MISTAKES = {
    name: [(place.strip(), tuple(facts)) for place, *facts in (line.split(" | ") for line in said.splitlines() if line)]
    for name, said in re.findall(
        r"^== (\S+)\.yaml\n((?:(?!== ).*\n)+)", (HERE / "mistakes.txt").read_text(encoding="utf-8"), re.MULTILINE
    )
}


def messages(path: Path) -> list[str]:
    with pytest.raises(StudyError) as caught:
        load(path)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_is_reported_at_its_place_with_value_limit_and_remedy(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(HERE)
    found = messages(Path(f"{name}.yaml"))
    assert len(found) == len(MISTAKES[name])
    for message, (place, facts) in zip(found, MISTAKES[name], strict=True):
        start = f"{place.removesuffix(':')}: "
        assert message.startswith(start)
        said = message.removeprefix(start)
        assert [fact for fact in facts if fact not in said] == []
        assert len(said) > len("".join(facts))  # it explains them


def test_every_wrong_file_is_listed() -> None:
    assert {path.stem for path in HERE.glob("*.yaml")} == {*MISTAKES, "right"}


def test_the_files_contain_no_other_mistakes() -> None:
    study = load(HERE / "right.yaml").prepared
    assert list(study.case.cameras) == ["rig", "array", "near"]
    assert study.file.cameras["near"].baseline == 0.02  # type: ignore[union-attr]  # a stereo rig


@pytest.mark.parametrize("name", MISTAKES)
def test_the_reported_place_contains_what_the_message_quotes(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Found by looking into the file, not by trusting the reader: a quoted value stands at the place that is named."""
    monkeypatch.chdir(HERE)
    for message in messages(Path(f"{name}.yaml")):
        place, _, rest = message.partition(": ")
        file, line, column = place.rsplit(":", 2)
        here = Path(file).read_text(encoding="utf-8").splitlines()[int(line) - 1 :][:1]
        text = here[0][int(column) - 1 :] if here else ""
        if quoted := re.match(r"(?:[\w.-]+: )?'([^'…]*)' (?:has|is|stands)", rest):
            assert text.lstrip("\"'").startswith(quoted[1])
        elif unknown := re.match(r"([\w.-]+): (?:unknown key|duplicate key)", rest):
            assert text.startswith(unknown[1].rpartition(".")[2])


def test_files_that_are_not_text_are_refused(tmp_path: Path) -> None:
    contents = {
        "nothing": (b"", r"1:1: it is empty; `tradestudy new NAME` .*"),
        "binary": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", r"1:1: it is a binary file; text is expected"),
        "latin": (b"format: 2\ntitle: Gr\xf6\xdfe\n", r"2:10: the byte 0xf6 is not UTF-8; save it as UTF-8"),
        "utf16": ("format: 2".encode("utf-16"), r"1:1: it is text in UTF-16; save it as UTF-8"),
        "control": (b"format: 2\nstudy: a\x07b\n", r"2:9: the character U\+0007 is not allowed in YAML; .*"),
        "large": (b"# " + b"x" * 1_000_000, r"1:1: it is larger than 1 MB; a study file is at most 1 MB.*"),
    }
    for name, (content, expected) in contents.items():
        path = tmp_path / name
        path.write_bytes(content)
        (said,) = messages(path)
        assert re.fullmatch(rf"{re.escape(str(path))}:{expected}", said)


def test_paths_that_are_not_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text("format: 2")
    near = tmp_path / "stduy.yaml"
    assert messages(near) == [f"{near}:1:1: there is no such file; nearest: '{tmp_path / 'study.yaml'}'"]
    dangling = tmp_path / "dangling.yaml"
    dangling.symlink_to("nowhere")
    assert messages(dangling) == [f"{dangling}:1:1: there is no such file"]
    assert messages(tmp_path) == [f"{tmp_path}:1:1: it is a folder; a file is expected"]
    assert messages(Path("/dev/zero")) == ["/dev/zero:1:1: it is not a regular file; a file is expected"]
    assert messages(Path("a\0b")) == [r"a\x00b:1:1: it cannot be read (embedded null byte)"]
    long = Path("n" * 5000)
    assert messages(long) == [f"{long}:1:1: it cannot be read (File name too long)"]


STUDY = """format: 2
study: inherited
title: t
question: q
cameras:
  own: {like: wrong, lenses: {focal_lenght: 9 mm}}
  wrong:
    {kind: stereo, basline: 100 mm, sensor: {pixels: [1024, 1024], pixel_pitch: 10 um},
     lenses: {focal_length: 8 mm, f_number: 8}, depth: {disparity_error: 0.1 px}}
  again: {like: wrong}
  third: {like: again, baseline: -1 m}
scene: {distances: [0.5 m, 1 m], wavelength: 550 nm}
"""


def test_a_mistake_is_stated_once_for_all_cameras_that_inherit_it(tmp_path: Path) -> None:
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    found = {message.removeprefix(f"{path}:") for message in messages(path)}
    by_key = {message.partition(": ")[2].partition(":")[0]: message for message in found}
    assert sorted(by_key) == [
        "cameras.own.lenses.focal_lenght",
        "cameras.third.baseline",
        "cameras.wrong.baseline",
        "cameras.wrong.basline",
    ]
    assert by_key["cameras.wrong.basline"].startswith("8:20: ")
    assert [name for name in ("own", "again", "third") if f"cameras.{name}" in by_key["cameras.wrong.basline"]] == [
        "own", "again", "third",
    ]  # fmt: skip
    assert "cameras.third" not in by_key["cameras.wrong.baseline"]  # it has a baseline of its own
