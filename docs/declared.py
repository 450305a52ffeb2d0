"""Pages on the command line and on the variables of results, made from where the program declares them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

import typer.main

from tradestudy.cli import app
from tradestudy.results import GROUPS, Variable

_GROUPS: Final = {
    "cameras": "What every camera is, how it measures, and which properties follow from its inputs.",
    "depth": "Depth uncertainty and usable range of every camera that measures depth, at all distances of the scene.",
    "depth_at_places": "The variables of `/depth`, at the distances of `decision.at`.",
    "depth_field": "Variables of `/depth` off the axis, at the field positions of `propagation.field_places`.",
    "depth_map": "Depth uncertainty over the whole picture of each stereo rig whose lenses have a distortion model.",
    "disparity_causes": "What a derived disparity error results from.",
    "depth_loop": "Depth measured in rendered pictures of planes, compared with the prediction.",
    "depth_of_field": "Where each camera is sharp by each blur criterion, and how finely it resolves the object.",
    "criteria": "Criteria that compare cameras besides depth, and the ranks of cameras over all possible weights.",
    "decision": "Which camera is best at which distance and under which reading, and where that changes.",
    "calibration": "Calibrations fitted to corners or inferred from targets, and how far they can be trusted.",
    "sensitivity": "How much each input contributes to the depth uncertainty.",
    "fresnel_validity": "From which f-number Fresnel may replace Kirchhoff.",
    "images": "The picture of a light spot behind a main lens and microlenses, by each method.",
    "point_spread": "The image of a point behind each lens, while one input at a time is varied.",
    "hard_cases": "Cases in which textbook formulas lose precision, and what this program computes in each.",
    "effects": "Which model of each effect was chosen, and how much the other models would have changed the answers.",
    "cost": "Error and computing time of each set of models that can answer the study.",
    "claims": "Published statements, each compared with the results.",
    "datasheet": "The numbers that data sheets of depth cameras state.",
    "pictures": "Pictures of the scene, and depth measured in them.",
    "requirements": "What the study requires, and whether it is met.",
    "value_of_information": "What knowing each assumption would be worth.",
    "assumptions": "Every value of the study with its basis.",
    "contradictions": "Inputs that contradict each other, and the one that is used.",
}


def command_line_page() -> str:
    """Every command with its arguments and options, as the command line itself explains them."""
    program: Any = typer.main.get_command(app)
    lines = ["# The command line", "", *_COMMAND_LINE.strip().splitlines(), ""]
    for name, command in program.commands.items():
        arguments = " ".join(_argument(one) for one in command.params if one.param_type_name == "argument")
        lines += [
            f"(command-{name})=",
            f"## {name}",
            "",
            f"`python -m tradestudy {name} {arguments}`".replace(" `", "`"),
        ]
        lines += ["", _code(command.help.replace("\n", " ")), ""]
        for one in command.params:
            if one.param_type_name == "option" and "--help" not in one.opts:
                lines += [*_option(one), ""]
            elif one.param_type_name == "argument":
                lines += [f"`{_argument(one)}`", f": {one.help}", ""]
    return "\n".join(lines)


def _argument(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper())


def _option(option: Any) -> Iterator[str]:
    written = option.opts[0] if option.is_flag else f"{option.opts[0]} {option.metavar or option.name.upper()}"
    default = option.show_default if isinstance(option.show_default, str) else option.default
    yield f"`{written}`"
    text = default if isinstance(default, str) else f"{default:g}" if isinstance(default, float) else str(default)
    yield f": {_code(option.help)}" + ("" if option.is_flag or default in (None, ()) else f" Default: {text}.")


def results_page() -> str:
    """Every variable of `results.nc`."""
    lines = ["# Results", "", *_RESULTS.strip().splitlines(), ""]
    for group, variables in GROUPS.items():
        lines += [f"(group-{group})=", f"## /{group}", "", _GROUPS[group], ""]
        for name, one in _own(group, variables).items():
            lines += [*_variable(name, one), ""]
    return "\n".join(lines)


def _own(group: str, variables: Mapping[str, Variable]) -> Mapping[str, Variable]:
    return {} if group == "depth_at_places" else variables


def _variable(name: str, one: Variable) -> Iterator[str]:
    dims = f" ({', '.join(one.dims)})" if one.dims else ""
    unit = f" [{one.units}]" if one.units not in ("", "1") else ""
    yield f"`{name}`{dims}{unit}"
    yield f": {_sentence(one.long_name)}"
    facts = {
        "Symbol": f"{one.symbol}.",
        "Source": _sentence(one.reference) if one.reference else ".",
        "Error": _sentence(one.error) if one.error else ".",
    }
    reported = " ".join(f"*{title}:* {text}" for title, text in facts.items() if text != ".")
    if reported:
        yield ""
        yield f"  {reported}"


def _sentence(text: str) -> str:
    """A description as a sentence of Markdown, with names of variables as code; one at its beginning stays as it is."""
    escaped = text.replace("*", "\\*").replace("<", "&lt;")
    begins_with_name = "_" in text.split(" ", 1)[0]
    sentence = escaped if begins_with_name else escaped[:1].upper() + escaped[1:]
    return _code(sentence) + "."


def _code(text: str) -> str:
    """Mark values in quotes, and names of keys, variables and files, as code; typesetting would change their quotes."""
    value = r"(?:(?<!\S)\S+=|(?<![\w`]))'[^']+'(?!\w)"  # the lookarounds spare the apostrophes of possessives
    return re.sub(rf"{value}|(?<![\w/`])[a-z]\w*(?:[._=][a-z0-9]\w*)+", r"`\g<0>`", text)


_COMMAND_LINE: Final = """
`tradestudy COMMAND` and `python -m tradestudy COMMAND` do the same. `--help` after a command prints what this page
says about it, and `python -m tradestudy --version` prints the version.

| exit status | means |
|---|---|
| 0 | done |
| 1 | any other error; one line says what happened and names a log file |
| 2 | the input is wrong, or asks for an accuracy that cannot be reached |
| 3 | with `--strict`, a requirement that must hold is missed or undecided |
| 130 | interrupted; finished parts are kept |
"""

_RESULTS: Final = """
A run writes `results.nc`, a netCDF4 file. This page lists its groups; a file contains `/cameras` and those that its
study needs. After the name of a variable stand its dimensions (in parentheses) and its unit (in brackets): SI, or
`mixed` where each entry has its own unit. The attributes of each variable are `units`, `long_name`, `symbol`,
`reference` and `error`. In a sweep, each variable also has one dimension for every parameter that varies, before those
listed.

Standard errors *over scrambles* come from repeating a computation with independently scrambled quasi-random draws; a
*scramble* is one of these repetitions. The *main pair* consists of the two cameras in `decision.between`.

`tradestudy.open_result(folder).data` is the whole file as an xarray `DataTree`, and `.table(name)` one table of it as a
pandas data frame; see [Work in Python and notebooks](/how-to/python.md).
"""
