"""The common part of cameras with a microlens array behind the main lens: their errors and their depth measurement."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.camera import (
    PRINTED_TOLERANCE,
    Contradiction,
    DerivedValue,
    Properties,
    lens_contradictions,
    show,
)
from tradestudy.cameras.depth_camera import DepthCamera, declared_disparity_error
from tradestudy.cameras.depth_measurement import (
    INTERIOR,
    NOISE_PARAMETER,
    PIXEL_NOISE,
    Environment,
    ErrorParameter,
    Errors,
    ErrorVocabulary,
    Field,
    MeasuredInverseDepth,
    require_field,
    require_known,
    shares_of,
    value_of,
    warmed,
)
from tradestudy.cameras.microlens_exposure import ArrayGeometry, MicrolensExposure, Observation, lattice_counts
from tradestudy.cameras.parts import Lens, MicrolensArray
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.units import FRACTION, LENGTH, pretty

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart
    from tradestudy.optics.microlens_camera import MicrolensCamera


PLENOPTIC_ERRORS: Final[ErrorVocabulary] = {
    "mla_distance": ErrorParameter(
        unit="m", part=INTERIOR, meaning="Distance from the main lens to the microlens array."
    ),
    "focal_length": ErrorParameter(unit="m", part=INTERIOR, meaning="Focal length of the main lens."),
    "microlens_gap": ErrorParameter(
        unit="m", part=INTERIOR, meaning="Distance from the microlens array to the sensor."
    ),
    "microlens_pitch": ErrorParameter(
        unit="m", part="array", meaning="Mean distance between neighbouring microlens centres."
    ),
    "array_rotation": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Rotation of the microlens array about the optical axis, relative to the rows of pixels.",
    ),
    "array_tilt_x": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Tilt of the microlens array along x, relative to the sensor; if positive, the array is "
        "nearer to the sensor at larger x.",
    ),
    "array_tilt_y": ErrorParameter(
        unit="rad",
        part="array",
        meaning="Tilt of the microlens array along y, relative to the sensor; if positive, the array is "
        "nearer to the sensor at larger y.",
    ),
    "array_offset_x": ErrorParameter(
        unit="m", part="array", meaning="Position of the centre of the microlens array on the sensor, along x."
    ),
    "array_offset_y": ErrorParameter(
        unit="m", part="array", meaning="Position of the centre of the microlens array on the sensor, along y."
    ),
    "pupil_distance": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Distance from the microlens array to the exit pupil, minus that by design. In a thin lens, the pupil "
        "lies in the lens. The error changes how far the centres of the micro-images of a white scene lie from the "
        "centres of the microlenses.",
    ),
    "principal_point_x": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Position along x at which the axis of the main lens meets the microlens array: the centre of "
        "distortion and field curvature.",
    ),
    "principal_point_y": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Position along y at which the axis of the main lens meets the microlens array: the centre of "
        "distortion and field curvature.",
    ),
    "field_curvature": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Field curvature, for a flat object: the image distance in the corner of the sensor, minus that on the "
        "axis. The difference grows with the square of the distance from the axis.",
    ),
    "depth_distortion": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Relative change, in the corner of the sensor, of the distance between the microlens array and the "
        "image that the main lens forms. The change grows with the square of the distance from the axis.",
    ),
    "depth_distortion_d0": ErrorParameter(
        unit="1",
        part=INTERIOR,
        meaning="Relative growth of depth_distortion_d1 and depth_distortion_d2 with the image distance, times the "
        "declared distance from the main lens to the microlens array.",
    ),
    "depth_distortion_d1": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="Displacement away from the main lens of an image that lies as far from the axis as the corner of the "
        "sensor. The displacement grows with the square of the image's own distance from the axis.",
    ),
    "depth_distortion_d2": ErrorParameter(
        unit="m",
        part=INTERIOR,
        meaning="As depth_distortion_d1, but the displacement grows with the fourth power of the distance.",
    ),
    **{
        f"distortion_{name}": ErrorParameter(
            unit="1",
            part=INTERIOR,
            meaning=f"Coefficient {term} distortion of the main lens{where}.",
        )
        for name, term, where in (
            ("k1", "of r² in the radial", ", where r is the slope of a ray"),
            ("k2", "of r⁴ in the radial", ", where r is the slope of a ray"),
            ("k3", "of r⁶ in the radial", ", where r is the slope of a ray"),
            ("p1", "p1 of the tangential", ": the slopes x and y grow by 2 p1 x y and p1 (r² + 2 y²)"),
            ("p2", "p2 of the tangential", ": the slopes x and y grow by p2 (r² + 2 x²) and 2 p2 x y"),
        )
    },
    "microlens_center_scatter": ErrorParameter(
        unit="m",
        part="microlens centres",
        meaning="Each coordinate of the centre of a microlens. The error differs from microlens to microlens. A "
        "disparity compares two microlenses, so its error from this source is √2 times the error of one coordinate.",
        error_class=ErrorClass.ELEMENT,
    ),
    PIXEL_NOISE: NOISE_PARAMETER,
}
"""Errors of a plenoptic camera, focused or not, in the order in which they are drawn.

