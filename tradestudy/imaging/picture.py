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

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from tradestudy.cameras.parts import require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.aliasing import REPLICAS, alias_radii, alias_weights, ring_weights
from tradestudy.imaging.geometry import LensStage, PictureGeometry
from tradestudy.imaging.matching_bound import BandNodes, band_nodes, matching_bound_px
from tradestudy.imaging.noise import Light, SensorNoise, SensorNoiseModel, mean_electrons, noise_variance
from tradestudy.imaging.texture import Texture, share_beyond, texture_spectrum
from tradestudy.imaging.transfer import (
    airy_transfer,
    disc_transfer,
    fresnel_transfer,
    kirchhoff_transfers,
    square_transfer,
)
from tradestudy.imaging.vignetting import field_illumination, require_field
from tradestudy.optics.arrays import BoolArray, FloatArray

DefocusModel = Literal["off", "disc"]
DiffractionModel = Literal["none", "airy", "fresnel", "kirchhoff"]
PixelModel = Literal["point", "square"]
SpectrumModel = Literal["central", "weighted"]
VignettingModel = Literal["off", "cos4"]

# Where a matcher leaves the bound was found by simulation; tests/campaigns/matching.md keeps the figures.
LARGEST_ERROR_PX = 0.25
"""Above this error a bound of small errors says little about a matcher: one match in twenty is another one."""
SMALLEST_WINDOW_PX = 5.0
_WINDOW_OVER_BLUR = 1.5
_WINDOW_OVER_LENGTH = 0.5
_PEAK_CONTRAST = 3.0

# Bounds above this say only that nothing is known; they are called infinite.
_NOTHING_KNOWN_PX = 1e9
_MOST_BLUR_OF_WAVES = 200.0
_COARSER = (0.85, 0.7, 0.55)
# Up to which blur how many nodes along the band suffice; beyond the last the window is too small in practice.
_BLUR_STEPS_PX = (3.0, 8.0, 16.0)
_NODES = (20, 25, 31, 38)


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """What is looked at, how brightly, and how it is matched.

    Parameters
    ----------
    texture
        Of the surface.
    window_px, window_length
        Side of the square window that is matched: in samples of the picture, or as a length [m] on the object so that
        cameras are compared at equal window there. Exactly one. Never more than a micro-image holds.
    light
        Scene and exposure.
    sensor_noise
        Read noise, full well, bits.
    wavelength
        Of the model `central` [m].
    spectrum
        Wavelengths [m] and weights of the model `weighted`; the weights are normalised.
    field_angle
        Of the place in the picture whose light counts [rad], from 0 to below 90°.
    stop_separation
        See `field_illumination` [m], 0 or more.
    pixel_fill
        Active width of a pixel over its pitch, above 0 to 1.
    lens_phase
        Of the Kirchhoff model: a well-corrected lens (``perfect``), or the paper's (``parabolic``).

    Raises
    ------
    OutOfRangeError
        For values outside these ranges, both windows or none.
    """

    texture: Texture
    light: Light
    sensor_noise: SensorNoise
    wavelength: float
    window_px: float | None = None
    window_length: float | None = None
    spectrum: tuple[tuple[float, float], ...] = ()
    field_angle: float = 0.0
    stop_separation: float = 0.0
    pixel_fill: float = 1.0
    lens_phase: Literal["perfect", "parabolic"] = "perfect"

    def __post_init__(self) -> None:
        if (self.window_px is None) == (self.window_length is None):
            raise OutOfRangeError(
                "a window is given in pixels or as a length on the object", limit="exactly one of them"
            )
        for name, value, unit in (
            ("window", self.window_px, "px"),
            ("window", self.window_length, "m"),
            ("wavelength", self.wavelength, "m"),
        ):
            if value is not None:
                require_positive(name, value, unit)
        require_field(self.field_angle, self.stop_separation)
        for wavelength, weight in self.spectrum:
            require_positive("wavelength", wavelength)
            require_positive("weight of a wavelength", weight, "")
        if not 0.0 < self.pixel_fill <= 1.0:
            raise OutOfRangeError("active width of a pixel", value=f"{self.pixel_fill:g}", limit="above 0 to 1 pitch")


