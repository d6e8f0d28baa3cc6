"""The sensor model's names, and that estimator and simulator use one definition."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.effects import (
    CATALOGUE,
    Signals,
    distort_imu,
    effect_named,
    extra_basis,
    imu_terms,
)
from automap.effects.formula_text import parse_formula
from automap.effects.imu import BASIS_EXTRA
from automap.effects.inertial_signals import formula_of
from automap.effects.signals import FIELDS
from automap.errors import ConfigError
from automap.fusion.kernels.readings import correct, correction_of
from automap.fusion.kernels.transition import add_transition
from automap.fusion.layout import N_NAV

XYZ = "x y z"
NAMES = {
    "accel_bias": XYZ,
    "gyro_bias": XYZ,
    "accel_scale": XYZ,
    "gyro_scale": XYZ,
    "accel_bias_walk": XYZ,
    "gyro_bias_walk": XYZ,
    "accel_misalignment": "yx zx zy",
    "gyro_misalignment": "xy xz yx yz zx zy",
    "accel_scale_asymmetry": XYZ,
    "gyro_scale_asymmetry": XYZ,
    "accel_quadratic": XYZ,
    "gyro_g_sensitivity": "xx xy xz yx yy yz zx zy zz",
    "accel_temperature": XYZ,
    "gyro_temperature": XYZ,
    "imu_mounting": "roll pitch yaw",
    "imu_time_offset": None,
    "imu_clock_skew": None,
    "earth_rotation": "",
    "speed_vibration": XYZ,
    "gnss_lever_arm": XYZ,
    "gnss_latency": None,
    "gnss_velocity_latency": None,
    "gnss_velocity_lag": None,
    "gnss_correlated_noise": "sigma tau",
    "gnss_noise_scale": None,
    "gnss_outliers": None,
    "gnss_datum_shift": "n e d",
    "vehicle_sideslip": None,
    "nhc_lever_arm": XYZ,
    "camera_boresight": "roll pitch yaw",
    "camera_time_offset": None,
    "rolling_shutter": None,
    "camera_focal": None,
    "camera_distortion": "k1 k2",
    "camera_lever_arm": XYZ,
}
"""The published names. Parameters of None: one number whose name is free."""
INERTIAL = [n for n, e in CATALOGUE.items() if e.family == "imu"]


OWN = {
    *("odometer_scale", "odometer_time_offset", "vehicle_pitch", "gnss_velocity_wander"),
    *("gnss_slow_wander", "gnss_height_wander", "gnss_position_steps"),
    *("gnss_freeze", "gnss_speed_threshold"),
    *("gnss_course_latency", "gnss_course_distance", "gnss_speed_offset"),
    *("gnss_velocity_scale", "gnss_multipath"),
    *("imu_filter_delay", "accel_saturation", "gyro_saturation"),
    *("accel_dead_zone", "gyro_dead_zone", "accel_warm_up", "gyro_warm_up"),
    "gyro_speed_vibration",
}
"""Names of ours beside the published ones."""


def test_every_published_effect_exists_and_no_other_without_mention() -> None:
    assert set(CATALOGUE) == set(NAMES) | OWN


@pytest.mark.parametrize("name", NAMES)
def test_parameters_have_the_published_names(name: str) -> None:
    parameters = effect_named(name).parameters
    expected = NAMES[name]
    if expected is None:
        assert len(parameters) == 1
    else:
        assert [p.name for p in parameters] == expected.split()
    assert all(p.prior_sd > 0 for p in parameters)


def test_a_wrong_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'gyro_scale'"):
        effect_named("gyro_scal")
    with pytest.raises(ConfigError, match="does not act on inertial readings"):
        imu_terms(["gnss_latency"])


STEP_S = 0.02


def _of_drive(n: int = 40) -> Signals:
    """Quantities of a drive of which the time alone is asked for."""
    time, rest = STEP_S * np.arange(n, dtype=np.float64), np.zeros(n)
    return Signals(time, *[rest] * (len(FIELDS) - 1))


def _signals(n: int = 40) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(7)
    gyro = rng.normal(0.0, 0.4, (n, 3))
    accel = rng.normal(0.0, 2.0, (n, 3)) + np.array([0.0, 0.0, -9.8])
    return gyro, accel, rng.uniform(5.0, 45.0, n), rng.uniform(0.0, 30.0, n)


@pytest.mark.parametrize("name", INERTIAL)
def test_each_parameter_adds_its_own_signal(name: str) -> None:
    """Against formulas written out here."""
    gyro, accel, temp, speed = _signals()
    source = accel if name.startswith(("accel", "speed", "imu")) else gyro
    width = 0.1 if source is accel else 0.01
    for parameter in effect_named(name).parameters:
        theta = 0.01
        rates, forces = distort_imu(
            *(gyro, accel, {name: {parameter.name: theta}}, temp, speed),
            temp_ref_c=20.0,
            signals=_of_drive(),
        )
        out = "xyz".index(parameter.name[0])
        other = "xyz".index(parameter.name[-1])
        phi = {
            "bias": 1.0,
            "scale": source[:, out],
            "misalignment": source[:, other],
            "scale_asymmetry": np.abs(source[:, out]),
            "quadratic": accel[:, out] ** 2,
            "g_sensitivity": accel[:, other],
            "temperature": temp - 20.0,
            "vibration": speed**2,
            "speed_vibration": speed**2,
            "saturation": -(source[:, out] ** 3),
            "dead_zone": -np.tanh(source[:, out] / width),
            "warm_up": np.exp(-np.arange(40) * STEP_S / 120.0),
            # half a step late: half the way back to the sample before
            "filter_delay": -np.diff(source[:, out], prepend=source[0, out]) / STEP_S,
        }[name.split("_", 1)[1]]
        expected = np.zeros_like(gyro)
        expected[:, out] = theta * phi
        change = (forces - accel, rates - gyro)
        hit, still = change if source is accel else change[::-1]
        assert hit == pytest.approx(expected, abs=1e-12)
        assert np.abs(still).max() == 0.0


def test_a_parameter_on_several_axes_moves_the_path_as_one_on_each_does() -> None:
    rng = np.random.default_rng(3)
    codes = np.array([[0, 0, 7], [0, 1, 8], [0, 2, 9], [1, 0, 10], [1, 1, 11], [1, 2, 12]])
    rows = rng.normal(size=(9, N_NAV + 6))
    # what acts on forces alone tilts nothing
    rows[6:, N_NAV + 3 :] = 0.0
    one = np.column_stack([rows[:, :N_NAV], rows[:, N_NAV:].sum(axis=1)])
    known = rng.normal(size=(3, 3)), rng.normal(size=12), rng.normal(size=3), 0.02
    add_transition(rows, np.column_stack([codes, np.arange(6)]), *known)
    add_transition(one, np.column_stack([codes, np.zeros(6, np.int64)]), *known)
    assert one[:, N_NAV] == pytest.approx(rows[:, N_NAV:].sum(axis=1), abs=1e-12)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_filter_takes_out_what_the_simulator_puts_in(seed: int) -> None:
    rng = np.random.default_rng(seed)
    gyro, accel, temp, speed = _signals()
    # delays and dead zones are taken out to first order only
    exact = [n for n in INERTIAL if n != "imu_filter_delay" and "dead" not in n]
    names = [n for n in exact if rng.random() < 0.6] or ["gyro_bias"]
    terms = imu_terms(names)
    theta = np.array([rng.normal(0.0, t.parameter.prior_sd) for t in terms])
    values: dict[str, dict[str, float]] = {n: {} for n in names}
    for term, value in zip(terms, theta, strict=True):
        values[term.effect][term.parameter.name] = float(value)
    drive = _of_drive()
    rates, forces = distort_imu(gyro, accel, values, temp, speed, signals=drive)
    codes = [(t.sensor, t.axis, t.basis, i) for i, t in enumerate(terms)]
    table = np.array(codes, dtype=np.int64)
    extra = extra_basis(terms, gyro, accel, temp, speed, signals=drive)
    raw = np.concatenate([rates, forces], axis=1)
    matrix, shift, out = np.empty((6, 6)), np.empty(6), np.empty(6)
    for i in range(len(raw)):
        correction_of(table, theta, extra[i], matrix, shift)
        correct(raw[i], matrix, shift, out)
        assert out == pytest.approx(np.concatenate([gyro[i], accel[i]]), abs=1e-11)


def test_signals_without_a_source_are_zero() -> None:
    gyro, accel, _, _ = _signals()
    terms = imu_terms(["accel_temperature", "speed_vibration", "imu_filter_delay", "gyro_warm_up"])
    extra = extra_basis(terms, gyro, accel)
    assert extra.shape == (40, 6)
    assert np.abs(extra).max() == 0.0


@pytest.mark.parametrize("name", INERTIAL)
def test_the_filters_column_is_the_derivative_of_what_the_simulator_does(name: str) -> None:
    gyro, accel, temp, speed = _signals()
    drive, step = _of_drive(), 1e-4
    terms = imu_terms([name])
    extra = extra_basis(terms, gyro, accel, temp, speed, signals=drive)
    basis = np.concatenate([np.ones((40, 1)), gyro, accel, extra], axis=1)
    inner = slice(1, -1)  # where there are samples on both sides
    for term in terms:
        up, down = (
            np.concatenate(
                distort_imu(
                    *(gyro, accel, {name: {term.parameter.name: theta}}, temp, speed),
                    signals=drive,
                ),
                axis=1,
            )
            for theta in (step, -step)
        )
        slope = np.zeros((40, 6))
        slope[:, 3 * term.sensor + term.axis] = basis[:, term.basis]
        assert ((up - down) / (2.0 * step))[inner] == pytest.approx(slope[inner], abs=1e-8)


def test_a_dead_zone_lies_where_the_sensor_reads_nothing() -> None:
    gyro, accel, _, _ = _signals()
    values = {"accel_dead_zone": {"y": 0.02}, "accel_bias": {"y": 0.15}}
    _, forces = distort_imu(gyro, accel, values)
    without = accel[:, 1] + 0.15
    assert forces[:, 1] == pytest.approx(without - 0.02 * np.tanh(without / 0.1))
    # and the filter, which has readings alone, sees it there
    terms = imu_terms(["accel_dead_zone"])
    column = extra_basis(terms, gyro, accel, as_read=(gyro, forces))[:, 1]
    # a dead zone is narrow against its width, which is what it errs by to first order
    assert np.abs(0.02 * column - (forces[:, 1] - without)).max() < 0.02 * 0.02 / 0.1
    assert np.abs(column + np.tanh(accel[:, 1] / 0.1)).max() > 0.5


def test_formulas_of_signals_are_what_they_say() -> None:
    gyro, accel, temp, speed = _signals()
    drive = replace(
        _of_drive(),
        speed=speed,
        **{
            f"{s}_{a}": r[:, i]
            for s, r in (("rate", gyro), ("force", accel))
            for i, a in enumerate("xyz")
        },
    )
    said = 0
    for term in imu_terms([n for n in INERTIAL if "temperature" not in n]):
        if term.extra is None:
            continue
        text = formula_of(term.extra)
        if not text:
            assert term.effect == "imu_filter_delay"
            continue
        column = extra_basis(
            [replace(term, basis=BASIS_EXTRA)], gyro, accel, temp, speed, signals=drive
        )
        assert parse_formula(text)(drive) == pytest.approx(column[:, 0], rel=1e-12), text
        said += 1
    assert said > 20


def test_effects_that_an_entry_names_exist_and_each_pair_once() -> None:
    pairs = []
    for effect in CATALOGUE.values():
        named = [other for other, _ in effect.told_apart]
        pairs += [frozenset({effect.name, other}) for other in named]
        named += [effect.first_order[0]] if effect.first_order else []
        named += [n for n in (effect.unknown_epoch, effect.walk_setting) if n]
        assert set(named) <= set(CATALOGUE) - {effect.name}, effect.name
    assert len(pairs) == len(set(pairs))


def test_what_follows_from_the_terms() -> None:
    drifts = {e.name for e in CATALOGUE.values() if e.resembles_drift}
    assert {"accel_scale", "gyro_temperature", "imu_mounting", "speed_vibration"} <= drifts
    assert not drifts & {"accel_bias", "gnss_latency", "nhc_lever_arm"}
    assert CATALOGUE["speed_vibration"].sensor == "accel"
    assert CATALOGUE["imu_mounting"].sensor == ""
    assert CATALOGUE["imu_clock_skew"].resembles == CATALOGUE["gnss_velocity_lag"].resembles != ""
    negative = ("gnss_velocity_lag", "vehicle_sideslip", "gyro_dead_zone", "gyro_scale")
    assert [CATALOGUE[e].never_negative for e in negative] == [True, True, True, False]
    assert CATALOGUE["imu_filter_delay"].resembles == CATALOGUE["imu_time_offset"].resembles
    recorded = {e.name for e in CATALOGUE.values() if e.of_recorder}
    assert {"gyro_bias", "gnss_lever_arm", "odometer_scale"} <= recorded
    assert not recorded & {"gnss_correlated_noise", "vehicle_sideslip", "imu_time_offset"}
