"""The README and the documentation: their blocks run, their links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.blocks import LANGUAGES, PAGES, ROOT, Block, Session, blocks, run_page

_LINK = re.compile(r"\]\((?!https?:|#)(?P<target>[^)#\s]+)")


def named(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize("page", PAGES, ids=named)
def test_blocks_do_what_the_page_says(page: Path, tmp_path: Path) -> None:
    run_page(page, tmp_path, slow=False)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_block_is_of_a_kind_that_is_run(page: Path) -> None:
    for block in blocks(page):
        assert block.language in LANGUAGES, f"{named(page)}:{block.line}"
        if block.language == "yaml":
            assert {"file", "more", "into"} & set(block.said), f"{named(page)}:{block.line}"
        if block.language == "text":
            assert {"file", "output"} & set(block.said), f"{named(page)}:{block.line}"


@pytest.mark.parametrize("page", [*PAGES, ROOT / "ARCHITECTURE.md", ROOT / "CONTRIBUTING.md"], ids=named)
def test_links_between_files_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "[](" not in text, "a link without text is invisible in a plain viewer"
    for target in _LINK.findall(text):
        if "generated/" not in target:
            base = ROOT / "docs" if target.startswith("/") else page.parent
            assert (base / target.lstrip("/")).exists(), target


def test_numbers_of_an_output_are_compared_with_it(tmp_path: Path) -> None:
    session = Session(page=ROOT / "README.md", folder=tmp_path)
    session.run(Block(language="python", text="print('worst 0.832 % at 3 m in 12.5 s')\n", line=1, said={}))
    session.run(Block(language="text", text="0.832 % at 3 m in 99 s\n", line=2, said={"output": ""}))
    with pytest.raises(AssertionError, match=r"0\.83"):
        session.run(Block(language="text", text="0.83 % at 3 m\n", line=3, said={"output": ""}))


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_files_that_a_page_names_exist(page: Path) -> None:
    for name in re.findall(r"`([\w/]+/[\w/]+\.(?:py|md|yaml|csv))`", page.read_text(encoding="utf-8")):
        assert (ROOT / name).exists() or (ROOT / "tradestudy" / name).exists(), name
