"""The fenced blocks of the README and the documentation, and how each is run.

A block of `sh` holds commands of the program, run in a folder with the shipped studies. One of `python` runs in the
namespace of its page, as a doctest where it shows a session. One of `yaml` is a study or, with a base to be merged
into, a fragment of one. What a block needs besides stands in a comment before it, which readers do not see:

    <!-- file: NAME -->        write this block to a file of the page's folder; a study is loaded from it
    <!-- more: FILE -->        append this block to a file of the page's folder, a study, which is then loaded
    <!-- into: FILE [PATH] --> merge this YAML into a study, below a dotted path of it, and load that
    <!-- exit: STATUS -->      the command ends with this status
    <!-- slow -->              left to `python -m tests.docs.slow`
    <!-- elsewhere: WHERE -->  run by another program
    <!-- output -->            every number of this text stands in what the block before it printed, but for times
"""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import shlex
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from typer.testing import CliRunner

import tradestudy
from tradestudy import cli

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted(path for path in (ROOT / "docs").rglob("*.md") if "generated" not in path.parts))
LANGUAGES = ("sh", "yaml", "python", "text")

_PROGRAM = "python -m tradestudy "
_FENCE = re.compile(r"^(?P<indent> *)(?P<fence>```+|~~~+)(?P<language>\S*)")
_DIRECTIVE = re.compile(r"^<!-- (?P<name>file|more|into|exit|slow|elsewhere|output)(?:: (?P<value>.*))? -->$")
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?![\w.]*\d)(?! ?(?:ms|s|min)\b)")


@dataclass(frozen=True, kw_only=True)
class Block:
    """One fenced block, the line that it begins at, and what stands in the comments before it."""

    language: str
    text: str
    line: int
    said: Mapping[str, str]


def blocks(page: Path) -> Iterator[Block]:
    """The blocks of a page but for directives of the documentation's generator."""
    lines = iter(enumerate(page.read_text(encoding="utf-8").splitlines(), start=1))
    said: dict[str, str] = {}
    before = ""
    for number, line in lines:
        if directive := _DIRECTIVE.match(line):
            said[directive["name"]] = directive["value"] or ""
        elif fence := _FENCE.match(line):
            inside = []
            for _, below in lines:
                if below.strip() == fence["fence"]:
                    break
                inside.append(below.removeprefix(fence["indent"]))
            if not fence["language"].startswith("{"):
                yield Block(language=fence["language"], text="\n".join(inside) + "\n", line=number, said=said)
            said = {}
        elif line.startswith("    ") and not before.strip():
            yield Block(language="indented", text=line, line=number, said={})
        before = line


@dataclass
class Session:
    """What the blocks of one page leave for those after them."""

    page: Path
    folder: Path
    names: dict[str, Any] = field(default_factory=dict)
    printed: str = ""

    def run(self, block: Block) -> None:
        """Run a block; raise AssertionError where it does not do what the page says."""
        getattr(self, f"_{block.language}")(block)

    def _sh(self, block: Block) -> None:
        """Commands of the program run in this process: starting one for each would take most of the time."""
        self.printed = ""
        for line in block.text.splitlines():
            assert line.startswith(_PROGRAM), f"not run: {line}"
            with contextlib.chdir(self.folder):
                done = CliRunner().invoke(cli.app, shlex.split(line.removeprefix(_PROGRAM)))
            self.printed += done.output
            assert done.exit_code == int(block.said.get("exit", "0")), self.printed

    def _python(self, block: Block) -> None:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.chdir(self.folder):
            if not block.text.startswith(">>>"):
                exec(compile(block.text, f"{self.page.name}:{block.line}", "exec"), self.names)
            else:
                test = doctest.DocTestParser().get_doctest(
                    block.text, self.names, self.page.name, str(self.page), block.line
                )
                runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
                complaints: list[str] = []
                runner.run(test, out=complaints.append, clear_globs=False)
                self.names.update(test.globs)
                assert not complaints, "".join(complaints)
        self.printed = printed.getvalue()

    def _yaml(self, block: Block) -> None:
        if "more" in block.said:
            with (self.folder / block.said["more"]).open("a", encoding="utf-8") as file:
                file.write(block.text)
            tradestudy.load(self.folder / block.said["more"])
        elif "into" in block.said:
            base, _, place = block.said["into"].partition(" ")
            path = self.folder / base
            fragment: Any = _yaml(block.text)
            for key in reversed(place.split(".") if place else []):
                fragment = {key: fragment}
            merged = path.with_name(f"merged-{block.line}.yaml")
            with merged.open("w", encoding="utf-8") as file:
                YAML().dump(_merged(_yaml(path.read_text(encoding="utf-8")), fragment), file)
            tradestudy.load(merged)
        else:
            self._text_file(block)
            tradestudy.load(self.folder / block.said["file"])

    def _text(self, block: Block) -> None:
        if "file" in block.said:
            self._text_file(block)
        missing = set(_NUMBER.findall(block.text)) - set(_NUMBER.findall(self.printed))
        assert "file" in block.said or not missing, f"{sorted(missing)} stand in no output:\n{self.printed}"

    def _text_file(self, block: Block) -> None:
        (self.folder / block.said["file"]).write_text(block.text, encoding="utf-8")


def _yaml(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def _merged(base: Any, other: Any) -> Any:
    """A study with the keys of a fragment in it."""
    if not (isinstance(base, Mapping) and isinstance(other, Mapping)):
        return other
    return {**base, **{key: _merged(base.get(key), below) for key, below in other.items()}}


def run_page(page: Path, folder: Path, *, slow: bool) -> None:
    """Run the blocks of a page in their order, in a folder with the shipped studies and the example's results."""
    shutil.copytree(ROOT / "studies", folder / "studies")
    shutil.copytree(ROOT / "reports" / "examples", folder / "reports" / "examples")
    session = Session(page=page, folder=folder)
    skipped = False
    for block in blocks(page):
        # What a slow block printed, or left behind, is not there for the text after it.
        skipped = "slow" in block.said or (skipped and block.language == "text" and "file" not in block.said)
        if "elsewhere" in block.said or (skipped and not slow):
            continue
        try:
            session.run(block)
        except Exception as error:
            error.add_note(f"at {page.relative_to(ROOT)}:{block.line}")
            raise


def slow_pages(pages: Sequence[Path] = PAGES) -> list[Path]:
    """Pages with blocks that take longer than a test may."""
    return [page for page in pages if any("slow" in block.said for block in blocks(page))]
