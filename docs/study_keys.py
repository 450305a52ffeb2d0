"""Pages on every key of a study file, made from its JSON Schema; examples are taken from studies that run."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

import tradestudy
from tradestudy import units

Schema = Mapping[str, Any]

_PAGES: Final = {
    "scene": ("The scene", ("scene", "depth_loop")),
    "accuracy": ("Accuracy and effects", ("accuracy", "effects", "propagation")),
    "optics": (
        "Depth of field and wave optics",
        ("depth_of_field", "relief", "refocusing", "fresnel_validity", "light_spot", "point_spread", "hard_cases"),
    ),
}
_OTHER_PAGE: Final = ("questions", "Questions")
_LONGEST_EXAMPLE: Final = 90
_MOST_PATHS: Final = 3
_BASIS: Final = {"value", "basis", "note"}
# Keys that no shipped study uses, or whose value there would mislead; a key alone applies wherever it occurs.
_EXAMPLES: Final = {
    # Cameras
    "read_as": "{format: OpenCV FileStorage}",
    "note": "the wide-angle head of the data sheet",
    "stated": "{field_of_view: 65.24 deg}",
    "field_of_view": "65.24 deg",
    "field_curvature": "0.2 mm",
    "microlens_gap": "0.45 mm",
    "StatedPart.mla_distance": "15.3 mm",
    "scaling": "{quadratic: 0.11 1/m, linear: 0.9, offset: 12 mm}",
    "quadratic": "0.11 1/m",
    "linear": "0.9",
    "offset": "12 mm",
    "hyperfocal_distance": "7.5 m",
    "nearest_distance": "520 mm",
    "accuracy": (
        "{depth: {says: below 2 % at 4 m, metric: unstated, relative: 2 %, up_to: 4 m, mode: not stated, "
        "target: not stated}}"
    ),
    "StatedAccuracyPart.says": "depth accuracy below 2 % at 4 m",
    "metric": "error",
    "StatedAccuracyPart.relative": "2 %",
    "absolute": "2 mm",
    "StatedAccuracyPart.share": "95 %",
    "up_to": "4 m",
    "mode": "848x480",
    "StatedAccuracyPart.target": "a flat wall with texture",
    "gives": "disparity_error",
    "projector": "on",
    "absolute_sensitivity_threshold": "12.6 photons",
    "StatedPart.depth_of_field": "0.82 mm",
    "envelope": "[60 mm, 60 mm, 90 mm]",
    "quantum_efficiency": "60 %",
    "temporal_dark_noise": "7 electrons",
    "saturation_capacity": "10500 electrons",
    "system_gain": "0.39 DN/electron",
    "disparity_range": "95 px",
    "least_lit_share": "10 %",
    "factor": "1.5",
    "floor": "0.05 px",
    "pixel_locking": "0.05 px",
    "false_matches": "1 %",
    "focal_lengths": "[0.38 mm, 0.41 mm, 0.45 mm]",
    "FocusPart.mla_distance": "15.3 mm",
    "UnfocusedMicrolensesPart.aperture_diameter": "126.5 um",
    "images": "8",
    "time_per_image": "5 s",
    "FocusStackPart.from": "140 mm",
    "FocusStackPart.to": "160 mm",
    "image_scale": "14.5 um",
    "working_distance": "22.5 mm",
    "StereoDeclaration.principal_distance": "focused",
    "source": "section 5.3, Figure 7",
    # Calibrations
    "FocusedPlenopticDeclaration.calibration": "{errors: {mla_distance: {standard_deviation: 1 um}}}",
    "UnfocusedPlenopticDeclaration.calibration": "{errors: {mla_distance: {standard_deviation: 1 um}}}",
    "target": (
        "{views: 20, columns: 9, rows: 6, spacing: 25 mm, distances: [0.4 m, 1 m], half_field_angle: 15 deg, "
        "tilt: 20 deg, corner_noise: 0.1 px}"
    ),
    "StereoCalibration.correlations": "{yaw: {principal_point: -0.9}}",
    "correlations": "{mla_distance: {focal_length: 0.9}}",
    "StereoErrors.baseline": "{standard_deviation: 50 um}",
    "StereoErrors.yaw": "{standard_deviation: 0.01 deg}",
    "StereoErrors.pitch": "{standard_deviation: 0.01 deg}",
    "StereoErrors.roll": "{standard_deviation: 0.01 deg}",
    "StereoErrors.baseline_direction_y": "{standard_deviation: 0.02 deg}",
    "StereoErrors.baseline_direction_z": "{standard_deviation: 0.02 deg}",
    "StereoErrors.principal_point": "{standard_deviation: 0.3 px}",
    "StereoErrors.left_focal_length": "{standard_deviation: 0.5 px}",
    "StereoErrors.right_focal_length": "{standard_deviation: 0.5 px}",
    "StereoErrors.left_principal_point_x": "{standard_deviation: 0.5 px}",
    "StereoErrors.left_principal_point_y": "{standard_deviation: 0.5 px}",
    "StereoErrors.right_principal_point_x": "{standard_deviation: 0.5 px}",
    "StereoErrors.right_principal_point_y": "{standard_deviation: 0.5 px}",
    "left_distortion_k1": "{standard_deviation: 0.001}",
    "left_distortion_k2": "{standard_deviation: 0.005}",
    "right_distortion_k1": "{standard_deviation: 0.001}",
    "right_distortion_k2": "{standard_deviation: 0.005}",
    "distortion_k1": "{standard_deviation: 0.001}",
    "distortion_k2": "{standard_deviation: 0.005}",
    "distortion_k3": "{standard_deviation: 0.01}",
    "distortion_p1": "{standard_deviation: 0.0002}",
    "distortion_p2": "{standard_deviation: 0.0002}",
    "depth_distortion": "{standard_deviation: 0.01}",
    "depth_distortion_d0": "{standard_deviation: 0.1}",
    "depth_distortion_d1": "{standard_deviation: 5 um}",
    "depth_distortion_d2": "{standard_deviation: 5 um}",
    "known": "{array_tilt_x: 0.05 deg, distortion_k1: -0.12}",
    **{
        f"PlenopticKnown.{name}": value
        for name, value in {
            "array_rotation": "0.02 deg",
            "array_tilt_x": "0.05 deg",
            "array_tilt_y": "-0.03 deg",
            "array_offset_x": "15 um",
            "array_offset_y": "-40 um",
            "principal_point_x": "0.2 mm",
            "principal_point_y": "-0.1 mm",
            "depth_distortion": "0.02",
            "depth_distortion_d0": "0.3",
            "depth_distortion_d1": "-0.1 mm",
            "depth_distortion_d2": "20 um",
            "distortion_k1": "-0.12",
            "distortion_k2": "0.05",
            "distortion_k3": "0.01",
            "distortion_p1": "0.0003",
            "distortion_p2": "-0.0002",
        }.items()
    },
    "microlens_pitch": "{standard_deviation: 10 nm}",
    "array_rotation": "{standard_deviation: 0.005 deg}",
    "array_tilt_x": "{standard_deviation: 0.02 deg}",
    "array_tilt_y": "{standard_deviation: 0.02 deg}",
    "array_offset_x": "{standard_deviation: 1 um}",
    "array_offset_y": "{standard_deviation: 1 um}",
    "pupil_distance": "{standard_deviation: 0.5 mm}",
    "principal_point_x": "{standard_deviation: 50 um}",
    "principal_point_y": "{standard_deviation: 50 um}",
    "PlenopticErrors.field_curvature": "{standard_deviation: 5 um}",
    "microlens_center_scatter": "{standard_deviation: 0.1 um}",
    "color": "{half_width: 5 um}",
    "StereoStability.ageing": "{yaw: {standard_deviation: 0.005 deg}}",
    "LengthDistribution.standard_deviation": "50 um",
    "LengthOrPixelsDistribution.standard_deviation": "5 um",
    "AngleDistribution.standard_deviation": "0.01 deg",
    "LengthDistribution.mean": "0.1 mm",
    "LengthDistribution.half_width": "0.2 mm",
    "LengthDistribution.inexactness": "50 um",
    "LengthDistribution.scale": "50 um",
    "LengthOrPixelsDistribution.mean": "5 um",
    "LengthOrPixelsDistribution.half_width": "20 um",
    "LengthOrPixelsDistribution.inexactness": "5 um",
    "LengthOrPixelsDistribution.scale": "0.5 px",
    "AngleDistribution.mean": "0.01 deg",
    "AngleDistribution.half_width": "0.02 deg",
    "AngleDistribution.inexactness": "0.005 deg",
    "AngleDistribution.scale": "0.01 deg",
    "NumberDistribution.mean": "0.001",
    "NumberDistribution.standard_deviation": "0.001",
    "NumberDistribution.half_width": "0.002",
    "NumberDistribution.inexactness": "0.0005",
    "NumberDistribution.scale": "0.001",
    "PressureDistribution.mean": "-1 kPa",
    "PressureDistribution.standard_deviation": "2 kPa",
    "PressureDistribution.half_width": "3 kPa",
    "PressureDistribution.inexactness": "0.5 kPa",
    "PressureDistribution.scale": "1 kPa",
    "TemperatureDistribution.mean": "5 K",
    "TemperatureDistribution.inexactness": "2 K",
    "TemperatureDistribution.scale": "3 K",
    "degrees_of_freedom": "9",
    "CornersPart.file": "corners.csv",
    "PosteriorPart.file": "posterior.nc",
    "AngleDistribution.file": "yaw.csv",
    "AngleDistribution.column": "yaw",
    "file": "calibration.csv",
    "column": "baseline",
    "NumberDistribution.column": "distortion_k1",
    "TemperatureDistribution.file": "weather.csv",
    "TemperatureDistribution.column": "temperature_change",
    "PressureDistribution.file": "weather.csv",
    "PressureDistribution.column": "pressure_change",
    "square_size_uncertainty": "0.1 %",
    "max_steps": "50000",
    "rotation_known_to": "0.05 deg",
    "position_known_to": "0.1 mm",
    "PosePart.rotation": "[20 deg, -10 deg, 0 deg]",
    "position": "[50 mm, -30 mm, 600 mm]",
    "housing_expansion": "23 ppm/K",
    "sensor_expansion": "2.6 ppm/K",
    "relative_exposure": "4",
    "baseline_expansion": "1 ppm/K",
    "array_expansion": "7 ppm/K",
    "microlens_centers": "found-again",
    "focal_length_expansion": "10 ppm/K",
    "glass_index": "1.52",
    # Lens models
    "GeometryPart.rotation": "[0.1 deg, -0.3 deg, 0.05 deg]",
    "translation": "[-62.4 mm, 0.3 mm, -0.1 mm]",
    "ConventionalDeclaration.geometry": "{focal_length: [882.5 px, 881.9 px], principal_point: [639.2 px, 402.7 px]}",
    "CalibratedCameraPart.focal_length": "[882.5 px, 881.9 px]",
    "CalibratedCameraPart.principal_point": "[639.2 px, 402.7 px]",
    "KannalaBrandtPart.k3": "-0.001",
    "FittedKannalaBrandtPart.k3": "-0.001",
    "KannalaBrandtPart.k4": "0.0002",
    "FittedKannalaBrandtPart.k4": "0.0002",
    "k1": "-0.02",
    "k2": "0.003",
    "k3": "-0.004",
    "k4": "0.05",
    "k5": "-0.01",
    "k6": "0.002",
    "p1": "0.0005",
    "p2": "-0.0003",
    "s1": "0.0002",
    "s2": "-0.0001",
    "s3": "0.0003",
    "s4": "-0.0002",
    "tau_x": "0.2 deg",
    "tau_y": "-0.1 deg",
    "w": "53 deg",
    "OmnidirectionalPart.xi": "1.2",
    "FittedOmnidirectionalPart.xi": "1.2",
    "xi": "-0.2",
    "alpha": "0.6",
    "beta": "1.1",
    "FittedRationalPart.fitted": "[k1, k2, p1, p2]",
    "FittedKannalaBrandtPart.fitted": "[k1, k2]",
    "FittedOmnidirectionalPart.fitted": "[xi, k1, k2]",
    "FittedDoubleSpherePart.fitted": "[xi, alpha]",
    "FittedExtendedUnifiedPart.fitted": "[alpha, beta]",
    # Scene
    "PicturePart.lens_phase": "parabolic",
    "field_angle": "10 deg",
    "stop_separation": "5 mm",
    "linear_fill_factor": "90 %",
    "PicturePart.spectrum": "[{wavelength: 500 nm, weight: 1}, {wavelength: 600 nm, weight: 2}]",
    "photons": "12000 photons",
    "weight": "2",
    "background": "10 %",
    "noise": "shot+read",
    "SceneImagePart.samples": "16",
    "depth_format": "npy",
    "PlanePart.distance": "1 m",
    "SpherePart.distance": "1 m",
    "centre": "[50 mm, -20 mm]",
    "PlanePart.size": "[400 mm, 300 mm]",
    "tilt_x": "20 deg",
    "tilt_y": "-10 deg",
    "StairsPart.near": "0.9 m",
    "StairsPart.far": "1.1 m",
    "treads": "5",
    "tread_width": "40 mm",
    "edge": "10 mm",
    "radius": "150 mm",
    "hurst": "70 %",
    "depth": "map.png",
    "unit": "1 mm",
    "width": "800 mm",
    "DepthMapPart.picture": "photo.png",
    "mosaic": "{pattern: RGGB, response: [30 %, 40 %, 25 %]}",
    "response": "[30 %, 40 %, 25 %]",
    "contrasts": "[5 %, 20 %]",
    "DepthLoopPart.electrons": "[1000 electrons, 10000 electrons]",
    "DepthLoopPart.windows": "3000",
    "DepthLoopPart.samples": "100",
    # Accuracy and effects
    "AccuracyPart.depth_uncertainty": "2 %",
    "AccuracyPart.usable_range": "0.5 %",
    "AccuracyPart.depth_of_field": "0.5 %",
    "pixel_intensity": "2 %",
    "psf_width": "2 %",
    "time_limit": "10 min",
    "effects": "{main_lens_diffraction: kirchhoff, crosstalk: off}",
    "defocus_blur": "disc",
    "main_lens_diffraction": "fresnel",
    "microlens_diffraction": "kirchhoff",
    "EffectsPart.calibration": "linear",
    "sensor_noise": "shot+read",
    "EffectsPart.spectrum": "weighted",
    "seed": "7",
    "max_draws": "262144",
    "coverage": "[90 %, 99 %]",
    # Wave optics
    "SpotMicrolensesPart.layout": "hexagonal",
    "SpotMicrolensesPart.aperture": "square",
    "aperture_width": "120 um",
    "SpotSourcePart.x": "1 mm",
    "SpotSourcePart.y": "-0.5 mm",
    "LightSpotPart.spectrum": "{wavelengths: [500 nm, 550 nm, 600 nm], weights: [1, 2, 1]}",
    "SpectrumPart.wavelengths": "[500 nm, 550 nm, 600 nm]",
    "weights": "[1, 2, 1]",
    "families": "[thin-lens, triangulation]",
    # Questions
    "cameras": "[stereo-50mm, stereo-75mm]",
    "candidates": "[stereo-50mm, stereo-75mm]",
    "compare": "[[stereo-50mm, raytrix-r5], [stereo-75mm, raytrix-r5]]",
    "AssumptionPart.says": "long-term stability of yaw",
    "DepthOfFieldClaim.tolerance_reason": (
        "two digits are printed; the scale is known to 3 %, and depth of field varies with its square"
    ),
    "DepthOfFieldRatioClaim.says": "the depth of field is multiple times larger",
    "LimitDistanceClaim.tolerance_reason": "'one digit allows 10 %; \"≈\" doubles that'",
    "PsfErrorClaim.tolerance_reason": "5 % in the f-number changes the error by 20 %",
    "CriterionFNumberClaim.expect": "{about: 7.3, within: 0.7 %}",
    "CriterionFNumberClaim.tolerance_reason": "printed as two digits; 7.25 to 7.35 round to them",
    "UncertaintyRatioClaim.tolerance_reason": "lower means a ratio below 1",
    "ShareBetterClaim.tolerance_reason": "a good substitute is better over more than half of the range",
    "LitPixelsClaim.tolerance_reason": "more means at least a tenth more",
    "DepthOfFieldRatioClaim.source": "section 3",
    "ReadingPart.says": "the plenoptic camera is Galilean",
    "ReadingPart.set": "{raytrix-r5.focus.relay: galilean}",
    "RequirementPart.says": "depth to 1 % from 0.4 to 3 m",
    "LitPixelsClaim.says": "diffraction lights more pixels than geometrical optics predicts",
    "RelativeUncertaintyDistanceClaim.says": "10 % of the distance at ≈ 1 m",
    "SolvePart.says": "Which yaw error makes the rig with a field of view of 65° as uncertain as the R5 at 0.5 m?",
    "MeasurementPart.camera": "oak",
    "MeasurementPart.file": "wall.csv",
    "MeasurementPart.source": "a textured wall and a tape measure, 100 frames at each distance",
    "zero": "fitted",
    "vary": "stereo-75mm.calibration.errors.yaw.standard_deviation",
    "low": "0.002 deg",
    "high": "0.05 deg",
    "requirement": "far",
    "PsfErrorClaim.reading": "green",
    "FresnelFNumberClaim.reading": "green",
    "CriterionFNumberClaim.reading": "green",
    "ImageDifferenceClaim.reading": "blue",
    "LitPixelsClaim.reading": "blue",
    "reading": "galilean",
    "readings": "[galilean]",
    "tolerance_reason": "20 %, as for the other distances stated with ≈",
    "over": "[0.4 m, 3 m]",
    "BoundOverPart.at": "0.6 m",
    "UsablePart.at": "0.6 m",
    "ShareAbovePart.at": "0.6 m",
    "ShareBelowPart.at": "0.6 m",
    "LengthBelowPart.at": "0.6 m",
    "SharpPart.at": "150 mm",
    "overlap": "{above: 80 %, over: [0.4 m, 3 m]}",
    "ShareAbovePart.above": "80 %",
    "lateral_resolution": "{below: 0.5 mm, over: [0.4 m, 3 m]}",
    "LengthBelowPart.below": "0.5 mm",
    "RequirementPart.failed_fraction": "{below: 1 %, over: [0.4 m, 3 m]}",
    "ShareBelowPart.below": "1 %",
    "SharpPart.above": "40 mm",
    "RequirementPart.depth_of_field": "{over: [140 mm, 160 mm]}",
    "SharpPart.over": "[140 mm, 160 mm]",
    "SharpPart.criterion": "two-pixels",
    "refocusing": "{shifts: [0, 0.25, 1], pairs: [1, 6]}",
    "RefocusingPart.cameras": "[r5-unfocused]",
    "RefocusingPart.shifts": "[-0.1, 0, 0.25, 1]",
    "RefocusingPart.pairs": "[1, 6]",
    "RefocusingPart.blur": "0.5 px",
    "RequirementPart.refocusing": "{over: [140 mm, 160 mm]}",
    "RequirementPart.refocused_depth_of_field": "{at: 150 mm, below: 20 mm}",
    "RefocusablePart.over": "[140 mm, 160 mm]",
    "RefocusablePart.at": "150 mm",
    "RefocusablePart.planes": "20",
    "RefocusedDepthOfFieldPart.at": "150 mm",
    "RefocusedDepthOfFieldPart.below": "20 mm",
    "RefocusedDepthOfFieldPart.above": "5 mm",
    "RefocusedDepthOfFieldPart.limits": "rays",
    "RequirementPart.criterion": "{name: mass, below: 500 g}",
    "CriterionPart.name": "mass",
    "CriterionPart.below": "500 g",
    "CriterionPart.above": "5 mm",
    "guard_band": "{risk: 5 %}",
    "RequirementPart.field": "80 %",
    "standard_errors": "2",
    "risk": "5 %",
    "ValueOfInformationPart.at": "[0.4 m, 1 m, 3 m]",
    "unusable": "50 %",
    "ValueOfInformationPart.draws": "1024",
    "order": "[precision, mass]",
    "sweep": "{stereo-75mm.baseline: [50 mm, 75 mm, 100 mm]}",
}
# Parts whose class name makes no heading.
_TITLES: Final = {
    "BlurPart": "Blur criterion",
    "BoundOverPart": "Bound on depth uncertainty",
    "CalibratedAtPart": "Air during the calibration",
    "CriterionFNumberClaim": "Claim about the minimum f-number from a criterion",
    "CriterionPart": "Bound on a criterion",
    "DepthOfFieldClaim": "Claim about a depth of field",
    "DepthOfFieldRatioClaim": "Claim about the ratio of two depths of field",
    "DepthScalingPart": "Depth scaling of a focused plenoptic camera",
    "DoubleSpherePart": "Double-sphere lens model",
    "ConventionalDeclaration": "Conventional camera",
    "ConventionalFocusPart": "Focus of a conventional camera",
    "ElementPart": "Lens",
    "ExpectPart": "Expected value",
    "ExtendedUnifiedPart": "Extended unified lens model",
    "FNumberRangePart": "Range of f-numbers",
    "FieldOfViewPart": "Field-of-view lens model",
    "FittedDoubleSpherePart": "Fitted double-sphere lens model",
    "FittedExtendedUnifiedPart": "Fitted extended unified lens model",
    "FittedFieldOfViewPart": "Fitted field-of-view lens model",
    "FittedKannalaBrandtPart": "Fitted Kannala–Brandt lens model",
    "FittedOmnidirectionalPart": "Fitted omnidirectional lens model",
    "FittedRationalPart": "Fitted rational lens model",
    "FocusedPlenopticCalibration": "Calibration of a focused plenoptic camera",
    "FocusedPlenopticDeclaration": "Focused plenoptic camera",
    "FresnelFNumberClaim": "Claim about the f-number that Fresnel's approximation needs",
    "FresnelValidityPart": "Validity of Fresnel's approximation",
    "GeometryPart": "Geometry of a calibrated pair",
    "ImageDifferenceClaim": "Claim about the difference between two pictures",
    "KannalaBrandtPart": "Kannala–Brandt lens model",
    "LengthBelowPart": "Upper bound on a length",
    "LensPart": "Main lens of a camera",
    "LengthOrPixelsDistribution": "Distribution of a length inside a camera",
    "LengthDistribution": "Distribution of a length",
    "AngleDistribution": "Distribution of an angle",
    "NumberDistribution": "Distribution of a number",
    "PressureDistribution": "Distribution of a pressure change",
    "TemperatureDistribution": "Distribution of a temperature change",
    "LimitDistanceClaim": "Claim about where a limit is met",
    "LitPixelsClaim": "Claim about the number of lit pixels",
    "MainLensPart": "Main lens of the light path",
    "OffAxisPart": "Off-axis comparison",
    "OmnidirectionalPart": "Omnidirectional lens model",
    "PlenopticDepthPart": "Depth from micro-images",
    "PlenopticErrors": "Errors of a plenoptic camera",
    "PlenopticKnown": "Known values of a plenoptic camera",
    "PlenopticStability": "Stability of a plenoptic camera",
    "ProjectingLensPart": "Lens of a stereo rig or conventional camera",
    "PsfErrorClaim": "Claim about the error of Fresnel's approximation",
    "PublishedTimePart": "Published computing time",
    "RationalPart": "Rational lens model",
    "ReferenceScalePart": "Reference focus setting",
    "RefocusablePart": "Refocusable distances",
    "RefocusedDepthOfFieldPart": "Bound on the depth of field of a refocused picture",
    "RelativeUncertaintyDistanceClaim": "Claim about where the relative uncertainty exceeds a threshold",
    "ShareAbovePart": "Lower bound on a fraction",
    "ShareBelowPart": "Upper bound on a fraction",
    "ShareBetterClaim": "Claim about where a camera is better",
    "SharpPart": "Bound on depth of field",
    "SolvePart": "Inverse question",
    "MeasurementPart": "Measurements",
    "SpotDetectorPart": "Detector of the light path",
    "SpotMicrolensesPart": "Microlenses of the light path",
    "SpotSourcePart": "Light source",
    "StatedPart": "Stated values",
    "StatedAccuracyPart": "Stated accuracy",
    "StereoCalibration": "Calibration of a stereo rig",
    "StereoDeclaration": "Stereo rig",
    "StereoErrors": "Errors of a stereo rig",
    "StereoStability": "Stability of a stereo rig",
    "TradeOffPart": "Trade-off",
    "UncertaintyRatioClaim": "Claim about the ratio of two uncertainties",
    "UnfocusedDepthPart": "Depth from views",
    "UnfocusedFocusPart": "Focus of an unfocused plenoptic camera",
    "UnfocusedMicrolensesPart": "Microlenses of an unfocused plenoptic camera",
    "UnfocusedPlenopticCalibration": "Calibration of an unfocused plenoptic camera",
    "UnfocusedPlenopticDeclaration": "Unfocused plenoptic camera",
    "UsablePart": "Usable distances",
    "WeighedPart": "Weighted criterion",
}
# What the keys that choose between parts say, instead of the description of the part they stand in.
_CHOOSES: Final = {
    "kind": "Kind of camera that the keys of this section describe.",
    "shape": "Kind of surface that the keys of this section describe.",
    "quantity": "Kind of claim that the keys of this section describe.",
}
_BY_PATH: Final = ("sweep", "set", "vary")  # whose names are paths of values
_DIMENSIONS: Final = sorted(
    (one for one in vars(units).values() if isinstance(one, units.Dimension)), key=lambda one: -len(one.name)
)


@dataclass(frozen=True, kw_only=True)
class Part:
    """A mapping of a study file: where it may stand, and its schema."""

    name: str
    paths: Sequence[str] = ()
    schema: Schema

    @property
    def anchor(self) -> str:
        """The target of links to it."""
        return f"part-{self.name.lower()}"


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The schema of study files, and what writes about it needs to know."""

    schema: Schema
    examples: dict[tuple[str, str], str] = field(default_factory=dict)

    def alternatives(self, schema: Schema, name: str = "") -> Iterator[tuple[str, Schema]]:
        """What may stand at a key: the names of parts (empty for values) and their schemas, without null and basis."""
        if "$ref" in schema:
            target = schema["$ref"].rpartition("/")[2]
            is_part = "properties" in self.schema["$defs"][target] and target[0].isupper()
            yield from self.alternatives(self.schema["$defs"][target], target if is_part else "")
            return
        inner = [*schema.get("anyOf", ()), *schema.get("oneOf", ())]
        if inner:
            for one in inner:
                yield from self.alternatives(one)
        elif schema.get("type") != "null" and "allOf" not in schema:  # which values with their basis have
            yield name, schema

    def parts_below(self, schema: Schema, path: str) -> Iterator[tuple[str, str]]:
        """Names and paths of the parts that a key leads to."""
        for name, one in self.alternatives(schema):
            if name:
                yield name, path
            for below in _members(one):
                yield from self.parts_below(below, f"{path}.{'PATH' if path in _BY_PATH else 'NAME'}")
            for below in _items(one):
                yield from self.parts_below(below, f"{path}[]")

    def part(self, name: str, paths: Sequence[str] = ()) -> Part:
        """A part by its name."""
        return Part(name=name, paths=paths, schema=self.schema["$defs"][name])

    def reached(self, name: str, path: str) -> Iterator[tuple[str, str]]:
        """A part and all parts below it, each with every path by which it is reached."""
        yield name, path
        for key, below in self.schema["$defs"][name]["properties"].items():
            for inner, where in self.parts_below(below, f"{path}.{key}"):
                yield from self.reached(inner, where)

    def learn(self, owner: str, value: Any, schema: Schema) -> None:
        """Take examples of keys from a value as it is written in a study."""
        found = [(name, one) for name, one in self.alternatives(schema) if _fits(value, one)]
        for name, one in found[:1]:
            if isinstance(value, Mapping):
                members = list(_members(one))
                for key, below in value.items():
                    inside = one.get("properties", {}).get(key)
                    if inside is not None:
                        self._keep(name or owner, key, below)
                        self.learn(name or owner, below, inside)
                    elif members:
                        self.learn(name or owner, below, members[0])
            elif isinstance(value, list):
                for below, inside in zip(value, _items(one), strict=False):
                    self.learn(owner, below, inside)

    def _keep(self, owner: str, key: str, value: Any) -> None:
        text = _flow(value)
        if value is not None and len(text) <= _LONGEST_EXAMPLE:
            self.examples.setdefault((owner, key), text)

    def takes(self, schema: Schema) -> str:
        """What may stand at a key, in words."""
        return _either(self._each(schema))

    def _each(self, schema: Schema) -> list[str]:
        """Everything that may stand at a key, in words."""
        found = sorted(self.alternatives(schema), key=lambda one: any(True for _ in _items(one[1])))  # lists last
        words = dict.fromkeys(word for name, one in found for word in self._takes_one(name, one))
        if "a number" in words:
            words.pop("a whole number", None)
        return [*words]

    def _takes_one(self, name: str, schema: Schema) -> Iterator[str]:
        if not name and "enum" in schema:
            yield from (f"`{_flow(one)}`" for one in schema["enum"] if one is not None)
        elif not name and schema.get("type") == "boolean":
            yield from ("`true`", "`false`")
        else:
            yield self._kind(name, schema)

    def _kind(self, name: str, schema: Schema) -> str:
        if name:
            return f"[{_spoken(name)}](#{self.part(name).anchor})"
        if "const" in schema:
            return f"`{_flow(schema['const'])}`"
        if "title" in schema and "examples" in schema:
            return str(schema["title"])
        if "prefixItems" in schema:
            inner = [self.takes(one) for one in schema["prefixItems"]]
            each = f", each {inner[0]}" if len(set(inner)) == 1 else f": {', '.join(inner)}"
            return f"a list of {len(inner)} values{each}"
        if schema.get("type") == "array":
            each = self.takes(schema["items"])
            if each == "text":
                return f"a list of {_count(schema).replace('values', 'names')}"
            if each == "a list of 2 names":
                return "a list of pairs of names"
            if re.fullmatch("`[^`]+`", each):
                return f"`[{each[1:-1]}]`"
            return f"a list of {_count(schema)}, each {each}"
        if members := list(_members(schema)):
            of = self._each(members[0])
            if len(of) > 1:
                return f"a mapping from names to values, each {_either(of)}"
            return f"a mapping from names to {of[0].replace('a mapping from', 'mappings, each from')}"
        if "properties" in schema:
            return f"a mapping with {' and '.join(f'`{key}`' for key in schema['properties'])}"
        if isinstance(schema["type"], list):
            return "a number"
        plain = {"integer": "a whole number", "number": "a number", "string": "text"}
        return plain[schema["type"]] + _limits(schema)

    def example(self, owner: str, key: str, schema: Schema) -> str:
        """One value that may stand at a key: from a study, else from its schema; a link where only parts may."""
        if (own := f"{owner}.{key}") in _EXAMPLES:
            return f"`{key}: {_EXAMPLES[own]}`"
        if (owner, key) in self.examples:
            return f"`{key}: {self.examples[owner, key]}`"
        if key in _EXAMPLES:
            value = YAML(typ="safe", pure=True).load(_EXAMPLES[key])
            if any(_fits(value, one) for _, one in self.alternatives(schema)):
                return f"`{key}: {_EXAMPLES[key]}`"
        for name, one in self.alternatives(schema):
            text = self._made_part(name) if name else self._made(one)
            if text:
                return f"`{key}: {text}`"
        name = next((name for name, _ in self.parts_below(schema, "")), "")
        if not name:
            raise ValueError(f"no example of {owner}.{key}")
        return f"see [{_spoken(name)}](#{self.part(name).anchor})"

    def _made_part(self, name: str) -> str:
        """What shipped studies say of the required keys of a part, or of one key where none is; empty if too long."""
        known = {key: text for (owner, key), text in self.examples.items() if owner == name}
        required = self.schema["$defs"][name].get("required", ())
        if not known or not set(required) <= set(known):
            return ""
        text = ", ".join(f"{key}: {known[key]}" for key in required or list(known)[:1])
        return f"{{{text}}}" if len(text) <= _LONGEST_EXAMPLE else ""

    def _made(self, schema: Schema) -> str:
        if "examples" in schema:
            return _flow(schema["examples"][0])
        if "const" in schema:
            return _flow(schema["const"])
        if "enum" in schema:
            return _flow(next(one for one in schema["enum"] if one is not None))
        if schema.get("type") == "boolean":
            return "true"
        if schema.get("type") == "integer":
            return str(schema.get("minimum", 1))
        if schema.get("type") == "array" and schema.get("maxItems", 1) != 0:
            inner = [
                self._made(one)
                for below in _items(schema)
                for name, one in [next(self.alternatives(below))]
                if not name
            ]
            count = max(schema.get("minItems", 1), 1) if "items" in schema else len(inner)
            return (
                f"[{', '.join((inner * count)[:count] if 'items' in schema else inner)}]"
                if all(inner) and inner
                else ""
            )
        return ""

    def lines(self, part: Part) -> Iterator[str]:
        """Everything about one part."""
        yield f"({part.anchor})="
        yield f"## {_spoken(part.name)}"
        yield ""
        if 1 <= len(part.paths) <= _MOST_PATHS:
            yield ", ".join(f"`{path}`" for path in part.paths)
            yield ""
        if meaning := part.schema.get("description"):
            yield _prose(meaning)
            yield ""
        yield from self.keys(part.name, part.schema)

    def keys(self, owner: str, schema: Schema) -> Iterator[str]:
        """A definition list of the keys of a mapping."""
        required = schema.get("required", ())
        for key, below in schema["properties"].items():
            meaning, takes = below.get("description") or self._described(below), self.takes(below)
            if meaning == schema.get("description"):
                meaning = _CHOOSES.get(key, meaning)
            if not (meaning and takes):
                raise ValueError(f"{owner}.{key} has no text")
            yield f"`{key}`"
            yield f": {_prose(meaning)}"
            yield ""
            takes = takes.replace("names", "paths") if key in _BY_PATH else takes
            default = "*Required.*" if key in required else self._default(below)
            yield f"  *Value:* {takes}. {default} "
            yield f"  *Example:* {self.example(owner, key, below)}"
            yield ""

    def _described(self, schema: Schema) -> str:
        """The description behind the references of a key."""
        while "$ref" in schema:
            schema = self.schema["$defs"][schema["$ref"].rpartition("/")[2]]
            if "description" in schema:
                return str(schema["description"])
        return ""

    def _default(self, schema: Schema) -> str:
        """The default of a key that may be left out; "Optional" where it has none."""
        while "$ref" in schema and "default" not in schema:
            schema = self.schema["$defs"][schema["$ref"].rpartition("/")[2]]
        if "default" not in schema or schema["default"] in (None, {}, [], ""):
            return "*Optional.*"
        if isinstance(schema["default"], Mapping):
            return "*Default:* the defaults of its keys."
        return f"*Default:* `{self._with_units(schema['default'], schema)}`."

    def _with_units(self, value: Any, schema: Schema) -> str:
        """A default value, or each value of a list, in its unit."""
        kinds = [one for _, one in self.alternatives(schema)]
        if isinstance(value, list | tuple):
            items = next((list(_items(one)) for one in kinds if any(True for _ in _items(one))), [])
            return f"[{', '.join(self._with_units(one, items[0]) if items else _flow(one) for one in value)}]"
        titles = [one["title"] for one in kinds if "title" in one]
        dimension = next((one for one in _DIMENSIONS for title in titles[:1] if title.startswith(one.name)), None)
        if isinstance(value, float) and dimension is not None:
            return units.pretty(value, dimension, digits=6)
        return _flow(value)


