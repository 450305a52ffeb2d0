"""The result of a study: its results tree, figures, tables and files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tradestudy import provenance

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

    from tradestudy.figures.drawn import Drawer


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a study.

    Parameters
    ----------
    data
        The results tree, with SI units in the attributes.
    run_record
        Provenance: the content of ``run.json``.
    """

    data: xr.DataTree
    run_record: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"<Result {self.data.attrs['study']}: {', '.join(self.data.children)}>"

    @property
    def unmet_requirements(self) -> list[str]:
        """The 'must' requirements that are not met or undecided, and inferred calibrations that did not converge."""
        missed = []
        if "requirements" in self.data.children:
            columns = ["says", "priority", "met", "camera_deciding", "reason"]
            table = self.data["requirements"].to_dataset()[columns].to_dataframe()
            unmet = table[(table["met"] != 1) & (table["priority"] == "must")]
            missed += [
                f"{name}: {row['says']} ({row['camera_deciding']}: {row['reason']})" for name, row in unmet.iterrows()
            ]
        if "calibration" in self.data.children and "posterior_converged" in self.data["calibration"].data_vars:
            chains = self.data["calibration"].to_dataset()
            for name, converged in zip(chains["posterior"].values, chains["posterior_converged"].values, strict=True):
                if not converged:
                    why = str(chains["posterior_verdict"].sel(posterior=name).item())
                    missed.append(f"{name}: its calibration did not converge ({why})")
        return missed

    def lines(self, most: int = 5) -> tuple[str, ...]:
        """The conclusions as lines for a terminal: the best cameras, requirements, what the answers rest on."""
        from tradestudy.results.views.conclusions import terminal_lines

        return tuple(terminal_lines(self.data, most))

    def conclusions(self, directory: str | Path | None = None) -> dict[str, Any]:
        """The conclusions as ``--json`` prints them, with numbers in SI.

        - ``format``: version of these keys, which increases when a key changes its meaning; ``study``, ``title`` and
          ``question`` are those of the study.
        - ``best``: for each range of distances, its ends ``near`` and ``far`` [m] and the best ``cameras`` in it
          (titles; empty where no camera is usable).
        - ``requirements``: for each requirement, its ``name``, ``says`` and ``priority``; whether it is ``met`` (null
          where undecided); the ``camera``, the ``margin`` (fraction by which the worst value could be worse), the
          ``place`` [m] and the ``reason`` of the answer; ``conformity`` and ``rests_on`` as in the results; and the
          ``probability`` that it is met (fraction of the combinations of unknown values; null if the study declares no
          unknown values). In a sweep, ``designs_met`` says how many of the ``designs`` meet it; in a sweep of one
          number, ``met_with`` gives the ``parameter``, the range ``from`` and ``to`` in which it is met, their
          ``error`` and the ``camera``. If a matcher is declared, ``bound_alone`` gives ``met``, ``camera`` and
          ``reason`` for a matcher as precise as its bound.
        - ``designs``, in a sweep with requirements: their ``count``, how many are ``feasible``, and the ``best``
          design: its ``values`` by path and its smallest ``margin``.
        - ``questions``: for each inverse question, its ``name`` and ``says``, the ``answer`` in words, the smallest
          ``value`` with its ``error`` in ``units`` (null where there is none), and the number of ``solutions``.
        - ``trade_off``: for each ``camera``, the fraction of the possible weights that rank it ``first``, and the
          ``error`` of this fraction.
        - ``measured``: depth that each ``camera`` measured in pictures ``of`` the ``scene`` or of a ``plane`` (at its
          ``distance`` [m], ``contrast`` and ``electrons``): ``spread`` and ``bias`` with the standard errors
          ``spread_error`` and ``bias_error``, the ``predicted`` spread [m], and the fraction ``filled`` of the points
          that the camera could measure.
        - ``light_spot``: for each picture, its ``method``, its stated ``error`` and its ``difference`` from the
          ``reference``.
        - ``fresnel_validity``: for each ``element`` and ``lens_phase``, the ``f_number`` from which Fresnel's law stays
          within ``limit`` of Kirchhoff's over a ``window`` [Airy radii]; 0 if it always does, null if it never does.
        - ``hard_cases``: the number of ``cases``, and the number of those ``met``.
        - ``rests_on``: the limits and inputs that decide the answers, in words.
        - ``measure_first``: what to measure next, in words, or empty.
        - ``assumptions``: for each ``assumption``, the most valuable first, the range ``between`` which it lies, and
          the ``worth`` of knowing it with its standard ``error`` (fractions of the distance).
        - ``report``: path of the report.
        """
        from tradestudy.results.views.conclusions_json import conclusions_as_json

        found = conclusions_as_json(self.data)
        return found if directory is None else {**found, "report": str(Path(directory) / "report.html")}

    @property
    def figure_names(self) -> list[str]:
        """Valid names for `figure`."""
        from tradestudy import figures

        return list(figures.build(self.data))

    def figure(self, name: str) -> Figure:
        """One figure of the report, as a matplotlib figure."""
        from tradestudy import figures

        return figures.figure(self.data, name)

    @property
    def table_names(self) -> list[str]:
        """Valid names for `table`, those of the files in ``tables/``."""
        from tradestudy.results.views.tables import tables_of

        return list(tables_of(self.data))

    def table(self, name: str) -> pd.DataFrame:
        """One table of the results, such as ``depth_by_camera_distance``; ``attrs["units"]`` has the SI units.

        Raises
        ------
        OutOfRangeError
            For a name that is not among `table_names`.
        """
        from tradestudy.results.views.tables import table_named

        return table_named(self.data, name).frame()

    def with_cost(self, cost: xr.Dataset) -> Result:
        """The same result with the costs measured by `Study.cost`, for the report to show."""
        return replace(self, data=self.data.assign({"cost": type(self.data)(cost)}))

    def write(self, directory: str | Path, *, pdf: bool = True, drawer: Drawer | None = None) -> Path:
        """Write results, record, tables, figures and report, each file completely or not at all.

        Parameters
        ----------
        directory
            Output folder; created if missing.
        pdf
            Whether to write the PDF too.
        drawer
            Writes the results and draws figures in another process while this one composes the report; None: this
            process does everything.
        """
        from tradestudy import report as renderer
        from tradestudy.results import storage

        target = Path(directory)
        drawing = None if drawer is None else drawer.begin(self.data, filed=True)
        try:
            made = renderer.compose_files(self.data, storage.read_back(self.run_record), pdf=pdf, drawing=drawing)
        finally:  # a report that cannot be made costs no results
            content = storage.encoded(self.data) if drawing is None else drawing.file()
            storage.remove_abandoned(target)
            storage.write_finished(content, self.run_record, target)
            _write_posteriors(self.data, target)
            _write_matchers(self.data, target)
        renderer.place(made, target)
        return target

    def _repr_html_(self) -> str:
        if "decision" not in self.data.children:
            return f"<h3>{escape(str(self.data.attrs['title']))}</h3><p>{escape(', '.join(self.data.children))}</p>"
        best = self.data["decision"].to_dataset()["best_camera"].sel(error_source="both").to_series()
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
    """Read the result that an earlier run wrote.

    Raises
    ------
    ResultsError
        If the result is missing, unreadable or damaged, or the run was killed between writing its record and its
        results.
    """
    from tradestudy.results import storage

    data, record = storage.read_finished(Path(directory))
    return Result(data=data, run_record=record)


