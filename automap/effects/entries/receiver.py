"""Errors of the satellite receiver, and where its antenna is."""

from __future__ import annotations

from automap.effects.effect import Effect, Parameter
from automap.effects.entries.parts import axes, named, one, xyz
from automap.effects.terms import FIX, POSITION, TRAVEL, VELOCITY, GaussMarkov, Kind, Term

_SLOW_CIRCLES = "drive the same tight circle slowly both ways: a lever arm does not grow with speed"

RECEIVER = (
    Effect(
        "gnss_lever_arm",
        "gnss",
        xyz("m", 1.0),
        "antenna away from the IMU",
        axes(FIX, Kind.POINT),
        looks_like="a slip",
    ),
    Effect(
        "gnss_latency",
        "gnss",
        named("s", "s", 0.1),
        "fixes older than their tag",
        one("s", FIX, Kind.TIME, weight=-1.0),
        told_apart=(("gnss_lever_arm", _SLOW_CIRCLES),),
    ),
    Effect(
        "gnss_velocity_latency",
        "gnss",
        named("s", "s", 0.1),
        "velocities older than the positions of the same fix",
        one("s", VELOCITY, Kind.TIME, weight=-1.0),
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
        named("tau", "s", 0.2, 0.0),
        "velocity passed through a first-order low-pass",
        one("tau", VELOCITY, Kind.LAG),
    ),
    Effect(
        "gnss_course_latency",
        "gnss",
        named("s", "s", 0.3),
        "the velocity's course older than its size, as of filters that treat them apart",
        one("s", VELOCITY, Kind.COURSE, weight=-1.0),
    ),
    Effect(
        "gnss_course_distance",
        "gnss",
        named("m", "m", 1.0, 0.0),
        "the velocity's course that of a place so far behind, as of filters that smooth it more "
        "the slower the car goes",
        # its size is that of two phones of which it was measured: 1.3 and 0.1 m
        one("m", VELOCITY, Kind.POINT, weight=-1.0),
        told_apart=(("gnss_lever_arm", _SLOW_CIRCLES),),
    ),
    Effect(
        "gnss_velocity_scale",
        "gnss",
        named("relative", "", 0.02),
        "horizontal velocity too long",
        (
            Term("relative", VELOCITY, Kind.SCALE, 0),
            Term("relative", VELOCITY, Kind.SCALE, 1),
        ),
    ),
    Effect(
        "gnss_speed_offset",
        "gnss",
        # two phones tell 0.023 m/s too little on average, 0.02 to 0.06 for minutes
        named("along", "m/s", 0.05),
        "speeds told too high by as much at any speed",
        tuple(Term("along", VELOCITY, Kind.AXIS, axis, part) for axis, part in enumerate(TRAVEL)),
        nuisance=True,
    ),
    Effect(
        "gnss_correlated_noise",
        "gnss",
        (Parameter("sigma", "m", 1.0, 0.0), Parameter("tau", "s", 60.0, 0.0)),
        "position error that wanders",
        axes(POSITION, names="n e d", signal="position_sd_{}"),
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
        axes(POSITION, names="n e d", signal="quick_sd_{}"),
        markov=GaussMarkov("multipath_tau_s", "multipath_share", ("multipath",) * 3),
        nuisance=True,
    ),
    Effect(
        "gnss_velocity_wander",
        "gnss",
        (Parameter("sigma", "m/s", 0.1, 0.0), Parameter("tau", "s", 2.0, 0.0)),
        "velocity error that lasts",
        axes(VELOCITY, names="n e d"),
        markov=GaussMarkov(
            *("velocity_wander_tau_s", "velocity_wander_sd"),
            *(("velocity_wander",) * 3, "velocity_wander_tau"),
        ),
        setting="fuse.velocity_wander_sd",
        nuisance=True,
    ),
    Effect(
        "gnss_noise_scale",
        "gnss",
        named("factor", "", 1.0, 0.0),
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
        named("n e d", "m", 1.0),
        "another datum",
        axes(POSITION, names="n e d"),
    ),
)
