"""The command line: ``python -m tradestudy`` and ``tradestudy``."""

from __future__ import annotations

import atexit
import gc
import logging
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import tradestudy
from tradestudy.console import INTERRUPTED, prepare_streams, reporting_errors, say, warned
from tradestudy.errors import OutOfRangeError, RequirementsNotMetError, StudyError, TradestudyError
from tradestudy.models import DEFAULT_BUDGET
from tradestudy.shown_progress import shown_progress
from tradestudy.wording import json_text

if TYPE_CHECKING:
    from tradestudy.execution import Executor

_NEEDED_BY_WORKERS = ("tradestudy.answers.requirements", "tradestudy.answers.ranks")

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

StudyArgument = Annotated[Path, typer.Argument(metavar="STUDY", help="The study file.", show_default=False)]
DirectoryArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished run.", show_default=False)]


def _output_folder(default: str) -> object:
    name = "where NAME consists of the name of the study and of any values changed on the command line"
    return typer.Option("--out", metavar="DIR", help="Output folder.", show_default=f"{default}, {name}")


OutOption = Annotated[Path | None, _output_folder("reports/NAME")]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="For this command only, replace the value at PATH, as in stereo-short.baseline='50 mm'. PATH consists of "
        "the keys that lead to the value, joined by dots; if the first key is 'cameras', it may be left out. If VALUE "
        "is a mapping in braces, its keys are merged into the mapping at PATH; if VALUE is null, the value at PATH is "
        "removed. May be repeated.",
    ),
]
ToleranceOption = Annotated[
    str | None,
    typer.Option(
        "--tolerance",
        metavar="X",
        help="Use this tolerance, such as '1 %', for every quantity instead of the study's tolerances.",
        show_default=False,
    ),
]
JobsOption = Annotated[
    int | None, typer.Option("--jobs", metavar="N", help="Compute on N worker processes.", show_default=False)
]
ThreadsOption = Annotated[
    int | None, typer.Option("--threads", metavar="N", help="Compute on N threads.", show_default=False)
]
DaskOption = Annotated[
    str | None,
    typer.Option(
        "--dask", metavar="ADDRESS", help="Compute on the Dask cluster at ADDRESS, of the form tcp://HOST:PORT."
    ),
]
FreshOption = Annotated[bool, typer.Option("--fresh", help="Ignore the results of earlier runs.")]
NoPdfOption = Annotated[
    bool, typer.Option("--no-pdf", help="Do not write report.pdf, and remove that of an earlier report.")
]
LargeTablesOption = Annotated[
    bool, typer.Option("--large-tables", help="Also write tables/*.csv above 50 MB; other tables are always written.")
]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]
DebugOption = Annotated[bool, typer.Option("--debug", help="Show the Python traceback of an error.")]


def _print_version(requested: bool) -> None:
    """Print the version and exit, on request."""
    if requested:
        typer.echo(f"tradestudy {tradestudy.__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; the exit status says how it ended."""
    prepare_streams()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that SIGTERM ends a run as Ctrl-C does
    # Read when NumPy loads OpenBLAS, whose threads make no study faster and wait for each other beside busy cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(200_000, 20, 20)  # most objects live until the end: collect garbage rarely
    atexit.register(gc.freeze)  # and not at exit, where it takes half a second
    # Hidden until they are needed: xarray would import them for every run, only to ask whether arrays are theirs. An
    # xarray that a caller has imported knows already that they are there, and fails without them.
    if "xarray" not in sys.modules:
        sys.modules["dask"] = sys.modules["pint"] = None  # type: ignore[assignment]
    try:
        app()
    except KeyboardInterrupt:  # before a command has begun
        sys.exit(INTERRUPTED)


@app.callback()
def program(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_print_version, help="Show the version and exit.")
    ] = False,
) -> None:
    """Compare cameras that measure depth: how precise each one is at every distance, and what limits it."""


