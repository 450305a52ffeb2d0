"""The result of a study: its results tree, figures, tables and files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tradestudy import provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a run; `Study.run` and `open_result` return it.

    Parameters
    ----------
    data
        All results, as groups of variables; the attributes of each variable state its unit.
    run_record
        Record of the run, as in ``run.json``: inputs, versions, machine and times.
    """

    data: xr.DataTree
    run_record: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"<Result {self.data.attrs['study']}: {', '.join(self.data.children)}>"

    @property
    def unmet_requirements(self) -> list[str]:
        """Requirements of priority ``must`` that are missed or undecided, and calibrations that did not converge."""
        from tradestudy.results.views.groups import unconverged
        from tradestudy.results.views.requirement_conclusions import requirement_conclusions

        unmet = [
            requirement
            for requirement in requirement_conclusions(self.data)
            if requirement.priority == "must" and not requirement.met
        ]
        return [
            *(
                f"{requirement.name}: {requirement.says} ({requirement.camera}: {requirement.reason})"
                for requirement in unmet
            ),
            *(f"calibrations did not converge for {camera}" for camera in unconverged(self.data)),
        ]

    def lines(self, most: int = 6) -> tuple[str, ...]:
        """Return the conclusions as lines for a terminal.

        Parameters
        ----------
        most
            Largest number of lines.

        Returns
        -------
        tuple of str
            The best cameras, the verdicts on requirements, and what these answers rest on.
        """
        from tradestudy.results.views.terminal import terminal_lines

        return tuple(terminal_lines(self.data, most, self.run_record.get("seconds", {})))

    def conclusions(self, directory: str | Path | None = None) -> dict[str, Any]:
        """Return the conclusions as a dictionary, the object that ``--json`` prints, with numbers in SI units.

        - ``format``: version of these keys; it increases when a key changes its meaning.
        - ``study``, ``title``, ``question``: name, title and question of the study.
        - ``best``: for each range of distances, from ``near`` to ``far`` [m], the titles of the best ``cameras``; no
          titles if no camera is usable there.
        - ``best_nowhere``: for each candidate that is usable but nowhere best, its title ``camera`` and the smallest
          ratio of its depth uncertainty to that of the best one, ``at_least``.
        - ``lower_bounds``: titles of the cameras that decide answers with a disparity error that is a lower bound,
          because the study declares no matcher.
        - ``requirements``: for each requirement,

          - its ``name``, ``says`` and ``priority``, as declared;
          - whether it is ``met`` (null if undecided), the title of the ``camera`` that decides the verdict, and
            the ``reason`` in words;
          - the ``margin``: how far the worst value could worsen before it reaches its bound, as a fraction of this
            value (negative if the value violates the bound); and the ``place`` of the worst value, a distance [m];
          - the ``conformity``, the probability that the true worst value meets the bound;
          - ``rests_on``, the input or limit that decides the answer, in words;
          - the ``probability`` that the requirement is met: the fraction of random draws of the study's uncertain
            assumptions with which it is met (null if the study declares none);
          - in a sweep, the number ``designs_met`` of designs that meet the requirement, and the number of all
            ``designs``;
          - in a sweep of one numerical parameter, ``met_with``: the ranges of the ``parameter`` in which a ``camera``
            meets the requirement, ``from`` one value ``to`` another, with the ``error`` of these two values;
          - ``on_lower_bound``: whether the value of this camera is a lower bound, because it depends on the error of a
            matcher and the study declares none, so that a real camera may miss the requirement;
          - ``others``: for a requirement that any or all cameras must meet, the other cameras, each with ``camera``,
            ``met``, ``margin`` and ``reason``;
          - if the study declares readings, their number ``readings``, and ``other_verdicts``: each ``reading`` that
            changes the verdict or the camera that meets a requirement on any best, with ``met``, ``camera`` and
            ``reason``;
          - if the value depends on the error of a matcher, ``bound_alone``: the verdict (``met``, ``camera`` and
            ``reason``) for a matcher whose error equals its lower limit, the Cramér–Rao bound.

        - ``designs``, in a sweep with requirements: the ``count`` of all designs, the number of ``feasible`` ones, and
          the ``best`` design, with its ``values`` by dotted path and its smallest ``margin``.
        - ``questions``: for each inverse question, its ``name`` and ``says``, the ``answer`` in words, the smallest
          ``value`` that solves it and its ``error``, both in ``units`` (null if there is no such value), and the
          number of ``solutions``.
        - ``trade_off``: for each candidate (``camera``), the fraction of all possible weights of the criteria that rank
          it ``first``, and the ``error`` of this fraction.
        - ``measured``: for each ``camera`` and each set of simulated pictures, ``of`` the ``scene`` or ``of`` a
          ``plane``, the ``spread`` (half the width of the central 68.27 % interval) and the ``bias`` (median) of the
          depth errors [m]; for a plane, also its ``distance`` [m] and ``contrast``, and the mean number of
          ``electrons`` per pixel; the standard errors ``spread_error`` and ``bias_error`` [m]; the ``predicted`` spread
          [m]; and the fraction ``filled`` of the measurable points at which the camera measured a depth.
        - ``light_spot``: for each picture of the light spot, its ``method``, its stated relative ``error``, and its
          ``difference`` from the picture by the reference method, which the key ``reference`` names: the sum of the
          absolute differences of the pixels, as a fraction of the light in the reference (null for the reference
          itself).
        - ``fresnel_validity``: for each ``element`` (a lens) and ``lens_phase``, the ``f_number`` above which the spots
          computed with Fresnel's and with Kirchhoff's integral differ by less than ``limit``; it is 0 if they do at
          every f-number of the study, and null if they do at none. The difference of the spots is the integral of the
          absolute difference of their intensities over a disc with the radius ``window`` [Airy radii], relative to the
          integral of Kirchhoff's intensity.
        - ``hard_cases``: the number of ``cases`` with known answers, and how many of them the program gets right
          (``met``); empty if the study computed none.
        - ``rests_on``: the inputs and limits that decide the answers, in words.
        - ``measure_first``: what to measure next, in words; empty if the results do not tell.
        - ``reversed_by``: for each ``reading`` that reverses the choice between the two cameras of the decision, the
          distances ``at`` which it does [m].
        - ``assumptions``: for each ``assumption``, the most valuable first, the values ``between`` which it lies, in
          words; the ``worth`` of knowing it, which is the expected reduction of the relative depth uncertainty (a
          fraction of the distance); and the standard ``error`` of this worth.
        - ``report``: path of the report, if `directory` is given.

        Parameters
        ----------
        directory
            Folder of the report, for the key ``report``.

        Returns
        -------
        dict
            The keys above.
        """
        from tradestudy.results.views.terminal import conclusions_as_json

        conclusions = conclusions_as_json(self.data, self.run_record.get("seconds", {}))
        return conclusions if directory is None else {**conclusions, "report": str(Path(directory) / "report.html")}

    @property
    def figure_names(self) -> list[str]:
        """Names that `figure` accepts."""
        from tradestudy import figures

        return list(figures.build(self.data))

    def figure(self, name: str) -> Figure:
        """Return one figure of the report.

        Parameters
        ----------
        name
            One of `figure_names`.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        OutOfRangeError
            If the name is not one of `figure_names`.
        """
        from tradestudy import figures

        return figures.figure(self.data, name)

    @property
    def table_names(self) -> list[str]:
        """Names that `table` accepts, which are also those of the files in ``tables/``."""
        from tradestudy.results.views.tables import tables_of

        return list(tables_of(self.data))

    def table(self, name: str) -> pd.DataFrame:
        """Return one table of the results.

        Parameters
        ----------
        name
            One of `table_names`, such as ``depth_by_camera_distance``.

        Returns
        -------
        pandas.DataFrame
            The table; its ``attrs["units"]`` gives the unit of each column.

        Raises
        ------
        OutOfRangeError
            If the name is not one of `table_names`.
        """
        from tradestudy.results.views.tables import table_named

        return table_named(self.data, name).frame()

    def budget(self, camera: str, distance: float) -> pd.DataFrame:
        """Return the uncertainty budget of one camera's depth at one distance, after the GUM (JCGM 100:2008).

        Parameters
        ----------
        camera
            Key of the camera in the study, such as ``stereo-short``.
        distance
            One of the distances of ``decision.at`` or, without these, of ``data["budget"]["distance"]`` [m]; three
            digits suffice.

        Returns
        -------
        pandas.DataFrame
            One row for each uncertain input, and one for each correlated pair of inputs. The columns are the variables
            of ``/budget``: ``distribution``, ``evaluation`` (type A or B), ``input_units``, ``degrees_of_freedom``,
            ``input_uncertainty``, ``correlation``, ``sensitivity_coefficient`` [m per unit of the input],
            ``contribution`` [m], and ``variance`` [m²], whose sum is the square of ``combined_uncertainty``.
            ``attrs["units"]`` gives the unit of each column. ``attrs`` also contains ``distance`` [m],
            ``combined_uncertainty`` [m],
            ``effective_degrees_of_freedom``, ``coverage``, ``coverage_factor``, ``expanded_uncertainty`` [m], and the
            ends of the interval of depths with this coverage, ``interval_near`` and ``interval_far`` [m]. Factor and
            expanded uncertainty are NaN where depth is not linear enough in the inputs; the interval holds there too.

        Raises
        ------
        OutOfRangeError
            If the results have no budget of this camera at this distance.
        """
        from tradestudy.results.views.tables import budget_frame

        return budget_frame(self.data, camera, distance)

    def with_cost(self, cost: xr.Dataset) -> Result:
        """Return the result with the costs that `Study.cost` measured, so that the report shows them.

        Parameters
        ----------
        cost
            What `Study.cost` returned.

        Returns
        -------
        Result
            The result with the costs as group ``cost``.
        """
        return replace(self, data=self.data.assign({"cost": type(self.data)(cost)}))

    def write(
        self,
        directory: str | Path,
        *,
        pdf: bool = True,
        large_tables: bool = False,
        pictures: Path | None = None,
        progress: Callable[[float], None] = lambda _share: None,
    ) -> Path:
        """Write the results, tables, figures, report and provenance, each file completely or not at all.

        Parameters
        ----------
        directory
            Output folder; created if missing.
        pdf
            Whether to write the report as a PDF, too.
        large_tables
            Whether to write tables above 50 MB, too.
        pictures
            Folder inside the output folder with the pictures of the run, which becomes ``pictures``. Default: none.
        progress
            Called with the fraction that is done, from 0 to 1.

        Returns
        -------
        pathlib.Path
            The output folder.

        Raises
        ------
        PlaceError
            If a file would be replaced that this program did not write.
        """
        from tradestudy import report as renderer
        from tradestudy.results import storage

        target = Path(directory)
        storage.refuse_foreign(target, storage.RUN_FILES)
        try:
            composed = renderer.compose_files(self.data, storage.read_back(self.run_record), pdf=pdf, progress=progress)
        finally:  # a report that cannot be made costs no results
            storage.remove_abandoned(target)
            storage.write_finished(storage.encoded(self.data), self.run_record, target, pictures)
            write_parts(self.data, target)
        renderer.place(composed, self.data, target, large_tables=large_tables)
        return target

    def _repr_html_(self) -> str:
        if "decision" not in self.data.children:
            return f"<h3>{escape(str(self.data.attrs['title']))}</h3><p>{escape(', '.join(self.data.children))}</p>"
        best = self.data["decision"].to_dataset()["best_camera"].sel(error_source="both").to_series()
        # Neighbouring distances with the same best camera share a row.
        runs = best.groupby((best != best.shift()).cumsum())
        rows = "".join(
            f"<tr><td>{run.index[0]:.3g} – {run.index[-1]:.3g} m</td><td>{escape(str(run.iloc[0])) or '—'}</td></tr>"
            for _, run in runs
        )
        return (
            f"<h3>{escape(str(self.data.attrs['title']))}</h3><p>{escape(str(self.data.attrs['question']))}</p>"
            f"<table><tr><th>distance</th><th>most certain usable camera</th></tr>{rows}</table>"
            f"<p>{escape(', '.join(self.data.children))}</p>"
        )


