"""From light to disparity: what a picture lets a matcher know of a disparity.

The picture of a texture is its spectrum times the transfer of every step, aliased by the samples, with the noise of the
electrons; `matching_bound_px` says what that leaves of the disparity.

How steps combine. Defocus and diffraction of one lens are one transfer in ``fresnel`` and ``kirchhoff``; as ``disc``
times ``airy`` they are a product, exact where either is negligible and otherwise conservative for blurs of up to about
two Airy diameters (the first dark ring comes sooner than it does). The lens and the microlens are multiplied as if the
main lens's image were an incoherent object: conservative, since in truth the narrower of the two cones is the aperture
and the other cuts little of it, and light does not spread twice. The pixel integrates intensity: its product is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.aliasing import REPLICAS, alias_radii, alias_weights, ring_weights
from tradestudy.imaging.geometry import PictureGeometry
from tradestudy.imaging.matching_bound import BandNodes, band_nodes, matching_bound_px
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.noise import mean_electrons, noise_variance
from tradestudy.imaging.optical_transfer import optical_transfer
from tradestudy.imaging.texture import share_beyond, texture_spectrum
from tradestudy.imaging.transfer import disc_transfer, square_transfer
from tradestudy.imaging.vignetting import field_illumination
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray

# Where a matcher leaves the bound was found by simulation; tests/campaigns/matching.md keeps the figures.
LARGEST_ERROR_PX = 0.25
"""Above this error a bound of small errors says little about a matcher: one match in twenty is another one."""
SMALLEST_WINDOW_PX = 5.0
_WINDOW_OVER_BLUR = 1.5
_WINDOW_OVER_LENGTH = 0.5
_PEAK_CONTRAST = 3.0

# Bounds above this say only that nothing is known; they are called infinite.
_NOTHING_KNOWN_PX = 1e9
_COARSER = (0.85, 0.7, 0.55)
# Up to which blur how many nodes along the band suffice; beyond the last the window is too small in practice.
_BLUR_STEPS_PX = (3.0, 8.0, 16.0)
_NODES = (20, 25, 31, 38)


@dataclass(frozen=True, kw_only=True, eq=False)
class DerivedDisparityError:
    """The bound over distance.

    Parameters
    ----------
    value
        Standard deviation of one disparity [samples]; NaN where the camera forms no picture, infinite where that shows
        nothing.
    error
        Estimated numerical error of it [samples]: of the quadrature over the band (twice the largest change by three
        coarser rules), of aliased power from beyond the replicas that are summed, of Kirchhoff's transfer.
    violated
        By condition, where the bound is not what a matcher can reach.
    filled_share
        Electrons of the brightest texture over the full well; above 1 the picture is cut off and the bound is none.
    """

    value: FloatArray
    error: FloatArray
    violated: Mapping[str, BoolArray]
    filled_share: FloatArray

    @property
    def applies(self) -> BoolArray:
        """Where every condition holds, saturation apart."""
        return np.asarray(~np.any(list(self.violated.values()), axis=0))


def disparity_error_px(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels
) -> DerivedDisparityError:
    """Cramér–Rao bound of the disparity of one pair of windows [samples], over the distances of the geometry.

    Raises
    ------
    OutOfRangeError
        A model that the camera has no stage for, or a spectrum asked for and not given.
    """
    _require_possible(geometry, settings, models)
    value, error = np.empty(geometry.distance.size), np.empty(geometry.distance.size)
    for chosen, along in _by_blur(geometry):
        value[chosen], error[chosen] = _value_and_error(geometry.at(chosen), settings, models, along)
    value = np.where(value > _NOTHING_KNOWN_PX, np.inf, value)
    return DerivedDisparityError(
        value=value,
        error=error,
        violated=_violated(geometry, settings, value),
        filled_share=np.broadcast_to(_filled_share(settings, _electrons(geometry, settings, models)), value.shape),
    )


def disparity_bound_px(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """The value of `disparity_error_px` alone, at a quarter of the work: for models that are weighed."""
    _require_possible(geometry, settings, models)
    value = np.empty(geometry.distance.size)
    for chosen, along in _by_blur(geometry):
        matching = _matching(geometry.at(chosen), settings, models, (_rule(along),))
        value[chosen] = matching.bound(0, matching.tail)
    return np.where(value > _NOTHING_KNOWN_PX, np.inf, value)


def _require_possible(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> None:
    if geometry.microlens is None and models.microlens_diffraction != "none":
        raise OutOfRangeError(
            "this camera's picture is not blurred by microlenses",
            value=f"microlens_diffraction {models.microlens_diffraction}",
            limit="none",
        )
    if models.spectrum == "weighted" and not settings.spectrum:
        raise OutOfRangeError("a weighted spectrum without wavelengths", remedy="give wavelengths and weights")


def _by_blur(geometry: PictureGeometry) -> Iterator[tuple[IndexArray, int]]:
    """Distances that share a number of nodes along the band, and that number.

    It is what the blur asks for, in steps: what is found at a distance must not depend on the others asked for.
    """
    step = np.searchsorted(_BLUR_STEPS_PX, np.nan_to_num(geometry.blur_px))
    for k in np.unique(step):
        yield np.flatnonzero(step == k), _NODES[k]


def _rule(along: float) -> BandNodes:
    return band_nodes(round(along), max(5, round(along / 5.0)))


def _value_and_error(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, along: int
) -> tuple[FloatArray, FloatArray]:
    """The bound and its numerical error by rules of so many nodes, and fewer."""
    matching = _matching(geometry, settings, models, tuple(_rule(share * along) for share in (1.0, *_COARSER)))
    tail = matching.tail
    value = matching.bound(0, tail)
    coarser = np.stack([matching.bound(k, tail) for k in range(1, 1 + len(_COARSER))])
    with np.errstate(invalid="ignore"):  # an infinite bound has no error: NaN
        quadrature = 2.0 * np.max(np.abs(coarser - value), axis=0)
        without_tail, fewer_radii = matching.bound(0, np.zeros_like(tail)), matching.bound(0, tail, every=2)
        aliasing = np.abs(value - without_tail) + np.abs(value - fewer_radii)
        return value, quadrature + aliasing + matching.moved_by_transfer(value)


def window_px(geometry: PictureGeometry, settings: PictureSettings) -> FloatArray:
    """Side of the window [samples] over distance, at most what the picture holds."""
    if settings.window_px is not None:
        asked = np.full_like(geometry.magnification, settings.window_px)
    else:
        assert settings.window_length is not None  # the settings hold one of the two
        asked = settings.window_length * geometry.magnification / geometry.sample_pitch
    return np.minimum(asked, geometry.widest_window_px)


def _electrons(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Mean per pixel over distance."""
    left = 1.0
    if models.vignetting == "cos4":
        left = field_illumination(
            settings.field_angle, pupil_diameter=geometry.pupil_diameter, stop_separation=settings.stop_separation
        )
    return mean_electrons(settings.light, geometry.light_f_number, geometry.pixel_pitch, left)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Matching:
    """All that the bound follows from by some rules of falling order.

    Attributes
    ----------
    rules
        Nodes of the band.
    inside, beyond
        Power density of the picture at the nodes of each rule, and at the radii that alias.
    tail
        Aliased power from beyond those radii.
    floor
        Power density of noise.
    sample_width, window
        Side of a square sample and of the window [samples].
    transfer, transfer_error
        Of lenses and round samples at the nodes of the first rule; how far it is off, over distance.
    """

    rules: tuple[BandNodes, ...]
    inside: tuple[FloatArray, ...]
    beyond: FloatArray
    tail: FloatArray
    floor: FloatArray
    sample_width: float
    window: FloatArray
    transfer: FloatArray
    transfer_error: FloatArray

    def bound(self, k: int, aliased: FloatArray, every: int = 1) -> FloatArray:
        """By the k-th rule, with so much power from far beyond, and every n-th radius of what aliases."""
        rule = self.rules[k]
        signal = self.inside[k] * np.square(square_transfer(rule.x, rule.y, self.sample_width))
        replicas = self.beyond[:, ::every] @ alias_weights(rule, self.sample_width, every)
        return matching_bound_px(rule, signal=signal, noise=self.floor + replicas + aliased, window_px=self.window)

    def moved_by_transfer(self, value: FloatArray) -> FloatArray:
        """A transfer off by δ everywhere moves the bound by about δ over its root mean square where it matters."""
        slope = self.rules[0].weight * np.square(self.rules[0].radius)
        strength = np.sqrt(np.square(self.transfer) @ (slope / slope.sum()))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # nothing passed: the bound is infinite
            return np.where(self.transfer_error > 0.0, value * self.transfer_error / strength, 0.0)


