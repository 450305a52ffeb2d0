"""The way of the data is the way of the packages: imports go downward only, and heavy libraries stay in their rooms."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "tradestudy"

# Every package and module of the top level, in the order in which data flows: each may import those before it.
ORDER = (
    "errors", "unit_registry", "units", "wording", "light_methods", "accuracy", "provenance", "machine", "catalogue",
    "optics", "declarations", "uncertainty", "execution",
    "cameras", "imaging", "calibration", "effects",
    "study", "depth", "verification", "results", "models", "answers",
    "figures", "report", "comparison", "result", "camera_object", "loaded_study", "api",
    "shown_progress", "console", "cli", "__main__",
)  # fmt: skip
# Figures and reports are made from results, and from nothing that computes them.
READ_RESULTS_ONLY = ("figures", "report")
MAY_BE_READ = ("errors", "units", "light_methods", "wording", "accuracy", "results", "figures", "report")
# What a study may declare of cameras, of all kinds and of each; a camera itself is computed with without pydantic.
KINDS = tuple(sorted(path.parent.name for path in (PACKAGE / "cameras").glob("*/declaration.py")))
DECLARATIONS = (
    "cameras.kinds", "cameras.declaration", "cameras.stated_declaration", "cameras.calibration_declaration",
    *(f"cameras.{kind}.declaration" for kind in KINDS),
)  # fmt: skip
# What reports take from figures: facts come from the views of the results.
DRAWINGS = ("figures", "figures.drawing", "figures.drawn", "figures.fonts")
# library → packages and modules that may import it; every other one must go through them.
HEAVY = {
    "pydantic": ("declarations", "study", *DECLARATIONS),
    "xarray": (
        "results",
        "answers",
        "comparison",
        "figures",
        "report",
        "result",
        "camera_object",
        "loaded_study",
        "api",
    ),
    "matplotlib": ("figures", "optics.spread_plot"),
    "PIL": ("imaging.scenes.pattern", "answers.pictures", "answers.depth_maps"),
    "typst": ("report",),
    "jinja2": ("report",),
    "ruamel": ("study", "verification.study_files"),
    "pint": ("unit_registry",),
    "typer": ("cli", "console"),
    "rich": ("shown_progress",),
    "emcee": ("calibration",),
    "arviz_stats": ("calibration",),
    "distributed": ("execution",),
    "cv2": ("cameras.stereo",),
}
# module, library → why it may break the rule above.
EXCEPTIONS = {
    ("optics.lens_point_spread", "matplotlib"): "as result: names the type of the plot; imported for typing only",
    ("optics.chain.accuracy", "matplotlib"): "as result: names the type of the plot; imported for typing only",
    ("result", "matplotlib"): "names the type of a figure for the reader of its signature; imported for typing only",
}


@cache
def modules() -> dict[str, Path]:
    """Every module below the package, by its dotted name."""
    found = {
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__"): path
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    return {name.removeprefix("tradestudy."): path for name, path in found.items() if name != "tradestudy"}


@cache
def imports(module: str) -> frozenset[str]:
    """Dotted names that a module imports, of this package without its name before them."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(modules()[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative imports hide the direction"
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            known = {name for name in members if name.removeprefix("tradestudy.") in modules()}
            names |= known | ({str(node.module)} if len(known) < len(members) else set())
    return frozenset(name.removeprefix("tradestudy.") for name in names if name != "tradestudy")


def own_imports() -> Iterator[tuple[str, str]]:
    """Every import of one module of the package by another."""
    return ((here, there) for here in modules() for there in imports(here) if there in modules())


def top(module: str) -> str:
    return module.partition(".")[0]


def test_the_order_names_existing_packages() -> None:
    assert {top(name) for name in modules()} == set(ORDER)


def test_imports_go_downward() -> None:
    upward = [
        f"{here} imports {there}" for here, there in own_imports() if ORDER.index(top(there)) > ORDER.index(top(here))
    ]
    assert not upward


def test_imports_have_no_cycles() -> None:
    """Inside every package, too, modules stand in an order."""
    below = {here: {there for there in imports(here) if there in modules()} for here in modules()}
    while free := [here for here, left in below.items() if not left & below.keys()]:
        for here in free:
            del below[here]
    assert not below, f"circles among or above: {sorted(below)}"


def test_only_the_tuple_of_kinds_imports_the_packages_of_kinds() -> None:
    rooms = tuple(f"cameras.{kind}" for kind in KINDS)
    strays = [
        f"{here} imports {there}"
        for here, there in own_imports()
        if there.startswith(rooms) and here != "cameras.kinds" and here.split(".")[:2] != there.split(".")[:2]
    ]
    assert not strays


def test_figures_and_reports_read_results_only() -> None:
    assert [
        f"{here} imports {there}"
        for here, there in own_imports()
        if top(here) in READ_RESULTS_ONLY and top(there) not in MAY_BE_READ
    ] == []


def test_reports_take_nothing_but_drawings_from_figures() -> None:
    taken = {there for here, there in own_imports() if top(here) == "report" and top(there) == "figures"}
    assert taken <= set(DRAWINGS)


def test_heavy_libraries_are_imported_only_where_allowed() -> None:
    strays = [
        f"{here} imports {name}"
        for here in modules()
        for name in imports(here)
        if (rooms := HEAVY.get(top(name))) is not None
        and not any(f"{here}.".startswith(f"{room}.") for room in rooms)
        and (here, top(name)) not in EXCEPTIONS
    ]
    assert not strays


def test_every_package_and_every_exception_is_still_needed() -> None:
    for library, rooms in HEAVY.items():
        for room in rooms:
            assert room in modules(), f"{room} is gone: drop it from the rooms of {library}"
            users = [here for here in modules() if f"{here}.".startswith(f"{room}.")]
            assert any(top(name) == library for here in users for name in imports(here)), f"{room}: no {library}"
    for here, library in EXCEPTIONS:
        assert any(top(name) == library for name in imports(here)), f"{here} no longer imports {library}"


def test_no_kind_is_named_outside_cameras() -> None:
    names = {kind.replace("_", "-") for kind in KINDS}
    strays = [
        f"{module}: {node.value!r}"
        for module, path in modules().items()
        if top(module) != "cameras"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in names
    ]
    assert not strays


def test_architecture_md_gives_this_order_and_names_existing_files() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    table = [line.split("|")[1] for line in page.partition("\n## ")[0].splitlines() if line.startswith("| `")]
    assert [name.rstrip("/") for cell in table for name in re.findall(r"`([^`]+)`", cell)] == list(ORDER[:-1])
    named = {name for name in re.findall(r"`([\w/]+(?:\.\w+|/))`", page) if "/" in name}
    folders = (PACKAGE, PACKAGE / "cameras", ROOT)
    assert not [name for name in sorted(named) if not any((folder / name).exists() for folder in folders)]