@app.command()
def run(
    study: StudyArgument,
    out: OutOption = None,
    set_: SetOption = None,
    tolerance: ToleranceOption = None,
    jobs: JobsOption = None,
    threads: ThreadsOption = None,
    dask: DaskOption = None,
    fresh: FreshOption = False,
    no_pdf: NoPdfOption = False,
    large_tables: LargeTablesOption = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Exit with status 3 if a requirement that must hold is missed or undecided, or a calibration did not "
            "converge.",
        ),
    ] = False,
    with_cost: Annotated[
        bool,
        typer.Option(
            "--with-cost",
            help="Also measure the error and computing time of the sets of models with which the study can be "
            "computed, and show these measurements in the report.",
        ),
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the conclusions as one JSON object instead of lines.")
    ] = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Compute a study, write its report and print its conclusions."""
    with reporting_errors(debug=debug):
        from tradestudy import api

        loaded = warned(api.load(study, set_ or (), tolerance=tolerance), quiet=quiet)
        directory = out if out is not None else Path("reports") / loaded.folder_name
        with _executor(jobs=jobs, threads=threads, dask=dask) as executor, shown_progress(quiet=quiet) as progress:
            result = api.run(
                loaded,
                directory,
                fresh=fresh,
                pdf=not no_pdf,
                large_tables=large_tables,
                with_cost=with_cost,
                progress=progress,
                executor=executor,
            )
        if as_json:
            typer.echo(json_text(result.conclusions(directory)))
        elif not quiet:
            left_out = [] if large_tables else api.tables_left_out(result)
            say(*result.lines(), *left_out, f"Report: {directory / 'report.html'}")
        if strict and result.unmet_requirements:
            raise RequirementsNotMetError("requirements not met", value=", ".join(result.unmet_requirements))


@app.command()
def render(
    study: StudyArgument,
    out: OutOption = None,
    set_: SetOption = None,
    jobs: JobsOption = None,
    threads: ThreadsOption = None,
    dask: DaskOption = None,
    fresh: FreshOption = False,
    depth: Annotated[
        bool, typer.Option("--depth", help="Also measure depth in the pictures and compare it with the true depth.")
    ] = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Render the pictures of a study's scene; also write their true depth and a description of each camera."""
    with reporting_errors(debug=debug):
        from tradestudy import api

        loaded = warned(api.load(study, set_ or ()), quiet=quiet)
        directory = out if out is not None else Path("reports") / loaded.folder_name
        with _executor(jobs=jobs, threads=threads, dask=dask) as executor, shown_progress(quiet=quiet) as progress:
            done = api.render(loaded, directory, depth=depth, fresh=fresh, progress=progress, executor=executor)
        if not quiet:
            say(
                *map(str, done.pictures),
                *(line for camera, score in done.depths.items() for line in (score.line(camera), f"  {score.matcher}")),
            )


@app.command()
def export(
    study: StudyArgument,
    camera: Annotated[str, typer.Argument(metavar="CAMERA", help="Name of the camera.", show_default=False)],
    out: Annotated[Path | None, _output_folder("reports/NAME/cameras")] = None,
    set_: SetOption = None,
    formats: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="NAME",
            help="Format to write: opencv, ros, kalibr, mrcal or posterior; may be repeated. Default: all.",
        ),
    ] = None,
    lossy: Annotated[
        bool,
        typer.Option("--lossy", help="Export even if a format cannot represent everything, and list what is left out."),
    ] = False,
    debug: DebugOption = False,
) -> None:
    """Write a camera's calibration as files for other programs and, as a posterior, for other studies.

    The option --format chooses among the formats.
    """
    with reporting_errors(debug=debug):
        from tradestudy import api

        loaded = warned(api.load(study, set_ or ()))
        directory = out if out is not None else Path("reports") / loaded.folder_name / "cameras"
        written, left_out = api.export(loaded, camera, directory, formats=formats or (), lossy=lossy)
        for line in left_out:
            say(f"left out: {line}", err=True)
        say(*map(str, written))


@app.command()
def plan(
    study: StudyArgument,
    set_: SetOption = None,
    tolerance: ToleranceOption = None,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", help="Show every choice of model and the numbers behind it, and every step of the run."
        ),
    ] = False,
    debug: DebugOption = False,
) -> None:
    """Say what a run will simulate and how long it will take. Also say which effects it will leave out, and why."""
    with reporting_errors(debug=debug):
        from tradestudy import api

        say(*warned(api.load(study, set_ or (), tolerance=tolerance)).plan().text(verbose=verbose).split("\n"))


