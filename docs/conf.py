"""How the documentation is built: ``python -m sphinx -W docs OUT``."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import catalogue_page  # noqa: E402 - found beside this file
import declared  # noqa: E402 - found beside this file
import study_keys  # noqa: E402 - as above

import tradestudy  # noqa: E402 - after them, by the order of imports

project = "tradestudy"
version = release = tradestudy.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
default_role = "py:obj"  # in docstrings single backticks name what Python can import
myst_enable_extensions = ["deflist"]
myst_heading_anchors = 3
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "groupwise"
autodoc_preserve_defaults = True
html_theme = "furo"
html_title = f"tradestudy {release}"
html_static_path = ["static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_copyright = False


def write_generated(_app: Sphinx) -> None:
    """Write the pages that are made from the program; leave unchanged ones alone, and remove obsolete ones."""
    pages = {f"study/{name}": text for name, text in study_keys.study_pages(HERE.parent).items()}
    pages |= {"command-line": declared.command_line_page(), "results": declared.results_page()}
    pages |= {"catalogue": catalogue_page.catalogue_page()}
    folder = HERE / "reference" / "generated"
    for path in set(folder.rglob("*.md")) - {folder / f"{name}.md" for name in pages}:
        path.unlink()
    for name, text in pages.items():
        path = folder / f"{name}.md"
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def keep_bars(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Take |U|² for a magnitude, which reStructuredText would take for a substitution."""
    lines[:] = [line if line.lstrip().startswith((">>>", "...")) else line.replace("|", r"\|") for line in lines]


def keep_initials(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    """Take "M. Born" for a name, which reStructuredText would take for the thirteenth item of a list."""
    lines[:] = [re.sub(r"^(\s*[A-Z])\. ", r"\1\\. ", line) for line in lines]


def shorten_types(_app: Sphinx, _domain: str, _kind: str, content: nodes.Element) -> None:
    """Name types as their users do: arrays without their element types, classes without their modules."""
    array = r"[~\w.]*ndarray\[[^]]*\], [~\w.]*dtype\[[^][]*(\[[^]]*\])?\]\]"
    array_like = r"[~\w.]*_Buffer .*_NestedSequence\[complex[^]]*\]"
    for field in content.findall(nodes.field):
        name, body = field.children
        if name.astext().startswith(("type", "rtype")):
            for text in list(body.findall(nodes.Text)):
                short = re.sub(array, "numpy.ndarray", re.sub(array_like, "array_like", text))
                text.parent.replace(text, nodes.Text(re.sub(r"~?\btradestudy\.(\w+\.)+(?=\w)", "", short)))
        elif name.astext().startswith("raises"):
            for text in list(body.findall(nodes.Text)):  # continuation lines keep the indentation of the source
                text.parent.replace(text, nodes.Text(re.sub(r"\s+", " ", text)))
    for annotation in content.parent.findall(addnodes.desc_annotation):  # the type of a property
        if "ndarray[" in (full := annotation.astext()):
            annotation.children = []
            annotation += nodes.Text(re.sub(array, "numpy.ndarray", full))


def unlink_architecture(_app: Sphinx, _name: str, source: list[str]) -> None:
    """Name ARCHITECTURE.md without a link: it lies outside the documentation, and plain viewers alone can follow it."""
    source[0] = re.sub(r"\[(ARCHITECTURE\.md)\]\([./]+ARCHITECTURE\.md\)", r"`\1`", source[0])


def let_tab_reach_scrolling_blocks(
    _app: Sphinx, _page: str, _template: str, context: dict[str, Any], _tree: nodes.document | None
) -> None:
    """Let the keyboard reach code and tables, which scroll sideways where the page is narrow."""
    body = re.sub(r'(<div class="highlight">)<pre>', r'\1<pre tabindex="0">', context.get("body", ""))
    context["body"] = re.sub(
        r'(<div class="table-wrapper [^"]*")', r'\1 tabindex="0" role="group" aria-label="Table"', body
    )


def setup(app: Sphinx) -> None:
    """Write the generated pages before Sphinx looks for sources, and have docstrings read as they are meant."""
    app.connect("builder-inited", write_generated)
    app.connect("source-read", unlink_architecture)
    app.connect("autodoc-process-docstring", keep_bars)
    app.connect("autodoc-process-docstring", keep_initials)
    app.connect("html-page-context", let_tab_reach_scrolling_blocks)
    app.connect("object-description-transform", shorten_types, priority=600)  # after autodoc adds the types
