"""Whether what the mean over a source lacks is stated: random discs before a small camera, against far more points.

    python -m tests.campaigns.source_averages [--discs 12]

A knob that samples the source more finely refines the radii at which the main lens's field is known, too; what those
lack shows in single points, so that the whole statement is held against the truth, and the two terms are told beside.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from tests.campaigns import record
from tests.optics.small_chain import WAVELENGTH, camera, relative
from tradestudy.errors import TradestudyError
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.image import chain_image
from tradestudy.optics.chain.scene import KIRCHHOFF, LightPath
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens

TOLERANCE = 1e-2
SAMPLINGS = (0.5, 1.0)
FINEST = 2.0
WIDE = CircularLens(radius=0.4e-3, focal_length=2e-3, lens_phase="parabolic")


def scene(index: int) -> tuple[LightPath, DiscSource]:
    """A random disc, and one of two main lenses: one lights about a microlens, the other all."""
    rng = np.random.default_rng([1, index])
    x, y = rng.uniform(-0.8e-3, 0.8e-3, 2)
    disc = DiscSource(x=float(x), y=float(y), diameter=float(rng.uniform(0.3e-3, 1.6e-3)), distance=24e-3)
    return (camera(main_lens=WIDE) if rng.random() < 0.5 else camera()), disc


def picture(path: LightPath, disc: DiscSource, sampling: float) -> ChainImage:
    """By Kirchhoff's integrals, more or less finely sampled."""
    return chain_image(
        path, disc, wavelength=WAVELENGTH, legs=KIRCHHOFF, rng=np.random.default_rng(0),
        accuracy=ChainAccuracy(tolerance=TOLERANCE, source_sampling=sampling),
    )  # fmt: skip


def rows_of(index: int) -> list[tuple[object, ...]]:
    """One row for each sampling; words where a picture is refused."""
    path, disc = scene(index)
    place = f"{1e3 * disc.diameter:.2f} at ({1e3 * disc.x:.2f}, {1e3 * disc.y:.2f})"
    lens = "wide" if path.main_lens == WIDE else "narrow"
    try:
        truth = picture(path, disc, FINEST).pixels
    except TradestudyError as error:
        return [(index, lens, place, "", str(error), "", "", "", "")]
    rows: list[tuple[object, ...]] = []
    for sampling in SAMPLINGS:
        found = picture(path, disc, sampling)
        true, terms = relative(found.pixels, truth), found.error_terms
        both = math.hypot(terms["source angles"], terms["source radii"])
        rows.append(
            (
                index, lens, place, sampling, f"{100 * true:.2g} %", f"{100 * terms['source angles']:.2g} %",
                f"{100 * terms['source radii']:.2g} %", f"{true / both:.2f}", f"{true / found.numerical_error:.2f}",
            )
        )  # fmt: skip
        print(*rows[-1], flush=True)
    return rows


def main() -> None:
    """Measure every disc and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--discs", type=int, default=12)
    discs = parser.parse_args().discs
    record.write(
        "source_averages",
        f"What the mean over a disc lacks, against one sampled {FINEST:g} times as finely: {discs} random discs",
        "python -m tests.campaigns.source_averages",
        (
            "Disc", "Main lens", "Diameter and place [mm]", "Sampling", "True error", "Stated, angles",
            "Stated, radii", "True over both", "True over all that is stated",
        ),
        [row for index in range(discs) for row in rows_of(index)],
    )  # fmt: skip


if __name__ == "__main__":
    main()
