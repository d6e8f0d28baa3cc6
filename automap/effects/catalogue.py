"""All effects: names, parameters, units, priors, and the terms by which they act."""

from __future__ import annotations

import difflib
import math

from automap.effects.effect import Effect, Parameter
from automap.effects.terms import (
    ACCEL,
    ELAPSED,
    FIX,
    FORWARD_ACCELERATION,
    GYRO,
    LATERAL_ACCELERATION,
    ONE,
    POSITION,
    TEMPERATURE,
    VEHICLE,
    VELOCITY,
    GaussMarkov,
    Kind,
    Term,
)
from automap.errors import ConfigError

EARTH = "earth_rotation"
"""On or off: an effect without parameters."""

_XYZ = "x y z"
_RPY = "roll pitch yaw"
_FULL = "xx xy xz yx yy yz zx zy zz"


def _named(names: str, unit: str, sd: float, at_least: float = -math.inf) -> tuple[Parameter, ...]:
    return tuple(Parameter(n, unit, sd, at_least) for n in names.split())


def _xyz(unit: str, sd: float, at_least: float = -math.inf) -> tuple[Parameter, ...]:
    return _named(_XYZ, unit, sd, at_least)


def _axes(
    on: str | tuple[str, ...],
    kind: Kind = Kind.AXIS,
    names: str = _XYZ,
    signal: str = ONE,
    weight: float = 1.0,
) -> tuple[Term, ...]:
    """A parameter an axis; ``{}`` in the signal stands for the parameter's name."""
    measured = (on,) if isinstance(on, str) else on
    return tuple(
        Term(name, one, kind, axis, signal.format(name), weight)
        for axis, name in enumerate(names.split())
        for one in measured
    )


def _matrix(sensor: str, signal: str, names: str) -> tuple[Term, ...]:
    """Parameters named by output axis and input axis; ``{}`` in the signal is the latter."""
    return tuple(
        Term(name, sensor, Kind.AXIS, _XYZ.split().index(name[0]), signal.format(name[1]))
        for name in names.split()
    )


def _one(
    parameter: str,
    on: str | tuple[str, ...],
    kind: Kind,
    axis: int = 0,
    signal: str = ONE,
    weight: float = 1.0,
) -> tuple[Term, ...]:
    measured = (on,) if isinstance(on, str) else on
    return tuple(Term(parameter, each, kind, axis, signal, weight) for each in measured)


# Manoeuvres that tell several pairs apart.
_SLOW_CIRCLES = "drive the same tight circle slowly both ways: a lever arm does not grow with speed"
_COLD_AND_WARM = "start once cold and once warm"
_POSES = "record twelve poses on a desk"
_LONG_DRIVE = "record a drive of half an hour or more"