@dataclass(frozen=True, kw_only=True)
class PictureModels:
    """Which physics of the picture counts: one model for each effect, the first of each the plainest.

    Parameters
    ----------
    defocus_blur
        ``off``: everything in focus. ``disc``: the geometric blur; where diffraction is ``fresnel`` or ``kirchhoff``,
        the defocus that belongs to it.
    main_lens_diffraction, microlens_diffraction
        ``none``; ``airy``: in focus, beside the disc; ``fresnel``: the defocused pupil; ``kirchhoff``: exact paths and
        cosines. Where the blur exceeds 200 λN the last two are the disc times their transfer in focus. A camera without
        a microlens stage takes ``none`` only.
    pixel_integration
        ``point`` or ``square``: over the active pixel.
    spectrum
        ``central`` wavelength, or ``weighted`` transfer over the spectrum.
    vignetting
        ``off``, or ``cos4``: with the stops at the field angle.
    sensor_noise
        Which noise counts.
    """

    defocus_blur: DefocusModel
    main_lens_diffraction: DiffractionModel
    microlens_diffraction: DiffractionModel
    pixel_integration: PixelModel
    spectrum: SpectrumModel
    vignetting: VignettingModel
    sensor_noise: SensorNoiseModel


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
    if geometry.microlens is None and models.microlens_diffraction != "none":
        raise OutOfRangeError(
            "this camera's picture is not blurred by microlenses",
            value=f"microlens_diffraction {models.microlens_diffraction}",
            limit="none",
        )
    if models.spectrum == "weighted" and not settings.spectrum:
        raise OutOfRangeError("a weighted spectrum without wavelengths", remedy="give wavelengths and weights")
    # As many nodes as the blur asks for, in steps: what is found at a distance must not depend on the others asked for.
    step = np.searchsorted(_BLUR_STEPS_PX, np.nan_to_num(geometry.blur_px))
    value, error = np.empty(step.size), np.empty(step.size)
    for k in np.unique(step):
        chosen = np.flatnonzero(step == k)
        value[chosen], error[chosen] = _value_and_error(geometry.at(chosen), settings, models, _NODES[k])
    value = np.where(value > _NOTHING_KNOWN_PX, np.inf, value)
    return DerivedDisparityError(
        value=value,
        error=error,
        violated=_violated(geometry, settings, value),
        filled_share=np.broadcast_to(_filled_share(settings, _electrons(geometry, settings, models)), value.shape),
    )


def _value_and_error(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, along: int
) -> tuple[FloatArray, FloatArray]:
    """The bound and its numerical error by rules of so many nodes, and fewer."""
    rules = tuple(band_nodes(round(share * along), max(5, round(share * along / 5.0))) for share in (1.0, *_COARSER))
    found = _bounds(geometry, settings, models, rules)
    value = found.by_rule[0]
    with np.errstate(invalid="ignore"):  # an infinite bound has no error: NaN
        quadrature = 2.0 * np.max(np.abs(np.stack(found.by_rule[1:]) - value), axis=0)
        aliasing = np.abs(value - found.without_tail) + np.abs(value - found.fewer_radii)
        return value, quadrature + aliasing + found.transfer_error


def window_px(geometry: PictureGeometry, settings: PictureSettings) -> FloatArray:
    """Side of the window [samples] over distance, at most what the picture holds."""
    if settings.window_px is not None:
        asked = np.full_like(geometry.magnification, settings.window_px)
    else:
        assert settings.window_length is not None  # the settings hold one of the two
        asked = settings.window_length * geometry.magnification / geometry.sample_pitch
    return np.minimum(asked, geometry.widest_window_px)


