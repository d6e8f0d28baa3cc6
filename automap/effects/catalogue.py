"""Names, parameters, units and priors of all effects."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from automap.errors import ConfigError


@dataclass(frozen=True)
class Parameter:
    """One number of an effect: its name within the effect, unit and prior one-sigma."""

    name: str
    unit: str
    prior_sd: float


@dataclass(frozen=True)
class Effect:
    """A named physical effect.

    ``family`` is where it acts: "imu", "noise", "clock", "gnss", "vehicle", "earth", "camera".
    """

    name: str
    family: str
    parameters: tuple[Parameter, ...]
    summary: str


def _xyz(unit: str, sd: float) -> tuple[Parameter, ...]:
    return tuple(Parameter(a, unit, sd) for a in ("x", "y", "z"))


def _named(names: str, unit: str, sd: float) -> tuple[Parameter, ...]:
    return tuple(Parameter(n, unit, sd) for n in names.split())


_FULL = "xx xy xz yx yy yz zx zy zz"

# Priors are those of a consumer MEMS unit after the sensor file's conversion to SI.
_EFFECTS = (
    Effect("accel_bias", "imu", _xyz("m/s^2", 0.3), "constant accelerometer offset"),
    Effect("gyro_bias", "imu", _xyz("rad/s", 0.02), "constant gyro offset"),
    Effect("accel_scale", "imu", _xyz("", 0.01), "accelerometer scale error"),
    Effect("gyro_scale", "imu", _xyz("", 0.01), "gyro scale error"),
    Effect(
        "accel_bias_walk", "noise", _xyz("m/s^2/sqrt(s)", 1e-3), "in-run accelerometer bias drift"
    ),
    Effect("gyro_bias_walk", "noise", _xyz("rad/s/sqrt(s)", 5e-5), "in-run gyro bias drift"),
    Effect(
        "accel_misalignment",
        "imu",
        _named("yx zx zy", "rad", 0.01),
        "non-orthogonal accelerometer axes",
    ),
    Effect(
        "gyro_misalignment",
        "imu",
        _named("xy xz yx yz zx zy", "rad", 0.01),
        "gyro axes turned against the accelerometer's and each other",
    ),
    Effect("accel_scale_asymmetry", "imu", _xyz("", 0.005), "scale differs with the sign"),
    Effect("gyro_scale_asymmetry", "imu", _xyz("", 0.005), "scale differs with the sign"),
    Effect("accel_quadratic", "imu", _xyz("1/(m/s^2)", 5e-4), "second-order accelerometer term"),
    Effect(
        "gyro_g_sensitivity",
        "imu",
        _named(_FULL, "(rad/s)/(m/s^2)", 5e-4),
        "gyro reads specific force",
    ),
    Effect("accel_temperature", "imu", _xyz("(m/s^2)/K", 5e-3), "bias follows temperature"),
    Effect("gyro_temperature", "imu", _xyz("(rad/s)/K", 5e-4), "bias follows temperature"),
    Effect(
        "speed_vibration",
        "imu",
        _xyz("(m/s^2)/(m/s)^2", 5e-4),
        "accelerometer rectifies vibration that grows with speed",
    ),
    Effect(
        "imu_mounting",
        "vehicle",
        _named("roll pitch yaw", "rad", 0.05),
        "IMU axes turned against the vehicle's",
    ),
    Effect("imu_time_offset", "clock", _named("s", "s", 0.1), "IMU stamps later than the truth"),
    Effect("imu_clock_skew", "clock", _named("skew", "s/s", 5e-5), "IMU clock runs fast"),
    Effect("earth_rotation", "earth", (), "the Earth turns under the sensor"),
    Effect("gnss_lever_arm", "gnss", _xyz("m", 1.0), "antenna away from the IMU"),
    Effect("gnss_latency", "gnss", _named("s", "s", 0.1), "fixes older than their tag"),
    Effect(
        "gnss_velocity_latency",
        "gnss",
        _named("s", "s", 0.1),
        "velocities older than the positions of the same fix",
    ),
    Effect(
        "gnss_velocity_lag",
        "gnss",
        _named("tau", "s", 0.2),
        "velocity passed through a first-order low-pass",
    ),
    Effect(
        "gnss_correlated_noise",
        "gnss",
        (Parameter("sigma", "m", 1.0), Parameter("tau", "s", 60.0)),
        "position error that wanders",
    ),
    Effect("gnss_noise_scale", "gnss", _named("factor", "", 1.0), "reported accuracy is off"),
    Effect("gnss_outliers", "gnss", _named("fraction", "", 0.05), "wild fixes"),
    Effect("gnss_datum_shift", "gnss", _named("n e d", "m", 1.0), "another datum"),
    Effect(
        "vehicle_sideslip",
        "vehicle",
        _named("coefficient", "rad/(m/s^2)", 0.005),
        "the car drifts outwards in curves",
    ),
    Effect(
        "vehicle_pitch",
        "vehicle",
        _named("coefficient", "rad/(m/s^2)", 0.01),
        "the nose rises on its springs with the acceleration",
    ),
    Effect(
        "nhc_lever_arm",
        "vehicle",
        _xyz("m", 1.5),
        "from the IMU to the point that does not slide sideways",
    ),
    Effect("odometer_scale", "vehicle", _named("relative", "", 0.03), "wheels turn too fast"),
    Effect("camera_boresight", "camera", _named("roll pitch yaw", "rad", 0.03), "camera turned"),
    Effect("camera_time_offset", "camera", _named("s", "s", 0.1), "frame stamps off"),
    Effect("rolling_shutter", "camera", _named("s", "s/image height", 0.03), "rows read in turn"),
    Effect("camera_focal", "camera", _named("relative", "", 0.02), "focal length off"),
    Effect("camera_distortion", "camera", _named("k1 k2", "", 0.05), "lens distortion off"),
    Effect("camera_lever_arm", "camera", _xyz("m", 0.3), "camera away from where it is said"),
)

CATALOGUE: dict[str, Effect] = {e.name: e for e in _EFFECTS}


def effect_named(name: str) -> Effect:
    """The effect of that name.

    Raises:
        ConfigError: no such effect; the message names the nearest one.
    """
    if name in CATALOGUE:
        return CATALOGUE[name]
    near = difflib.get_close_matches(name, CATALOGUE, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise ConfigError(f"there is no effect named '{name}'{hint}")