Depth distortion: O. Johannsen et al., "On the calibration of focused plenoptic cameras", 2013. A microlens's own focal
length changes blur, not geometry, and is therefore not included. The principal point is a position on the array, as
tilts require; ``array_offset_x`` and ``_y`` move the array on the sensor. ``depth_distortion_d0`` to ``_d2``: C. Heinze
et al., "Automated robust metric calibration algorithm for multifocus plenoptic cameras", 2016."""
KNOWN_VALUES: Final = (
    *("array_rotation", "array_tilt_x", "array_tilt_y", "array_offset_x", "array_offset_y"),
    *("principal_point_x", "principal_point_y", "depth_distortion"),
    *("depth_distortion_d0", "depth_distortion_d1", "depth_distortion_d2"),
    *("distortion_k1", "distortion_k2", "distortion_k3", "distortion_p1", "distortion_p2"),
)
"""Parameters whose values a calibration may state; those of the other lengths are declared with the camera."""


# f-number matching is a rule of thumb; a mismatch of a few percent neither wastes pixels nor mixes micro-images.
_MATCHING_TOLERANCE: Final = 0.05
Points = tuple[FloatArray, FloatArray, FloatArray]
_LITTLE_LIGHT: Final = 0.5  # of the area of a cell; less is a design that few would choose
_UNSHARP: Final = 0.1  # of the aperture of a microlens; two pixels of about twenty
_FIELD_PLACES: Final = 101  # in a table; linear interpolation between them misses a parabola by 1e-4 of its height
_ANY_COLOUR: Final = 550e-9  # the table is the same for all wavelengths


def require_pupil(lens: Lens, mla_distance: float) -> None:
    """Refuse an entrance pupil in front of the plane in focus on an array, whose exit pupil lies on or behind it."""
    if lens.entrance_pupil and mla_distance > 0.0 >= lens.principal_distance(mla_distance):
        raise OutOfRangeError(
            "entrance_pupil of the main lens",
            value=f"{lens.entrance_pupil * 1e3:g} mm",
            limit="one that the objects in focus lie in front of",
            remedy="correct entrance_pupil or exit_pupil",
        )


@dataclass(frozen=True, kw_only=True)
class PlenopticCamera(DepthCamera):
    """A camera with a main lens, a microlens array and a sensor.

    Parameters
    ----------
    main_lens, microlenses
        The lens and the array. Distances to objects count from the first principal plane of the lens, that to the array
        from the second one.
    field_curvature
        How much farther from the main lens its image is known to lie in the corner of the sensor than on the axis [m];
        the error of the same name is the unknown part.
    known
        Names among `KNOWN_VALUES`, and values in SI. The camera deviates from its design by them, and its calibration
        contains them: they act in measured depth and in rendered pictures, and errors add to them. Blur, coverage and
        lateral resolution are those of the design, as on the axis.
    """

    family: ClassVar[str] = "plenoptic"
    error_vocabulary: ClassVar[ErrorVocabulary] = PLENOPTIC_ERRORS
    known_parameters: ClassVar[tuple[str, ...]] = KNOWN_VALUES

    main_lens: Lens
    microlenses: MicrolensArray
    field_curvature: float = 0.0
    known: tuple[tuple[str, float], ...] = ()

    def with_known(self, errors: Errors) -> Errors:
        """Deviations from the design: the known values and errors."""
        return {**errors, **{name: value + value_of(errors, name) for name, value in self.known}}

    @property
    def left_out(self) -> str:
        """See `Camera.left_out`."""
        where = "act in depth and rendered pictures, not in blur, coverage, depth of field and lateral resolution"
        return f"the known values of its calibration {where}" if self.known else ""

    def cropped(self, columns: int, rows: int) -> Self:
        """See `DepthCamera.cropped`; what is stated for the corner becomes that of the new corner."""
        smaller = super().cropped(columns, rows)
        square = (smaller.sensor.diagonal / self.sensor.diagonal) ** 2
        of_corner = {"depth_distortion": square, "depth_distortion_d1": square, "depth_distortion_d2": square**2}
        known = tuple((name, value * of_corner.get(name, 1.0)) for name, value in self.known)
        return replace(smaller, known=known, field_curvature=self.field_curvature * square)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.microlenses.pitch > self.sensor.width:
            raise OutOfRangeError(
                "the sensor is smaller than one microlens",
                value=f"pitch {self.microlenses.pitch * 1e6:g} um",
                limit=f"at most {self.sensor.width * 1e6:g} um",
            )
        require_pupil(self.main_lens, self.geometry.mla_distance)

    @property
    def gathering_lens(self) -> Lens:
        """The main lens."""
        return self.main_lens

    @property
    def principal_plane(self) -> float:
        """Distances count from the first principal plane, because depth follows from conjugates."""
        return 0.0

    @property
    def origin(self) -> str:
        """See `Camera.origin`."""
        return "first principal plane" if self.main_lens.is_thick else "principal plane"

    @property
    def principal_distance(self) -> float:
        """Principal distance c of the array [m], so that c/A is the f-number on the image side; z for a thin lens."""
        return self.main_lens.principal_distance(self.geometry.mla_distance)

    def depth_behind_lens(self, nearest: float) -> float:  # noqa: ARG002 - nothing moves
        """Distance from the second principal plane of the main lens to the sensor [m]."""
        return self.geometry.mla_distance + self.microlenses.gap

    @property
    @abstractmethod
    def geometry(self) -> ArrayGeometry:
        """The design, on which both observations and depth measurements are based."""

    def geometry_at(self, mla_distance: float) -> ArrayGeometry:
        """The geometry with the array at a given distance [m] behind the main lens."""
        return ArrayGeometry(
            focal_length=self.main_lens.focal_length,
            mla_distance=mla_distance,
            gap=self.microlenses.gap,
            pitch=self.microlenses.pitch,
            corner=self.sensor.diagonal / 2.0,
            field_curvature=self.field_curvature,
            entrance_pupil=self.main_lens.entrance_pupil,
        )

    @abstractmethod
    def observe(self, errors: Errors, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> Observation:
        """The observation of a point [m] by a camera that deviates from its design by ``errors``."""

    def observe_warm(self, errors: Errors, environment: Environment | None, point: Points) -> Observation:
        """The observation of points [m] since the calibration, by the pixels and centres of the calibration.

        Positions are counted in pixels, which have expanded with the sensor. If the centres of the microlenses are
        found again, the array itself is the scale; see `Environment`.
        """
        changed = self.geometry.changed(errors, environment)
        seen = self.observe(changed, *point)
        return seen if environment is None else self.rescaled(seen, changed, environment.scale_factor(errors))

    @abstractmethod
    def rescaled(self, seen: Observation, changed: Errors, scale: FloatArray) -> Observation:
        """What a camera that has changed observes if the pixels, or the scale in their place, have grown by a factor.

        The centres of the micro-images are those of the calibration, on pixels.
        """

    @abstractmethod
    def believe(self, errors: Errors, seen: Observation, distance: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """The inverse depth [1/m] measured when ``errors`` are the errors of the calibration, and where it is valid.

        The true distance [m] determines which microlenses or views the estimator uses.
        """

    @property
    def is_centred(self) -> bool:
        """Whether depth depends on a disparity alone, and not on its position in the picture."""
        return not (self.known or self.field_curvature)

    def field_angle(self, field: float) -> float:
        """Angle [rad] of a position on the sensor's diagonal, seen from the pupil at the distance of the array."""
        require_field(field)
        return math.atan(field * self.sensor.diagonal / 2.0 / self.principal_distance)

    def read(
        self, distance: FloatArray, field: Field, errors: Errors, environment: Environment | None = None
    ) -> MeasuredInverseDepth:
        """See `DepthCamera.read`, and `ArrayGeometry.changed` for the effect of the surroundings."""
        require_known(errors, PLENOPTIC_ERRORS, "a plenoptic camera")
        a = np.asarray(distance, dtype=np.float64)
        if self.geometry.changed(errors, environment):
            seen = self.observe_warm(errors, environment, self._points(a, field))
        else:
            seen = _observation(self, a.tobytes(), a.shape, field)
        inverse, valid = self.believe(errors, seen, a)
        return MeasuredInverseDepth(
            inverse_depth=inverse,
            no_overlap=np.zeros((1, 1), dtype=bool),
            out_of_range=~(valid & self.images(a)),
        )

    def observe_at(self, distance: FloatArray, field: Field) -> Observation:
        """What the camera without errors observes of points at distances [m] and a field position."""
        return self.observe({}, *self._points(distance, field))

    def _points(self, distance: FloatArray, field: Field) -> Points:
        """Points [m] at distances [m] that the camera pictures at field positions if it has only its known values."""
        half = (self.sensor.width / 2.0, self.sensor.height / 2.0)
        x, y = (share * extent for share, extent in zip(shares_of(field), half, strict=True))
        right, down = self.geometry.place_seen(self.with_known({}), x, y).ray
        return right * self.from_pupil(distance), down * self.from_pupil(distance), distance

    def light_chain(self) -> MicrolensCamera:
        """The camera in the form that `tradestudy.optics.microlens_image` expects.

        All lenses are thin: a main lens without aberrations and parabolic microlenses. `dataclasses.replace` changes
        their phase, or adds aberrations. A table of focal lengths models
        field curvature: it moves images near the array as in the design. Positions are those of the light, upside
        down compared with the picture.

        Raises
        ------
        OutOfRangeError
            The entrance pupil lies outside the principal planes, or the camera has known values of a calibration,
            which light spots do not contain.
        """
        if self.known:
            raise OutOfRangeError(
                "light spots are not computed for a camera with known values of its calibration",
                value=", ".join(name for name, _ in self.known),
                remedy="leave calibration.known out of the camera",
            )
        if self.main_lens.entrance_pupil:
            raise OutOfRangeError(
                "light behind microlenses is computed for a pupil in the principal planes of the main lens only: "
                "entrance_pupil",
                value=f"{self.main_lens.entrance_pupil * 1e3:g} mm",
                limit="0 mm",
                remedy="use geometric optics, or leave entrance_pupil and exit_pupil out",
            )
        # Reading a study does not need them.
        from tradestudy.optics.microlens_camera import MicrolensCamera
        from tradestudy.optics.propagation.lens import FocalLengths

        f, z, corner = self.main_lens.focal_length, self.geometry.mla_distance, self.sensor.diagonal / 2.0
        height = corner * np.linspace(0.0, 1.0, _FIELD_PLACES)
        # The lens that moves an image at z to this distance has 1/f′ = 1/f − 1/z + 1/moved.
        moved = z + self.field_curvature * (height / corner) ** 2
        curved = FocalLengths(
            field_angles=np.arctan(height / z),
            wavelengths=np.array([_ANY_COLOUR]),
            focal_lengths=1.0 / (1.0 / f - 1.0 / z + 1.0 / moved)[:, np.newaxis],
            reference_wavelength=_ANY_COLOUR,
        )
        return MicrolensCamera(
            focal_length=curved if self.field_curvature else f,
            f_number=self.main_lens.f_number,
            array_distance=z,
            microlens_focal_lengths=self.microlenses.focal_lengths,
            microlens_pitch=self.microlenses.pitch,
            gap=self.microlenses.gap,
            pixel_pitch=self.sensor.pixel_pitch,
            layout=self.microlenses.layout,
            microlens_aperture=self.microlenses.aperture_diameter,
            odd_pixels=(self.sensor.rows % 2 == 1, self.sensor.columns % 2 == 1),
        )

    @property
    def elements(self) -> int:
        """Number of microlenses, with some to spare beyond the edges of the sensor."""
        return math.prod(lattice_counts(self.microlenses, self.sensor))

    def exposures(
        self, reference_distance: float, errors: Errors, environment: Environment | None, stop_separation: float
    ) -> Sequence[MicrolensExposure]:
        """One raw picture.

        Raises
        ------
        OutOfRangeError
            For a second stop: only vignetting by the pupil is modelled behind microlenses.
        """
        require_known(errors, PLENOPTIC_ERRORS, "a plenoptic camera")
        if stop_separation > 0.0:
            raise OutOfRangeError(
                "a plenoptic camera cannot be rendered with a second stop: scene.picture.stop_separation",
                value=f"{stop_separation * 1e3:g} mm",
                limit="0 mm",
                remedy="remove it",
            )
        changed = self.geometry.changed(errors, environment)
        moved = self.with_known(
            {name: value_of(errors, name) + value_of(changed, name) for name in {**errors, **changed}}
        )
        return [
            MicrolensExposure(
                name="raw",
                sensor=warmed(self.sensor, errors, environment),
                main_lens=self.main_lens,
                microlenses=self.microlenses,
                geometry=self.geometry,
                errors=moved,
                reference_distance=reference_distance,
            )
        ]

    def target_noise_px(self, corner_noise_px: float) -> FloatArray:
        """Noise of the disparity as declared, and of both coordinates, all of them of samples."""
        samples = np.array([declared_disparity_error(self), corner_noise_px, corner_noise_px])
        return np.asarray(samples * (self.sample_pitch / self.sensor.pixel_pitch))

    def seen_on_sensor(self, observed_px: FloatArray) -> BoolArray:
        """Whether the pictures of a corner lie on the sensor."""
        half = np.array([self.sensor.columns, self.sensor.rows]) / 2.0
        inside = np.all(np.abs(observed_px[..., 1:]) <= half, axis=-1)
        return np.repeat(inside[..., np.newaxis], 3, axis=-1)

    def contradictions(self, stated: StatedPart | None, tolerance: float) -> Sequence[Contradiction]:  # noqa: ARG002 - none of depth
        """Contradictions of the main lens and of the array."""
        array = array_contradictions(self.main_lens, self.microlenses, self.geometry.mla_distance, stated)
        return [*lens_contradictions(self.main_lens, self.sensor, stated, part="main_lens"), *array]


