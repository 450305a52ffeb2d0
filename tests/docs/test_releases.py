"""The changelog, the version of the package and the citation agree."""

from __future__ import annotations

import re
import tomllib

from ruamel.yaml import YAML

from tests.docs.blocks import ROOT


def test_the_package_has_the_version_after_the_newest_of_the_changelog() -> None:
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    titles = re.findall(r"^## (.*)$", log, re.MULTILINE)
    assert titles[0] == "Unreleased"
    released = [int(re.fullmatch(r"0\.(\d+) – \d+ \w+ \d{4}", title)[1]) for title in titles[1:]]  # type: ignore[index]
    assert released == list(range(len(released), 0, -1))
    package = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert package == f"0.{released[0] + 1}.0.dev0"


def test_the_citation_has_what_its_format_requires() -> None:
    cited = YAML(typ="safe", pure=True).load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors"} <= cited.keys()
    assert cited["cff-version"] == "1.2.0"
    assert all(author["name"] for author in cited["authors"])
    assert "license" not in cited