def optical_transfer(
    geometry: PictureGeometry, settings: PictureSettings, models: PictureModels, frequency_px: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Transfer of the lenses, without the pixel, at |ν| [cycles/sample]; shape (distances, frequencies), and its error.

    With the model ``weighted`` it is the mean over the spectrum of the product of all stages; thin lenses focus all
    colours alike.
    """
    spectrum = settings.spectrum if models.spectrum == "weighted" else ((settings.wavelength, 1.0),)
    total = sum(weight for _, weight in spectrum)
    shape = (geometry.distance.size, frequency_px.size)
    transfer, error = np.zeros(shape), np.zeros(shape[0])
    for wavelength, weight in spectrum:
        passed = np.ones(shape)
        for stage, model in (
            (geometry.main_lens, models.main_lens_diffraction),
            (geometry.microlens, models.microlens_diffraction),
        ):
            if stage is not None:
                found, off = _stage_transfer(
                    stage, model, models.defocus_blur, settings, wavelength, frequency_px / geometry.sample_pitch
                )
                passed *= found
                error += weight / total * off
        transfer += weight / total * passed
    return transfer, error


def _stage_transfer(
    stage: LensStage,
    model: DiffractionModel,
    defocus: DefocusModel,
    settings: PictureSettings,
    wavelength: float,
    frequency: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Of one lens at frequencies on the sensor [cycles/m], and its error over distance."""
    nu = frequency * stage.relay[:, np.newaxis]
    N = stage.f_number[:, np.newaxis]
    blur = (stage.blur_diameter if defocus == "disc" else np.zeros_like(stage.blur_diameter))[:, np.newaxis]
    exact = np.zeros(stage.relay.size)
    blurred = np.any(blur != 0.0)
    # Far out of focus rays err by less than 0.2 √(λN/c), and waves would take ever more nodes for what is not matched.
    by_rays = blur > _MOST_BLUR_OF_WAVES * wavelength * N
    match model:
        case "none":
            return (disc_transfer(nu, blur) if blurred else np.ones_like(nu)), exact
        case "airy":
            spread = airy_transfer(nu, wavelength, N)
            return (spread * disc_transfer(nu, blur) if blurred else spread), exact
        case "fresnel":
            value, error = fresnel_transfer(nu, wavelength, N, np.where(by_rays, 0.0, blur)), exact
        case "kirchhoff":
            value, error = kirchhoff_transfers(
                nu,
                wavelength=wavelength,
                aperture_diameter=stage.aperture_diameter,
                focal_length=stage.focal_length,
                plane_distance=stage.plane_distance,
                defocus_waves=np.where((blur == 0.0) | by_rays, 0.0, stage.defocus(wavelength)[:, np.newaxis])[:, 0],
                lens_phase=settings.lens_phase,
            )
        case _:
            assert_never(model)
    far = by_rays[:, 0]
    if np.any(far):
        value[far] *= disc_transfer(nu[far], blur[far])
        error = np.where(far, error + 0.2 * np.sqrt(wavelength * N[:, 0] / np.where(far, blur[:, 0], 1.0)), error)
    return value, error


def _electrons(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Mean per pixel over distance."""
    left = 1.0
    if models.vignetting == "cos4":
        left = field_illumination(
            settings.field_angle, pupil_diameter=geometry.pupil_diameter, stop_separation=settings.stop_separation
        )
    return mean_electrons(settings.light, geometry.light_f_number, geometry.pixel_pitch, left)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bounds:
    """The bound in several ways, and by how much the error of the transfer moves it.

    By rules of falling order; without the tail of aliased power; with every other alias radius.
    """

    by_rule: list[FloatArray]
    without_tail: FloatArray
    fewer_radii: FloatArray
    transfer_error: FloatArray


def _bounds(
    geometry: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    rules: tuple[BandNodes, ...],
) -> _Bounds:
    """The bound by each rule, and by the first in the other ways."""
    window = window_px(geometry, settings)
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
    tail = (n * contrast) ** 2 * share_beyond(REPLICAS + 0.5, length) * outermost[:, np.newaxis]
    floor = noise_variance(n, settings.sensor_noise, models.sensor_noise)

    def bound(k: int, aliased: FloatArray, every: int = 1) -> FloatArray:
        rule = rules[k]
        signal = inside[k] * np.square(square_transfer(rule.x, rule.y, width))
        replicas = beyond[:, ::every] @ alias_weights(rule, width, every)
        return matching_bound_px(rule, signal=signal, noise=floor + replicas + aliased, window_px=window)

    value = bound(0, tail)
    # A transfer that is off by δ everywhere moves the bound by about δ over its root mean square where it matters.
    slope = rules[0].weight * np.square(rules[0].radius)
    strength = np.sqrt(np.square(transfer[:, : ends[0]]) @ (slope / slope.sum()))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # nothing passed: the bound itself is infinite
        moved = np.where(transfer_error > 0.0, value * transfer_error / strength, 0.0)
    return _Bounds(
        by_rule=[value, *(bound(k, tail) for k in range(1, len(rules)))],
        without_tail=bound(0, np.zeros_like(tail)),
        fewer_radii=bound(0, tail, every=2),
        transfer_error=moved,
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