def fill_properties(array: MicrolensArray) -> Properties:
    """Fraction of the array that transmits light, and the lengths from which it follows."""
    aperture, pitch = array.aperture_diameter, array.pitch
    area = math.pi / 4.0 * aperture**2 / (LATTICES[array.layout].cell_area * pitch**2)
    return (
        ("fill factor of the array", DerivedValue(area, FRACTION)),
        ("width of a microlens", DerivedValue(aperture, LENGTH)),
        ("microlens pitch", DerivedValue(pitch, LENGTH)),
    )


def array_contradictions(
    lens: Lens, array: MicrolensArray, mla_distance: float, stated: StatedPart | None
) -> list[Contradiction]:
    """Check stated distances against those used, and the f-numbers of microlenses and main lens against each other."""
    pairs = (
        ("microlens gap", "microlens_gap", stated.microlens_gap if stated else None, array.gap),
        ("distance from main lens to array", "mla_distance", stated.mla_distance if stated else None, mla_distance),
    )
    contradictions = [
        Contradiction(
            what=what,
            stated=show(value, LENGTH),
            implied=show(used, LENGTH),
            used="the implied value",
            path=("stated", key),
        )
        for what, key, value, used in pairs
        if value is not None and not math.isclose(value, used, rel_tol=PRINTED_TOLERANCE)
    ]
    micro, main = array.gap / array.pitch, lens.principal_distance(mla_distance) / lens.pupil_diameter
    if not math.isclose(micro, main, rel_tol=_MATCHING_TOLERANCE):
        contradictions.append(
            Contradiction(
                what="f-number matching of microlenses and main lens",
                stated=f"main lens f/{main:.3g} on the image side",
                implied=f"microlenses f/{micro:.3g} from pitch and gap",
                used=f"gap {show(array.gap, LENGTH)}; micro-images "
                + ("leave dark pixels between them" if micro < main else "overlap"),
                path=("main_lens", "f_number"),
                consequence=_mismatch(micro, main),
            )
        )
    return [*contradictions, *_unsharp(lens, array, mla_distance)]