def _members(schema: Schema) -> Iterator[Schema]:
    yield from schema.get("patternProperties", {}).values()
    if isinstance(schema.get("additionalProperties"), Mapping):
        yield schema["additionalProperties"]


def _items(schema: Schema) -> Iterator[Schema]:
    if "prefixItems" in schema:
        yield from schema["prefixItems"]
    elif isinstance(schema.get("items"), Mapping):
        yield schema["items"]


def _fits(value: Any, schema: Schema) -> bool:
    """Roughly check whether a value fits a schema: enough to choose between alternatives."""
    if isinstance(value, Mapping):
        keys = schema.get("properties", {})
        fixed = {key: one["anyOf"][0].get("const") for key, one in keys.items() if "anyOf" in one}
        is_open = any(True for _ in _members(schema))
        return (bool(keys) or is_open) and all(
            (key in keys or is_open) and fixed.get(key) in (None, below) for key, below in value.items()
        )
    if isinstance(value, list):
        return schema.get("type") == "array"
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    return schema.get("type") not in ("array", "object") and schema.get("const", value) == value


def _without_basis(value: Any) -> Any:
    """The plain values of a study, of which each may be written with what it rests on."""
    if isinstance(value, list):
        return [_without_basis(one) for one in value]
    if not isinstance(value, Mapping):
        return value
    if "value" in value and set(value) <= _BASIS:
        return value["value"]
    return {key: _without_basis(one) for key, one in value.items()}