# Priors are those of a consumer MEMS unit after the sensor file's conversion to SI.
_INERTIAL = (
    Effect(
        "accel_bias",
        "imu",
        _xyz("m/s^2", 0.3),
        "constant accelerometer offset",
        _axes(ACCEL),
        walk_setting="accel_bias_walk",
        nuisance=True,
    ),
    Effect(
        "gyro_bias",
        "imu",
        _xyz("rad/s", 0.02),
        "constant gyro offset",
        _axes(GYRO),
        walk_setting="gyro_bias_walk",
        nuisance=True,
    ),
    Effect(
        "accel_scale",
        "imu",
        _xyz("", 0.01),
        "accelerometer scale error",
        _axes(ACCEL, signal="force_{}"),
        told_apart=(("accel_quadratic", _POSES), ("accel_scale_asymmetry", _POSES)),
    ),
    Effect("gyro_scale", "imu", _xyz("", 0.01), "gyro scale error", _axes(GYRO, signal="rate_{}")),
    Effect(
        "accel_bias_walk",
        "noise",
        _xyz("m/s^2/sqrt(s)", 1e-3, 0.0),
        "in-run accelerometer bias drift",
        setting="fuse.accel_bias_walk",
    ),
    Effect(
        "gyro_bias_walk",
        "noise",
        _xyz("rad/s/sqrt(s)", 5e-5, 0.0),
        "in-run gyro bias drift",
        setting="fuse.gyro_bias_walk",
    ),
    Effect(
        "accel_misalignment",
        "imu",
        _named("yx zx zy", "rad", 0.01),
        "non-orthogonal accelerometer axes",
        _matrix(ACCEL, "force_{}", "yx zx zy"),
        looks_like="a tilt",
        told_apart=(
            ("imu_mounting", "accelerate and brake on a straight, level road, and drive it back"),
        ),
    ),
    Effect(
        "gyro_misalignment",
        "imu",
        _named("xy xz yx yz zx zy", "rad", 0.01),
        "gyro axes turned against the accelerometer's and each other",
        _matrix(GYRO, "rate_{}", "xy xz yx yz zx zy"),
        told_apart=(
            ("gyro_g_sensitivity", "drive slow tight circles, and brake hard on a straight"),
        ),
    ),
    Effect(
        "accel_scale_asymmetry",
        "imu",
        _xyz("", 0.005),
        "scale differs with the sign",
        _axes(ACCEL, signal="abs_force_{}"),
    ),
    Effect(
        "gyro_scale_asymmetry",
        "imu",
        _xyz("", 0.005),
        "scale differs with the sign",
        _axes(GYRO, signal="abs_rate_{}"),
    ),
    Effect(
        "accel_quadratic",
        "imu",
        _xyz("1/(m/s^2)", 5e-4),
        "second-order accelerometer term",
        _axes(ACCEL, signal="sq_force_{}"),
    ),
    Effect(
        "gyro_g_sensitivity",
        "imu",
        _named(_FULL, "(rad/s)/(m/s^2)", 5e-4),
        "gyro reads specific force",
        _matrix(GYRO, "force_{}", _FULL),
    ),
    Effect(
        "accel_temperature",
        "imu",
        _xyz("(m/s^2)/K", 5e-3),
        "bias follows temperature",
        _axes(ACCEL, signal=TEMPERATURE),
        told_apart=(("accel_bias_walk", _COLD_AND_WARM),),
    ),
    Effect(
        "gyro_temperature",
        "imu",
        _xyz("(rad/s)/K", 5e-4),
        "bias follows temperature",
        _axes(GYRO, signal=TEMPERATURE),
        told_apart=(("gyro_bias_walk", _COLD_AND_WARM),),
    ),
    Effect(
        "speed_vibration",
        "imu",
        _xyz("(m/s^2)/(m/s)^2", 5e-4),
        "accelerometer rectifies vibration that grows with speed",
        _axes(ACCEL, signal="speed_squared"),
    ),
)

_INSTALLATION = (
    Effect(
        "imu_mounting",
        "vehicle",
        _named(_RPY, "rad", 0.05),
        "IMU axes turned against the vehicle's",
        _axes((*FIX, VEHICLE), Kind.TURN, _RPY),
        looks_like="a tilt",
    ),
    Effect(
        "imu_time_offset",
        "clock",
        _named("s", "s", 0.1),
        "IMU stamps later than the truth",
        _one("s", (*FIX, VEHICLE), Kind.TIME),
        first_order=("gnss_latency", -1.0),
        told_apart=(
            (
                "gnss_latency",
                "late fixes and late IMU stamps look the same to IMU and receiver; compare with "
                "wheel speeds on the host clock, or tap the IMU against a timed event",
            ),
        ),
    ),
    Effect(
        "imu_clock_skew",
        "clock",
        _named("skew", "s/s", 5e-5),
        "IMU clock runs fast",
        _one("skew", (*FIX, VEHICLE), Kind.TIME, signal=ELAPSED),
        unknown_epoch="imu_time_offset",
        told_apart=(("imu_time_offset", _LONG_DRIVE), ("gnss_latency", _LONG_DRIVE)),
    ),
    Effect(
        EARTH,
        "earth",
        (),
        "the Earth turns under the sensor",
        setting="fuse.earth_rotation",
    ),
)