def open_result(directory: str | Path) -> Result:
    """Open the result of a finished run.

    Parameters
    ----------
    directory
        Folder of the run, or its ``results.nc``.

    Returns
    -------
    Result
        The result, as `Study.run` returned it.

    Raises
    ------
    ResultsError
        If the result is missing, unreadable or damaged, or the run was killed while it wrote its files.
    """
    from tradestudy.results import storage

    path = Path(directory)
    data, record = storage.read_finished(path.parent if path.name == storage.RESULTS and path.is_file() else path)
    return Result(data=data, run_record=record)


@contextmanager
def shown(results: Mapping[str, Result]) -> Iterator[None]:
    """Refuse results, by folder, that lack what is to be shown.

    Raises
    ------
    ResultsError
        Something is missing: another version of the program did not write it, or the files are damaged.
    """
    from tradestudy.errors import ResultsError

    try:
        yield
    except KeyError as error:
        others = [
            name for name, result in results.items() if result.data.attrs.get("code_hash") != provenance.code_hash()
        ]
        if not others:
            raise ResultsError(
                f"these results or their record are damaged: they lack {error}",
                value=", ".join(results),
                remedy="run the study again",
            ) from error
        raise ResultsError(
            "these results are from another version of the program and lack what this one shows",
            value=", ".join(others),
            remedy="run the study again",
        ) from error


