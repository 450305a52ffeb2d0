"""Every docstring within reach of `tradestudy.optics` names its arguments, units, errors and examples."""

from __future__ import annotations

import ast
import doctest
import inspect
import re
import textwrap
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import Any

import pytest

from tradestudy import optics

SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "References", "Examples")
UNIT = re.compile(r"\[(?!\d*[,\]])[^\]]+\]|\[1\]")
DIMENSIONLESS = re.compile(r"[Ff]raction|[Ff]actor|[Rr]elative")
NUMERIC = re.compile(r"^(?!Callable).*(float|FloatArray|ComplexArray|ArrayLike|\bArray\b|PupilMap)")


@dataclass(frozen=True)
class Documented:
    """One public function, class, method or property."""

    name: str
    kind: str
    value: Any

    @cached_property
    def text(self) -> str:
        return inspect.getdoc(self.value) or ""

    def section(self, title: str) -> str:
        """Text of a section, empty where there is none."""
        _, _, rest = self.text.partition(f"\n{title}\n{'-' * len(title)}\n")
        return re.split(rf"\n(?:{'|'.join(SECTIONS)})\n---", rest)[0]

    def entries(self, *titles: str) -> dict[str, str]:
        """Description of each argument or attribute."""
        found: dict[str, str] = {}
        for title in titles:
            for names, description in re.findall(
                r"^(\w[\w, ]*)\n((?:    .*\n?|\n)+)", self.section(title), re.MULTILINE
            ):
                found |= dict.fromkeys(names.split(", "), description)
        return found

    @property
    def parameters(self) -> dict[str, str]:
        """Annotation of each argument."""
        if self.kind == "class":
            return (
                {one.name: str(one.type) for one in fields(self.value) if one.init} if is_dataclass(self.value) else {}
            )
        arguments = inspect.signature(self.value).parameters
        return {name: str(one.annotation) for name, one in arguments.items() if name not in ("self", "cls")}

    @property
    def returned(self) -> str:
        return "" if self.kind == "class" else str(inspect.signature(self.value).return_annotation)


def members(cls: type) -> Iterator[Documented]:
    for owner in cls.__mro__:
        for name, member in vars(owner).items():
            if name.startswith("_") or not owner.__module__.startswith("tradestudy"):
                continue
            function = (
                getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
            )
            if inspect.isfunction(function):
                kind = "property" if isinstance(member, (property, cached_property)) else "method"
                yield Documented(f"{owner.__name__}.{name}", kind, function)


def classes_in(hint: Any) -> Iterator[type]:
    if isinstance(hint, type):
        yield hint
    for part in typing.get_args(hint):
        yield from classes_in(part)


def within_reach() -> dict[str, Documented]:
    """All that users of the package see: its names, and, of classes, what their members and results are."""
    found: dict[str, Documented] = {}
    waiting: list[Any] = [getattr(optics, name) for name in optics.__all__]
    while waiting:
        value = waiting.pop()
        if not (inspect.isclass(value) or inspect.isfunction(value)) or value.__name__ in found:
            continue
        kind = "class" if inspect.isclass(value) else "function"
        here = [Documented(value.__name__, kind, value), *(members(value) if kind == "class" else ())]
        found |= {one.name: one for one in here}
        for one in here:
            if not one.name.endswith(".plot"):  # its figure belongs to matplotlib, which types alone load
                hints = typing.get_type_hints(one.value)
                seen = hints.values() if one.kind == "class" else [hints.get("return")]
                waiting += [c for hint in seen for c in classes_in(hint) if c.__module__.startswith("tradestudy")]
    return found


ALL = within_reach()
EXAMPLES = {
    name: "\n".join(example.source for example in doctest.DocTestParser().get_examples(one.text))
    for name, one in ALL.items()
}


def referred(one: Documented) -> Documented | None:
    """The docstring that explains the same arguments, as in "as in `Class.method`"."""
    found = re.search(r"as in\s+`(\w+\.\w+)`", one.text)
    return ALL[found[1]] if found else None


def described(one: Documented) -> dict[str, str]:
    """Description of each argument; "As in `name`" adds the description found there."""
    other = referred(one)
    own = one.entries("Parameters", "Attributes") or (other.entries("Parameters") if other else {})
    references = {key: re.search(r"As in `(\w+)`", text) for key, text in own.items()}
    return {
        key: text + (ALL[where[1]].entries("Parameters").get(key, "") if (where := references[key]) else "")
        for key, text in own.items()
    }


