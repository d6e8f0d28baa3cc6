"""Errors of the inertial sensors."""

from __future__ import annotations

from automap.effects.effect import Effect
from automap.effects.entries.parts import NINE, axes, matrix, named, xyz
from automap.effects.terms import ACCEL, GYRO, TEMPERATURE

_COLD_AND_WARM = "start once cold and once warm"
_POSES = "record twelve poses on a desk"

# Priors are those of a consumer MEMS unit after the sensor file's conversion to SI.
INERTIAL = (
    Effect(
        "accel_bias",
        "imu",
        xyz("m/s^2", 0.3),
        "constant accelerometer offset",
        axes(ACCEL),
        walk_setting="accel_bias_walk",
        nuisance=True,
    ),
    Effect(
        "gyro_bias",
        "imu",
        xyz("rad/s", 0.02),
        "constant gyro offset",
        axes(GYRO),
        walk_setting="gyro_bias_walk",
        nuisance=True,
    ),
    Effect(
        "accel_scale",
        "imu",
        xyz("", 0.01),
        "accelerometer scale error",
        axes(ACCEL, signal="force_{}"),
        told_apart=(("accel_quadratic", _POSES), ("accel_scale_asymmetry", _POSES)),
    ),
    Effect("gyro_scale", "imu", xyz("", 0.01), "gyro scale error", axes(GYRO, signal="rate_{}")),
    Effect(
        "accel_bias_walk",
        "noise",
        xyz("m/s^2/sqrt(s)", 1e-3, 0.0),
        "in-run accelerometer bias drift",
        setting="fuse.accel_bias_walk",
    ),
    Effect(
        "gyro_bias_walk",
        "noise",
        xyz("rad/s/sqrt(s)", 5e-5, 0.0),
        "in-run gyro bias drift",
        setting="fuse.gyro_bias_walk",
    ),
    Effect(
        "accel_misalignment",
        "imu",
        named("yx zx zy", "rad", 0.01),
        "non-orthogonal accelerometer axes",
        matrix(ACCEL, "force_{}", "yx zx zy"),
        looks_like="a tilt",
        told_apart=(
            ("imu_mounting", "accelerate and brake on a straight, level road, and drive it back"),
        ),
    ),
    Effect(
        "gyro_misalignment",
        "imu",
        named("xy xz yx yz zx zy", "rad", 0.01),
        "gyro axes turned against the accelerometer's and each other",
        matrix(GYRO, "rate_{}", "xy xz yx yz zx zy"),
        told_apart=(
            ("gyro_g_sensitivity", "drive slow tight circles, and brake hard on a straight"),
        ),
    ),
    Effect(
        "accel_scale_asymmetry",
        "imu",
        xyz("", 0.005),
        "scale differs with the sign",
        axes(ACCEL, signal="abs_force_{}"),
    ),
    Effect(
        "gyro_scale_asymmetry",
        "imu",
        xyz("", 0.005),
        "scale differs with the sign",
        axes(GYRO, signal="abs_rate_{}"),
    ),
    Effect(
        "accel_quadratic",
        "imu",
        xyz("1/(m/s^2)", 5e-4),
        "second-order accelerometer term",
        axes(ACCEL, signal="sq_force_{}"),
    ),
    Effect(
        "gyro_g_sensitivity",
        "imu",
        named(NINE, "(rad/s)/(m/s^2)", 5e-4),
        "gyro reads specific force",
        matrix(GYRO, "force_{}", NINE),
    ),
    Effect(
        "accel_temperature",
        "imu",
        xyz("(m/s^2)/K", 5e-3),
        "bias follows temperature",
        axes(ACCEL, signal=TEMPERATURE),
        told_apart=(("accel_bias_walk", _COLD_AND_WARM),),
    ),
    Effect(
        "gyro_temperature",
        "imu",
        xyz("(rad/s)/K", 5e-4),
        "bias follows temperature",
        axes(GYRO, signal=TEMPERATURE),
        told_apart=(("gyro_bias_walk", _COLD_AND_WARM),),
    ),
    Effect(
        "speed_vibration",
        "imu",
        xyz("(m/s^2)/(m/s)^2", 5e-4),
        "accelerometer rectifies vibration that grows with speed",
        axes(ACCEL, signal="speed_squared"),
    ),
)
