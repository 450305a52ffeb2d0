"""Pages on the command line and on the variables of results, made from where the program declares them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

import typer.main

from tradestudy.cli import app
from tradestudy.results import GROUPS, PAPER, Variable

_GROUPS: Final = {
    "cameras": "What each camera is, how it measures, and which properties follow from its declared values.",
    "depth": """
Depth uncertainty and usable range of each camera that measures depth, for points on the axis at the distances of
`scene.distances`.

There is one *interval of depths* for the central 68.27 % of measured depths, and one for each further fraction in
`propagation.coverage`. An interval has no far end where too many measured depths lie beyond infinity.

`side`, a dimension of `depth_discrimination`, is the direction of the change of true depth: `nearer` to the camera or
`farther` from it. `part` names groups of errors, such as `noise` or `relative rotation`. `quantile` lists the
probabilities of the quantiles: 0.5, and those of both ends of every interval of depths. The dimension `interval`, by
contrast, counts the ranges of distance in which a camera is usable, from the nearest.

`limit` names the limits of the usable range. Those declared in `usable_range` have the names of their keys, except
`total_covering_plane` (key `virtual_depth`), `focus` (key `blur`) and `last_disparity_step` (key `disparity_step`).
`disparity_range` is declared for a rig (key `depth.disparity_range`). The others are not declared: `real_image` (the
lens forms a real image), and for derived disparity errors `saturation` (the brightest pixels are not saturated) and
`matching` (a real matcher can come close to the Cramér–Rao bound).
""",
    "depth_at_places": """
