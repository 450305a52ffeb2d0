"""The law of propagation behind one lens, and what it may change in the width of a point's image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.effects.base import COMPLETE, Bound, EffectCriterion, Model, Slot
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation import CircularLens, PointSource
from tradestudy.optics.propagation.lens import lens_paths
from tradestudy.optics.propagation.paths import ParabolicPath, SphericalPath
from tradestudy.optics.quadrature import QuadratureNodes, disc_nodes

# Seconds per image of a point on the reference machine; `python -m tests.campaigns.light_seconds` measures them.
SECONDS_PER_IMAGE: Final = {"fresnel": 0.09, "kirchhoff": 0.10}
_HALF_ENERGY: Final = 0.5348  # of λ N: 1 − J₀²(v) − J₁²(v) = ½ at v = π r/(λ N) = 1.680


@dataclass(frozen=True, kw_only=True)
class PointImage:
    """A lens, a point, and the plane in which its image is looked at.

    Parameters
    ----------
    lens, source
        Lens and point.
    image_distance
        Lens → plane [m].
    centre
        Where the chief ray meets the plane, about which the width is taken (x, y) [m].
    wavelength
        λ [m].
    """

    lens: CircularLens
    source: PointSource
    image_distance: float
    centre: tuple[float, float]
    wavelength: float

    @property
    def diffraction_radius(self) -> float:
        """Radius that holds half the light in focus without aberration [m]."""
        return _HALF_ENERGY * self.wavelength * self.image_distance / (2.0 * self.lens.radius)

    @cached_property
    def blur(self) -> float:
        """Root mean square by which paraxial rays miss the centre [m]."""
        return self._landing(self._slopes[1])

    @cached_property
    def displacement(self) -> float:
        """Root mean square by which exact rays land elsewhere than paraxial ones [m]."""
        return self._landing(self._slopes[0] - self._slopes[1])

    @cached_property
    def brightness(self) -> float:
        """Mean share of the light by which the cosines of both legs, one in Fresnel's law, lower it."""
        nodes = self._pupil
        behind = (nodes.x - self.centre[0]) ** 2 + (nodes.y - self.centre[1]) ** 2
        lost = 1.0 - 1.0 / (1.0 + behind / self.image_distance**2) ** 2
        return float(np.average(lost, weights=nodes.weights))

    @cached_property
    def _pupil(self) -> QuadratureNodes:
        return disc_nodes(radius=self.lens.radius, radial_count=6, angular_count=16)

    def _landing(self, slopes: FloatArray) -> float:
        """Root mean square over the pupil by which rays of such slopes miss [m]."""
        squared = np.average(np.sum(slopes**2, axis=1), weights=self._pupil.weights)
        return self.image_distance * float(np.sqrt(squared))

    @cached_property
    def _slopes(self) -> list[FloatArray]:
        """Slopes of the exact and the paraxial path from the source through every pupil point to the centre.

        They are zero for a perfect image.
        """
        x, y = self._pupil.x, self._pupil.y
        u, v = self.centre
        legs = [
            (lens_paths(self.source, self.lens, paraxial=paraxial), kind(x=u, y=v, distance=self.image_distance))
            for paraxial, kind in ((False, SphericalPath), (True, ParabolicPath))
        ]
        return [np.add(behind.slope(x, y), leg.slope(x, y)).T for behind, leg in legs]

    def fresnel_change(self) -> float:
        """Bound on |r_Fresnel − r_Kirchhoff|/r_Kirchhoff of the radius that holds half the light.

        Blur q and displacement δ add as vectors and widen the radius r of diffraction by squares: |Δ r²| ≤ 2 q δ + δ²;
        where δ exceeds r, the radius moves by δ at most. Fresnel's radius is at most the larger one by all of it, and
        exceeds Kirchhoff's only where aberration undoes blur, down to r. Light that the cosines take counts as light
        outside.
        """
        r, q, moved = self.diffraction_radius, self.blur, self.displacement
        most = max(1.0, float(np.hypot(r, q)) / r - 1.0)
        least = float(np.hypot(r, max(q - moved, 0.0)))
        return min((2.0 * q * moved + moved**2) / least**2, 2.0 * moved / least, most) + 2.0 * self.brightness


def diffraction_of_points(images: Sequence[PointImage]) -> Slot:
    """Fresnel's law or Kirchhoff's for points behind single lenses; the bound is that of the worst of them.

    The width is the radius about the chief ray that holds half the light of the pupil. Rays are not offered: a point
    in focus has no width by them.
    """
    worst = max(images, key=PointImage.fresnel_change)
    return Slot(
        name="main_lens_diffraction",
        models=(
            Model(
                name="fresnel",
                bounds={
                    "psf_width": Bound(
                        relative_change=worst.fresnel_change(),
                        criterion=EffectCriterion(
                            words="displacement of rays over the diffraction radius",
                            definition="δ/(0.535 λ N); δ the root mean square by which rays land elsewhere by exact "
                            "than by parabolic paths, N the working f-number: the worst of the declared cases",
                            value=worst.displacement / worst.diffraction_radius,
                        ),
                        reason="second-order paths leave out aberration, which widens the image of a point: it counts "
                        "unless it is well below the width of diffraction and blur",
                    )
                },
                seconds=SECONDS_PER_IMAGE["fresnel"] * len(images),
            ),
            Model(
                name="kirchhoff",
                bounds={"psf_width": COMPLETE},
                seconds=SECONDS_PER_IMAGE["kirchhoff"] * len(images),
            ),
        ),
    )