_RECEIVER = (
    Effect(
        "gnss_lever_arm",
        "gnss",
        _xyz("m", 1.0),
        "antenna away from the IMU",
        _axes(FIX, Kind.POINT),
        looks_like="a slip",
    ),
    Effect(
        "gnss_latency",
        "gnss",
        _named("s", "s", 0.1),
        "fixes older than their tag",
        _one("s", FIX, Kind.TIME, weight=-1.0),
        told_apart=(("gnss_lever_arm", _SLOW_CIRCLES),),
    ),
    Effect(
        "gnss_velocity_latency",
        "gnss",
        _named("s", "s", 0.1),
        "velocities older than the positions of the same fix",
        _one("s", VELOCITY, Kind.TIME, weight=-1.0),
        first_order=("gnss_velocity_lag", 1.0),
        told_apart=(
            (
                "gnss_velocity_lag",
                "brake hard to a halt a few times: after the halt a lag dies away slowly, a "
                "latency ends at once",
            ),
            ("gnss_lever_arm", _SLOW_CIRCLES),
        ),
    ),
    Effect(
        "gnss_velocity_lag",
        "gnss",
        _named("tau", "s", 0.2, 0.0),
        "velocity passed through a first-order low-pass",
        _one("tau", VELOCITY, Kind.LAG),
    ),
    Effect(
        "gnss_course_latency",
        "gnss",
        _named("s", "s", 0.3),
        "the velocity's course older than its size, as of filters that treat them apart",
        _one("s", VELOCITY, Kind.COURSE, weight=-1.0),
    ),
    Effect(
        "gnss_velocity_scale",
        "gnss",
        _named("relative", "", 0.02),
        "horizontal velocity too long",
        (
            Term("relative", VELOCITY, Kind.SCALE, 0),
            Term("relative", VELOCITY, Kind.SCALE, 1),
        ),
    ),
    Effect(
        "gnss_correlated_noise",
        "gnss",
        (Parameter("sigma", "m", 1.0, 0.0), Parameter("tau", "s", 60.0, 0.0)),
        "position error that wanders",
        _axes(POSITION, names="n e d", signal="position_sd_{}"),
        markov=GaussMarkov(
            "wander_tau_s", "wander_share", ("wander", "wander", "wander_v"), "wander_tau"
        ),
        nuisance=True,
    ),
    Effect(
        "gnss_multipath",
        "gnss",
        (Parameter("sigma", "m", 0.3, 0.0), Parameter("tau", "s", 10.0, 0.0)),
        "position error that lasts for seconds",
        _axes(POSITION, names="n e d", signal="position_sd_{}"),
        markov=GaussMarkov("multipath_tau_s", "multipath_share", ("multipath",) * 3),
        nuisance=True,
    ),
    Effect(
        "gnss_velocity_wander",
        "gnss",
        (Parameter("sigma", "m/s", 0.1, 0.0), Parameter("tau", "s", 2.0, 0.0)),
        "velocity error that lasts",
        _axes(VELOCITY, names="n e d"),
        markov=GaussMarkov("velocity_wander_tau_s", "velocity_wander_sd", ("velocity_wander",) * 3),
        setting="fuse.velocity_wander_sd",
        nuisance=True,
    ),
    Effect(
        "gnss_noise_scale",
        "gnss",
        _named("factor", "", 1.0, 0.0),
        "reported accuracy is off",
        setting="fuse.adapt",
        nuisance=True,
    ),
    Effect(
        "gnss_outliers",
        "gnss",
        (Parameter("fraction", "", 0.05, 0.0, 1.0),),
        "wild fixes",
        setting="fuse.gate_probability",
        nuisance=True,
    ),
    Effect(
        "gnss_slow_wander",
        "gnss",
        (Parameter("sigma", "m", 1.0, 0.0), Parameter("tau", "s", 600.0, 0.0)),
        "horizontal position error that wanders over many minutes",
        nuisance=True,
    ),
    Effect(
        "gnss_height_wander",
        "gnss",
        (Parameter("sigma", "m", 3.0, 0.0), Parameter("tau", "s", 1800.0, 0.0)),
        "height error that wanders over many minutes",
        nuisance=True,
    ),
    Effect(
        "gnss_position_steps",
        "gnss",
        (Parameter("size", "m", 0.5, 0.0), Parameter("interval", "s", 60.0, 0.0)),
        "position error that stays and now and then jumps to another value",
        nuisance=True,
    ),
    Effect(
        "gnss_freeze",
        "gnss",
        (Parameter("length", "s", 2.0, 0.0), Parameter("interval", "s", 300.0, 0.0)),
        "position held for some seconds while its tag goes on",
        nuisance=True,
    ),
    Effect(
        "gnss_speed_threshold",
        "gnss",
        (Parameter("speed", "m/s", 0.3, 0.0),),
        "speeds below it are said to be nothing",
        nuisance=True,
    ),
    Effect(
        "gnss_datum_shift",
        "gnss",
        _named("n e d", "m", 1.0),
        "another datum",
        _axes(POSITION, names="n e d"),
    ),
)