def _either(words: list[str]) -> str:
    """Alternatives as an enumeration."""
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _count(schema: Schema) -> str:
    """How many values a list has, as far as its schema says."""
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    if least == most:
        return f"{least} values"
    if most is not None:
        return f"{least} to {most} values" if least else f"up to {most} values"
    return f"{least} or more values" if least > 1 else "values"


def _limits(schema: Schema) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    if above is not None and below is not None:
        return f" above {above:g} and below {below:g}"
    if low is not None and high is not None:
        return f" from {low} to {'2⁶⁴ − 1' if high == 2**64 - 1 else high}"
    return f" of {low} or more" if low is not None else ""


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, str):
        is_plain = re.fullmatch(r"-?[^\s\[\]{},&*!|>'\"%@`#:-][^\[\]{},#:\n]*", value)
        return value if is_plain else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)


def _spoken(name: str) -> str:
    """``LengthDistribution`` as "Length distribution"."""
    if name in _TITLES:
        return _TITLES[name]
    words = re.findall(r"[A-Z][a-z]*", name.removesuffix("Part").removesuffix("Declaration"))
    return " ".join([words[0], *(word.lower() for word in words[1:])])


def _prose(text: str) -> str:
    """A description as Markdown: one paragraph, paths of keys as code, angle brackets kept from being tags."""
    parts = " ".join(text.replace("``", "`").replace("<", "&lt;").split()).split("`")
    parts[::2] = [re.sub(r"\b[a-z]\w*(?:[._][a-z]\w*)+", r"`\g<0>`", part) for part in parts[::2]]  # outside code
    return "`".join(parts)


