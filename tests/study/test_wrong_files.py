"""Wrong study files: every mistake of each is told at once, at its place, in words that help."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tradestudy import load
from tradestudy.errors import StudyError

HERE = Path(__file__).parent / "wrong"

# file in wrong/ → everything that is said about it, as a user in that folder sees it
MESSAGES = {
    name: told.strip().splitlines()
    for name, told in re.findall(
        r"^== (\S+)\.yaml\n((?:(?!== ).*\n)+)", (HERE / "messages.txt").read_text(encoding="utf-8"), re.MULTILINE
    )
}


def messages(path: Path) -> list[str]:
    with pytest.raises(StudyError) as caught:
        load(path)
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize("name", MESSAGES)
def test_says_exactly_this(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(HERE)
    assert messages(Path(f"{name}.yaml")) == MESSAGES[name]


def test_no_wrong_file_is_forgotten() -> None:
    assert {path.stem for path in HERE.glob("*.yaml")} == {*MESSAGES, "right"}


def test_the_files_are_wrong_by_their_mistakes_alone() -> None:
    definition = load(HERE / "right.yaml").definition
    assert list(definition.case.cameras) == ["rig", "array", "near"]
    assert definition.file.cameras["near"].baseline == 0.02  # type: ignore[union-attr]  # a stereo rig


@pytest.mark.parametrize("name", MESSAGES)
def test_the_place_holds_what_the_message_quotes(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_files_that_are_no_text(tmp_path: Path) -> None:
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


def test_files_that_are_no_files(tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text("format: 2")
    near = tmp_path / "stduy.yaml"
    assert messages(near) == [f"{near}:1:1: there is no such file; nearest: '{tmp_path / 'study.yaml'}'"]
    assert messages(tmp_path) == [f"{tmp_path}:1:1: it is a folder; a file is expected"]
    assert messages(Path("/dev/zero")) == ["/dev/zero:1:1: it is not a regular file; a file is expected"]
    assert messages(Path("a\0b")) == ["a\0b:1:1: it cannot be read (embedded null byte)"]
    long = Path("n" * 5000)
    assert messages(long) == [f"{long}:1:1: it cannot be read (File name too long)"]
