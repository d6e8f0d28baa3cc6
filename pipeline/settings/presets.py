"""What the named sensor and receiver of a drive say to the fusion, below the user's settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.fusion.limits import KNOWN_ROLL_SD
from automap.fusion.options import FusionOptions
from automap.io.drive import Drive
from automap.io.imu_calibration import read_imu_calibration
from automap.io.receiver_file import ReceiverModel, find_receiver, read_receiver
from automap.io.sensor_file import SensorModel, find_sensor, read_sensor
from automap.records import ImuCalibration
from pipeline.settings.fuse import FuseSettings

_PLAIN_ACCEL = 300e-6 * STANDARD_GRAVITY
_PLAIN_GYRO = np.radians(0.01)
"""Noise densities of a plain consumer sensor on a desk. The default levels are such a sensor's
in a car; what is left of them is the car's vibration, which any sensor there feels."""


@dataclass(frozen=True)
class Preset:
    """A preset in use: ``role`` "imu" or "gnss", its file, full name, and what it sets, by the
    names of the fusion's settings (priors as ``prior_sd.EFFECT``)."""

    role: str
    file: Path
    name: str
    values: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The preset in JSON's types."""
        return {"preset": self.file.stem, "name": self.name, "values": self.values}


def preset_files(drive: Drive) -> list[Path]:
    """The files of the presets that the manifest names; ConfigError where there is none."""
    files = []
    if drive.imu.sensor is not None:
        files.append(find_sensor(drive.imu.sensor, drive.path))
    if drive.gnss.receiver is not None:
        files.append(find_receiver(drive.gnss.receiver, drive.path))
    return files


def fusion_options(drive: Drive, settings: FuseSettings) -> tuple[FusionOptions, list[Preset]]:
    """The fusion's options for a drive: defaults, its presets, then the user's own settings.

    Raises ConfigError for a preset that does not exist or cannot be read.
    """
    options = settings.options()
    presets = []
    if drive.imu.sensor is not None:
        file = find_sensor(drive.imu.sensor, drive.path)
        sensor = read_sensor(file)
        values = sensor_figures(sensor, calibrated=drive.imu_calibration is not None)
        presets.append(Preset("imu", file, sensor.name, values))
    if drive.gnss.receiver is not None:
        file = find_receiver(drive.gnss.receiver, drive.path)
        receiver = read_receiver(file)
        presets.append(Preset("gnss", file, receiver.name, receiver_figures(receiver)))
    used = []
    for preset in presets:
        values = {k: v for k, v in preset.values.items() if not _is_stated(k, settings)}
        options = with_figures(options, values)
        used.append(replace(preset, values=values))
    if drive.imu_calibration is not None:
        left = calibrated_figures(read_imu_calibration(drive.imu_calibration))
        options = with_figures(
            options, {k: v for k, v in left.items() if not _is_stated(k, settings)}
        )
    if "effects" not in settings.stated:
        options = without_known_angles(options)
    return options, used


def calibrated_figures(calibration: ImuCalibration) -> dict[str, float]:
    """How exactly a calibration knows the angles between axes, as priors of what is left."""
    return {
        f"prior_sd.{kind}_misalignment": triad.angles_sd
        for kind, triad in (("accel", calibration.accel), ("gyro", calibration.gyro))
        if np.isfinite(triad.angles_sd)
    }


def without_known_angles(options: FusionOptions) -> FusionOptions:
    """The options without the angles between axes that are known as well as a body keeps its own
    roll: what is left of them turns nothing."""
    known = {
        effect
        for effect, sd in options.prior_sd.items()
        if effect.endswith("_misalignment") and max(sd.values(), default=np.inf) <= KNOWN_ROLL_SD
    }
    return replace(options, effects=tuple(e for e in options.effects if e not in known))


def sensor_figures(sensor: SensorModel, calibrated: bool) -> dict[str, float]:
    """Noise, drift and, for readings that nobody calibrated, the spread of the sensor's errors."""
    base = FusionOptions()
    figures = {}
    for kind, triad, plain in (
        ("accel", sensor.accel, _PLAIN_ACCEL),
        ("gyro", sensor.gyro, _PLAIN_GYRO),
    ):
        in_car = getattr(base, f"{kind}_noise")
        figures[f"{kind}_noise"] = np.sqrt(in_car**2 - plain**2 + triad.noise_density**2)
        figures[f"{kind}_bias_walk"] = triad.bias_walk
        if not calibrated:
            figures[f"prior_sd.{kind}_bias"] = triad.bias_sd
            figures[f"prior_sd.{kind}_scale"] = triad.scale_sd
            figures[f"prior_sd.{kind}_misalignment"] = triad.misalignment_sd
    return {name: float(value) for name, value in figures.items() if np.isfinite(value)}


def receiver_figures(receiver: ReceiverModel) -> dict[str, float]:
    """Shares, floors and fallbacks of the receiver's errors, and what its delay may be."""
    figures = dict(receiver.figures)
    if np.isfinite(receiver.velocity_latency_sd_s):
        figures["prior_sd.gnss_velocity_latency"] = receiver.velocity_latency_sd_s
    return figures


def with_figures(options: FusionOptions, figures: Mapping[str, float]) -> FusionOptions:
    """The options with these figures; ``prior_sd.EFFECT`` is for all parameters of an effect."""
    plain = {name: value for name, value in figures.items() if not name.startswith("prior_sd.")}
    priors = {
        name.removeprefix("prior_sd."): {"*": value}
        for name, value in figures.items()
        if name.startswith("prior_sd.")
    }
    changed: dict[str, Any] = {**plain, "prior_sd": {**options.prior_sd, **priors}}
    return replace(options, **changed)


def _is_stated(figure: str, settings: FuseSettings) -> bool:
    if figure.startswith("prior_sd."):
        return figure.removeprefix("prior_sd.") in settings.options().prior_sd
    return figure in settings.stated
