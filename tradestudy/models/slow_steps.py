"""Which steps of a run are slow, by order of magnitude: amounts of work times one table of seconds per unit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.cameras.depth_measurement import CORNERS
from tradestudy.effects import OFF, Models
from tradestudy.imaging.picture import kirchhoff_lattice
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.wave_optics import LightSpotPart
from tradestudy.study.varying import calibrations_to_infer, sweep_axes
from tradestudy.wording import counted

# On one core of a laptop; good to a factor of about five, which suffices to tell seconds from minutes and hours.
SECONDS: Final[Mapping[str, float]] = {
    "calibration": 5.0,
    "depth at a distance, linear": 2e-4,
    "depth at a distance, exact": 3e-3,
    "Kirchhoff diffraction at a defocus": 0.2,
    "verdict under a reading": 0.1,
    "combination of errors": 0.02,
    "sensitivity of a camera": 0.5,
    "question": 1.0,
    "rendered pixel": 4e-6,
    "rendered pixel by waves": 8e-6,
    "depth of a pixel": 5e-6,
    "rendered plane": 4.0,
    "pair of point spreads, on axis": 0.05,
    "pair of point spreads, off axis": 1.0,
    "point spread": 0.12,
    "microlens lit to 1 %": 0.6,
    "hard case": 0.015,
    "report": 2.0,
}
_AT_ONCE: Final = 2.0  # seconds
_GROWTH_WITH_ACCURACY: Final = 0.75  # exponent of the time of a light spot in the inverse tolerance
_POINTS_FOLLOWED_ALONG: Final = 50.0  # source points whose light takes as long as that of one microlens


@dataclass(frozen=True, kw_only=True)
class Work:
    """A part of a run's work.

    Parameters
    ----------
    step
        Name of the step in the run's progress.
    amount
        The amount of work, in words.
    seconds
        Time on one core, from `SECONDS`.
    problem
        Name of the problem of the plan that it solves; empty if it belongs to the whole study.
    """

    step: str
    amount: str
    seconds: float
    problem: str = ""


def magnitude(seconds: float) -> str:
    """A time by order of magnitude: "at once", "seconds", "minutes" or "hours"."""
    if seconds < _AT_ONCE:
        return "at once"
    return "seconds" if seconds < 60.0 else "minutes" if seconds < 3600.0 else "hours"


def work_of(study: PreparedStudy) -> tuple[Work, ...]:
    """All work of a run, in the order of its steps, for a study with its models applied."""
    return (
        *_depth(study),
        *_pictures(study),
        *_wave_optics(study),
        *_answers(study),
        Work(step="report", amount="figures, HTML, PDF", seconds=SECONDS["report"]),
    )


def _work(step: str, unit: str, count: float, amount: str, problem: str = "") -> Work:
    return Work(step=step, amount=amount, seconds=count * SECONDS[unit], problem=problem)


def _depth(study: PreparedStudy) -> Iterator[Work]:
    """Calibrations, tables of depth, and the sensitivity of each camera."""
    file, case = study.file, study.case
    if requests := calibrations_to_infer(study):
        yield _work("calibration", "calibration", len(requests), counted(len(requests), "posterior"))
    if lattice := kirchhoff_lattice(case.cameras.values(), case.distance):
        amount = f"Kirchhoff diffraction at {counted(len(lattice), 'value')} of defocus"
        yield _work("pictures", "Kirchhoff diffraction at a defocus", len(lattice), amount)
    places, designs = len(CORNERS) * len(file.propagation.field_places), _designs(study)
    for camera_name, camera in case.cameras.items():
        exact = "exact" if camera.propagation.model == "exact" else "linear"
        for step, count, noun in (
            ("depth", designs[camera_name], "design"),
            ("depth off the axis", places, "place"),
        ):
            if count:
                amount = f"{counted(count, noun)} at {counted(case.distance.size, 'distance')}"
                unit = f"depth at a distance, {exact}"
                yield _work(step, unit, count * case.distance.size, amount, camera_name)
    if file.sensitivity is not None:
        fields = file.propagation.axis_and_places
        count = len(case.cameras) * len(fields)
        amount = f"{counted(len(case.cameras), 'camera')} at {counted(len(fields), 'field position')}"
        yield _work("sensitivity", "sensitivity of a camera", count, amount)


def _designs(study: PreparedStudy) -> dict[str, int]:
    """For each camera, how many designs of the sweep need a table of depth of their own.

    An axis counts if its ends differ in the camera, its calibration to infer, or its limits.
    """
    axes, counts = sweep_axes(study), dict.fromkeys(study.case.cameras, 1)
    first = {axis.path: axis.values[0] for axis in axes}
    low = study.with_values(first)
    for axis in axes:
        high = study.with_values({**first, axis.path: axis.values[-1]})
        for camera_name in counts:
            of_ends = (
                (end.case.cameras[camera_name], end.definition.posterior_keys.get(camera_name), end.case.criteria)
                for end in (low, high)
            )
            counts[camera_name] *= len(axis.values) if len(set(of_ends)) > 1 else 1
    return counts


def _answers(study: PreparedStudy) -> Iterator[Work]:
    """Verdicts under every reading, the value of information, and inverse questions."""
    file = study.file
    if file.decision is not None:
        verdicts = 1 + len(study.readings)
        amount = f"{counted(verdicts, 'verdict')} on the main pair"
        yield _work("decision", "verdict under a reading", verdicts, amount)
    if (answers := len(file.claims) * (1 + len(study.readings)) + len(file.requirements)) > 0:
        amount = counted(answers, "verdict")
        yield _work("claims", "verdict under a reading", answers, amount)
    if (part := file.value_of_information) is not None:
        amount = counted(part.draws, "combination")
        yield _work("value of information", "combination of errors", part.draws, amount)
    if file.solve:
        yield _work("inverse questions", "question", len(file.solve), counted(len(file.solve), "question"))


def _pictures(study: PreparedStudy) -> Iterator[Work]:
    """Rendered scenes and planes, and the depth that is read in them."""
    file = study.file
    if file.scene is not None and file.scene.image is not None:
        from tradestudy.models.rendered_scene import set_up
        from tradestudy.models.scene_pictures import TRIAL_TEXTURE, name_of

        _, cameras = set_up(study, rig="as-designed", texture_side=TRIAL_TEXTURE)
        for taken in cameras:
            problem = name_of(taken.name)
            pixels = sum(exposure.sensor.columns * exposure.sensor.rows for exposure in taken.exposures)
            by_waves = study.choices.models.get(problem, {}).get("main_lens_diffraction", OFF) != OFF
            amount = f"{pixels / 1e6:.3g} million pixels"
            yield _work("rendering", "rendered pixel" + " by waves" * by_waves, pixels, amount, problem)
            if file.scene.image.depth_maps:
                yield _work("depth maps", "depth of a pixel", pixels, amount, problem)
    if (loop := file.depth_loop) is not None:
        cameras_of_loop = loop.cameras or study.case.cameras
        varied = max(1, len(loop.contrasts or ())) * max(1, len(loop.electrons or ()))
        planes = len(cameras_of_loop) * len(loop.distances) * varied
        yield _work("depth loop", "rendered plane", planes, counted(planes, "plane"))


def _wave_optics(study: PreparedStudy) -> Iterator[Work]:
    """Comparisons of Fresnel with Kirchhoff, light spots, images of points, and hard cases."""
    from tradestudy.study.schema.wave_optics import listed

    file = study.file
    if (fresnel := file.fresnel_validity) is not None:
        numbers, elements = len(listed(fresnel.f_numbers)), len(fresnel.elements)
        # The peak is the same in every window; the other two metrics have a limit in each.
        limits = len(fresnel.lens_phases) * (1 + 2 * len(fresnel.windows))
        pairs = elements * len(fresnel.wavelengths) * (numbers + limits)
        step = "Fresnel against Kirchhoff, on axis"
        yield _work(step, "pair of point spreads, on axis", pairs, f"about {counted(pairs, 'pair')} of point spreads")
        if fresnel.off_axis is not None:
            pairs = elements * (numbers + 1)
            step = "Fresnel against Kirchhoff, off axis"
            yield _work(step, "pair of point spreads, off axis", pairs, f"{counted(pairs, 'pair')} of point spreads")
    if file.light_spot is not None:
        yield _light_spot(file.light_spot, study.choices.models)
    if (part := file.point_spread) is not None:
        varied = (listed(part.f_numbers), part.wavelengths, part.field_angles, part.defocus)
        count = 2 * len(part.elements) * sum(map(len, varied))
        yield _work("point spread", "point spread", count, counted(count, "point spread"))
    if file.hard_cases is not None:
        from tradestudy.verification import all_families

        count = sum(len(family.cases) for family in all_families() if family.name in file.hard_cases.families)
        yield _work("hard cases", "hard case", count, counted(count, "case"))


def _light_spot(part: LightSpotPart, models: Mapping[str, Models]) -> Work:
    """Pictures by waves: those of the compared methods and that of the chosen models; at least one picture."""
    from tradestudy.models.light_spot import NAME, spot_models
    from tradestudy.models.spot_images import RAYS, compared_models

    compared = dict.fromkeys([*(compared_models(part, method) for method in part.methods), spot_models(models[NAME])])
    waves = [spot for spot in compared if spot.method not in RAYS]
    amount = f"{counted(max(1, len(waves)), 'picture')} of {counted(_microlenses(part), 'microlens', 'microlenses')}"
    seconds = math.fsum(
        picture_seconds(part, spot.tolerance) / (len(part.lines) if spot.monochromatic else 1) for spot in waves
    )
    return Work(step="image of the spot", amount=amount, seconds=seconds, problem=NAME)


def picture_seconds(part: LightSpotPart, tolerance: float) -> float:
    """Time of one picture of a light spot by waves, with all its wavelengths, to a tolerance."""
    from tradestudy.models.light_spot import LightSpotProblem

    accuracy = (0.01 / tolerance) ** _GROWTH_WITH_ACCURACY
    points = max(0.0, LightSpotProblem(part, {}).points - _POINTS_FOLLOWED_ALONG)
    units = len(part.lines) * (_microlenses(part) + points / _POINTS_FOLLOWED_ALONG) * accuracy
    return float(units * SECONDS["microlens lit to 1 %"])


def _microlenses(part: LightSpotPart) -> int:
    """How many microlenses lie in front of a pixel."""
    from tradestudy.models.spot_images import light_path
    from tradestudy.optics.chain.behind_microlens import nearest_microlens

    return np.unique(nearest_microlens(light_path(part))).size
