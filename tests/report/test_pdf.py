from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pypdfium2 as pdfium
import pytest
import xarray as xr

from tradestudy import figures
from tradestudy.errors import TradestudyError
from tradestudy.figures.style import traces
from tradestudy.report.document import (
    Appendices,
    Bullets,
    Callout,
    Column,
    Contents,
    Equation,
    Heading,
    PageBreak,
    Paragraph,
    Picture,
    Report,
    Table,
    say,
)  # fmt: skip
from tradestudy.report.pdf import render_pdf, typeset

SVG = b'<svg xmlns="http://www.w3.org/2000/svg" width="10" height="10"><rect width="10" height="10" fill="red"/></svg>'


def texts(content: bytes) -> list[str]:
    with pdfium.PdfDocument(content) as document:
        return [re.sub(r"\s+", " ", page.get_textpage().get_text_bounded()) for page in document]


def pixels(content: bytes, page: int, scale: float = 2.0) -> npt.NDArray[np.int64]:
    """A page as (height, width, 3) integers."""
    with pdfium.PdfDocument(content) as document:
        return np.asarray(document[page].render(scale=scale).to_pil().convert("RGB"), dtype=np.int64)


@pytest.fixture(scope="module")
def printed(written: Path) -> bytes:
    return (written / "report.pdf").read_bytes()


@pytest.fixture(scope="module")
def pages(printed: bytes) -> list[str]:
    return texts(printed)


def test_headings_appear_on_their_pages_in_order(pages: list[str]) -> None:
    assert "1 The answer" in pages[0]
    main, appendices = " ".join(pages[1:]).split(" Appendices ")[-2:]  # behind the contents, which name them too
    names = ["Camera by distance", "Cameras", "Which camera each error source favours", "Claims", "Results"]
    more = {
        "A": "Assumptions",
        "B": "Notes on the cameras",
        "C": "Contradictions found",
        "D": "Method",
        "E": "Depth at the declared distances",
        "F": "The decision under every reading",
        "G": "Claims under every reading",
        "H": "Requirements",
        "I": "Calibration",
    }
    for body, numbered in ((main, dict(enumerate(names, start=2))), (appendices, more)):
        places = [[m.start() for m in re.finditer(rf"\b{number} {name}", body)] for number, name in numbered.items()]
        assert all(places)
        starts = [place[-1] for place in places]
        assert starts == sorted(starts)
    for number, text in enumerate(pages, start=1):
        assert f"{number} of {len(pages)}" in text


def test_the_outline_and_the_tags_are_accessible(printed: bytes) -> None:
    with pdfium.PdfDocument(printed) as document:
        titles = [bookmark.get_title() for bookmark in document.get_toc()]
    assert any("The answer" in title for title in titles)
    assert b"pdfuaid:part" in printed
    assert b"/Lang" in printed


@pytest.mark.parametrize("name", ["whole_range", "close_range", "mid_range"])
def test_the_curve_of_every_camera_is_on_the_page(
    tree: xr.DataTree, printed: bytes, pages: list[str], name: str
) -> None:
    """Each camera's colour runs across the plotting area of the figure, also in the page as printed."""
    caption = " ".join(figures.build(tree)[name].caption.split())[:60].rstrip()  # plain spaces, as in `texts`
    number = next(i for i, text in enumerate(pages) if caption in text)
    image = pixels(printed, number, scale=2.0)
    for camera in traces(tree):
        depth = tree["depth"].to_dataset().sel(camera=camera.key)
        span = {"whole_range": (0.05, 10.0), "close_range": (0.0, 1.0), "mid_range": (1.0, 10.0)}[name]
        usable = depth["usable"] & (depth["distance"] >= span[0]) & (depth["distance"] <= span[1])
        color = [int(camera.style.color[i : i + 2], 16) for i in (1, 3, 5)]
        near = np.abs(image - np.array(color)).max(axis=2) <= 24
        columns = np.flatnonzero(near.any(axis=0))
        if int(usable.sum()) > 20:
            assert len(columns) > 60, (camera.key, len(columns))


def test_a_drawn_curve_lies_where_its_numbers_are(tree: xr.DataTree) -> None:
    """Read the curve back from the picture: slope 2 on the log-log chart, as the synthetic tree has it."""
    figure = figures.figure(tree, "whole_range")
    page = render_pdf(
        Report(title="t", subtitle="", blocks=(Picture(name="p", caption="c", alt="a"),)), {"p": figure.svg()}
    )
    image = pixels(page, 0, scale=4.0)
    axes = figure.axes[0]
    color = [int("#0072B2"[i : i + 2], 16) for i in (1, 3, 5)]
    blue = np.abs(image - np.array(color)).max(axis=2) <= 24
    rows, columns = np.nonzero(blue)
    # The curve is above the bars, which are in the lower part of the figure.
    top, bottom = rows.min(), rows.max()
    box = axes.get_position()
    margin, text_width = (millimetres / 25.4 * 72.0 * 4.0 for millimetres in (19.0, 172.0))
    # The name of the curve stands right of the panel.
    curve = (rows < top + 0.55 * (bottom - top)) & (columns < margin + box.x1 * text_width)
    slope = -np.polyfit(columns[curve], rows[curve], 1)[0]
    size = figure.get_size_inches()
    decades_x, decades_y = (np.log10(b / a) for a, b in (axes.get_xlim(), axes.get_ylim()))
    expected = 2.0 * (box.height * size[1] / decades_y) / (box.width * size[0] / decades_x)
    assert slope == pytest.approx(expected, rel=0.02)