def study_pages(root: Path) -> dict[str, str]:
    """The pages on study files by their names, without a suffix.

    Parameters
    ----------
    root
        The checkout, whose studies give the examples.
    """
    schema = tradestudy.schema()
    reference = Reference(schema=schema)
    reader = YAML(typ="safe", pure=True)
    camera = next(_members(schema["properties"]["cameras"]))
    for folder, of in (("studies", schema), ("studies/cameras", camera)):
        for path in sorted((root / folder).glob("*.yaml")):
            reference.learn("", _without_basis(reader.load(path.read_text(encoding="utf-8"))), of)

    titles, owners = _owners(reference)
    written = {name: [f"# {title}", ""] for name, title in titles.items()}
    for part, page in owners:
        written[page] += reference.lines(part)
    index = ["# The study file", "", _INDEX.strip(), "", "```{toctree}", *titles, "```", "", "## Top level", ""]
    return {"index": "\n".join([*index, *reference.keys("", schema), _FROM_FILES.strip(), ""])} | {
        name: "\n".join(lines) for name, lines in written.items()
    }


def _owners(reference: Reference) -> tuple[dict[str, str], list[tuple[Part, str]]]:
    """Titles of the pages, and the page of each part: that of the one key that leads to it, or a shared one."""
    roots: list[tuple[str, str, str]] = []  # page, part, path
    titles: dict[str, str] = {}
    for key, below in reference.schema["properties"].items():
        page = next((name for name, (_, keys) in _PAGES.items() if key in keys), _OTHER_PAGE[0])
        for part, path in reference.parts_below(below, key):
            if key == "cameras":
                page = part.removesuffix("Declaration").lower()
                titles[page] = f"{_spoken(part)}s"
            roots.append((page, part, path))
    kinds = set(titles)
    titles |= {"camera-parts": "Parts of several kinds of camera"}
    titles |= {name: title for name, (title, _) in _PAGES.items()} | dict([_OTHER_PAGE])
    titles |= {"shared": "The matcher"}  # so far, the only shared part
    pages: dict[str, set[str]] = {}
    paths: dict[str, dict[str, None]] = {}
    for page, part, path in roots:
        for name, where in reference.reached(part, path):
            pages.setdefault(name, set()).add(page)
            paths.setdefault(name, {})[where] = None

    def home(found: set[str]) -> str:
        if len(found) == 1:
            return next(iter(found))
        return "camera-parts" if found <= kinds else "shared"

    return titles, [(reference.part(name, [*paths[name]]), home(found)) for name, found in pages.items()]


