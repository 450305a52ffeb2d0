"""The reference pages hold everything that the program declares, each with its text."""

from __future__ import annotations

import re
import sys
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer.main
from ruamel.yaml import YAML

import tradestudy
from tradestudy.cli import app
from tradestudy.results import GROUPS

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module", autouse=True)
def _beside_the_configuration() -> None:
    sys.path.insert(0, str(ROOT / "docs"))


@pytest.fixture(scope="module")
def pages(_beside_the_configuration: None) -> dict[str, str]:
    import study_keys

    return study_keys.study_pages(ROOT)


def terms(page: str) -> list[str]:
    """What the definition lists of a page define."""
    lines = page.splitlines()
    return [line.split("`")[1] for line, below in pairwise(lines) if below.startswith(": ")]


def test_defines_every_key_once(pages: dict[str, str]) -> None:
    schema = tradestudy.schema()
    parts = [one for name, one in schema["$defs"].items() if "properties" in one and name[0].isupper()]
    declared = sorted(key for part in [schema, *parts] for key in part["properties"])
    assert sorted(term for page in pages.values() for term in terms(page)) == declared


def test_gives_every_key_a_meaning_a_value_and_an_example_and_says_what_holds_without_it(pages: dict[str, str]) -> None:
    for page in pages.values():
        entries = page.split("\n: ")[1:]
        assert all(entry.split("\n")[0].strip() for entry in entries)
        for entry in entries:
            said = [word for word in ("*Required.* ", "*Optional.* ", "*Default:* ") if word in entry]
            assert len(said) == 1, entry
        for fact in ("*Value:* ", "*Example:* "):
            texts = [entry.partition(fact)[2] for entry in entries]
            assert all(text[:1].strip(". \n") for text in texts), fact


def test_examples_are_yaml(pages: dict[str, str]) -> None:
    reader: Any = YAML(typ="safe", pure=True)
    for page in pages.values():
        for line in page.splitlines():
            example = line.partition("*Example:* `")[2].rpartition("`")[0]
            if example:
                assert len(reader.load(example)) == 1


def test_examples_are_valid_for_their_keys(pages: dict[str, str]) -> None:
    reader: Any = YAML(typ="safe", pure=True)
    schema = tradestudy.schema()
    parts = {f"(part-{name.lower()})=": one for name, one in schema["$defs"].items()} | {"## Top level": schema}
    checked = 0
    for page in pages.values():
        keys: dict[str, Any] = {}
        for line in page.splitlines():
            keys = parts[line]["properties"] if line in parts else keys
            if example := line.partition("*Example:* `")[2].rpartition("`")[0]:
                ((key, value),) = reader.load(example).items()
                jsonschema.Draft202012Validator({"$defs": schema["$defs"], **keys[key]}).validate(value)
                checked += 1
    assert checked > 400


def test_links_of_keys_lead_to_parts(pages: dict[str, str]) -> None:
    whole = "\n".join(pages.values())
    targets = {line[1:-2] for line in whole.splitlines() if line.startswith("(part-")}
    assert {one.partition(")")[0] for one in whole.split("](#")[1:]} == targets


def test_explains_every_command_and_option() -> None:
    import declared

    page = declared.command_line_page()
    program: Any = typer.main.get_command(app)
    for name, command in program.commands.items():
        section = page.partition(f"\n## {name}\n")[2].partition("\n## ")[0]
        assert command.help.split()[0] in section
        expected = {one.opts[0] for one in command.params if one.param_type_name == "option"} - {"--help"}
        assert {term.split()[0] for term in terms(section) if term.startswith("--")} == expected


def test_defines_every_variable_of_every_group() -> None:
    import declared

    page = declared.results_page()
    for group, variables in GROUPS.items():
        section = page.partition(f"\n## /{group}\n")[2].partition("\n(group-")[0]
        assert terms(section) == ([] if group == "depth_at_places" else list(variables))


def test_entries_that_refer_to_another_group_find_the_same_variable_described_there() -> None:
    import declared

    page = declared.results_page()
    sections = {group: page.partition(f"\n## /{group}\n")[2].partition("\n(group-")[0] for group in GROUPS}
    referring = 0
    for group, section in sections.items():
        for line, below in pairwise(section.splitlines()):
            if below.startswith(": As in"):
                name, other = line.split("`")[1], below.partition("#group-")[2].partition(")")[0]
                assert GROUPS[group][name].comment == GROUPS[other][name].comment
                assert f"\n`{name}` " in sections[other]
                referring += 1
    assert referring > 20


def test_lists_everything_that_the_package_offers() -> None:
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    listed = set(re.findall(r":: tradestudy\.(\w+)", page))
    assert set(tradestudy.__all__) - {"__version__"} <= listed


def test_properties_begin_with_no_colon() -> None:
    """Napoleon takes the text of a property before a colon in its first line for its type."""
    for owner in (tradestudy, tradestudy.optics, tradestudy.uncertainty):
        for offered in (getattr(owner, name) for name in owner.__all__):
            members = vars(offered) if isinstance(offered, type) else {}
            for name, member in members.items():
                if isinstance(member, property | cached_property) and not name.startswith("_"):
                    first = re.sub(r"``.*?``", "", (member.__doc__ or "").split("\n")[0])
                    assert ": " not in first, f"{offered.__name__}.{name}"


def test_marks_quoted_values_as_code_but_no_possessives() -> None:
    import declared

    assert declared._code("the lens's error against Kirchhoff's") == "the lens's error against Kirchhoff's"
    assert (
        declared._code("the study's values: 'on', '1 m' or a='1 m'") == "the study's values: `on`, `'1 m'` or `a='1 m'`"
    )
    assert declared._code("the option --format, or --with-cost") == "the option `--format`, or `--with-cost`"


def test_counts_the_values_of_a_list_as_its_schema_does() -> None:
    import study_keys

    counts = {
        "values": {},
        "2 or more values": {"minItems": 2},
        "2 to 4 values": {"minItems": 2, "maxItems": 4},
        "up to 10 values": {"maxItems": 10},
        "2 values": {"minItems": 2, "maxItems": 2},
    }
    assert {words: study_keys._count(schema) for words, schema in counts.items()} == {words: words for words in counts}
