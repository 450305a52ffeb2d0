"""Reports as HTML, PDF, SVG and CSV, made from finished results and figures; nothing is computed here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import xarray as xr

# Typical times, in units of the time in which a figure is drawn.
_LISTING: Final = 1.7
_COMPOSING: Final = 1.3
_TYPESETTING: Final = 0.9


def write(
    tree: xr.DataTree,
    run: Mapping[str, Any],
    directory: Path,
    *,
    pdf: bool = True,
    large_tables: bool = False,
    progress: Callable[[float], None] = lambda _share: None,
) -> None:
    """Write the report of a finished run: `compose_files` and `place` explain the parameters."""
    made = compose_files(tree, run, pdf=pdf, progress=progress)
    place(made, tree, directory, large_tables=large_tables)


def compose_files(
    tree: xr.DataTree,
    run: Mapping[str, Any],
    *,
    pdf: bool = True,
    progress: Callable[[float], None] = lambda _share: None,
) -> Mapping[str, bytes | Future[bytes]]:
    """Make ``report.html``, ``report.pdf`` and ``figures/*.svg``, by these paths; the PDF later, in another thread.

    The same results and run give the same bytes.

    Parameters
    ----------
    tree
        The content of ``results.nc``.
    run
        The content of ``run.json``; only the section on provenance depends on it.
    pdf
        Whether to make ``report.pdf``.
    progress
        Called with the fraction that is done, from 0 to 1.
    """
    from tradestudy import figures
    from tradestudy.figures.drawn import drawn_here
    from tradestudy.report import contents
    from tradestudy.report.html import render_html
    from tradestudy.report.page_data import curve_values, page_designs
    from tradestudy.report.pdf import render_pdf

    drawings = figures.build(tree)
    whole = _LISTING + _COMPOSING + len(drawings) + _TYPESETTING
    progress(_LISTING / whole)
    document = contents.compose_report(tree, run, drawings)

    def drawn(share: float) -> None:
        progress((_LISTING + _COMPOSING + share * len(drawings)) / whole)

    drawn(0.0)

    pictures = drawn_here(drawings, drawn)
    images = {name: picture.svg for name, picture in pictures.items()}
    made: dict[str, bytes | Future[bytes]] = {f"figures/{name}.svg": svg for name, svg in images.items()}
    if pdf:
        pool = ThreadPoolExecutor(1)  # other threads run while it typesets: what only the page needs is made meanwhile
        made["report.pdf"] = pool.submit(render_pdf, document, images)
        pool.shutdown(wait=False)
    made["report.html"] = render_html(document, pictures, curve_values(tree), page_designs(tree))
    return made


def place(
    made: Mapping[str, bytes | Future[bytes]], tree: xr.DataTree, directory: Path, *, large_tables: bool = False
) -> None:
    """Write the files of a report and ``tables/*.csv`` into a folder, which is made if it does not exist.

    Each takes its place only when it is complete, so that an interrupted call leaves no half-written file. Figures,
    tables and the PDF of an earlier report that this one does not have are removed; other files stay. Tables above
    50 MB are written only if `large_tables`.

    Raises
    ------
    PlaceError
        If a file would be replaced that this program did not write.
    OSError
        If a file cannot be written.
    """
    from tradestudy.report.csv_tables import tables
    from tradestudy.results.storage import (
        RESULTS,
        RUN,
        list_written,
        refuse_foreign,
        remove_earlier,
        replacing,
        written,
    )

    def write_pieces(name: str, pieces: Iterable[bytes] | Future[bytes]) -> None:
        pieces = [pieces.result()] if isinstance(pieces, Future) else pieces
        with replacing(directory / name) as temporary, temporary.open("wb") as file:
            file.writelines(pieces)

    files: dict[str, Iterable[bytes] | Future[bytes]] = {
        name: (content,) if isinstance(content, bytes) else content for name, content in made.items()
    }
    files |= {f"tables/{name}": pieces for name, pieces in tables(tree, large=large_tables).items()}
    refuse_foreign(directory, map(escape, files))
    earlier = written(directory)
    list_written(directory, [RESULTS, RUN, *files] if (directory / RUN).is_file() else files)
    with ThreadPoolExecutor() as pool:  # threads, because writing waits for the disk
        list(pool.map(write_pieces, files, files.values()))
    remove_earlier(directory, earlier, ("report.pdf", "figures/*.svg", "tables/*.csv"), files)
