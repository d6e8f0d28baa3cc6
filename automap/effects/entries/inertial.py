"""Errors of the inertial sensors."""

from __future__ import annotations

from automap.effects.effect import Effect
from automap.effects.entries.parts import NINE, axes, matrix, named, xyz
from automap.effects.terms import ACCEL, GYRO, SPEED_SQUARED, TEMPERATURE, WARM_UP

_COLD_AND_WARM = "start once cold and once warm"
_POSES = "record twelve poses on a desk"
_HARD = "brake and corner gently and as hard as is safe"
_FAST_AND_SLOW = "drive fast and slowly in turns, some minutes each"
_SWITCH_ON = "switch the sensor on at the start of one drive and half an hour before another"

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
        axes(ACCEL, signal=SPEED_SQUARED),
    ),
    Effect(
        "gyro_speed_vibration",
        "imu",
        # 0.1 deg/s at 20 m/s, as much as a steady 1 g does to such a gyro (MPU-6050's data sheet)
        xyz("(rad/s)/(m/s)^2", 5e-6),
        "gyro rectifies vibration that grows with speed",
        axes(GYRO, signal=SPEED_SQUARED),
        told_apart=(("gyro_bias_walk", _FAST_AND_SLOW), ("gyro_warm_up", _FAST_AND_SLOW)),
    ),
    Effect(
        "imu_filter_delay",
        "imu",
        # low-passes of 44, 10 and 5 Hz are 5, 14 and 19 ms late (MPU-6000's register map), and
        # readings that are paired with the other sensor's nearest are off by a step; an axis, for
        # filters of analog sensors are capacitors, one each: alike, but not the same
        xyz("s", 0.02),
        "accelerometer readings later than the gyro's: below zero, the gyro's are",
        axes(ACCEL, signal="late_force_{}"),
        isotropic=True,
        looks_like="a delay",
        told_apart=(
            (
                "imu_time_offset",
                "drive tight bends both ways beside braking hard on a straight: what the gyro "
                "tells of a bend comes in time where the accelerometer alone is late",
            ),
        ),
    ),
    Effect(
        "accel_saturation",
        "imu",
        # 0.5 %, the nonlinearity of MPU-6050's data sheet, of a reading of 1 g. Of either sign:
        # springs soften and stiffen (coefficient K3 of IEEE Std 1293)
        xyz("1/(m/s^2)^2", 5e-5),
        "accelerometer reads less the stronger the force, by its cube",
        axes(ACCEL, signal="lost_force_{}"),
        told_apart=(("accel_scale", _HARD), ("accel_quadratic", _HARD)),
    ),
    Effect(
        "gyro_saturation",
        "imu",
        # 0.2 %, the nonlinearity of MPU-6050's data sheet, of a turn of 1 rad/s
        xyz("1/(rad/s)^2", 2e-3),
        "gyro reads less the faster the turn, by its cube",
        axes(GYRO, signal="lost_rate_{}"),
        told_apart=(("gyro_scale", "drive wide bends and tight circles"),),
    ),
    Effect(
        "accel_dead_zone",
        "imu",
        # two steps of 0.001 g, as recorders of cars and phones write them
        xyz("m/s^2", 0.02, 0.0),
        "accelerometer does not feel forces below so much, and all others by as much too little",
        axes(ACCEL, signal="dead_force_{}"),
        told_apart=(("accel_scale", _HARD),),
    ),
    Effect(
        "gyro_dead_zone",
        "imu",
        # 0.1 deg/s: two steps of recorders that write 0.07 deg/s
        xyz("rad/s", 2e-3, 0.0),
        "gyro does not feel turns below so much, and all others by as much too little",
        axes(GYRO, signal="dead_rate_{}"),
        told_apart=(
            ("gyro_scale", "drive slow wide bends and tight circles, both ways"),
            ("gyro_saturation", "drive slow wide bends and tight circles, both ways"),
        ),
    ),
    # a warm-up by 15 K with the prior of the bias's temperature coefficient
    Effect(
        "accel_warm_up",
        "imu",
        xyz("m/s^2", 0.075),
        "bias that dies away in the minutes after switching on",
        axes(ACCEL, signal=WARM_UP),
        told_apart=(("accel_bias_walk", _SWITCH_ON), ("accel_temperature", _SWITCH_ON)),
    ),
    Effect(
        "gyro_warm_up",
        "imu",
        xyz("rad/s", 7.5e-3),
        "bias that dies away in the minutes after switching on",
        axes(GYRO, signal=WARM_UP),
        told_apart=(("gyro_bias_walk", _SWITCH_ON), ("gyro_temperature", _SWITCH_ON)),
    ),
)
