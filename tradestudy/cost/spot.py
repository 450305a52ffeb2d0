"""Picture of a light spot: the laws and tolerances that can compute it, and their reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from tradestudy.analysis.spot_images import RAYS, SpotModels, compared_models, light_source, picture_of
from tradestudy.cost.measuring import Candidate, CostProblem, Reference
from tradestudy.light_methods import short_title
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainImage, DiscSource
from tradestudy.study.schema.wave_optics import LightSpotPart
from tradestudy.units import FRACTION, pretty

_COARSEST, _FINEST = 0.2, 1e-6  # possible tolerances of a picture
_OF_RAYS: Final = 0.2  # time of a picture by rays relative to that of one by waves
# Tolerance relative to that of the chosen models, and growth of the computing time.
_REFERENCES: Final = ((0.5, 2.0), (0.15, 4.0), (0.05, 4.0))


def spot_problem(part: LightSpotPart, name: str, chosen: SpotModels) -> CostProblem:
    """Candidates for all pixels of the picture of the spot.

    They are the chosen models, every law that the study names, and Kirchhoff's law at several tolerances.

    Parameters
    ----------
    part
        The light path.
    name
        Name of the problem.
    chosen
        The models of the picture in a run.
    """

    def image(models: SpotModels, seed: int = part.seed) -> ChainImage:
        source = light_source(part)
        source = source.centre if models.point and isinstance(source, DiscSource) else source
        return picture_of(part, source, models, seed=seed)

    def reference(tolerance: float, growth: float) -> Reference:
        models = replace(compared_models(part, "kirchhoff"), tolerance=max(tolerance, _FINEST))

        def compute() -> tuple[FloatArray, float]:
            found = image(models, part.seed + 1)
            return found.pixels, found.numerical_error

        return Reference(words=_words(part, models), compute=compute, growth=growth)

    return CostProblem(
        name=name,
        title="Picture of the light spot",
        difference=_relative_norm,
        candidates=tuple(
            Candidate(
                models=_words(part, models),
                compute=partial(lambda models: image(models).pixels, models),
                chosen=models == chosen,
                growth=growth,
            )
            for models, growth in _sets(part, chosen)
        ),
        references=tuple(reference(share * chosen.tolerance, growth) for share, growth in _REFERENCES),
    )


def _sets(part: LightSpotPart, chosen: SpotModels) -> Iterator[tuple[SpotModels, float]]:
    """Sets of models, each once, with their time relative to that of the sets before them."""
    sets = {chosen: 1.0}
    for method in (*part.methods, "kirchhoff"):
        models = replace(compared_models(part, method), tolerance=chosen.tolerance)
        sets.setdefault(models, _OF_RAYS if method in RAYS else 1.0)
    for factor, growth in ((3.0, 1.0), (0.3, 3.0)):
        tolerance = min(max(factor * chosen.tolerance, _FINEST), _COARSEST)
        sets.setdefault(replace(compared_models(part, "kirchhoff"), tolerance=tolerance), growth)
    yield from sets.items()


def _words(part: LightSpotPart, models: SpotModels) -> str:
    """Law and tolerance in words, and what is left out of the declared spot."""
    left_out = {
        "cross-talk": models.separate,
        "pixels' width": not models.integrated,
        "spot's size": models.point and not part.spot.is_point,
        "spectrum": models.monochromatic and len(part.lines) > 1,
    }
    to = "" if models.method == "geometric" else f" to {pretty(models.tolerance, FRACTION, digits=2)}"
    return short_title(models.method) + to + "".join(f", without {name}" for name, off in left_out.items() if off)


def _relative_norm(values: FloatArray, reference: FloatArray) -> float:
    """Relative L2 difference over the pixels."""
    return float(np.linalg.norm(values - reference) / np.linalg.norm(reference))