HOSTILE = '#panic("x") #eval("1+1") $sum$ *b* _e_ `r` <l> @ref = h // c /* d */ \\ " \' ~ [x](#y) {z} ✓ \u65e5'
SHOWN = HOSTILE.replace("\u65e5", "⟨U+65E5⟩")


def test_hostile_text_stays_text() -> None:
    columns = (Column(title=HOSTILE, unit=HOSTILE, weight=1), Column(title="x"))
    document = Report(
        title="#t $x$",
        subtitle=HOSTILE,
        blocks=(
            Heading(text=HOSTILE, anchor="a"),
            Paragraph(say("{x}", x=HOSTILE)),
            Bullets((HOSTILE,)),
            Callout(title=HOSTILE, blocks=(Paragraph(HOSTILE),)),
            Table(name="t", caption=HOSTILE, columns=columns, rows=((HOSTILE, "1"), (HOSTILE,)), notes=(HOSTILE,)),
            Picture(name="p", caption=HOSTILE, alt=HOSTILE),
            Equation(typst="x", alt="x", reference="r"),
        ),
    )
    pages = texts(render_pdf(document, {"p": SVG}))
    text = re.sub(r"[\s\u00ad\ufffe\u0002]", "", "".join(pages))
    # Subtitle, heading, paragraph, bullet, callout twice, caption, title, unit, two cells, note, caption; and
    # the heading once more at the head of every page but the first.
    assert text.count(re.sub(r"\s", "", SHOWN)) == 13 + len(pages) - 1
    assert pages[0].startswith("#t $x$")


@pytest.mark.parametrize("lines", range(36, 48))
def test_a_row_heading_is_on_the_page_of_its_first_row_and_repeated_where_rows_continue(lines: int) -> None:
    def rows(heading: str, count: int) -> tuple[tuple[str, ...], ...]:
        return ((heading,), *((f"{heading} row {number};", "") for number in range(count)))

    columns = (Column(title="A"), Column(title="B"))
    table = Table(name="t", caption="T", columns=columns, rows=(*rows("First", lines), *rows("Second", 40)))
    printed = texts(render_pdf(Report(title="D", subtitle="", blocks=(table,)), {}))
    assert len(printed) > 1
    for page in printed:
        for heading in ("First", "Second"):
            assert len(re.findall(rf"{heading}(?! row)", page)) == (1 if f"{heading} row" in page else 0)


@pytest.mark.parametrize(("lines", "page"), [(1, 0), (15, 0), (30, 1), (38, 1), (50, 1)])
def test_the_contents_begin_on_the_first_page_only_if_it_is_short(lines: int, page: int) -> None:
    answer = tuple(Paragraph(f"Line {number}") for number in range(lines))
    rest = (Contents(), Heading(text="Cameras", anchor="cameras"), Paragraph("Each."), Appendices(), Paragraph("Last."))
    printed = texts(render_pdf(Report(title="D", subtitle="", blocks=(*answer, PageBreak(), *rest)), {}))
    for shown in ("Contents", "Each.", "Last."):  # appendices follow on the same page
        assert shown in printed[page]


def test_a_tall_figure_is_smaller_on_later_pages() -> None:
    tall = SVG.replace(b'height="10"', b'height="10" viewBox="0 0 10 10"')
    wide = tall.replace(b'height="10"', b'height="4"', 1).replace(b"0 0 10 10", b"0 0 10 4")
    blocks = (Picture(name="tall", caption="c", alt="a"), Picture(name="wide", caption="c", alt="a"))
    page = pixels(render_pdf(Report(title="D", subtitle="", blocks=blocks), {"tall": tall, "wide": wide}), 0)
    red = (page[..., 0] > 200) & (page[..., 1] < 60)
    widths = np.unique(red.sum(axis=1)[red.any(axis=1)])
    assert widths.max() / red.shape[1] == pytest.approx(172 / 210, abs=0.01)
    assert widths[widths > 0.2 * red.shape[1]].min() / widths.max() == pytest.approx(0.66, abs=0.01)


def test_an_equation_that_does_not_parse_is_a_clear_error() -> None:
    document = Report(title="t", subtitle="", blocks=(Equation(typst="frac(", alt="x"),))
    with pytest.raises(TradestudyError, match=r"the typesetter refused report\.typ"):
        render_pdf(document, {})


def test_a_picture_without_alternative_text_is_refused() -> None:
    document = Report(title="t", subtitle="", blocks=(Picture(name="p", caption="c", alt=""),))
    with pytest.raises(TradestudyError):
        render_pdf(document, {"p": SVG})


def test_equations_come_one_per_page() -> None:
    pages = typeset("equations.typ", {"equations": [{"typst": "x", "alt": "x"}, {"typst": "y^2", "alt": "y"}]}, "svg")
    assert len(pages) == 2
    assert pages[0] != pages[1]
