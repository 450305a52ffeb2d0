"""From light to disparity: how precisely a matcher can measure disparity in a picture.

The picture of a texture is its spectrum times the transfer function of every step, aliased by the samples, plus the
noise of the electrons; `matching_bound_px` gives the resulting disparity error.

Steps combine as follows. ``fresnel`` and ``kirchhoff`` give one transfer function for defocus and diffraction of a
lens. The product of ``disc`` and ``airy`` is exact where either is negligible and otherwise conservative, for blurs of
up to about two Airy diameters (its first zero is at too low a frequency). The transfer functions of main lens and
microlens are multiplied as if the image of the main lens were an incoherent object. This is conservative: the narrower
of the two cones is the actual aperture, of which the other cuts off little, so light does not spread twice. The pixel
integrates intensity, so its factor is exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import DepthCamera, Limit
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import AT_BOUND, Matcher, PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import kirchhoff_points
from tradestudy.imaging.passed_texture import (
    BandNodes,
    PassedTexture,
    TextureBand,
    band_nodes,
    matched_window,
    picture_electrons,
)
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray

if TYPE_CHECKING:
    from tradestudy.imaging.optical_transfer import LatticePoint


# Simulations showed where a matcher departs from the bound; tests/campaigns/matching.md has the numbers.
LARGEST_ERROR_PX = 0.25
"""Above this error, where one match in twenty is false, a bound for small errors says little about a matcher."""
SMALLEST_WINDOW_PX = 5.0
_WINDOW_OVER_BLUR = 1.5
_WINDOW_OVER_LENGTH = 0.5
_PEAK_CONTRAST = 3.0

# Bounds above this mean that a picture shows no texture; they are reported as infinite.
_NOTHING_KNOWN_PX = 1e9
_COARSER = (0.85, 0.7, 0.55)
# Nodes along the band that suffice up to each blur; beyond the last blur, windows are too small in practice.
_BLUR_STEPS_PX = (3.0, 8.0, 16.0)
_NODES = (20, 25, 31, 38)
CHANGES: Final = ("no blur", "no diffraction", "light of the brightest", "ten times the light")
"""Changes of a picture, each made alone."""
_MORE_LIGHT: Final = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class DerivedDisparityError:
    """The bound over distance.

    Parameters
    ----------
    value
        Standard deviation of one disparity [samples]; NaN where the camera forms no picture, infinite where the picture
        shows no texture.
    error
        Its estimated numerical error [samples]: of the quadrature over the band (twice the largest change by three
        coarser rules), of aliased power beyond the summed replicas, and of Kirchhoff's transfer function.
    violated
        For each condition, where it is violated and a matcher cannot reach the bound.
    """

    value: FloatArray
    error: FloatArray
    violated: Mapping[str, BoolArray]

    @property
    def applies(self) -> BoolArray:
        """Where every condition holds, regardless of saturation."""
        return np.asarray(~np.any(list(self.violated.values()), axis=0))


def disparity_error_px(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels
) -> DerivedDisparityError:
    """Cramér–Rao bound on the disparity error of one pair of windows [samples], over the distances of the geometry.

    Raises
    ------
    OutOfRangeError
        The camera has no stage for a model, or a requested spectrum is missing.
    """
    ((value, error),) = bounds_and_errors_px(geometry, settings, (LitModels(models=models),))
    return DerivedDisparityError(
        value=value,
        error=error,
        violated=violated_conditions(geometry, settings, models, value),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LitModels:
    """Models of a picture whose light is multiplied by a number, the same or another at each distance."""

    models: PictureModels
    brighter: ArrayLike = 1.0


def bounds_and_errors_px(
    geometry: PictureGeometry, settings: PictureSettings, variants: Sequence[LitModels]
) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Value and numerical error of `disparity_error_px` for several variants, computing what they share only once.

    Raises
    ------
    OutOfRangeError
        As for `disparity_error_px`.
    """
    bounds = np.empty((len(variants), 2, geometry.distance.size))
    for variant in variants:
        _require_possible(geometry, settings, variant.models)
    for chosen, along in _by_blur(geometry):
        rules = tuple(_rule(share * along) for share in (1.0, *_COARSER))
        band = TextureBand(geometry=geometry.at(chosen), settings=settings, rules=rules)
        for k, variant in enumerate(variants):
            brighter = np.broadcast_to(variant.brighter, geometry.distance.shape)[chosen]
            bounds[k, 0, chosen], bounds[k, 1, chosen] = _value_and_error(band.passed(variant.models, brighter))
    return tuple((np.where(value > _NOTHING_KNOWN_PX, np.inf, value), error) for value, error in bounds)


