"""What `tradestudy.optics` offers: found by `dir`, loaded when asked for, and explained by examples that run."""

from __future__ import annotations

import doctest
import inspect
import subprocess
import sys

import pytest

from tradestudy import optics

FUNCTIONS = [name for name in optics.__all__ if inspect.isfunction(getattr(optics, name))]
EXAMPLES = [
    example
    for name in optics.__all__
    if inspect.isclass(getattr(optics, name)) or inspect.isfunction(getattr(optics, name))
    for example in doctest.DocTestFinder(recurse=False).find(getattr(optics, name), name, globs={})
] + doctest.DocTestFinder(recurse=False).find(optics, "optics", globs={})


def test_the_package_lists_exactly_its_public_names() -> None:
    assert dir(optics) == sorted(optics.__all__)
    assert not [name for name in dir(optics) if name.startswith("_") or inspect.ismodule(getattr(optics, name))]
    with pytest.raises(AttributeError, match="no attribute 'point_spreed'"):
        optics.point_spreed  # noqa: B018


def test_importing_it_loads_no_heavy_library() -> None:
    code = (
        "import sys, tradestudy.optics.airy; from tradestudy.optics import arrays; "
        "print([m for m in ('scipy', 'finufft', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_docstring_gives_law_parameters_result_errors_source_and_example(name: str) -> None:
    text = inspect.getdoc(getattr(optics, name))
    assert text is not None
    required = ("Parameters", "Returns", "Raises", "References", "Examples")
    assert [section for section in required if f"\n{section}\n---" not in text] == []


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda one: one.name)
def test_examples_run(example: doctest.DocTest) -> None:
    assert example.examples, "no example"
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    runner.run(example, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
