"""What asking for 10 %, 5 %, 1 % and 0.1 % of the light spot picks, costs and reaches.

    python -m tests.campaigns.light_spot_accuracy

Each picture by the set that is selected, against one by the complete models at half of the finest tolerance.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from tests.campaigns import record
from tradestudy import load
from tradestudy.models import spot_images
from tradestudy.models.light_spot import LightSpotProblem, spot_models
from tradestudy.models.problem import choose

STUDY = Path(__file__).parents[2] / "studies" / "light_spot.yaml"
ASKED = (0.1, 0.05, 0.01, 0.001)
FINEST = 5e-4


def main() -> None:
    """Select, compute, compare; write the record."""
    part = load(STUDY).file.light_spot
    assert part is not None
    found = []
    for asked in ASKED:
        start = time.perf_counter()
        models = choose(LightSpotProblem(part, {}), {"pixel_intensity": asked}, {}).models
        selecting = time.perf_counter() - start
        wall, cpu = time.perf_counter(), time.process_time()
        image = spot_images.spot_picture(part, spot_models(models))
        taken = time.perf_counter() - wall, time.process_time() - cpu
        found.append((asked, models, selecting, image, taken))
        print(f"{asked:g}: {taken[0]:.0f} s", flush=True)
    finest = spot_images.spot_picture(part, spot_images.SpotModels(method="kirchhoff", tolerance=FINEST)).pixels
    rows = [
        (
            f"{100 * asked:g} %",
            ", ".join(f"{slot}: {model}" for slot, model in models.items()),
            f"{cpu:.1f}",
            f"{wall:.1f}",
            f"{100 * float(np.linalg.norm(image.pixels - finest) / np.linalg.norm(finest)):.3f} %",
            f"{100 * image.numerical_error:.3f} %",
            f"{1e3 * selecting:.0f}",
        )
        for asked, models, selecting, image, (wall, cpu) in found
    ]
    record.write(
        "light_spot_accuracy",
        "The light spot to 10, 5, 1 and 0.1 %",
        "python -m tests.campaigns.light_spot_accuracy",
        (
            "Asked", "Chosen", "Processor [s]", f"Wall [s] at load {os.getloadavg()[1]:.0f}",
            f"Error against {100 * FINEST:g} %", "Error stated", "Selecting [ms]",
        ),
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