def report(directory: str | Path, *, pdf: bool = True, large_tables: bool = False) -> Result:
    """Write the report of a finished run again, with identical bytes; its tables above 50 MB only if ``large_tables``.

    Returns
    -------
    Result
        The result of that run.

    Raises
    ------
    ResultsError
        If the folder contains no readable run, or one of another version that lacks data.
    """
    from tradestudy import report as renderer

    result = open_result(directory)
    with shown({str(directory): result}):
        renderer.write(result.data, result.run_record, Path(directory), pdf=pdf, large_tables=large_tables)
    return result


def tables_left_out(result: Result) -> list[str]:
    """A line on the tables that are not written unless large ones are requested; none where all are written."""
    from tradestudy.report.csv_tables import large_tables
    from tradestudy.units import DATA, pretty

    tables = [f"{name} ({pretty(8.0 * size, DATA, digits=2)})" for name, size in large_tables(result.data).items()]
    return [f"Tables above 50 MB, written only with --large-tables: {', '.join(tables)}"] * bool(tables)


def write_parts(tree: xr.DataTree, directory: Path) -> None:
    """Write fitted calibrations and matchers; remove those of an earlier run, its pictures, and other studies' costs.

    Pictures stay if this run has some, because `storage.write_finished` replaces them.
    """
    from tradestudy.results import storage

    written = storage.written(directory)
    files = [*_write_posteriors(tree, directory), *_write_matchers(tree, directory), *_write_fitted(tree, directory)]
    storage.remove_earlier(directory, written, ("posteriors/*.nc", "matchers.yaml", "fitted/*.yaml"), files)
    pictures = directory / storage.PICTURES
    if "pictures" not in tree.children and (pictures / storage.LIST).is_file():
        storage.remove_earlier(pictures, storage.written(pictures) | {storage.LIST}, ("*/*", storage.LIST))
        for folder in (*pictures.glob("*/"), pictures):
            with suppress(OSError):  # it holds other files
                folder.rmdir()
    if _study_of_costs(directory) != tree.attrs.get("study_hash"):
        storage.remove_earlier(directory, written, ("cost.json", "cost.svg"))


