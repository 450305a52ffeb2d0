"""The way of the data is the way of the folders: imports go downward only, and heavy libraries stay in their rooms."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "tradestudy"

# A module may import from its own layer's room and from every layer below it (smaller number).
LAYERS = {
    "errors": 1, "units": 1, "light_methods": 1, "wording": 1, "optics": 1,
    "cameras": 2, "scene": 2, "accuracy": 2, "machine": 2,
    "effects": 3, "uncertainty": 3, "imaging": 3, "verification": 3,
    "results": 4, "storage": 4, "study": 5, "cost": 6,
    "comparison": 5, "figures": 5, "report": 6,
    "provenance": 1, "api": 7, "cli": 8, "__main__": 9,
}  # fmt: skip
SAME_LAYER = {
    ("errors", "units"),
    ("units", "errors"),
    ("wording", "units"),
    ("optics", "errors"),
    ("optics", "units"),
    ("storage", "results"),
}
READ_RESULTS_ONLY = {"figures", "report"}
MAY_BE_READ = {"errors", "units", "light_methods", "wording", "results", "storage", "figures", "report"}

# library → rooms that may import it; every other room must go through them.
HEAVY = {
    "pydantic": {"study/schema", "study/mistakes.py"},
    "xarray": {"results", "storage", "study", "cost", "comparison", "figures", "report", "api", "cli"},
    "matplotlib": {"figures"},
    "typst": {"report"},
    "jinja2": {"report"},
    "ruamel": {"study"},
    "pint": {"units"},
    "typer": {"cli"},
    "rich": {"cli"},
    "emcee": {"uncertainty"},
}
# place → why it may break a rule above.
EXCEPTIONS = {
    ("api.py", "matplotlib"): "names the type of a figure for the reader of its signature; imported for typing only",
}


def modules() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py"))


def imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide the direction"
            base = node.module or ""
            names |= {f"{base}.{alias.name}" for alias in node.names} if base == "tradestudy" else {base}
    return names


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_go_downward(path: Path) -> None:
    here = room(path)
    if here == "__init__":
        return  # the package's face names the facade lazily
    assert here in LAYERS, f"{here} has no layer: give it one"
    for name in imports(path):
        parts = name.split(".")
        if parts[0] != "tradestudy" or len(parts) < 2 or parts[1] == here:
            continue
        there = parts[1]
        assert LAYERS[there] < LAYERS[here] or (here, there) in SAME_LAYER, f"{path.name} imports {name}: upward"
        if here in READ_RESULTS_ONLY:
            assert there in MAY_BE_READ, f"{path.name} imports {name}: figures and reports read results only"


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_heavy_libraries_stay_in_their_rooms(path: Path) -> None:
    place = path.relative_to(PACKAGE).as_posix()
    for name in imports(path):
        library = name.split(".")[0]
        allowed = HEAVY.get(library)
        if allowed is None or (place, library) in EXCEPTIONS:
            continue
        assert any(place == room_ or place.startswith((f"{room_}/", f"{room_}.py")) for room_ in allowed), (
            f"{place} imports {library}, which belongs to {sorted(allowed)}"
        )


def test_every_exception_is_still_needed() -> None:
    for place, library in EXCEPTIONS:
        path = PACKAGE / place
        assert path.is_file(), f"{place} is gone: drop its exception"
        assert any(name.split(".")[0] == library for name in imports(path)), f"{place} no longer imports {library}"
