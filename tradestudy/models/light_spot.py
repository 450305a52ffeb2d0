"""How far exact paths and cosines move a disparity error derived by Fresnel's transfer: a closed rule, and a trial."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Final, Literal

import numpy as np

from tradestudy.accuracy import Quantity
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.effects import LENSES, OFF, Models, SlotName, models_of
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.optical_transfer import is_by_rays
from tradestudy.imaging.picture import WeighedPicture, disparity_bound_px
from tradestudy.models.light_trial import TOLERANCE, light_trial
from tradestudy.models.problem import Change, Changes, SimulationProblem, Slot
from tradestudy.models.spot_images import RAYS, SpotModels, light_path, light_source
from tradestudy.optics.arrays import FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy
from tradestudy.optics.chain.lit_part import lit_disc
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource, source_nodes
from tradestudy.optics.chain.spot_image import followed_points
from tradestudy.optics.chain.spot_points import source_density
from tradestudy.study.prepared import with_models
from tradestudy.study.schema.wave_optics import LightSpotPart, MethodName

ErrorPx = Callable[[Models], FloatArray]
"""Disparity error [samples] over distances, with some models replaced."""
# Set by 150 random cameras, at the places where the rule is tightest.
_RULE_MARGIN: Final = 2.0
_TRANSFER_ERROR: Final = 2e-4  # of Kirchhoff's transfer, with which Fresnel's is compared
_NARROWER: Final = 0.5  # width of a disc of rays per sin² θ


def change_by_exact_paths(
    geometry: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    error_px: ErrorPx,
) -> tuple[FloatArray, FloatArray]:
    """Estimate, with a margin, how far Kirchhoff's law at either lens moves a disparity error found by Fresnel's.

    Fresnel's law leaves out two things. One is the excess path at the rim, which acts like a defocus once balanced. The
    other is the angle θ of the rays at the rim: amplitude falls by ε = sin² θ towards it, and the cutoff is 2 sin θ/λ,
    ε/2 below 1/(λ N). Both together increase the logarithmic loss of contrast by diffraction by the share ε, and
    therefore what diffraction adds to the error by the same share.

    Parameters
    ----------
    geometry, settings, models
        The picture; the models are the most complete in closed form.
    error_px
        Disparity error over the distances of the geometry.

    Returns
    -------
    tuple
        Relative changes by the main lens and by the microlenses, over distance; zero without microlenses.
    """
    return (
        _of_lens("main_lens", "main_lens_diffraction", geometry, settings, models, error_px),
        _of_lens("microlens", "microlens_diffraction", geometry, settings, models, error_px),
    )


def _of_lens(
    lens: Literal["main_lens", "microlens"],
    slot: SlotName,
    geometry: PictureGeometry,
    settings: PictureSettings,
    models: PictureModels,
    error_px: ErrorPx,
) -> FloatArray:
    """The change by one lens of the picture; zero where the picture has none."""
    stage: LensStage | None = getattr(geometry, lens)
    if stage is None:
        return np.zeros(geometry.distance.shape)
    aberrated = _aberrated(stage, settings)
    error, without_diffraction = error_px({}), error_px({slot: OFF})
    by_paths, other = np.zeros(error.shape), np.flatnonzero(aberrated.blur_diameter != stage.blur_diameter)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_diffraction = np.minimum(1.0, np.abs(without_diffraction / error - 1.0))
        if other.size:  # only where aberration changes the blur is a picture needed
            on_main = lens == "main_lens"
            moved = replace(geometry, main_lens=aberrated) if on_main else replace(geometry, microlens=aberrated)
            moved = moved.at(other)
            blurred = disparity_bound_px(moved, settings, with_models(models, {"defocus_blur": "disc"}))
            by_paths[other] = np.abs(blurred / error[other] - 1.0)
    return np.asarray(_RULE_MARGIN * (by_paths + _obliquity(stage) * by_diffraction) + _TRANSFER_ERROR)


def _aberrated(stage: LensStage, settings: PictureSettings) -> LensStage:
    """The lens with its blur changed by exact paths and angles.

    Light that falls off by ε = sin² θ towards the rim makes the disc of rays narrower by about ε/2. Spherical
    aberration of W waves at the rim, balanced, acts like a defocus of W waves, a blur of ``8 λ N W``; the margin covers
    the remaining thirteenth. A well-corrected lens has no spherical aberration: its rays meet in one point. A parabolic
    lens has ``W = R⁴/8 (1/b³ + 1/a³)/λ``.
    """
    # Far out of focus, both laws use the same disc of rays and differ by diffraction alone.
    by_waves = ~is_by_rays(stage.blur_diameter, settings.wavelength, stage.f_number)
    blur = stage.blur_diameter * (1.0 + _NARROWER * _obliquity(stage) * by_waves)
    if settings.lens_phase == "parabolic":
        rim = (stage.aperture_diameter / 2.0) ** 4 / 8.0
        path = rim * (np.abs(1.0 / stage.plane_distance**3) + np.abs(1.0 / stage.object_distance**3))
        blur = blur + 8.0 * stage.f_number * path
    return replace(stage, blur_diameter=blur)


def _obliquity(stage: LensStage) -> FloatArray:
    """sin² θ of the rays at the rim."""
    half = stage.aperture_diameter / 2.0
    return np.asarray(half**2 / (half**2 + stage.plane_distance**2))


def places_to_try(weight: FloatArray, blur_px: FloatArray) -> IndexArray:
    """Up to four places to try: where the rule's change of the uncertainty is largest, the sharpest, and two others.

    Changes oscillate with defocus, and can pass through zero where the rule is largest. Of places no more blurred than
    that one, the third is where the rule comes closest to halfway between the other two. The fourth has the largest
    change by the rule on the other side of the sharpest, where other blurs occur.

    Parameters
    ----------
    weight, blur_px
        Relative change of the uncertainty by the rule, and blur [samples], over places by rising distance.
    """
    weight = np.nan_to_num(weight, posinf=1.0)
    largest, sharpest = int(np.argmax(weight)), int(np.nanargmin(blur_px))
    from_halfway = np.abs(weight - (weight[largest] + weight[sharpest]) / 2.0)
    between = int(np.argmin(np.where(blur_px <= blur_px[largest], from_halfway, np.inf)))
    number = np.arange(weight.size)
    beyond = number >= sharpest if largest < sharpest else number <= sharpest
    other = int(np.argmax(np.where(beyond, weight, -np.inf)))
    return np.unique([largest, between, sharpest, other])


def tried_change(geometry: PictureGeometry, settings: PictureSettings, models: PictureModels) -> FloatArray:
    """Relative size of the change of the disparity error by Kirchhoff's law at all lenses, over distance.

    In light of the mean wavelength: a spectrum would only average over the defocus, in which the tried places differ.
    """
    if models.spectrum != OFF:
        wavelengths, weights = np.array(settings.spectrum).T
        settings = replace(settings, wavelength=float(np.average(wavelengths, weights=weights)))
    fresnel = replace(models, spectrum=OFF)
    exact = with_models(fresnel, {lens: "kirchhoff" for lens in LENSES if getattr(models, lens) != OFF})
    picture = WeighedPicture(geometry=geometry, settings=settings, interpolated=False)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(picture.bound_px(exact) / picture.bound_px(fresnel) - 1.0))


NAME: Final = "light-spot"
TOLERANCES: Final = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
# Rays combined with waves are paraxial, and only for comparisons.
METHODS: Final[Mapping[tuple[str, str], MethodName]] = {
    (OFF, OFF): "exact-rays",
    ("boundary_wave", "boundary_wave"): "boundary-wave",
    ("boundary_wave", "fresnel"): "boundary-wave-fresnel",
    ("boundary_wave", "kirchhoff"): "boundary-wave-kirchhoff",
    ("fresnel", "fresnel"): "fresnel",
    ("fresnel", "kirchhoff"): "fresnel-kirchhoff",
    ("kirchhoff", "boundary_wave"): "kirchhoff-boundary-wave",
    ("kirchhoff", "fresnel"): "kirchhoff-fresnel",
    ("kirchhoff", "kirchhoff"): "kirchhoff",
}
# Margins on trials, since a few points do not represent the whole picture. Those of laws were set on 51 discs with more
# than 120 followed points, of seeds 811 and 812 of `tests.campaigns.light_cases.large_part`. Rays changed pictures by
# at most 1.14 times what trials found, where by less than 25 %; Fresnel's law by at most 1.4 times, except for two
# changes of about 1 %, which were 1.9 and 3.5 times. On seven discs of the fresh seed 824, one change by rays was 1.22
# times what the trial found, and so 1.11 times what is stated; all others were smaller than stated. Their microlenses
# had any lens phase, and their trials left out light that misses a microlens's own pixels. With that light, and with
# parabolic microlenses, Fresnel's law changed five discs of seed 811 by at most 1.5 times what trials found.
_MARGIN_OF_RAYS: Final = 1.1
_MARGIN_OF_WAVES: Final = 2.4
_MARGIN: Final = 1.3  # of pixels and crosstalk, which save no time
# Of 79 changes from 0.1 to 22 % on light paths of seeds 302 and 303, trials found at least 95 %; other paths may be
# worse. Seven points instead of four found at least 91 % and took half as long again.
_MARGIN_OF_EXTENT: Final = 1.12
# Trials of three laws follow about forty points: for pictures of few points they cost more than they save.
_WORTH_TRYING: Final = 120.0
_LARGEST_BY_RULE: Final = 0.3  # beyond this, the second-order rule fails
_NEVER_A_POINT: Final = 100.0  # by the same rule; the light varies over twelve cycles, and no trial is worth its time
_FREE: Final = 0.25  # of the change by wave models: finer nodes than for this sampling error cost more than they save


_TOO_LARGE: Final = Change(relative=math.inf, least=math.inf)


class LightSpotProblem(SimulationProblem):
    """The picture of one spot; trials find the change due to what its models leave out.

    The boundary wave costs more than Fresnel's law and saves nothing behind the array, so it is used only where the
    study prescribes it. Images of single microlenses, or light at pixel centres alone, cost as much as the complete
    picture.

    Parameters
    ----------
    part
        The light path.
    forced
        Models that the study prescribes.

    Raises
    ------
    OutOfRangeError
        If the forced models cannot be combined.
    """

    def __init__(self, part: LightSpotPart, forced: Models) -> None:
        self.name = NAME
        self.title = "Picture of the light spot"
        self.asked: tuple[Quantity, ...] = ("pixel_intensity",)
        self._forced = {slot: model for slot, model in forced.items() if model in models_of(slot, "spot")}
        if part.spot.is_point:  # a point has no extent, whatever the study prescribes
            self._forced.pop("source_extent", None)
        self._part, self._trial = part, light_trial(part)
        self._squares: dict[SpotModels, list[tuple[float, float]]] = {}
        coherent, point, one_line = part.spot.coherent, part.spot.is_point, len(part.lines) == 1
        slots = (
            Slot(name="source_extent", models=(OFF,) if point else (OFF, "disc"), reason="a point" if point else ""),
            Slot(
                name="spectrum",
                models=(OFF,) if one_line else (OFF, "weighted"),
                reason="the light has one wavelength" if one_line else "",
            ),
            *(Slot(name=leg, models=self._laws(leg, coherent=coherent)) for leg in LENSES),
            Slot(name="crosstalk", models=(OFF, "coherent"), saves_time=False),
            Slot(name="pixel_integration", models=(OFF, "square"), saves_time=False),
            Slot(name="sampling", models=tuple(f"{100.0 * tolerance:.6g} %" for tolerance in TOLERANCES)),
        )
        self.slots = tuple(slot.under(self._forced) for slot in slots)
        complete = self._models(self.complete)
        if complete is None:
            raise OutOfRangeError(
                "forced models of the light spot cannot be combined",
                value=", ".join(f"{slot}: {model}" for slot, model in self._forced.items()),
                limit="rays on both legs with integrated pixels, or waves on both legs",
                remedy="set both legs to 'off', or both to a wave law",
            )
        self._complete = complete

    def _laws(self, leg: SlotName, *, coherent: bool) -> tuple[str, ...]:
        """The laws to choose from on a leg: no rays for coherent light, the boundary wave only where it is forced."""
        left_out = {"boundary_wave"} - {self._forced.get(leg)} | ({OFF} if coherent else set())
        return tuple(model for model in models_of(leg, "spot") if model not in left_out)

    def changes(self, models: Models) -> Changes:
        """Relative L2 change of the pixels due to omissions, from a trial, and to sampling, from its tolerance.

        The two are independent and add in quadrature.
        """
        spot = self._models(models)
        return {"pixel_intensity": _TOO_LARGE if spot is None else self._change(spot)}

    def _change(self, spot: SpotModels) -> Change:
        whole = replace(spot, tolerance=TOLERANCES[-1])
        if whole == self._complete:
            return Change(relative=spot.tolerance, evidence="rule")
        if whole not in self._squares:
            return self._untried(spot, whole)
        done = self._squares[whole]
        changed, light = (math.fsum(column) for column in zip(*done, strict=True))
        tried = math.sqrt(changed / light) if light > 0.0 else math.inf
        count = self._trial.count(whole, self._complete)
        if len(done) < count:
            # The lower bound if the other points change nothing, and contain up to four times the squared light.
            least = 0.5 * tried * math.sqrt(len(done) / count)
            return Change(relative=math.inf, least=least, evidence="trial")
        change = math.hypot(self._margin(whole) * tried, TOLERANCE)
        return Change(relative=_with_sampling(change, spot), evidence="trial")

    def _untried(self, spot: SpotModels, whole: SpotModels) -> Change:
        """The change before any trial; too large where no trial is worth its time."""
        if whole == self._shrunk:
            if self._extent > _NEVER_A_POINT:
                return _TOO_LARGE
            relative = _with_sampling(self._extent, spot) if self._extent < _LARGEST_BY_RULE else math.inf
            least = math.hypot(TOLERANCE, spot.tolerance)  # the least that a trial can find
            return Change(relative=relative, least=min(relative, least), evidence="rule")
        if whole.method != self._complete.method and not self._forced and (whole.point or not self.tries_laws):
            return _TOO_LARGE  # a trial of a law would take about as long as the picture itself
        return Change(relative=math.inf, evidence="trial")

    def _margin(self, models: SpotModels) -> float:
        """Factor on the change that a trial of models finds."""
        if models == self._shrunk:
            return _MARGIN_OF_EXTENT
        if models.method == self._complete.method:
            return _MARGIN
        return _MARGIN_OF_RAYS if models.method in RAYS else _MARGIN_OF_WAVES

    @cached_property
    def _extent(self) -> float:
        """Change of the picture if the disc counts as a point, by a second-order rule; NaN for coherent discs."""
        source = light_source(self._part)
        if not isinstance(source, DiscSource) or source.coherent:
            return math.nan
        return extent_rule(light_path(self._part), source, self._part.mean_wavelength)

    @property
    def _shrunk(self) -> SpotModels:
        """The most complete models, except that the disc counts as a point."""
        return replace(self._complete, point=True)

    @property
    def tries_laws(self) -> bool:
        """Whether pictures follow so many source points that trials of laws are worth their time."""
        return self.points >= _WORTH_TRYING

    @cached_property
    def points(self) -> float:
        """Source points that the picture follows at the coarsest sampling; infinite if they are too many to follow."""
        path, source = light_path(self._part), light_source(self._part)
        if not isinstance(source, DiscSource) or source.coherent:
            return 1.0
        density = source_density(ChainAccuracy(tolerance=TOLERANCES[0]))
        wavelength = self._part.mean_wavelength
        source = lit_disc(path, source, wavelength=wavelength, tolerance=TOLERANCES[0])
        try:
            nodes = source_nodes(path, source, wavelength=wavelength, density=density)
        except UnaffordableError:
            return math.inf
        return followed_points(path, source, nodes)

    def try_out(self, models: Models) -> bool:
        """Compare the image of one more source point with that by the most complete models."""
        spot = self._models(models)
        whole = spot and replace(spot, tolerance=TOLERANCES[-1])
        if whole is None or whole == self._complete:
            return False
        done = self._squares.setdefault(whole, [])
        if len(done) == self._trial.count(whole, self._complete):
            return False
        done.append(self._trial.squares(len(done), whole, self._complete))
        return True

    def _models(self, models: Models) -> SpotModels | None:
        """The spot's models, None if they conflict; rays on one leg mean rays on both, unless a wave law is forced."""
        rays = [leg for leg in LENSES if models[leg] == OFF]
        if rays and all(self._forced.get(leg, OFF) == OFF for leg in LENSES):
            models = {**models, **dict.fromkeys(LENSES, OFF)}
        if (models[LENSES[0]], models[LENSES[1]]) not in METHODS:
            return None
        spot = spot_models(models)
        if spot.method in RAYS and not spot.integrated:
            return None
        # Fresnel's law behind Kirchhoff's costs as much as Kirchhoff's law on both legs.
        return None if spot.method == "kirchhoff-fresnel" and LENSES[1] not in self._forced else spot


