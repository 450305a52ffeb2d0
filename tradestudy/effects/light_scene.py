"""A light path and its source in the few numbers that decide which effects matter: rays, widths, Fresnel numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import DiscSource, LightPath
from tradestudy.optics.chain.sources import symmetries
from tradestudy.optics.propagation import CircularLens, PointSource
from tradestudy.optics.propagation.lens import lens_paths

_PUPIL_POINTS: Final = 400
_SOURCE_POINTS: Final = 13
_RIM_POINTS: Final = 16
_FEW_RAYS: Final = 40  # for what changes slowly over the array
_FEWEST_RAYS: Final = 20
_LEAST_FRESNEL_NUMBER: Final = 0.5  # of the main pupil from the array
_GOLDEN: Final = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True, kw_only=True)
class LawDifference:
    """What Fresnel's law changes against Kirchhoff's on one leg, over the rays that pass the array.

    Attributes
    ----------
    displacement
        Root mean square by which rays land elsewhere on the detector [m]; infinite where no ray passes.
    brightness
        Root mean square of the relative change of intensity by the cosines that Fresnel takes for one.
    """

    displacement: float
    brightness: float


@dataclass(frozen=True, kw_only=True)
class _Rays:
    """Paraxial rays that pass the array, each with its source point s, pupil point u and array point x."""

    arriving: FloatArray  # u − x, shape (rays, 2)
    main_slope: FloatArray  # exact less paraxial slope of the path behind the main lens at u, shape (rays, 2)
    offset: FloatArray  # x − centre of its microlens, shape (rays, 2)
    object_offset: FloatArray  # main image of s less that centre, shape (rays, 2)
    focal_length: FloatArray  # infinite in clear gaps, shape (rays,)
    landing: FloatArray  # σ on the detector, shape (rays, 2)
    lens: FloatArray  # index of the microlens, shape (rays,)


@dataclass(frozen=True, kw_only=True, eq=False)  # what is computed of a scene is kept for it
class LightScene:
    """A light path, a disc before it, and one wavelength.

    Parameters
    ----------
    path, source
        Camera and disc.
    wavelength
        λ [m].
    """

    path: LightPath
    source: DiscSource
    wavelength: float

    @cached_property
    def depth(self) -> float:
        """Main image before the array, a_L [m], signed."""
        return self.path.image_at_array(self.source.centre)[2]

    @cached_property
    def main_image_distance(self) -> float:
        """b_M [m]."""
        return self.path.array_distance - self.depth

    @cached_property
    def blur_on_array(self) -> float:
        """Radius of the disc that a point lights on the array by rays [m]."""
        return self.path.main_lens.radius * abs(self.depth / self.main_image_distance)

    @cached_property
    def acting_width(self) -> float:
        """Width of the part of a microlens that a point lights [m]: its aperture, or less where rays meet on it."""
        waist = self.wavelength * self.path.array_distance / self.path.main_lens.radius
        return min(self.path.microlenses.aperture_width, 2.0 * math.hypot(self.blur_on_array, waist))

    @cached_property
    def cutoff(self) -> float:
        """Highest spatial frequency on the detector behind one microlens [1/m]."""
        return self.acting_width / (self.wavelength * self.path.detector_distance)

    @cached_property
    def spot_radius(self) -> float:
        """Radius of the disc's image behind one microlens [m]; the image of the pupil is the widest it can be."""
        b, widest = self.path.detector_distance, self.path.main_lens.radius / self.path.array_distance
        if self.depth == 0.0:
            return b * widest
        seen = self.source.diameter / 2.0 * self.main_image_distance / self.source.distance / self.depth
        return b * min(abs(seen), widest + self.acting_width / 2.0 / abs(self.depth))

    @cached_property
    def vergence_errors(self) -> FloatArray:
        """1/a_L + 1/b_L − 1/f_L of every type of microlens [1/m]: zero in focus."""
        kinds = np.unique(self.path.microlenses.focal_lengths)
        waist = self.wavelength * self.path.array_distance / self.path.main_lens.radius
        depth = math.copysign(max(abs(self.depth), waist), self.depth)
        return np.asarray(1.0 / depth + 1.0 / self.path.detector_distance - 1.0 / kinds)

    @cached_property
    def blur_on_detector(self) -> float:
        """Largest radius of the ray blur of a point behind one microlens [m]."""
        worst = float(np.max(np.abs(self.vergence_errors)))
        return self.acting_width / 2.0 * self.path.detector_distance * worst

    @cached_property
    def least_blur_on_detector(self) -> float:
        """The same behind the type of microlens that is nearest to focus [m]."""
        least = float(np.min(np.abs(self.vergence_errors)))
        return self.acting_width / 2.0 * self.path.detector_distance * least

    @cached_property
    def main_fresnel_number(self) -> float:
        """N = R²/λ |1/z − 1/b_M| of the main pupil as seen from the array."""
        z, b = self.path.array_distance, self.main_image_distance
        return self.path.main_lens.radius**2 / self.wavelength * abs(1.0 / z - 1.0 / b)

    @cached_property
    def microlens_fresnel_number(self) -> float:
        """N = (w/2)²/λ |1/a_L + 1/b_L − 1/f_L| of the lit part of a microlens; the type nearest to focus."""
        least = float(np.min(np.abs(self.vergence_errors)))
        return (self.acting_width / 2.0) ** 2 / self.wavelength * least

    @cached_property
    def largest_microlens_fresnel_number(self) -> float:
        """The same of the type farthest from focus."""
        return self.acting_width / 2.0 * self.blur_on_detector / (self.wavelength * self.path.detector_distance)

    @cached_property
    def symmetry_order(self) -> int:
        """Mirrors and turns that change nothing, the identity among them."""
        return len(symmetries(self.path, self.source))

    @cached_property
    def why_unbounded(self) -> str:
        """Why no bound can be stated from rays and widths; empty where one can.

        Rays say nothing of light that diffraction alone brings to a microlens, nor of the inside of a focal spot; the
        transfer functions of all bounds are those of intensities, which add where points radiate on their own.
        """
        if self.source.coherent:
            return "the points of the source radiate as one wave, and bounds are known for intensities that add"
        if len(self._rays.landing) < _FEWEST_RAYS:
            return "hardly any ray passes a microlens, so that nothing is known of the light that does"
        if self.main_fresnel_number < _LEAST_FRESNEL_NUMBER:
            return "the array stands within the focal spot of the main lens, where rays say nothing"
        return ""

    @cached_property
    def margins(self) -> FloatArray:
        """How far each ray lands inside its own microlens's cell on the detector [m]; < 0 behind a neighbour."""
        # Cells lie farther apart on the detector than microlenses on the array, seen from the main lens.
        rays, spread = self._rays, 1.0 + self.path.detector_distance / self.path.array_distance
        scaled = self.path.microlenses.centres * spread
        if len(scaled) == 1 or not len(rays.landing):
            return np.full(len(rays.landing), math.inf)
        to = np.linalg.norm(rays.landing[:, None] - scaled, axis=-1)
        index = rays.lens.astype(int)[:, None]
        own = np.take_along_axis(to, index, axis=1)
        apart = np.linalg.norm(scaled[index[:, 0]][:, None] - scaled, axis=-1)
        np.put_along_axis(apart, index, 1.0, axis=1)  # the cell has no border with itself: left out below
        distance = (to**2 - own**2) / (2.0 * apart)
        np.put_along_axis(distance, index, math.inf, axis=1)
        return np.asarray(distance.min(axis=1))

    @cached_property
    def main_law(self) -> LawDifference:
        """Fresnel against Kirchhoff from the main lens to the array."""
        rays, z, b = self._rays, self.path.array_distance, self.path.detector_distance
        error = _cosines(rays.arriving, z) - rays.arriving / z
        at_pupil, at_array = rays.main_slope + error, -error
        if self.blur_on_array < self.path.microlenses.aperture_width / 2.0:  # lit by the whole pupil
            power = 1.0 / z + 1.0 / b - 1.0 / rays.focal_length[:, None]
            landing = b * (power * z * at_pupil + at_array)
        else:
            landing = b * (at_array - at_pupil * self.main_image_distance / self.depth)
        return self._difference(landing, rays.arriving, z)

    @cached_property
    def detector_law(self) -> LawDifference:
        """Fresnel against Kirchhoff from the array to the detector, lens phases of the microlenses included."""
        return self._behind_array(self._rays)

    @cached_property
    def rim_detector_law(self) -> LawDifference:
        """The same for light that the rim of the main pupil diffracts to where rays pass the array."""
        return self._behind_array(self._rim_rays)

    @cached_property
    def rim_path_waves(self) -> float:
        """Change of phase by exact paths, of the rim's light against that of rays, root mean square [waves]."""
        rays, rim = self._rays, self._rim_rays
        if not len(rays.landing):
            return math.inf
        few = slice(None, None, max(1, len(rays.landing) // _FEW_RAYS))
        x = (rays.offset + self._centre_of(rays))[few]
        own = self._main_error(x + rays.arriving[few], x)
        at_rim = x[:, None] + rim.arriving.reshape(-1, _RIM_POINTS, 2)[: len(x)]
        other = self._main_error(at_rim, np.broadcast_to(x[:, None], at_rim.shape))
        return float(np.sqrt(np.mean((other - own[:, None]) ** 2))) / self.wavelength

    @cached_property
    def microlens_rim_path_waves(self) -> float:
        """The same behind the array: of light from the rim of a microlens, against that of the ray [waves]."""
        rays, path = self._rays, self.path
        acting = np.flatnonzero(np.isfinite(rays.focal_length))
        if not acting.size:
            return math.inf
        angle = 2.0 * math.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        rim = path.microlenses.aperture_width / 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        squares = []
        for ray in acting[:: max(1, acting.size // _FEW_RAYS)]:
            lens = path.microlenses.lens(int(rays.lens[ray]))
            seen = PointSource(
                x=float(rays.object_offset[ray, 0]), y=float(rays.object_offset[ray, 1]), distance=self.depth
            )
            at = np.vstack([rays.offset[ray], rim])
            towards = at - (rays.landing[ray] - path.microlenses.centres[int(rays.lens[ray])])
            error = _path_error(seen, lens, at, towards, path.detector_distance)
            squares.append(np.mean((error[1:] - error[0]) ** 2))
        return math.sqrt(float(np.mean(squares))) / self.wavelength

    def _main_error(self, pupil: FloatArray, x: FloatArray) -> FloatArray:
        """Exact less paraxial path from the middle of the source through pupil points to array points [m]."""
        return _path_error(self.source.centre, self.path.main_lens, pupil, pupil - x, self.path.array_distance)

    def _behind_array(self, rays: _Rays) -> LawDifference:
        b = self.path.detector_distance
        leaving = rays.landing - (rays.offset + self._centre_of(rays))
        error = self._microlens_slope(rays) + _cosines(-leaving, b) + leaving / b
        return self._difference(b * error, leaving, b)

    def _difference(self, landing: FloatArray, travel: FloatArray, distance: float) -> LawDifference:
        if not len(landing):
            return LawDifference(displacement=math.inf, brightness=math.inf)
        cosine = 1.0 / (1.0 + np.sum(travel**2, axis=1) / distance**2)
        return LawDifference(
            displacement=float(np.sqrt(np.mean(np.sum(landing**2, axis=1)))),
            brightness=float(np.sqrt(np.mean((1.0 - cosine**2) ** 2))),
        )

    def _centre_of(self, rays: _Rays) -> FloatArray:
        return np.asarray(self.path.microlenses.centres[rays.lens.astype(int)])

    def _microlens_slope(self, rays: _Rays) -> FloatArray:
        """Exact less paraxial slope of the phase of the microlenses."""
        kind, focal = self.path.microlenses.lens_phase, rays.focal_length[:, None]
        if kind == "parabolic":
            return np.zeros_like(rays.offset)
        if kind == "stigmatic":
            known = self.path.microlenses.focus_distance
            assert known is not None  # the lens's own promise
            before, apart = np.full_like(focal, known), np.zeros_like(rays.offset)
        else:
            before, apart = np.full_like(focal, self.depth), rays.object_offset
        with np.errstate(invalid="ignore", divide="ignore"):  # clear gaps have no lens: ∞, replaced below
            behind = before * focal / (before - focal)
            incoming = _cosines(rays.offset - apart, before)
            outgoing = -_cosines(rays.offset + apart * behind / before, behind)
            error = outgoing - incoming + rays.offset / focal
        return np.where(np.isfinite(focal), error, 0.0)

    @cached_property
    def _rim_rays(self) -> _Rays:
        """From all around the rim of the pupil to where some rays pass the array."""
        rays, path = self._rays, self.path
        few = slice(None, None, max(1, len(rays.landing) // _FEW_RAYS))
        angle = 2.0 * math.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        rim = path.main_lens.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        lens, offset, focal = (
            np.repeat(a[few], _RIM_POINTS, axis=0) for a in (rays.lens, rays.offset, rays.focal_length)
        )
        x = offset + path.microlenses.centres[lens.astype(int)]
        arriving = np.tile(rim, (len(x) // _RIM_POINTS, 1)) - x
        landing = x - path.detector_distance * (arriving / path.array_distance + offset / focal[:, None])
        return _Rays(
            arriving=arriving,
            main_slope=np.zeros_like(x),
            offset=offset,
            object_offset=np.repeat(rays.object_offset[few], _RIM_POINTS, axis=0),
            focal_length=focal,
            landing=landing,
            lens=lens,
        )

    @cached_property
    def _rays(self) -> _Rays:
        """Rays from points all over the disc through points all over the pupil; those that pass."""
        path, lenses, b = self.path, self.path.microlenses, self.path.detector_distance
        pupil = _spread(_PUPIL_POINTS) * path.main_lens.radius
        spots = _spread(_SOURCE_POINTS) * (self.source.diameter / 2.0) + (self.source.x, self.source.y)
        parts = []
        for spot in spots:
            point = PointSource(x=float(spot[0]), y=float(spot[1]), distance=self.source.distance)
            x = np.asarray(path.chief_point(point)) + pupil * (self.depth / -self.main_image_distance)
            slope = [
                np.column_stack(lens_paths(point, path.main_lens, paraxial=law).slope(pupil[:, 0], pupil[:, 1]))
                for law in (False, True)
            ]
            image = np.asarray(path.image_at_array(point)[:2])
            parts.append((x, pupil, slope[0] - slope[1], np.broadcast_to(image, pupil.shape)))
        x, u, main_slope, image = (np.concatenate(column) for column in zip(*parts, strict=True))
        lens = np.argmin(np.linalg.norm(x[:, None] - lenses.centres, axis=-1), axis=1)
        offset = x - lenses.centres[lens]
        acting = _inside(offset, lenses.aperture_width / 2.0, square=lenses.aperture == "square")
        passing = acting | ((lenses.gaps == "clear") & (np.linalg.norm(offset, axis=1) <= lenses.cell_reach))
        focal = np.where(acting, lenses.focal_lengths[lens], math.inf)
        landing = x + b * ((x - u) / path.array_distance - offset / focal[:, None])
        return _Rays(
            arriving=(u - x)[passing],
            main_slope=main_slope[passing],
            offset=offset[passing],
            object_offset=(image - lenses.centres[lens])[passing],
            focal_length=focal[passing],
            landing=landing[passing],
            lens=lens[passing].astype(float),
        )


def _path_error(
    source: PointSource, lens: CircularLens, at: FloatArray, towards: FloatArray, distance: float
) -> FloatArray:
    """Exact less paraxial path from a source through points of a lens to others, ``towards`` beside them [m]."""
    exact, paraxial = (lens_paths(source, lens, paraxial=law).value(at[..., 0], at[..., 1]) for law in (False, True))
    squared = np.sum(towards**2, axis=-1)
    # √(z² + d²) − z − d²/2z without the difference of large numbers
    leg = squared / (distance + np.sqrt(distance**2 + squared)) - squared / (2.0 * distance)
    return np.asarray(exact - paraxial + leg)


def _cosines(towards: FloatArray, distance: FloatArray | float) -> FloatArray:
    """Transverse direction cosines of a spherical wave at points ``towards`` from its centre."""
    length = np.sqrt(np.sum(towards**2, axis=1, keepdims=True) + np.square(distance))
    return np.asarray(np.sign(distance) * towards / length)


def _spread(count: int) -> FloatArray:
    """Points that fill the unit disc evenly (sunflower), shape (count, 2)."""
    index = np.arange(count) + 0.5
    radius, angle = np.sqrt(index / count), _GOLDEN * index
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def _inside(offset: FloatArray, half: float, *, square: bool) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    return np.asarray(np.max(np.abs(offset), axis=1) <= half if square else np.linalg.norm(offset, axis=1) <= half)