_INDEX = """
A study is one YAML file. These pages list its keys, each with the values it accepts, its default and an example.
Editors can complete the keys from the JSON Schema that `python -m tradestudy schema` prints.

Write quantities with their units: `12.5 mm`, not `12.5`. Where infinity is allowed, write `inf` or `infinity`. Every
value may carry its basis and a note: `{value: 12.5 mm, basis: datasheet, note: page 3}`, where `basis` is `paper`,
`datasheet`, `measured`, `assumed` or `derived`. Beside them, `source` may say where the value was read, as a mapping of
the texts `title`, `revision` (optional), `url`, `read_on` (a day such as 2026-11-29) and `quote`, the words that state
it; reports show it with the note. `null` removes a value that a camera inherits from a file (`from`) or from another
camera (`like`). `off` may be written with or without quotes.

The *path* of a value in the study consists of the keys that lead to it, joined by dots: `scene.wavelength`. The path of
a value of a camera may begin with the name of the camera, without `cameras`: `stereo-75mm.baseline`.

Each section describes one mapping. Below its heading are the paths at which it may occur, unless there are more than
three. In these paths, `NAME` is a name that you choose, `PATH` is the path of a value, and `[]` is an item of a list.
"""

_FROM_FILES = """
## Cameras from other files

A camera may start from a file or from another camera, instead of being declared in full. Further keys then replace its
values or add to them. `from: catalogue/NAME` takes a camera from [the catalogue](../catalogue.md). A camera file may
have `modes`: a mapping whose keys are names of modes, and whose values replace those of the camera; without the key
`mode`, the first mode holds. The last four keys in the table below say how to read calibration files. They are allowed
only beside a `from` that names such files; [Import a calibration](../../../how-to/import-a-calibration.md) lists their
formats.

| key | meaning | example |
|---|---|---|
| `from` | A camera file, or one or more calibration files; if the two cameras of a rig have separate files, \
that of the left one first. Paths are relative \
to the study. A camera file contains the keys of one camera, without `from` and `like`. \
| `from: cameras/raytrix-r5.yaml`, `from: [left.yaml, right.yaml]` |
| `mode` | Beside `from`: the mode of the camera, if its file has modes. | `mode: 848x480` |
| `like` | Instead of `from`: name of another camera of the study. Values that `--set`, sweeps, readings and questions \
change are changed only in the camera that they name, not in those that are like it. | `like: stereo-50mm` |
| `length_unit` | Unit of the lengths in the calibration files; needed if neither the files nor their format state it. \
| `length_unit: mm` |
| `pair` | Names of the left and the right camera in a Kalibr file, or the numbers of their sockets in a DepthAI \
file. In an OpenCV calibration, the cameras are 1 and 2; `pair: [2, 1]` says that the second one is the left \
one. \
Default: the first two cameras of a Kalibr file, the stereo pair that a DepthAI file names, or cameras 1 and 2. \
| `pair: [cam0, cam2]` |
| `pictures` | Whether depth is measured in the pictures as taken (`raw`, the default) or in rectified ones \
(`rectified`); for OpenCV and ROS files. | `pictures: rectified` |
| `lens_model` | `fisheye` or `pinhole`, if the OpenCV, ROS or Kalibr file does not say which the lenses are. \
| `lens_model: fisheye` |
"""