def _with_sampling(change: float, models: SpotModels) -> float:
    """Change by omissions and sampling together, which are independent; more rays cost next to nothing."""
    free = 0.0 if models.method in RAYS else _FREE
    return math.hypot(change, max(models.tolerance, free * change))


def extent_rule(path: LightPath, source: DiscSource, wavelength: float) -> float:
    """Relative L2 change of the pixels if an incoherent disc counts as a point.

    A pixel's light that comes through a width D of the pupil varies with the position of the source by at most D/(λ z)
    cycles per metre. The mean over a disc of diameter d lowers such a variation by 1 − 2 J₁(t)/t ≤ t²/8,
    t = π d D/(λ z). This rule states half of that, which is twice the largest change on 222 light paths, numerical
    errors aside. For the image of a point, a behind the main lens and |b| from the array, a microlens of width w
    accepts the width D = w a/|b|, widened by its Airy disc, 2.44 λ (a + b)/w.

    Parameters
    ----------
    path, source
        Camera and disc.
    wavelength
        λ [m].

    Returns
    -------
    float
        Valid up to about 0.3; larger values only say that the change is large.
    """
    width, array = path.microlenses.aperture_width, path.array_distance
    depth = path.image_at_array(source.centre)[2]
    airy = 2.44 * wavelength * array / width
    geometric = width * (array - depth) / abs(depth) if depth != 0.0 else math.inf
    accepted = min(2.0 * path.main_lens.radius, geometric + airy)
    return (math.pi * source.diameter * accepted / (wavelength * source.distance)) ** 2 / 16.0


def spot_models(models: Models) -> SpotModels:
    """The models of a spot image for a choice of models by slot."""
    return SpotModels(
        method=METHODS[models["main_lens_diffraction"], models["microlens_diffraction"]],
        separate=models["crosstalk"] == OFF,
        integrated=models["pixel_integration"] != OFF,
        point=models["source_extent"] == OFF,
        monochromatic=models["spectrum"] == OFF,
        tolerance=float(models["sampling"].removesuffix(" %")) / 100.0,
    )