def _matching(
    geometry: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    rules: tuple[BandNodes, ...],
) -> _Matching:
    """Pass the texture through every step."""
    radii = alias_radii()
    ends = np.cumsum([rule.x.size for rule in rules])
    frequency = np.concatenate([*(rule.radius for rule in rules), radii])
    transfer, transfer_error = optical_transfer(geometry, settings, models, frequency)
    width = _sample_width(geometry, settings, models)
    if geometry.sample_shape == "disc":  # a microlens collects from a disc: rotationally symmetric, like the lenses
        transfer = transfer * disc_transfer(frequency, width)
        width = 0.0
    length = (settings.texture.correlation_length * geometry.magnification / geometry.sample_pitch)[:, np.newaxis]
    contrast, n = settings.texture.contrast, _electrons(geometry, settings, models)[:, np.newaxis]
    density = n**2 * texture_spectrum(frequency, contrast, length) * np.square(transfer)
    *inside, beyond = np.split(density, ends, axis=1)
    # From beyond the replicas: what texture is left there, passed like the outermost ring, spread evenly.
    outermost = np.square(transfer[:, ends[-1] :]) @ ring_weights(width)
    return _Matching(
        rules=rules,
        inside=tuple(inside),
        beyond=beyond,
        tail=(n * contrast) ** 2 * share_beyond(REPLICAS + 0.5, length) * outermost[:, np.newaxis],
        floor=np.asarray(noise_variance(n, settings.sensor_noise, models.sensor_noise)),
        sample_width=width,
        window=window_px(geometry, settings),
        transfer=transfer[:, : ends[0]],
        transfer_error=transfer_error,
    )


