"""Results and figures to HTML, PDF, SVG and CSV; everything is computed elsewhere and only read here."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawn import Drawer


def write(
    tree: xr.DataTree,
    run: Mapping[str, Any],
    directory: Path,
    *,
    pdf: bool = True,
    drawer: Drawer | None = None,
) -> None:
    """Write ``report.html``, ``report.pdf``, ``figures/*.svg`` and ``tables/*.csv`` of a finished run.

    The same results and run give the same bytes. Everything is made in memory first, and each file takes its place
    only when it is complete, so that an interrupted call leaves no half-written report.

    Parameters
    ----------
    tree
        The content of ``results.nc``.
    run
        The content of ``run.json``; only the section on provenance depends on it.
    directory
        Where the files go; it is made if it does not exist. Figures and tables of an earlier report that this one does
        not have are removed.
    pdf
        Whether to write ``report.pdf``.
    drawer
        Who has begun to draw figures of these results; None draws all here.

    Raises
    ------
    OSError
        If a file cannot be written.
    """
    from tradestudy import figures
    from tradestudy.figures.drawn import drawn_here
    from tradestudy.report import contents, csv_tables, html
    from tradestudy.report import pdf as pdf_format
    from tradestudy.report.curve_values import curve_values
    from tradestudy.report.designs import page_designs
    from tradestudy.results.storage import replace_file

    drawings = figures.build(tree)
    document = contents.compose_report(tree, run, drawings)
    made = {f"tables/{name}": table for name, table in csv_tables.tables(tree).items()}
    values, designs = curve_values(tree), page_designs(tree)
    # Last, because the drawer draws meanwhile.
    pictures = drawn_here(drawings) if drawer is None else drawer.pictures(drawings)
    images = {name: picture.svg for name, picture in pictures.items()}
    made |= {f"figures/{name}.svg": svg for name, svg in images.items()}
    made["report.html"] = html.render_html(document, pictures, values, designs)
    if pdf:
        made["report.pdf"] = pdf_format.render_pdf(document, images)
    with ThreadPoolExecutor() as pool:  # they wait for the disk
        list(pool.map(replace_file, (directory / name for name in made), made.values()))
    for old in (*directory.glob("figures/*.svg"), *directory.glob("tables/*.csv")):
        if old.relative_to(directory).as_posix() not in made:
            old.unlink(missing_ok=True)  # another run on this folder may have been quicker
