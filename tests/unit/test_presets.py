"""Presets of sensors and receivers: they exist, act below the user's settings, and are told."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from input_drive import write_drive

from automap.errors import ConfigError
from automap.fusion.options import FusionOptions
from automap.io import names
from automap.io.drive import load_drive
from automap.io.imu_calibration import write_imu_calibration
from automap.io.receiver_file import SCHEMA, find_receiver, read_receiver
from automap.io.sensor_file import SCHEMA as SENSOR_SCHEMA
from automap.io.sensor_file import find_sensor, preset_names, read_sensor
from pipeline.check.command import check_drive
from pipeline.cli.root import run_command
from pipeline.run.stages import fuse
from pipeline.settings.load import load_settings
from pipeline.settings.presets import fusion_options

DEFAULT = FusionOptions()
M8 = 'receiver = "u-blox-m8"'
ADIS = 'sensor = "adis16465"'
CALIBRATION = 'calibration = "imu_calibration.toml"'


@pytest.fixture
def named(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "drive", ADIS, M8)


def test_every_receiver_file_that_comes_along_is_valid() -> None:
    known = preset_names(SCHEMA)
    assert {"u-blox-5", "u-blox-m8", "u-blox-f9p"} <= set(known)
    for name in known:
        model = read_receiver(find_receiver(name))
        assert 0.0 < model.figures["white_share"] < model.figures["wander_share"] <= 1.0
        assert 0.0 < model.velocity_latency_sd_s < 1.0


def test_better_devices_have_the_smaller_figures() -> None:
    def receiver(name: str) -> dict[str, float]:
        return read_receiver(find_receiver(name)).figures

    for figure in ("white_share", "horizontal_sd_m", "velocity_sd"):
        five, m8, f9p = (receiver(f"u-blox-{n}")[figure] for n in ("5", "m8", "f9p"))
        assert five > m8 > f9p
    best = read_sensor(find_sensor("adis16465"))
    for name in ("mpu9150", "lsm6ds3", "thinimu-micro"):
        other = read_sensor(find_sensor(name))
        for figure in ("noise_density", "bias_walk", "bias_sd", "scale_sd", "misalignment_sd"):
            assert getattr(best.gyro, figure) < getattr(other.gyro, figure)
            assert getattr(best.accel, figure) < getattr(other.accel, figure)


def test_presets_change_the_options(named: Path) -> None:
    options, presets = fusion_options(load_drive(named), load_settings().fuse)
    sensor = read_sensor(find_sensor("adis16465"))
    assert options.gyro_bias_walk == pytest.approx(np.radians(1.7e-4))
    assert options.prior_sd["accel_bias"] == {"*": pytest.approx(sensor.accel.bias_sd)}
    assert options.gyro_noise < DEFAULT.gyro_noise
    assert options.white_share == 0.15
    assert options.min_velocity_sd == 0.04
    assert options.prior_sd["gnss_velocity_latency"] == {"*": 0.1}
    assert [p.file.stem for p in presets] == ["adis16465", "u-blox-m8"]
    assert options.nhc_sd == DEFAULT.nhc_sd


def test_a_plain_sensor_in_a_car_is_what_the_defaults_are(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "plain", 'sensor = "generic-mems"')
    options, _ = fusion_options(load_drive(drive), load_settings().fuse)
    assert options.accel_noise == pytest.approx(DEFAULT.accel_noise)
    assert options.gyro_noise == pytest.approx(DEFAULT.gyro_noise)
    assert options.prior_sd == {}


def test_what_the_user_sets_stands_even_where_it_is_the_default(
    named: Path, tmp_path: Path
) -> None:
    config = tmp_path / "mine.toml"
    config.write_text(
        f"[fuse]\ngyro_noise = {DEFAULT.gyro_noise}\n[fuse.prior_sd.accel_bias]\nx = 0.5\n"
    )
    settings = load_settings(config, [f"fuse.white_share={DEFAULT.white_share}"])
    options, presets = fusion_options(load_drive(named), settings.fuse)
    assert options.gyro_noise == DEFAULT.gyro_noise
    assert options.white_share == DEFAULT.white_share
    assert options.prior_sd["accel_bias"] == {"x": 0.5}
    assert options.gyro_bias_walk != DEFAULT.gyro_bias_walk
    assert "white_share" not in presets[1].values
    assert "wander_tau_s" in presets[1].values


def _calibrated(drive: Path, accel_sd: float | None, gyro_sd: float | None) -> None:
    """Give a drive a calibration whose angles between axes are known so well."""
    sections: dict[str, dict[str, object]] = {}
    for kind, size, sd in (("accel", 9, accel_sd), ("gyro", 12, gyro_sd)):
        covariance = np.eye(size) * 1e-12
        covariance[6:, 6:] = np.eye(size - 6) * (sd or 0.0) ** 2
        sections[kind] = {"scale": np.ones(3), "bias": np.zeros(3), "covariance": covariance}
    write_imu_calibration(drive / "imu_calibration.toml", sections)
    manifest = drive / "drive.toml"
    manifest.write_text(manifest.read_text().replace("[imu]\n", f"[imu]\n{CALIBRATION}\n"))


def test_readings_that_were_calibrated_keep_the_priors_of_what_is_left(named: Path) -> None:
    _calibrated(named, 2e-4, 3e-4)
    options, _ = fusion_options(load_drive(named), load_settings().fuse)
    assert "accel_bias" not in options.prior_sd
    assert options.gyro_bias_walk != DEFAULT.gyro_bias_walk


ANGLES = "accel_misalignment", "gyro_misalignment"


@pytest.mark.parametrize(
    ("accel_sd", "gyro_sd", "estimated", "priors"),
    [
        (2e-4, 3e-4, (), (2e-4, 3e-4)),
        (None, 3e-4, ANGLES[:1], (None, 3e-4)),
        (2e-4, None, ANGLES[1:], (2e-4, None)),
        (5e-3, 2e-3, ANGLES, (5e-3, 2e-3)),
    ],
)
def test_angles_between_axes_are_estimated_unless_a_calibration_knows_them(
    tmp_path: Path,
    accel_sd: float | None,
    gyro_sd: float | None,
    estimated: tuple[str, ...],
    priors: tuple[float | None, float | None],
) -> None:
    drive = write_drive(tmp_path / "drive")
    plain, _ = fusion_options(load_drive(drive), load_settings().fuse)
    assert set(ANGLES) <= set(plain.effects)
    _calibrated(drive, accel_sd, gyro_sd)
    options, _ = fusion_options(load_drive(drive), load_settings().fuse)
    assert set(options.effects) == set(plain.effects) - set(ANGLES) | set(estimated)
    for effect, sd in zip(ANGLES, priors, strict=True):
        assert options.prior_sd.get(effect, {}).get("*") == (sd and pytest.approx(sd))
    stated = load_settings(None, [f'fuse.effects=["{ANGLES[0]}"]']).fuse
    assert fusion_options(load_drive(drive), stated)[0].effects == ANGLES[:1]


def test_angles_that_a_data_sheet_makes_small_are_not_estimated(named: Path) -> None:
    options, _ = fusion_options(load_drive(named), load_settings().fuse)
    assert not set(ANGLES) & set(options.effects)


@pytest.mark.parametrize(
    ("imu", "gnss", "said"),
    [
        ('sensor = "mpu9250"', "", "imu.sensor.*did you mean mpu9150"),
        ("", 'receiver = "ublox-m8"', "gnss.receiver.*did you mean u-blox-m8"),
        ("", 'receiver = "mpu9150"', "the line schema"),
    ],
)
def test_an_unknown_preset_names_the_nearest(
    imu: str, gnss: str, said: str, tmp_path: Path
) -> None:
    drive = write_drive(tmp_path / "drive", imu, gnss)
    with pytest.raises(ConfigError, match=said):
        fusion_options(load_drive(drive), load_settings().fuse)


def test_a_receiver_file_of_the_drives_own(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "drive", "", 'receiver = "mine"')
    own = drive / "mine.toml"
    own.write_text('schema = "automap.receiver/1"\n[errors]\nwhite_share = 0.4\n')
    loaded = load_drive(drive)
    assert own in fuse.STAGE.inputs(loaded)
    assert fusion_options(loaded, load_settings().fuse)[0].white_share == 0.4
    own.write_text('schema = "automap.receiver/1"\n[errors]\nwhite_shar = 0.4\n')
    with pytest.raises(ConfigError, match=r"errors.white_shar; did you mean white_share"):
        fusion_options(loaded, load_settings().fuse)


def test_sensor_files_are_no_receivers() -> None:
    assert not set(preset_names(SCHEMA)) & set(preset_names(SENSOR_SCHEMA))


@pytest.mark.slow
def test_a_run_uses_and_names_its_presets(named: Path, tmp_path: Path) -> None:
    text = check_drive(named).text()
    assert "sensor adis16465: Analog Devices" in text
    assert "receiver u-blox-m8: u-blox M8" in text
    out = tmp_path / "out"
    assert run_command(["run", str(named), "-o", str(out), "--to", "fuse"]) == 0
    metrics = json.loads((out / names.RUN).read_text())["metrics"]
    assert metrics["imu_preset"] == "adis16465"
    assert metrics["gnss_preset"] == "u-blox-m8"
    presets = json.loads((out / names.FUSION).read_text())["presets"]
    assert presets["gnss"]["values"]["white_share"] == 0.15