_VEHICLE = (
    Effect(
        "vehicle_sideslip",
        "vehicle",
        _named("coefficient", "rad/(m/s^2)", 0.005),
        "the car drifts outwards in curves",
        _one("coefficient", VEHICLE, Kind.SLIP, 2, LATERAL_ACCELERATION),
        one_signed=True,
        looks_like="a slip",
    ),
    Effect(
        "vehicle_pitch",
        "vehicle",
        _named("coefficient", "rad/(m/s^2)", 0.01),
        "the nose rises on its springs with the acceleration",
        _one("coefficient", VEHICLE, Kind.SLIP, 1, FORWARD_ACCELERATION),
        nuisance=True,
    ),
    Effect(
        "nhc_lever_arm",
        "vehicle",
        _xyz("m", 1.5),
        "from the IMU to the point that does not slide sideways",
        _axes(VEHICLE, Kind.POINT),
        looks_like="a slip",
        told_apart=(
            (
                "vehicle_sideslip",
                "drive the same bend once slowly and once fast: slip grows with the square of the "
                "speed",
            ),
        ),
    ),
    Effect(
        "odometer_scale",
        "vehicle",
        _named("relative", "", 0.03),
        "wheels turn too fast",
        _one("relative", VEHICLE, Kind.SCALE, 0),
    ),
    Effect(
        "odometer_time_offset",
        "vehicle",
        _named("s", "s", 0.3),
        "wheel speeds stamped later than the truth",
        _one("s", VEHICLE, Kind.TIME, weight=-1.0),
    ),
)

_CAMERA = (
    Effect("camera_boresight", "camera", _named(_RPY, "rad", 0.03), "camera turned"),
    Effect(
        "camera_time_offset",
        "camera",
        _named("s", "s", 0.1),
        "frame stamps off",
        told_apart=(
            ("rolling_shutter", "film signs high and low in the picture while turning"),
            (
                "camera_lever_arm",
                "pass signs at two speeds: an offset grows with the speed, a lever arm does not",
            ),
        ),
    ),
    Effect("rolling_shutter", "camera", _named("s", "s/image height", 0.03), "rows read in turn"),
    Effect(
        "camera_focal",
        "camera",
        _named("relative", "", 0.02),
        "focal length off",
        told_apart=(
            ("camera_distortion", "film signs in the corners of the picture"),
            ("camera_lever_arm", "pass signs near and far, to both sides of the road"),
        ),
    ),
    Effect("camera_distortion", "camera", _named("k1 k2", "", 0.05), "lens distortion off"),
    Effect(
        "camera_lever_arm",
        "camera",
        _xyz("m", 0.3),
        "camera away from where it is said",
        told_apart=(("camera_boresight", "film signs near and far"),),
    ),
)

CATALOGUE: dict[str, Effect] = {
    e.name: e for e in (*_INERTIAL, *_INSTALLATION, *_RECEIVER, *_VEHICLE, *_CAMERA)
}


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


def alike_to_first_order() -> list[tuple[str, str]]:
    """Pairs of effects that a filter cannot tell apart to first order."""
    return [pair for sign in (-1.0, 1.0) for pair in pairs_of_sign(sign)]


def pairs_of_sign(sign: float) -> list[tuple[str, str]]:
    """Those pairs of them that act with opposite (-1) or the same sign (1)."""
    pairs = [
        (e.name, e.first_order[0])
        for e in CATALOGUE.values()
        if e.first_order and e.first_order[1] == sign
    ]
    return [(min(pair), max(pair)) for pair in pairs]


def bias_walks() -> dict[str, Effect]:
    """The random walks of biases by name, and the bias that walks."""
    return {e.walk_setting: e for e in CATALOGUE.values() if e.walk_setting}