@pytest.mark.parametrize("name", ["optics", *(name for name in ALL if EXAMPLES[name])])
def test_its_example_runs(name: str) -> None:
    text = inspect.getdoc(optics if name == "optics" else ALL[name].value) or ""
    example = doctest.DocTestParser().get_doctest(text, {}, name, None, None)
    assert example.examples
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    said: list[str] = []
    runner.run(example, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)


@pytest.mark.parametrize("name", [name for name, one in ALL.items() if one.kind == "function"])
def test_a_function_gives_law_arguments_result_errors_source_and_example(name: str) -> None:
    required = ("Parameters", "Returns", "Raises", "References", "Examples")
    assert [title for title in required if not ALL[name].section(title).strip()] == []


def test_it_reaches_results_and_their_members() -> None:
    assert {"point_spread", "Measured", "LensPointSpread.width", "PointSpread.at", "NumericalError", "Effort"} <= set(
        ALL
    )
    assert len(ALL) > 120


@pytest.mark.parametrize("name", ALL)
def test_it_describes_exactly_its_arguments(name: str) -> None:
    one = ALL[name]
    assert one.text, "no docstring"
    if one.parameters:
        assert sorted(described(one)) == sorted(one.parameters)


@pytest.mark.parametrize("name", ALL)
def test_it_gives_the_unit_of_every_number(name: str) -> None:
    one = ALL[name]
    numbers = {key: text for key, text in described(one).items() if NUMERIC.search(one.parameters.get(key, ""))}
    if NUMERIC.search(one.returned):
        numbers["result"] = one.section("Returns") or one.text
    assert [key for key, text in numbers.items() if not (UNIT.search(text) or DIMENSIONLESS.search(text))] == []


@pytest.mark.parametrize("name", ALL)
def test_it_lists_the_errors_that_it_raises(name: str) -> None:
    one = ALL[name]
    checked = getattr(one.value, "__post_init__", None) if one.kind == "class" else one.value
    tree = ast.parse(textwrap.dedent(inspect.getsource(inspect.unwrap(checked)))) if checked else ast.Module([], [])
    calls = [node.exc.func for node in ast.walk(tree) if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)]
    raised = {call.id for call in calls if isinstance(call, ast.Name)}
    assert [error for error in raised if error not in one.section("Raises")] == []


RESULTS: tuple[str, ...] = ("Measured", "ApertureField", "ChainImage", "LensPointSpread", "PointSpread", "float")


@pytest.mark.parametrize("name", [name for name, one in ALL.items() if one.kind in ("function", "method")])
def test_a_computed_number_states_its_error(name: str) -> None:
    one = ALL[name]
    if one.returned in RESULTS and one.kind == "function":
        assert re.search("error|unchanged", one.section("Returns"))
    if one.kind == "method" and one.returned == "Measured":
        assert "error" in one.section("Returns")


@pytest.mark.parametrize("name", [name for name, one in ALL.items() if one.kind != "property"])
def test_an_example_uses_it(name: str) -> None:
    one = ALL[name]
    assert EXAMPLES[name] or one.kind == "method", "no example of its own"
    if one.kind == "method":
        owner, method = name.split(".")
        assert re.search(rf"\.{method}\(", EXAMPLES[owner] + EXAMPLES[name])


def check_of(function: Callable[..., Any], docstring: str) -> Documented:
    function.__doc__ = docstring
    return Documented(function.__name__, "function", function)


def test_the_checks_see_a_missing_argument_and_a_missing_unit() -> None:
    def sample(radius: float, share: float) -> float: ...

    sample.__annotations__ = {"radius": "float", "share": "float", "return": "float"}
    one = check_of(
        sample, "Law.\n\nParameters\n----------\nradius\n    Radius.\n\nReturns\n-------\nfloat\n    Area [m²].\n"
    )
    assert sorted(described(one)) != sorted(one.parameters)
    assert not UNIT.search(one.entries("Parameters")["radius"])
    assert UNIT.search(one.section("Returns"))
    assert not UNIT.search("pixel [0, 0] of index [3]")