def _study_of_costs(directory: Path) -> object:
    """Hash of the study whose costs `api.cost` wrote into a folder; None if it is not known."""
    with suppress(OSError, ValueError, AttributeError):
        return json.loads((directory / "cost.json").read_text(encoding="utf-8")).get("study_hash")
    return None


def _write_posteriors(tree: xr.DataTree, directory: Path) -> list[str]:
    """Write every posterior of a run as a file for a camera's ``calibration: {posterior: {file: …}}``."""
    if "calibration" not in tree.children:
        return []
    from tradestudy.answers.calibration import saved_posteriors
    from tradestudy.calibration.posterior_file import write_posterior
    from tradestudy.results.storage import list_written, replacing

    saved = saved_posteriors(tree)
    files = {f"posteriors/{name}.nc": posterior for name, posterior in saved.items()}
    list_written(directory, files)
    for name, posterior in files.items():
        with replacing(directory / name) as file:
            write_posterior(file, posterior)
    return list(files)


def _write_matchers(tree: xr.DataTree, directory: Path) -> list[str]:
    """Write the matchers fitted by a depth loop as ``matchers.yaml``, for the cameras of a study."""
    if "depth_loop" not in tree.children:
        return []
    from tradestudy.answers.depth_loop import matcher_file
    from tradestudy.results.storage import list_written, replace_file

    text = matcher_file(tree["depth_loop"].to_dataset(), str(tree.attrs["study"]))
    list_written(directory, ["matchers.yaml"])
    replace_file(directory / "matchers.yaml", text.encode())
    return ["matchers.yaml"]


def _write_fitted(tree: xr.DataTree, directory: Path) -> list[str]:
    """Write each measured camera with its fitted values as ``fitted/NAME.yaml``, for the key ``from`` of a camera."""
    from tradestudy.results.storage import list_written, replace_file
    from tradestudy.results.views.groups import records

    rows = records(tree, "measurements", "table")
    files = {f"fitted/{row['table']}.yaml": str(row["fitted_camera"]) for row in rows if row["fitted_camera"]}
    list_written(directory, files)
    for name, text in files.items():
        (directory / name).parent.mkdir(exist_ok=True)
        replace_file(directory / name, text.encode())
    return list(files)