@contextmanager
def shown(results: Mapping[str, Result]) -> Iterator[None]:
    """Refuse results, by folder, in which another version of the program did not write what is to be shown.

    Raises
    ------
    ResultsError
        Something is missing, and a folder was written by other code than this.
    """
    from tradestudy.errors import ResultsError

    try:
        yield
    except KeyError as error:
        others = [name for name, one in results.items() if one.data.attrs.get("code_hash") != provenance.code_hash()]
        if not others:
            raise
        raise ResultsError(
            "these results are from another version of the program and lack what this one shows",
            value=", ".join(others),
            remedy="run the study again",
        ) from error


def _write_posteriors(tree: xr.DataTree, directory: Path) -> None:
    """Write every posterior of a run as a file for a camera's ``calibration: {posterior: {file: …}}``."""
    if "calibration" not in tree.children:
        return
    from tradestudy.calibration.posterior_file import write_posterior
    from tradestudy.results.storage import replacing
    from tradestudy.run.groups.calibration import saved_posteriors

    for name, posterior in saved_posteriors(tree).items():
        with replacing(directory / "posteriors" / f"{name}.nc") as file:
            write_posterior(file, posterior)


def _write_matchers(tree: xr.DataTree, directory: Path) -> None:
    """Write the matchers fitted by a depth loop as ``matchers.yaml``, for the cameras of a study."""
    if "depth_loop" not in tree.children:
        return
    from tradestudy.results.storage import replace_file
    from tradestudy.run.groups.depth_loop import matcher_file

    text = matcher_file(tree["depth_loop"].to_dataset(), str(tree.attrs["study"]))
    replace_file(directory / "matchers.yaml", text.encode())