def _mismatch(micro: float, main: float) -> str:
    """What unequal f-numbers do, where that is more than a few dark pixels."""
    faster = f"the main lens (f/{main:.3g} on the image side) is {{}} than the microlenses (f/{micro:.3g})"
    if micro > main:
        return f"its micro-images overlap, because {faster.format('faster')}, and pixels mix views of the scene"
    if (micro / main) ** 2 < _LITTLE_LIGHT:
        share = pretty((micro / main) ** 2, FRACTION, 2)
        return f"its micro-images fill only {share} of their cells, because {faster.format('slower')}"
    return ""


def _unsharp(lens: Lens, array: MicrolensArray, mla_distance: float) -> Iterator[Contradiction]:
    """Check that a type of microlens focuses on an image that the main lens can form of a real object, or nearly."""
    if len(array.focal_lengths) == 1 and array.focal_lengths[0] == array.gap:
        return  # the unfocused design, in which the main lens focuses on the array
    if math.inf in array.focal_lengths:
        return  # pinholes focus on nothing
    far = array.gap / (mla_distance - lens.focal_length) if mla_distance != lens.focal_length else math.inf
    # 1/v of real objects lies between 1/v of infinity and 0 if the array is within the focal length, else outside them.
    in_focus = [array.gap / focal_length - 1.0 for focal_length in array.focal_lengths]
    within = [max(far - inverse, inverse, 0.0) for inverse in in_focus]
    outside = [max(min(far - inverse, inverse), 0.0) for inverse in in_focus]
    least = min(within if far < 0.0 else outside)
    if least > _UNSHARP:
        yield Contradiction(
            what="gap against focal lengths of the microlenses",
            stated=f"gap {show(array.gap, LENGTH)}",
            implied=f"focal lengths {', '.join(show(focal_length, LENGTH) for focal_length in array.focal_lengths)}",
            used="both; every object is blurred",
            path=("microlenses", "focal_lengths"),
            consequence="its microlenses focus on no real object: at every distance, their blur is at least "
            f"{pretty(least, FRACTION, 2)} of their aperture",
        )


@lru_cache(maxsize=8)
def _observation(camera: PlenopticCamera, distances: bytes, shape: tuple[int, ...], field: Field) -> Observation:
    """What an unchanged camera observes, from which depth is computed many times with different calibration errors."""
    return camera.observe_at(np.frombuffer(distances).reshape(shape), field)