@app.command()
def cost(
    study: StudyArgument,
    out: OutOption = None,
    set_: SetOption = None,
    tolerance: ToleranceOption = None,
    budget: Annotated[
        float,
        typer.Option(
            "--budget",
            metavar="SECONDS",
            help="Longest time for all measurements together; those that would exceed it are left out.",
        ),
    ] = DEFAULT_BUDGET,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Measure the error and computing time of each set of models that a study can use.

    The command writes cost.json and cost.svg.
    """
    with reporting_errors(debug=debug):
        from tradestudy import api

        loaded = warned(api.load(study, set_ or (), tolerance=tolerance), quiet=quiet)
        directory = out if out is not None else Path("reports") / loaded.folder_name
        with shown_progress(quiet=quiet) as progress:
            lines = api.cost(loaded, directory, budget=budget, progress=progress)
        if not quiet:
            say(*lines)


@app.command()
def check(study: StudyArgument, set_: SetOption = None, debug: DebugOption = False) -> None:
    """Check a study and report every mistake in it; compute nothing."""
    with reporting_errors(debug=debug):
        from tradestudy import api

        say(warned(api.load(study, set_ or ())).check())


@app.command(context_settings={"allow_extra_args": True})
def new(
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the study.", show_default=False)],
    stereo: Annotated[bool, typer.Option("--stereo", help="Compare two stereo rigs.")] = False,
    plenoptic: Annotated[bool, typer.Option("--plenoptic", help="Compare two plenoptic cameras.")] = False,
    from_: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="Start from the camera in this calibration file. For a stereo rig whose calibration is in several "
            "files, repeat this option for each: left, right and, if there is a separate one, the file with their "
            "relative pose (R and T).",
        ),
    ] = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            "--camera",
            metavar="ENTRY[:MODE]",
            help="Compare this camera of the catalogue with another one; give the option for each of them. Without a "
            "mode, the first one of the entry.",
        ),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Key and value to add to the imported camera, such as length_unit=mm; may be repeated.",
        ),
    ] = None,
    from_measurements: Annotated[
        Path | None,
        typer.Option(
            "--from-measurements",
            metavar="FILE",
            help="Compare a stereo rig with the measured depth errors in this CSV file.",
        ),
    ] = None,
    debug: DebugOption = False,
) -> None:
    """Write NAME.yaml, a commented study to start from. By default it compares a plenoptic camera with a stereo rig."""
    with reporting_errors(debug=debug):
        from tradestudy import api
        from tradestudy.cameras.depth_camera import DepthCamera
        from tradestudy.study.loading import read
        from tradestudy.study.starter import (
            before_table,
            between,
            of_catalogue,
            questions,
            starter,
            with_sharp_views,
            yaml_lines,
        )

        _refuse_joined(from_ or (), context.args)
        name = name.removesuffix(".yaml")
        options = {"--stereo": stereo, "--plenoptic": plenoptic, "--from-measurements": from_measurements is not None}
        kinds = [option for option, is_given in options.items() if is_given]
        if from_measurements is not None and len(kinds) > 1:
            raise OutOfRangeError("--from-measurements starts from one stereo rig", value=kinds[0], remedy="omit it")
        if kinds and from_:
            raise OutOfRangeError(
                "the calibration files determine the kind of camera", value=kinds[0], remedy="omit it"
            )
        if camera and (kinds or from_):
            raise OutOfRangeError("--camera takes no other cameras", value=(kinds or ["--from"])[0], remedy="omit it")
        if set_ and not from_:
            raise OutOfRangeError("--set applies to a camera imported with --from", remedy="give --from too")
        said = yaml_lines(set_ or ())
        kind = kinds[0].removeprefix("--") if len(kinds) == 1 and from_measurements is None else ""
        text = of_catalogue(name, camera) if camera else starter(name, kind, calibration_files=from_ or (), said=said)
        if from_measurements is not None:
            text = before_table(starter(name, "measured"), from_measurements)
        path = Path(f"{name}.yaml")
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(between(text))
        except FileExistsError:
            raise OutOfRangeError(
                "a file of this name already exists", value=str(path), remedy="choose another"
            ) from None
        if from_:
            try:
                document = read(path)
                asked = api.asked_of_camera(document)
                text = starter(name, calibration_files=from_, said=said, asked=asked)
                if api.refocuses(document):
                    text = with_sharp_views(text)
                path.write_text(between(text + questions() if asked else text), encoding="utf-8")
                if asked:
                    say(*_asking(path, asked, context.find_root().info_name))
                    return
                study = api.load(path)
                if isinstance(study.definition.designs["rig"], DepthCamera):
                    text = between(text + questions(), *(api.usable_span(study) or ()))
                    path.write_text(text, encoding="utf-8")
                warned(api.load(path))
            except TradestudyError as error:
                path.unlink()  # nobody can start from a study that cannot run
                raise OutOfRangeError(_not_written(path, error, set_ or ())) from None
        say(str(path), f"{context.find_root().info_name} run {path}")


@app.command()
def report(
    directory: DirectoryArgument,
    no_pdf: NoPdfOption = False,
    large_tables: LargeTablesOption = False,
    debug: DebugOption = False,
) -> None:
    """Write the report of a finished run again, from its results."""
    with reporting_errors(debug=debug):
        from tradestudy import result  # no study is read

        reported = result.report(directory, pdf=not no_pdf, large_tables=large_tables)
        say(*([] if large_tables else result.tables_left_out(reported)), str(directory / "report.html"))


@app.command()
def compare(
    directories: Annotated[
        list[Path],
        typer.Argument(metavar="DIR DIR…", help="Folders of finished runs, or their results.nc.", show_default=False),
    ],
    html: Annotated[
        Path | None,
        typer.Option(
            "--html",
            metavar="FILE",
            help="Also write the comparison as an HTML page, with a figure of the curves that changed.",
        ),
    ] = None,
    debug: DebugOption = False,
) -> None:
    """Compare conclusions, inputs and results of runs. Results that agree within their errors count as unchanged."""
    with reporting_errors(debug=debug):
        from tradestudy import api
        from tradestudy.results.storage import replace_file

        if html is not None:
            _refuse_other(html)
        comparison = api.compare(directories)
        if html is not None:
            replace_file(html, comparison.html())
        say(*str(comparison).split("\n"), *([] if html is None else [f"Page: {html}"]))


@app.command()
def cameras(
    kind: Annotated[str | None, typer.Option("--kind", metavar="KIND", help="Only cameras of this kind.")] = None,
    range_: Annotated[
        str | None,
        typer.Option(
            "--range",
            metavar="NEAR to FAR",
            help="Only cameras that measure from NEAR on, by the disparities that they search, and whose disparity at "
            "FAR is at least one pixel, such as '0.5 m to 3 m'.",
        ),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option("--baseline", metavar="LOW to HIGH", help="Only baselines in this range, such as '50 mm to 1 m'."),
    ] = None,
    field_of_view: Annotated[
        str | None,
        typer.Option(
            "--field-of-view", metavar="LOW to HIGH", help="Only horizontal fields of view in this range, in degrees."
        ),
    ] = None,
    check: Annotated[
        str | None,
        typer.Option(
            "--check",
            metavar="FILE",
            help="Instead of listing, check whether this camera file, or catalogue/NAME, is complete, and show its "
            "contradictions and claims.",
            show_default=False,
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON object, in SI units, instead of lines.")
    ] = False,
    debug: DebugOption = False,
) -> None:
    """List the cameras of the catalogue, which studies use with from: catalogue/ENTRY."""
    with reporting_errors(debug=debug):
        if check is not None:
            if any((kind, range_, baseline, field_of_view, as_json)):
                raise OutOfRangeError("--check takes no filters and no --json", value=check, remedy="omit them")
            from tradestudy.study.catalogue_entries import lines as check_lines

            say(*check_lines(check))
            return
        from tradestudy.catalogue.listing import content, filters, lines

        chosen = filters(kind, range_, baseline, field_of_view)
        if as_json:
            typer.echo(json_text(content(chosen)))
        else:
            say(*lines(chosen))


@app.command()
def schema(debug: DebugOption = False) -> None:
    """Print the JSON Schema of study files, for editors."""
    with reporting_errors(debug=debug):
        from tradestudy import api

        typer.echo(json_text(api.schema(), indent=1))


def _refuse_other(page: Path) -> None:
    """Refuse to replace anything but a page, and to replace the report of a run."""
    if page.is_file():
        with page.open("rb") as file:
            begin = file.read(200).lstrip().lower()
        if begin and not begin.startswith((b"<!doctype html", b"<html")):
            raise OutOfRangeError(
                "--html would replace a file that is no page", value=str(page), remedy="name another file"
            )
        if page.name == "report.html" and page.with_name("run.json").exists():
            raise OutOfRangeError(
                "--html would replace the report of a run", value=str(page), remedy="name another file"
            )


@contextmanager
def _executor(*, jobs: int | None, threads: int | None, dask: str | None) -> Iterator[Executor | None]:
    """The executor that the options choose; None if they choose none."""
    chosen = [name for name, value in (("--jobs", jobs), ("--threads", threads), ("--dask", dask)) if value is not None]
    if not chosen:
        yield None
        return
    if len(chosen) > 1:
        raise OutOfRangeError("these options exclude each other", value=" and ".join(chosen), remedy="give one of them")
    from tradestudy.execution import DaskCluster, Processes, Threads

    if jobs is not None:
        with closing(Processes(jobs, preload=_NEEDED_BY_WORKERS)) as executor:
            yield executor
    elif threads is not None:
        yield Threads(threads)
    elif dask is not None:
        if sys.modules.get("dask") is None:
            sys.modules.pop("dask", None)  # which main() hides
        cluster = DaskCluster(dask)
        cluster.check()  # before anything is computed or written
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # the run itself reports every lost worker
        yield cluster


def _refuse_joined(files: Sequence[Path], further: Sequence[str]) -> None:
    """Refuse arguments beyond the name, and several files given as one."""
    joined = [part for file in files if not file.exists() for part in str(file).split()]
    together = [*map(str, files), *further] if further else joined
    if further and not files:
        raise OutOfRangeError("new takes one name", value=" ".join(further), remedy="leave the others out")
    if further or (len(joined) > 1 and all(Path(part).exists() for part in joined)):
        remedy = "write " + " ".join(f"--from {part}" for part in together)
        raise OutOfRangeError("--from takes one file", value=" ".join(together), remedy=remedy)


def _asking(path: Path, asked: Mapping[str, str], program: str | None) -> Iterator[str]:
    """What a new study asks for, and how to give it."""
    settings = " ".join(f"--set rig.{key}=…" for key in asked)
    yield f"{path}: write these values into it, or give them to the command below; the calibration file lacks them"
    yield from (f"  {key}: {description}" for key, description in asked.items())
    yield f"{program} run {path} {settings}"


def _not_written(path: Path, error: TradestudyError, said: Sequence[str]) -> str:
    """Mistakes in an imported camera; those of the study itself lack a position, since its file is not written.

    ``said`` are the keys given with ``--set``; advice to give them is not repeated.
    """
    problems = error.problems if isinstance(error, StudyError) else ()
    causes = [
        f"{problem.path}: {problem.what}" if problem.file == str(path) else str(problem) for problem in problems
    ] or [str(error)]
    examples = {"length_unit": "--set length_unit=mm", "sensor.pixels": "--set 'sensor.pixels=[1280, 720]'"}
    keys = {setting.partition("=")[0].strip() for setting in said}
    shown = " or ".join(example for key, example in examples.items() if key not in keys)
    such = f", such as {shown}," if shown else ""
    advice = (
        f"{path} was not written. Keys beside from: can be given with --set{such} and the file of a second camera with "
        "another --from."
    )
    return "\n".join([*causes, advice])