def disparity_bound_px(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """The value of `disparity_error_px` without its error, at a quarter of the cost."""
    return WeighedPicture(geometry=geometry, settings=settings).bound_px(models)


@dataclass(frozen=True, kw_only=True, eq=False)
class WeighedPicture:
    """One picture under several models; what they share is computed once.

    Parameters
    ----------
    geometry, settings
        As for `disparity_error_px`.
    interpolated
        See `kirchhoff_transfers`.
    """

    geometry: PictureGeometry
    settings: PictureSettings
    interpolated: bool = True

    def bound_px(self, models: PictureModels) -> FloatArray:
        """The value of `disparity_error_px` [samples], over the distances of the geometry.

        Raises
        ------
        OutOfRangeError
            As for `disparity_error_px`.
        """
        _require_possible(self.geometry, self.settings, models)
        value = np.empty(self.geometry.distance.size)
        for chosen, band in self._bands:
            texture = band.passed(models)
            value[chosen] = texture.bound(0, texture.tail)
        return np.where(value > _NOTHING_KNOWN_PX, np.inf, value)

    @cached_property
    def _bands(self) -> tuple[tuple[IndexArray, TextureBand], ...]:
        return tuple(
            (
                chosen,
                TextureBand(
                    geometry=self.geometry.at(chosen),
                    settings=self.settings,
                    rules=(_rule(along),),
                    interpolated=self.interpolated,
                ),
            )
            for chosen, along in _by_blur(self.geometry)
        )


def matching_margin(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Smallest margin of the bound's conditions; negative where one is violated, NaN without a picture.

    The bound itself is computed only where all other conditions hold.
    """
    margin = np.asarray(np.min(list(_margins_of_the_window(geometry, settings, models).values()), axis=0))
    held = np.flatnonzero(margin >= 0.0)
    if held.size:
        bound = disparity_bound_px(geometry.at(held), settings, models)
        margin[held] = np.minimum(margin[held], np.where(bound == 0.0, -1.0, 1.0 - bound / LARGEST_ERROR_PX))
    return margin


def filled_share(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Electrons of the brightest texture relative to the full well, over distance."""
    brightest = picture_electrons(geometry, settings, models) * (1.0 + _PEAK_CONTRAST * settings.texture.contrast)
    return np.asarray(brightest / settings.sensor_noise.full_well_electrons)


def _require_possible(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> None:
    if geometry.microlens is None and models.microlens_diffraction != "off":
        raise OutOfRangeError(
            "this camera's picture is not blurred by microlenses",
            value=f"microlens_diffraction {models.microlens_diffraction}",
            limit="off",
        )
    if models.spectrum == "weighted" and not settings.spectrum:
        raise OutOfRangeError("a weighted spectrum without wavelengths", remedy="give wavelengths and weights")


def _by_blur(geometry: PictureGeometry) -> Iterator[tuple[IndexArray, int]]:
    """Groups of distances with the same number of nodes along the band, and that number.

    The blur determines that number, in steps, so that the result at one distance does not depend on the others.
    """
    step = np.searchsorted(_BLUR_STEPS_PX, np.nan_to_num(geometry.blur_px))
    for k in np.unique(step):
        yield np.flatnonzero(step == k), _NODES[k]


def _rule(along: float) -> BandNodes:
    return band_nodes(round(along), max(5, round(along / 5.0)))


def _value_and_error(texture: PassedTexture) -> tuple[FloatArray, FloatArray]:
    """The bound by the first rule, and its numerical error."""
    tail = texture.tail
    value = texture.bound(0, tail)
    coarser = np.stack([texture.bound(k, tail) for k in range(1, 1 + len(_COARSER))])
    with np.errstate(invalid="ignore"):  # the error of an infinite bound is NaN
        quadrature = 2.0 * np.max(np.abs(coarser - value), axis=0)
        without_tail, fewer_radii = texture.bound(0, np.zeros_like(tail)), texture.bound(0, tail, every=2)
        aliasing = np.abs(value - without_tail) + np.abs(value - fewer_radii)
        return value, quadrature + aliasing + texture.moved_by_transfer(value)


def matching_needs() -> str:
    """The conditions for a matcher to reach the bound, in words."""
    return (
        f"an error of at most {LARGEST_ERROR_PX:g} px, and a window at least as wide as the largest of "
        f"{SMALLEST_WINDOW_PX:g} samples, {_WINDOW_OVER_BLUR:g} times the blur and {_WINDOW_OVER_LENGTH:g} times the "
        "texture's correlation length"
    )


def violated_conditions(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, bound: FloatArray
) -> Mapping[str, BoolArray]:
    """For each condition, where it is violated and a matcher cannot reach the bound."""
    return {
        f"the matching error exceeds {LARGEST_ERROR_PX:g} px, beyond which the bound does not hold": ~(
            bound <= LARGEST_ERROR_PX
        ),
        "there is no noise": bound == 0.0,
        **{name: ~(margin >= 0.0) for name, margin in _margins_of_the_window(geometry, settings, models).items()},
    }


def _margins_of_the_window(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels
) -> Mapping[str, FloatArray]:
    """Samples by which the window exceeds each of its minimum sizes; NaN without a picture."""
    window = matched_window(geometry, settings, models).side_px
    length_px = settings.texture.correlation_length * geometry.magnification / geometry.sample_pitch
    needed = {
        "the window has too few samples": np.asarray(SMALLEST_WINDOW_PX),
        "the window is too small for the texture's correlation length": _WINDOW_OVER_LENGTH * length_px,
        "the window is too small for the blur": _WINDOW_OVER_BLUR * geometry.blur_px,
    }
    return {name: window - least for name, least in needed.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorCauses:
    """The bound, and what it would be after each of `CHANGES`.

    Parameters
    ----------
    value, error
        As for `disparity_error_px` [samples], over distance.
    changed, changed_error
        The same after each of `CHANGES`, shape (changes, distances); NaN where the light of the brightest picture is
        unknown.
    """

    value: FloatArray
    error: FloatArray
    changed: FloatArray
    changed_error: FloatArray


def error_causes(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, brightest: ArrayLike
) -> ErrorCauses:
    """Recompute the bound without blur, without diffraction, and in more light.

    Removing one cause changes nothing else: a picture in focus keeps its light and its diffraction, one without
    diffraction is blurred by the disc of rays alone, and a pixel with more light is assumed not to saturate. Causes
    interact, so the product of their separate effects need not equal their joint effect. Where blur removes texture
    too fine for the samples, the bound without blur can be the larger one.

    Parameters
    ----------
    geometry, settings, models
        As for `disparity_error_px`.
    brightest
        Electrons of the brightest picture in the comparison relative to this one, over distance; NaN if there is none.

    Raises
    ------
    OutOfRangeError
        As for `disparity_error_px`.
    """
    ratio = np.broadcast_to(np.asarray(brightest, dtype=np.float64), geometry.distance.shape)
    known = np.isfinite(ratio)
    variants = (
        LitModels(models=models),
        LitModels(models=replace(models, defocus_blur="off")),
        LitModels(models=replace(models, main_lens_diffraction="off", microlens_diffraction="off")),
        LitModels(models=models, brighter=np.where(known, ratio, 1.0)),
        LitModels(models=models, brighter=_MORE_LIGHT),
    )
    value, error = np.stack(bounds_and_errors_px(geometry, settings, variants), axis=1)
    error = np.where(np.isfinite(value), error, np.nan)
    in_its_light = 1 + CHANGES.index("light of the brightest")
    for array in (value, error):
        array[in_its_light] = np.where(known, array[in_its_light], np.nan)
    return ErrorCauses(value=value[0], error=error[0], changed=value[1:], changed_error=error[1:])


# Results to cache: callers compute depth at the same distances several times, for parts, limits and failures.
_CACHED = 64


@dataclass(frozen=True, kw_only=True)
class PictureDisparityError:
    """A `DisparityErrorLaw`: the Cramér–Rao bound on the error of matching, plus what a real matcher adds.

    It is evaluated at every requested distance; only Kirchhoff's correction to Fresnel is interpolated, between
    defoci. Equal cameras have equal errors. Whether the bound applies depends on the picture, not on the matcher.

    Parameters
    ----------
    settings
        The texture and light of the scene, and the matching window.
    models
        The models of the picture's physics.
    matcher
        What the matcher adds to the bound.
    """

    settings: PictureSettings
    models: PictureModels
    matcher: Matcher = AT_BOUND

    @property
    def false_matches(self) -> float:
        """Fraction of matches that are false."""
        return self.matcher.false_matches

    def error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Disparity error of the matcher [samples] at distances [m]; NaN without a picture, or if it shows no texture.

        Off the axis, light and pupil are those at the angle of the field position instead of the settings' own; blur
        and the estimator's baseline are those on the axis.
        """
        value = self.matcher.error_px(self.at_field(camera, field).bound_px(camera, distance))
        return np.where(np.isinf(value), np.nan, value).reshape(np.shape(distance))

    def numerical_error_px(self, camera: DepthCamera, distance: ArrayLike, field: float = 0.0) -> FloatArray:
        """Estimated numerical error of `error_px` [samples]; NaN where that is NaN."""
        derived = self.at_field(camera, field).derived(camera, distance)
        error = self.matcher.numerical_error_px(derived.value, derived.error)
        return np.where(np.isfinite(derived.value), error, np.nan).reshape(np.shape(distance))

    def at_field(self, camera: DepthCamera, field: float) -> PictureDisparityError:
        """The law at a field position; unchanged on the axis."""
        if field == 0.0:
            return self
        return replace(self, settings=replace(self.settings, field_angle=camera.field_angle(field)))

    def derived(self, camera: DepthCamera, distance: ArrayLike) -> DerivedDisparityError:
        """The bound, its numerical error and its violated conditions, over the distances as a flat array."""
        return disparity_error_px(camera.picture_geometry(np.ravel(distance)), self.settings, self.models)

    def limit(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Where a matcher can reach the bound: all conditions must hold there, not only that on the bound's value."""
        value, shape = self.bound_px(camera, distance), np.shape(distance)
        broken = violated_conditions(camera.picture_geometry(np.ravel(distance)), self.settings, self.models, value)
        met = ~np.any(list(broken.values()), axis=0)
        return Limit(value=value.reshape(shape), bound=LARGEST_ERROR_PX, met=met.reshape(shape))

    def margin(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """Smallest margin of the conditions of `limit`; negative where one is violated, NaN without a picture."""
        margin = matching_margin(camera.picture_geometry(np.ravel(distance)), self.settings, self.models)
        return margin.reshape(np.shape(distance))

    def broken_conditions(self, camera: DepthCamera, distance: float) -> tuple[str, ...]:
        """Conditions of `limit` that do not hold at a distance [m], in words."""
        return tuple(name for name, where in self.derived(camera, distance).violated.items() if where[0])

    def saturation(self, camera: DepthCamera, distance: ArrayLike) -> Limit:
        """Electrons of the brightest texture relative to the full well: at most 1."""
        share = filled_share(camera.picture_geometry(np.asarray(distance)), self.settings, self.models)
        return Limit(value=share, bound=1.0, met=share <= 1.0)

    def bound_px(self, camera: DepthCamera, distance: ArrayLike) -> FloatArray:
        """The bound [samples] as a flat array; NaN without a picture, infinite where it shows no texture."""
        a = np.ascontiguousarray(distance, dtype=np.float64)
        return _bound_px(camera.as_pictured, self.settings, self.models, a.tobytes())

    def picture(self, camera: DepthCamera, distance: FloatArray) -> WeighedPicture:
        """The picture for which `bound_px` computes the bound; other models can share its transfer functions."""
        return _picture(camera.as_pictured, self.settings, np.ascontiguousarray(distance).tobytes())


def at_bound(camera: DepthCamera) -> DepthCamera:
    """The camera with a matcher that reaches the bound; unchanged if its error is declared."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError) or law.matcher == AT_BOUND:
        return camera
    return replace(camera, disparity_error_px=replace(law, matcher=AT_BOUND))


@lru_cache(maxsize=_CACHED)
def _bound_px(camera: DepthCamera, settings: PictureSettings, models: PictureModels, distance: bytes) -> FloatArray:
    bound = _picture(camera, settings, distance).bound_px(models)
    bound.setflags(write=False)
    return bound


@lru_cache(maxsize=4)  # megabytes each
def _picture(camera: DepthCamera, settings: PictureSettings, distance: bytes) -> WeighedPicture:
    return WeighedPicture(geometry=camera.picture_geometry(np.frombuffer(distance)), settings=settings)


def kirchhoff_lattice(cameras: Iterable[DepthCamera], distance: FloatArray) -> tuple[LatticePoint, ...]:
    """Arguments of every `kirchhoff_correction` that derived errors need at distances [m], without duplicates."""
    return tuple(
        dict.fromkeys(
            point
            for camera in cameras
            if isinstance(law := camera.disparity_error_px, PictureDisparityError)
            for point in kirchhoff_points(camera.picture_geometry(distance), law.settings, law.models)
        )
    )
