from __future__ import annotations

import base64
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from tradestudy.figures.drawing import Plotted
from tradestudy.figures.style import FAINT, INK, SOFT, line_style, readable
from tradestudy.report.document import (
    Bullets,
    Callout,
    Column,
    Equation,
    Heading,
    Paragraph,
    Picture,
    Report,
    Table,
    say,
)  # fmt: skip
from tradestudy.report.html import render_html, script
from tradestudy.report.page_data import CurveValues, page_data
from tradestudy.report.pdf import template

VOID = {"meta", "img", "br", "link", "input"}
LETTER = re.compile(r'<path id="DejaVu[^>]*/>')


class Page(HTMLParser):
    """Elements, identifiers and texts of a page; raises if tags are not closed in order."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self.rows: list[list[str]] = []
        self._open: list[str] = []
        self.feed(source)
        self.close()
        assert not self._open, self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), (tag, attrs)
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] not in ("style", "script"):
            self.texts.append(data)
        if {"td", "th"} & set(self._open):
            self.rows[-1][-1] += data.replace("\u00a0", " ")

    def of(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", "".join(self.texts))


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page((written / "report.html").read_text(encoding="utf-8"))


def test_identifiers_are_unique_and_links_lead_somewhere(page: Page) -> None:
    identifiers = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(identifiers) > 20
    assert len(identifiers) == len(set(identifiers))
    targets = {attributes["href"].removeprefix("#") for attributes in page.of("a")}
    assert targets
    assert targets <= set(identifiers)


def test_every_image_has_an_alternative_text(page: Page) -> None:
    equations, figures = page.of("img"), page.of("svg")
    assert equations
    assert len(figures) >= 5
    assert all(len(image["alt"]) > 20 for image in equations)
    assert all(figure["role"] == "img" and len(figure["aria-label"]) > 20 for figure in figures)


def test_nothing_is_fetched(page: Page, written: Path) -> None:
    assert not any("src" in script for script in page.of("script"))
    assert not page.of("link")
    assert all(image["src"].startswith("data:image/svg+xml;base64,") for image in page.of("img"))
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)
    source = (written / "report.html").read_text(encoding="utf-8")
    assert set(re.findall(r"url\(.", source)) <= {"url(#"}
    assert not re.search(r"\bfetch\(|XMLHttpRequest|import\(|@import", source)
    assert "http" not in re.sub(r'src="[^"]*"', "", source)


def test_figures_in_the_page_equal_the_svg_files(written: Path) -> None:
    """All outlines but those of letters, which the page holds once, in the same order and to hundredths of a point."""
    source = (written / "report.html").read_text(encoding="utf-8")
    files = list((written / "figures").glob("*.svg"))
    assert files
    for file in files:
        svg = file.read_text(encoding="utf-8")
        ET.fromstring(svg)
        inside = source.partition(f'<figure class="plot" id="{file.stem}">')[2].partition("</svg>")[0]
        assert _outlines(inside) == pytest.approx(_outlines(svg), abs=0.01)


def _outlines(svg: str) -> list[float]:
    outlines = re.findall(r'\bd="([^"]*)"', LETTER.sub("", re.sub(r"\s+", " ", svg)))
    return [float(number) for outline in outlines for number in re.findall(r"-?[\d.]+", outline)]


def test_letters_and_identifiers_lead_somewhere(page: Page) -> None:
    identifiers = {attributes["id"] for _, attributes in page.elements if "id" in attributes}
    uses = {use["href"].removeprefix("#") for use in page.of("use")}
    assert uses
    assert uses <= identifiers


def test_curves_carry_the_numbers_of_the_results(written: Path, tree: xr.DataTree) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    data = json.loads(source.partition('id="page-data">')[2].partition("</script>")[0])
    depth = tree["depth"].to_dataset()
    known = 0
    for camera in depth["camera"].values:
        x, value, *_ = data["values"][f"depth_uncertainty/{camera}"]
        assert _decoded(data, x) == _read(depth["distance"].values)
        assert _decoded(data, value) == _read(depth["depth_uncertainty"].sel(camera=camera).values)
        known += 1
    assert known >= 2


def _decoded(data: dict[str, Any], place: int) -> list[str]:
    return _read(np.frombuffer(base64.b64decode(data["arrays"][place]), dtype="<f4").astype(np.float64))


def _read(values: np.ndarray) -> list[str]:
    return [f"{value:.2e}" for value in values]


def test_numbers_read_alike_as_single_floats() -> None:
    ties = np.array([1.2345e-3, 0.012350000001, 9.9949999, 9.995, 0.0, np.inf, np.nan, 1e-30, 123500.0, 2.675, 1.005])
    noise = np.random.default_rng(1).lognormal(sigma=9.0, size=20000)
    near = np.round(noise, 3) + 5e-4 * (1.0 + 1e-9)
    for values in (ties, noise, near, -noise):
        reported = page_data({}, {"one": CurveValues(x=values, value=values)})
        assert _decoded(json.loads(reported), 0) == _read(values)


def test_every_colour_of_cameras_follows_the_page() -> None:
    variables = set(re.findall(r"--c([0-9a-f]{6}):", template("report.css")))
    used = {line_style(order).color.lower().removeprefix("#") for order in range(7)}
    names = {readable(line_style(order).color).removeprefix("#") for order in range(7)}
    assert {*used, *names, *(color.removeprefix("#") for color in (INK, SOFT, FAINT))} <= variables


def test_the_script_is_short() -> None:
    assert len(script().encode()) <= 33_500


def test_sections_follow_their_order(page: Page) -> None:
    text = page.text.partition("The answer")[2]  # behind the contents
    sentences = (
        "The claims and their verdicts",
        "Usable distances",
        "Assumptions register",
        "Contradictions between inputs",
        "Depth from a focused plenoptic camera",
        "Requirements of the study",
        "How this report was made",
    )
    found = [text.rindex(sentence) for sentence in sentences]
    assert found == sorted(found)


def test_the_first_page_answers_the_question(page: Page) -> None:
    answer = page.text.partition("1 The answer")[2].partition("Assumptions register")[0]
    answer = answer.partition("1 The answer")[2] or answer
    # The synthetic tree: plenoptic from 0.15 m, stereo from 0.391 m, between two computed distances each.
    assert re.search(r"0\.15 to 0\.391 m: Raytrix R5, Keplerian", answer)
    assert re.search(r"0\.391 to 10 m: Stereo 100 mm, 65\.24° across", answer)
    assert "Which yaw makes stereo equal the R5 at 0.5 m? 0.682°" in answer


def test_the_first_page_says_what_flips_the_verdict(page: Page) -> None:
    # Ratios 3.4 at 0.3 m (the R5 is the only usable one) and 3.4 × 1.2 at 1 m; 0.9 under least squares, 1.08 at 1 m.
    stereo, r5 = "Stereo 100 mm, 65.24° across", "Raytrix R5, Keplerian"
    assert ["0.3 m", r5, "0 of 3", stereo, "3.4"] in page.rows
    assert ["1 m", stereo, "0 of 3", stereo, "4.1"] in page.rows


def test_numbers_in_the_table_equal_those_of_the_results(page: Page, tree: xr.DataTree) -> None:
    start = next(i for i, row in enumerate(page.rows) if row == ["At 1 m"])
    cells = next(row for row in page.rows[start:] if row[0].startswith("Stereo 100 mm, 65.24°"))
    distance = float(tree["depth"]["distance"].sel(distance=1.0, method="nearest"))
    noise, yaw = 6.9e-4 * distance**2, 0.0349 * distance**2
    both = (noise**2 + yaw**2) ** 0.5
    assert cells[1] == "yes"
    assert cells[3:6] == [f"{1e6 * noise:.0f} µm", f"{1e3 * yaw:.1f} mm", f"{1e3 * both:.1f} mm"]
    assert float(cells[7].removesuffix(" %")) == pytest.approx(100 * both, rel=0.005)
    assert cells[8] == f"{distance - 1.96 * both:.2f} – {distance + 1.96 * both:.2f} m"


HOSTILE = "<script>alert(1)</script> & \"q\" 'a' </figure> {{ 7*7 }} {% raw %} $x$ #eval @l \\ *b* _u_ \u65e5\u672c"


def test_hostile_text_stays_text() -> None:
    columns = (Column(title=HOSTILE, unit=HOSTILE), Column(title="x", align="right", weight=1))
    document = Report(
        title=HOSTILE,
        subtitle=HOSTILE,
        blocks=(
            Heading(text=HOSTILE, anchor="a"),
            Paragraph(say("**{x}** *{x}* `{x}` ~{x}~ ^{x}^ [{x}](#a)", x=HOSTILE)),
            Bullets((HOSTILE,)),
            Callout(title=HOSTILE, blocks=(Paragraph(HOSTILE),)),
            Table(name="t", caption=HOSTILE, columns=columns, rows=((HOSTILE, HOSTILE), (HOSTILE,)), notes=(HOSTILE,)),
            Picture(name="p", caption=HOSTILE, alt=HOSTILE),
            Equation(typst="x", alt="x", reference=HOSTILE),
        ),
    )
    page = Page(render_html(document, {"p": Plotted(svg=b'<svg viewBox="0 0 1 1"></svg>')}).decode())
    assert len(page.of("script")) == 2  # its own and its data
    # Everything but the picture's alternative text is shown: 23 places, title element and contents included.
    assert page.text.count(HOSTILE) == 23
    assert page.of("svg")[0]["aria-label"] == HOSTILE
