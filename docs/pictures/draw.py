"""Make the pictures of the README and the documentation: ``python docs/pictures/draw.py RUNS``.

RUNS is a folder with the finished run of every shipped study, in a folder named after the study's file, and with that
of the first tutorial in ``two-heads``, which must contain ``report.pdf``. Without RUNS, only the figure of the README
and the chessboard are drawn, from results and corners that the repository contains.
"""

from __future__ import annotations

import io
import re
import runpy
import sys
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from PIL import Image

import tradestudy
from tradestudy.results.views.conclusions import best_ranges
from tradestudy.results.views.groups import camera_titles

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parents[1]
DIAGRAMS: Final = runpy.run_path(str(HERE.parent / "diagrams" / "draw.py"))
WIDTH: Final = 700  # pixels: twice the width of a telephone's page
CAMERAS: Final = {
    "stereo-short": ("20 mm\nstereo rig", DIAGRAMS["GOLD"], (0.056, 0.036)),
    "raytrix-r5": ("Raytrix R5", DIAGRAMS["BLUE"], (1.95, 0.22)),
    "stereo-65-across": ("8 mm\nstereo rig", DIAGRAMS["RED"], (2.5, 0.034)),
}
"""The candidates of the study of the README: name, colour, and where the name stands."""


def answer(result: Any) -> Figure:
    """Relative depth uncertainty over distance of the candidates, and which of them is best where."""
    ink, soft = DIAGRAMS["INK"], DIAGRAMS["SOFT"]
    depth = result.data["depth"].to_dataset()
    titles = camera_titles(result.data)
    best = [one for one in best_ranges(result.data) if one.cameras]
    colours = {titles[camera]: colour for camera, (_, colour, _) in CAMERAS.items()}
    figure = Figure(figsize=(5.2, 3.5), facecolor=DIAGRAMS["GROUND"], layout="constrained")
    axes = figure.add_subplot(facecolor="none")
    for camera, (title, colour, place) in CAMERAS.items():
        mine = depth.sel(camera=camera)
        relative = (mine["depth_uncertainty"] / mine["distance"]).to_numpy()
        usable = mine["usable"].to_numpy().astype(bool)
        axes.plot(mine["distance"], relative, color=colour, linewidth=1.0, linestyle=(0, (3, 2)))
        axes.plot(mine["distance"], np.where(usable, relative, np.nan), color=colour, linewidth=2.6)
        axes.text(*place, title, color=colour, fontsize=9.5, fontweight="bold", linespacing=1.1)
    for one in best:
        axes.plot(
            [one.near, one.far], [0.0024, 0.0024], color=colours[one.cameras[0]], linewidth=9.0, solid_capstyle="butt"
        )
    axes.text(3.0, 0.0024, "best", color=ink, fontsize=9.5, va="center")
    ends = sorted({float(f"{end:.2g}") for one in best for end in (one.near, one.far)})
    axes.set(xscale="log", yscale="log", xlim=(0.05, 10.0), ylim=(0.0018, 0.5))
    axes.set_xticks([0.05, *ends, 10.0], [f"{end:.2g}" for end in (0.05, *ends, 10.0)])
    axes.set_yticks([0.003, 0.01, 0.03, 0.1, 0.3], ["0.3 %", "1 %", "3 %", "10 %", "30 %"])
    axes.minorticks_off()
    axes.tick_params(colors=soft, labelcolor=ink, labelsize=9.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(soft)
    axes.set_xlabel("distance [m]", color=ink, fontsize=9.5)
    axes.set_title("depth uncertainty, percent of distance (thick: usable)", color=ink, fontsize=9.5, loc="left")
    return figure


def chessboard(corners: pd.DataFrame, view: int) -> Figure:
    """The corners of one view as both cameras saw them, joined along the rows and columns of the board."""
    figure = Figure(figsize=(5.2, 1.75), facecolor=DIAGRAMS["GROUND"], layout="constrained")
    shown = corners[corners["view"] == view]
    for k, side in enumerate(("left", "right")):
        axes = figure.add_subplot(1, 2, k + 1, facecolor="none", aspect="equal")
        for along in ("board_x_mm", "board_y_mm"):
            for _, line in shown.groupby(along):
                axes.plot(line[f"{side}_x_px"], line[f"{side}_y_px"], color=DIAGRAMS["SOFT"], linewidth=0.8)
        axes.plot(shown[f"{side}_x_px"], shown[f"{side}_y_px"], "o", color=DIAGRAMS["BLUE"], markersize=2.6)
        axes.set(xlim=(0, 640), ylim=(360, 0), xticks=[], yticks=[])
        axes.spines[:].set_color(DIAGRAMS["SOFT"])
        axes.set_title(f"{side} camera", fontsize=9.5, color=DIAGRAMS["INK"])
    return figure


def first_figure(run: Path) -> Figure:
    """The first figure of a run's report."""
    report = (run / "report.html").read_text(encoding="utf-8")
    shown = re.findall(r'<figure class="plot" id="([^"]+)"', report)
    return tradestudy.open_result(run).figure(shown[0])


def write_svg(figure: Figure, name: str) -> None:
    """Write a figure with colours for a light and a dark ground."""
    with matplotlib.rc_context({"svg.hashsalt": "pictures"}):
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    (HERE / f"{name}.svg").write_text(DIAGRAMS["_with_dark_colours"](text.getvalue()), encoding="utf-8")


def write_small(figure: Figure, name: str) -> None:
    """Write a figure as a small picture."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=2 * WIDTH / figure.get_figwidth(), facecolor="white")
    shrink(Image.open(drawn), name)


def shrink(picture: Image.Image, name: str) -> None:
    """Write a picture `WIDTH` wide."""
    size = (WIDTH, round(picture.height * WIDTH / picture.width))
    picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(HERE / f"{name}.webp", quality=60, method=6)


def main(runs: Path | None) -> None:
    """Make all pictures whose sources are there."""
    write_svg(answer(tradestudy.open_result(ROOT / "reports" / "examples" / "plenoptic-vs-stereo")), "answer")
    write_svg(chessboard(pd.read_csv(ROOT / "studies" / "data" / "stereo_chessboard_corners.csv"), 17), "chessboard")
    if runs is None:
        return
    import pypdfium2

    for study in sorted((ROOT / "studies").glob("*.yaml")):
        write_small(first_figure(runs / study.stem), f"study-{study.stem}")
    write_small(tradestudy.open_result(runs / "real_rig").figure("depth-map-webcams"), "map")
    page = pypdfium2.PdfDocument(runs / "two-heads" / "report.pdf")[0]
    whole = page.render(scale=3).to_pil()
    shrink(whole.crop((0, 0, whole.width, whole.height * 2 // 3)), "report")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