def _sample_width(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> float:
    """Side or diameter of what a sample collects from [samples]; 0 for a point."""
    if models.pixel_integration == "point":
        return 0.0
    fill = settings.pixel_fill if geometry.sample_shape == "square" else 1.0
    return fill * geometry.sample_width / geometry.sample_pitch


def _filled_share(settings: PictureSettings, electrons: FloatArray) -> FloatArray:
    """Electrons of the brightest texture over the full well."""
    brightest = electrons * (1.0 + _PEAK_CONTRAST * settings.texture.contrast)
    return np.asarray(brightest / settings.sensor_noise.full_well_electrons)


def _violated(geometry: PictureGeometry, settings: PictureSettings, bound: FloatArray) -> Mapping[str, BoolArray]:
    """Where a matcher cannot reach the bound, by condition."""
    window = window_px(geometry, settings)
    length_px = settings.texture.correlation_length * geometry.magnification / geometry.sample_pitch
    return {
        "the error is too large for a bound of small errors": ~(bound <= LARGEST_ERROR_PX),
        "there is no noise": bound == 0.0,
        "the window has too few samples": ~(window >= SMALLEST_WINDOW_PX),
        "the window is too small for the texture's correlation length": ~(window >= _WINDOW_OVER_LENGTH * length_px),
        "the window is too small for the blur": ~(window >= _WINDOW_OVER_BLUR * geometry.blur_px),
    }
