from __future__ import annotations

import pytest

from tradestudy.report.document import (
    Appendices,
    Callout,
    Column,
    Heading,
    Paragraph,
    Picture,
    Report,
    Span,
    Table,
    all_blocks,
    literal,
    say,
    spans,
)  # fmt: skip

HOSTILE = "*a* _b_ `c` **d** ~e~ ^f^ [g](#h) {i} #j $k$ <b>&amp;\"'\\ @l // /* \u202e"


def test_a_plain_string_is_one_literal_span() -> None:
    assert spans("*a* `b` [c](#d)") == (Span("*a* `b` [c](#d)"),)


def test_markup_is_read_from_the_template_only() -> None:
    assert say("see **{name}** in *{name}* of `{name}`", name=HOSTILE) == (
        Span("see "),
        Span(literal(HOSTILE), "strong"),
        Span(" in "),
        Span(literal(HOSTILE), "emphasis"),
        Span(" of "),
        Span(literal(HOSTILE), "code"),
    )


def test_every_style_is_read() -> None:
    assert say("*f*~M~ 10^8^ [this](#there) [](#figure-x)") == (
        Span("f", "emphasis"),
        Span("M", "sub"),
        Span(" 10"),
        Span("8", "sup"),
        Span(" "),
        Span("this", "link", "there"),
        Span(" "),
        Span("", "link", "figure-x"),
    )


def test_spans_can_be_put_into_a_template() -> None:
    assert say("a {b} c", b=say("**d**")) == (Span("a "), Span("d", "strong"), Span(" c"))


def test_a_place_without_a_value_is_an_error() -> None:
    with pytest.raises(KeyError, match="name"):
        say("{name}")


def test_characters_forbidden_by_xml_and_direction_overrides_are_escaped() -> None:
    assert literal("a\x00b\u202ec\nd\ud800e") == r"a\x00b\u202ec d\ud800e"


def test_headings_figures_and_tables_are_numbered_in_reading_order() -> None:
    table = Table(name="t", caption="", columns=(Column(title="x"),), rows=())
    picture = Picture(name="p", caption="", alt="")
    document = Report(
        title="",
        subtitle="",
        blocks=(
            Heading(text="", anchor="a"),
            Heading(text="", anchor="a-a", level=2),
            Callout(title="", blocks=(picture,)),
            Heading(text="", anchor="a-b", level=2),
            Heading(text="", anchor="b"),
            table,
            Heading(text="", anchor="b-a", level=2),
            Picture(name="q", caption="", alt=""),
        ),
    )
    assert document.numbers == {
        "a": "1", "a-a": "1.1", "p": "Figure 1", "a-b": "1.2", "b": "2", "t": "Table 1", "b-a": "2.1", "q": "Figure 2",
    }  # fmt: skip


def test_appendices_have_letters_and_figures_and_tables_go_on() -> None:
    table = Table(name="t", caption="", columns=(Column(title="x"),), rows=())
    blocks = (
        Heading(text="", anchor="a"),
        Picture(name="p", caption="", alt=""),
        Appendices(),
        Heading(text="", anchor="b"),
        table,
        Heading(text="", anchor="b-a", level=2),
        Heading(text="", anchor="c"),
        Picture(name="q", caption="", alt=""),
    )
    assert Report(title="", subtitle="", blocks=blocks).numbers == {
        "a": "1", "p": "Figure 1", "b": "A", "t": "Table 1", "b-a": "A.1", "c": "B", "q": "Figure 2",
    }  # fmt: skip


def test_a_name_can_be_used_once() -> None:
    with pytest.raises(ValueError, match="'a'"):
        Report(title="", subtitle="", blocks=(Heading(text="", anchor="a"), Picture(name="a", caption="", alt="")))


def test_a_row_has_as_many_cells_as_columns_or_one() -> None:
    columns = (Column(title="x"), Column(title="y"), Column(title="z"))
    Table(name="t", caption="", columns=columns, rows=(("a",), ("a", "b", "c")))
    with pytest.raises(ValueError, match="2 cells, not 3"):
        Table(name="t", caption="", columns=columns, rows=(("a", "b"),))


def test_callouts_are_opened_when_blocks_are_counted() -> None:
    inner = Paragraph("b")
    box = Callout(title="", blocks=(inner,))
    assert tuple(all_blocks((Paragraph("a"), box))) == (Paragraph("a"), box, inner)