The variables of [`/depth`](#group-depth), at the distances of `decision.at`. Here, usable intervals are sought only
between the nearest and the farthest of these distances.
""",
    "budget": """
The uncertainty budget of each camera for points on the axis, after the GUM (JCGM 100:2008), at the distances of
`decision.at` or, without it, at up to four of `scene.distances`; a sweep without `decision.at` has none. `source` lists
the uncertain inputs and the correlated pairs of these, such as `mla_distance and focal_length`.
[What a budget says](../../explanation/uncertainty.md#the-uncertainty-budget) explains the rules.
""",
    "depth_field": """
Variables of [`/depth`](#group-depth) off the axis. `field` lists the field positions of `propagation.field_places`, and
`corner` the corners of the picture towards which they lie, as seen by the camera.
""",
    "depth_map": """
Depth uncertainty over the picture of each stereo rig with a lens model, at up to four of the distances of
`scene.distances`. The picture is that of an imaginary camera midway between the two of the rig. `across` and `down` are
coordinates from its middle, in units of half its width and half its height.
""",
    "disparity_causes": """
What makes each derived disparity error as large as it is, at the distances of `decision.at` or, without it, at up to
four of `scene.distances`. These variables include even effects whose influence is below the tolerance; other results
leave those out. `change` names the one cause that is changed: `no blur`, `no diffraction`, `light of the brightest`
(the light that `brightest_camera` collects) or `ten times the light`. For an unfocused plenoptic camera, 1 px is one
microlens.
""",
    "depth_loop": """
Depth measured in rendered pictures of planes, compared with the true depth and the predicted depth uncertainty.
`contrast` and `electrons` list the values of `depth_loop.contrasts` and `depth_loop.electrons`.

A *point* is a pixel of the depth map that a camera computes; where the estimator uses only microlenses of the type
that is sharpest at the distance of the point, a pixel counts only if it lies behind a microlens of that type. A point
is *seen* if nothing hides it, its true depth lies within the distances that the estimator searches, and at least two
of the pictures that the estimator compares show it. The *depth error* is measured minus true depth, at seen points.
The *predicted depth uncertainty* is the depth uncertainty from matching noise alone, at the true depth of the point,
for a texture with the declared statistics. The *standard deviation of depth due to noise* follows, to first order,
from the texture that the matching window of the point actually shows. Standard errors by *a jackknife* follow from
leaving out one of 4 × 4 parts of the depth map at a time, and are good to about 20 %. They are NaN where the quantity
itself is NaN, and where fewer than three parts have measured points.
""",
    "depth_of_field": """
Where each camera is sharp, and how finely it resolves the object. `sharp` names the blur criteria of
`depth_of_field.criteria`. The sharp range is computed for each *slice* of what a camera records: one picture of a
focus stack, what one type of microlens sees or, for any other camera, everything that it sees. A slice is sharp over
one range of distances, or nowhere. `stretch`, `gap`, `overlap` and `resolved` are indices of ranges of distance,
counted from the nearest.
""",
    "refocusing": """
On which planes each unfocused plenoptic camera can refocus by shifting its views, both depths of field there, and
baselines and disparities of pairs of views. `plane` is an index of refocused planes: those of `refocusing.shifts`, or
all distinct planes, from the nearest. `pair` is an index of pairs of views. The largest blur, `refocusing.blur`, is the
attribute `blur_px`. Distances count from where all distances of the camera count, unless a name says otherwise;
[Two depths of field](../../explanation/refocusing.md) explains the limits by rays and by blur.
""",
    "criteria": """
Criteria besides depth by which the study compares cameras (along `criterion`); the weighted criteria of
`trade_off.criteria` (along `weighed`), and the ranks of the candidates for all possible weights of these.
""",
    "decision": """
Which camera is best at which distance and under which reading, and where that changes. The *main pair* is the two
cameras of `decision.between`. Two depth uncertainties are *equal within their error* if their difference is at most
the root sum of squares of their errors, after standard errors over scrambles are multiplied by 5.4. (With eight
scrambles, chance alone causes a deviation of more than 5.4 standard errors once in a thousand.)

`place` lists the distances of `decision.at`, `pair` the pairs of `decision.compare` (or the main pair), and `question`
the questions of `solve`. `change` and `crossing` are indices of changes and crossovers, counted from the nearest.
`rank_distance` and `rank_error_source` are the distances and error sources for which the cameras of a pair are
compared. `design_place` and `design_crossing` are `place` and `crossing` for the designs of a sweep.
""",
    "calibration": """
Calibrations that the program fits to the corners of a calibration board (stereo rigs) or to a simulated target, by
Markov-chain Monte Carlo, which draws values of the parameters from the posterior. The labels of the
dimension `posterior` are the names of the cameras.
Parameters are in SI units or, if their names end in `_px`, in pixels.

An *ensemble* is a group of chains that is independent of the other groups; `ensemble` is its index. *R-hat* is near 1
if the ensembles, or the chains of one ensemble, agree with each other. The *effective sample size* is the number of
independent draws that would determine the result equally well.

Variables whose names begin with `rig_` concern stereo rigs calibrated from corners. The depths in them are those of
points straight ahead of the midpoint of the baseline, at the distances `rig_distance`.
""",
    "sensitivity": """
How much each error contributes to the depth uncertainty, at the distances of `sensitivity.at`. `field` lists the axis
(0) and the field positions of `propagation.field_places`, each towards the corner of the picture where depth is least
certain. `source` names the error sources, which are independent of
each other. Each is matching noise, the error of a single parameter, or the joint error of a group of correlated
parameters.
""",
    "fresnel_validity": """
The smallest f-number at which Fresnel's approximation may replace Kirchhoff's integral, for each lens (`element`).

`metric` names three measures of the difference between the point-spread functions by Fresnel's approximation and by
Kirchhoff's integral, relative to the latter: `peak`, the difference at the thin-lens image point, divided by the
intensity there; `l1`, the integral of the absolute difference over a window, divided by the integral of the intensity;
and `largest`, the largest difference in the window, divided by the largest intensity. `window` is the radius of the
window about the thin-lens image point, in Airy radii. `lens_phase` says how the lens delays the wave: `parabolic`,
`stigmatic` or `perfect`, as listed in `fresnel_validity.lens_phases`.

In equations, f is the focal length, a the distance of the object, b that of the image, and λ the wavelength. Of the
solutions of eq. 27 of the paper, `zero` lists the two with the smallest apertures: the `first`, with the smallest
aperture and thus the largest f-number, and the `second`, which the paper takes. `quarter_wave` is the fractional part
of 4 (a + b)/λ. `path_error` lists the values of `fresnel_validity.path_errors`.
""",
    "images": """
The image that a main lens and microlenses form of a light spot, by each method of `light_spot.methods` or, without
that key, by the one method that the program chooses. The dimensions `propagator` and `against` both run over these
methods. `row` and `column` are the coordinates of the pixel centres on the detector. `benchmark` names the
computations whose duration `light_spot.benchmarks` measures; `run.json` contains the times.
""",
    "point_spread": """
The image that each lens (along `element`) forms of a point, as computed by each method (along `propagator`). One
input at a time varies: `varied` names it, and `step` is the index of its value. Circles, discs and the *computed
square*, declared by `point_spread.window`, are centred on the thin-lens image.
""",
    "hard_cases": "Cases in which textbook formulas lose precision, and what this program computes in each.",
    "effects": """
Which model of each effect was chosen, and how much the others would have changed the answers. A *problem* is a part of
the study with models of its own: a camera, its pictures, a light path, the point spread or the depth of field.
The dimension `decision` (not the study key of this name) lists every model of every effect of each problem, and
`quantity` the quantities that have tolerances under `accuracy`.
""",
    "cost": """
Error and computing time of the sets of models with which the answers of a study can be computed; the command
[`cost`](#command-cost) measures the same. Only `run --with-cost` stores this group; `cost` writes `cost.json` and
`cost.svg` instead. A *problem* is a camera or a light path; an *entry* is one set of models for a problem.
""",
    "claims": "Published statements, declared in `claims`, each compared with the results under its readings.",
    "measurements": """
Measured depth errors, declared in `measurements`, beside the predicted ones, and what they imply about the camera.
`row` counts the rows of all tables, and `point` the points of a curve. `statistic` lists `median`, `smallest` and
`largest`; `end`, the ends `low` and `high` of a 95 % interval. Fits use the change of disparity with depth of the
camera as declared.
""",
    "datasheet": """
Each camera in the terms of depth-camera data sheets, at up to five distances (`sheet_distance`): those of `decision.at`
(of more than five, five spread evenly through the list); if there are fewer than three, also the ends of
`scene.distances` and their geometric mean.
""",
    "pictures": """
Rendered pictures of the scene and, for the cameras along `mapped_camera`, depth measured in them. The terms are those
of [`/depth_loop`](#group-depth_loop), but the predicted depth uncertainty includes calibration errors if
`scene.image.rig` is `drawn`. The measured points, sorted by true depth, form six *classes* (along `depth_class`) of
equally many points.
""",
    "requirements": """
What the study requires, and whether the cameras meet it. In a sweep, the dimension `stretch` numbers the ranges of the
varied parameter in which the same camera meets the requirement throughout.

Variables whose names begin with `bound_alone_` tell what the answer would be if matching reached its Cramér–Rao bound,
without the errors of a declared matcher.
""",
    "value_of_information": """
How much knowing the true value of each assumption would improve the choice of a camera. The values of all assumptions
are drawn at random together. The *utility* of a camera is minus its relative depth uncertainty, averaged over the
distances of `value_of_information.at` (the dimension `place`). At a distance where a camera is not usable, or where
its relative depth uncertainty exceeds `value_of_information.unusable`, the value of this key counts instead. The
attribute `draws` of the group is the number of draws.
""",
    "assumptions": """
Every value of the study with its basis. `path` is the place of the value in the study file; for values of cameras, it
leaves out `cameras` and the name of the camera.
""",
    "contradictions": "Inputs that contradict each other, and the value that the program uses.",
}
"""What each group holds, and the terms that its variables share."""
_ESTIMATE: Final = "itself an error estimate"  # needs no explanation beside its own name


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
        lines += ["", _code(" ".join(command.help.split())), ""]
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
        lines += [f"(group-{group})=", f"## /{group}", "", _GROUPS[group].strip(), ""]
        for name, variable in variables.items():
            if group != "depth_at_places":
                lines += [*_variable(name, variable), ""]
    return "\n".join(lines)


def _variable(name: str, one: Variable) -> Iterator[str]:
    dims = f" ({', '.join(one.dims)})" if one.dims else ""
    unit = f" [{one.units}]" if one.units not in ("", "1") else ""
    yield f"`{name}`{dims}{unit}"
    if one.described_in:
        yield f": As in [`/{one.described_in}`](#group-{one.described_in})."
        return
    yield f": {_sentence(one.comment)}"
    facts = {
        "Symbol": f"{one.symbol}.",
        "Source": _sentence(one.reference.replace(PAPER, "the paper")) if one.reference else ".",
        "Error": _sentence(one.error) if one.error not in ("", _ESTIMATE) else ".",
    }
    reported = " ".join(f"*{title}:* {text}" for title, text in facts.items() if text != ".")
    if reported:
        yield ""
        yield f"  {reported}"


def _sentence(text: str) -> str:
    """A description as a sentence of Markdown, with names of variables as code; one at its beginning stays as it is.

    Names of groups become links, and quoted values lose their quotes, which only text without markup needs.
    """
    escaped = text.replace("*", "\\*").replace("<", "&lt;")
    begins_with_name = "_" in text.split(" ", 1)[0]
    sentence = escaped if begins_with_name else escaped[:1].upper() + escaped[1:]
    groups = rf"(?<![\w`])/({'|'.join(GROUPS)})\b"
    return re.sub(groups, r"[`/\1`](#group-\1)", re.sub("`'([^'`]+)'`", r"`\1`", _code(sentence))) + "."


def _code(text: str) -> str:
    """Mark values in quotes, options, and names of keys, variables and files, as code, which typesetting leaves alone.

    A single word loses its quotes, which only text without markup needs.
    """
    value = r"(?:(?<!\S)\S+=|(?<![\w`]))'[^']+'(?!\w)"  # the lookarounds spare the apostrophes of possessives
    option = r"(?<![\w`-])--[a-z][\w-]*"
    marked = re.sub(rf"{value}|{option}|(?<![\w/`])[a-z]\w*(?:[._=][a-z0-9]\w*)+", r"`\g<0>`", text)
    return re.sub(r"`'([^'`\s]+)'`", r"`\1`", marked)


_COMMAND_LINE: Final = """
`tradestudy COMMAND` and `python -m tradestudy COMMAND` do the same. `--help` after a command prints what this page
says about that command, and `python -m tradestudy --version` prints the version.

| exit status | means |
|---|---|
| 0 | done |
| 1 | a failure other than those below |
| 2 | the input is wrong, or asks for more than can be computed |
| 3 | with `--strict`, a requirement that must hold is missed or undecided, or a calibration did not converge |
| 130 | interrupted; the next run continues from the finished parts |
"""

_RESULTS: Final = """
A run writes `results.nc`, a netCDF4 file. It contains `/cameras` and those of the groups below that the study needs.
With `result = tradestudy.open_result(folder)`, `result.data` is the whole file as an xarray `DataTree`, and
`result.table(name)` is one table as a pandas data frame; see [From Python](/how-to/python.md).

Each entry below gives the name of a variable, its dimensions in parentheses and its unit in brackets: an SI unit, `px`,
`electrons`, `percent`, or `mixed` if the unit differs from value to value. A variable without brackets is a plain
number or text. The description is the attribute `comment` of the variable; *Symbol*, *Source* and *Error* are its
attributes `symbol`, `reference` and `error`. `long_name` is a short name, with which xarray labels plots, and
`ancillary_variables` names the variable with the error, if one holds it. Where a source is
{term}`the paper <paper, the>`, the attribute gives its title.

*Error* says how large the error of a value may be:

| error | means |
|---|---|
| see `name` | the variable of this name holds the error, in the same unit unless its entry says that it is relative |
| see `name` of `/group` | the same, but the variable is in another group |
| rounding only | the value follows from the inputs in closed form |
| none | nothing is uncertain; the text gives the reason, for example that the value is declared or that it is a count |
| not estimated, not stored | no variable holds the error; the text says where the error comes from, how large it \
is, or what indicates its size |
| other text | states the error itself, or says that the value is itself an error estimate, and of what kind |

A variable without *Error* is a text, a flag (1 or true for yes, 0 or false for no, in some −1 for undecided) or an
error estimate that needs no explanation, or its error is not known.

The labels of dimensions such as `camera`, `reading`, `claim` and `requirement` are keys of the study file; the label
`as declared` of `reading` stands for the study as declared. The labels of `error_source` are `noise` (matching noise
alone), `calibration` (errors of calibration and drift together, without noise) and `both` (noise and these errors
together). In a sweep, the variables of `/depth`, those whose names begin with `design_`, and `feasible` and
`on_pareto_front` of `/criteria` also have the swept parameters as dimensions, before those given here. A dimension has
the last word of its parameter's path, such as `baseline` for `stereo.baseline`, or as many words as distinguish it from
others; its attribute `path` is the path, and `declared` the value that the study declares. Variables whose
names begin with `met_` describe ranges of the swept parameter; all others hold for the study as declared, or as a
reading changes it. Numeric labels of dimensions are in SI units, with exceptions such as `window` (in Airy radii) and
`path_error` (in wavelengths).

A *scramble* is one of several repetitions of a computation, each with its own quasi-random draws. A standard error
*over scrambles* follows from the differences between them.
"""
