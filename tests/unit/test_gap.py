"""The parts of the gap finder: sensitivities, whitening, what is screened, drives."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest

from automap.effects import CATALOGUE
from automap.effects.user import set_user_effects
from automap.errors import InputError
from automap.gap import GapDrive, base_model, find_gaps
from automap.gap.candidates import library
from automap.gap.columns import effect_columns
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive, without
from automap.gap.motion import motion_of
from automap.gap.nodes import node_motion
from automap.gap.result import advice
from automap.gap.selection import Chosen
from automap.gap.sensitivity import sensitivities
from automap.gap.whitening import fit_whitener, white_rows
from automap.simulation.scenario import Gnss, Imu, Leg, Route, Scenario, Start, Stop, Vehicle
from automap.simulation.sensors import random_streams, simulate_sensors
from tests.unit.gap_linear import changes, screened

ARM = np.array([0.3, -0.2, -1.0])


def scenario_with(errors: dict[str, Any], noise: float = 1.0) -> Scenario:
    """Some two minutes through a town, with a halt."""
    legs = []
    for side in (-1.0, 1.0):
        legs += [
            Leg(length_m=180.0, speed_m_s=15.0),
            Leg(turn_deg=90.0 * side, radius_m=18.0, speed_m_s=7.0),
            Leg(length_m=120.0, speed_m_s=10.0),
            Leg(turn_deg=-75.0 * side, radius_m=30.0, speed_m_s=9.0),
            Leg(length_m=100.0, speed_m_s=14.0),
            Leg(turn_deg=70.0, radius_m=25.0, speed_m_s=9.0),
        ]
    return Scenario(
        schema="automap.scenario/1",
        name="gap",
        start=Start(
            utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC),
            lat_deg=-35.28,
            lon_deg=149.13,
            height_m=580.0,
            heading_deg=62.0,
        ),
        vehicle=Vehicle(),
        route=Route(legs=legs, stops=[Stop(at_m=500.0, hold_s=6.0)]),
        imu=Imu(),
        gnss=Gnss(lever_arm_m=(0.3, -0.2, -1.0), sigma_velocity=(0.05 * noise,) * 3),
        errors={
            "accel_bias": {"x": 0.06, "y": -0.09, "z": 0.11},
            "gyro_bias": {"x": 0.003, "y": -0.002, "z": 0.0016},
            **errors,
        },
    )


def simulated(errors: dict[str, Any], seed: int = 3, noise: float = 1.0) -> GapDrive:
    """That drive recorded."""
    sensors = simulate_sensors(scenario_with(errors, noise), random_streams(seed))
    assert sensors.fixes is not None
    return GapDrive(sensors.imu, sensors.fixes, sensors.clock, "gap", ARM)


@pytest.fixture(scope="module")
def plain() -> Fit:
    model = base_model()
    # beside it little of a delay or an arm is left, and that not linear
    model = without(model, "gnss_course_distance")
    # a fix that passes its gate by a hair has at once three tenths more variance, a step that no
    # sensitivity has
    model = replace(model, options=replace(model.options, gate_probability=0.0))
    return fit_drive(open_drive(simulated({}), model.options), model)


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        ("gnss_lever_arm", 0.05),
        ("gyro_scale", 2e-3),
        ("accel_misalignment", 2e-3),
        ("nhc_lever_arm", 0.05),
        ("gnss_latency", 0.01),
        ("imu_filter_delay", 0.01),
        ("accel_dead_zone", 0.01),
        ("gyro_dead_zone", 5e-4),
        ("gyro_saturation", 0.02),
        ("accel_warm_up", 0.02),
        ("gyro_speed_vibration", 2e-6),
    ],
)
def test_sensitivities_predict_what_an_effect_does_to_the_innovations(
    plain: Fit, effect: str, size: float
) -> None:
    # the same drive filtered with the effect at a value, linearised about the same path
    motion = motion_of(plain.last)
    sds = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
    columns = effect_columns(effect, node_motion(plain, motion), sds)
    column = 2 if effect.startswith("gyro") else 0
    phi = sensitivities(plain, motion, columns)[:, column]
    values = {effect: {columns[column].parameter: size}}
    other = fit_drive(plain.opened, replace(plain.model, values=values), linearised_at=plain)
    seen, at = changes(plain, other)
    predicted = size * phi[at]
    # delays reach the second order that the columns leave out
    assert np.corrcoef(predicted, seen)[0, 1] > (0.9 if effect == "gnss_latency" else 0.97)
    slope = float(predicted @ seen / (predicted @ predicted))
    assert slope == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("effect", "size"), [("imu_time_offset", 1e-2), ("imu_clock_skew", 1e-4)])
def test_beside_late_velocities_a_delay_is_screened_by_what_happened_then(
    effect: str, size: float
) -> None:
    late = {"gnss_velocity_latency": {"s": 0.8}}
    model = without(base_model(), "gnss_course_distance")
    options = replace(model.options, gate_probability=0.0)
    held = {"imu_clock_skew": {"origin": 1e-9}}
    model = replace(model, options=replace(options, prior_sd=held), values=late)
    fit = fit_drive(open_drive(simulated(late), model.options), model)
    # about the same path as the other
    fit = fit_drive(fit.opened, model, linearised_at=fit)
    motion = motion_of(fit.last)
    sds = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
    columns = effect_columns(effect, node_motion(fit, motion), sds)
    phi = sensitivities(fit, motion, columns)[:, 0]
    values = {**late, effect: {columns[0].parameter: size}}
    seen, at = changes(fit, fit_drive(fit.opened, replace(model, values=values), linearised_at=fit))
    predicted = size * phi[at]
    assert np.corrcoef(predicted, seen)[0, 1] > 0.9
    assert float(predicted @ seen / (predicted @ predicted)) == pytest.approx(1.0, abs=0.1)
    set_user_effects([])


@pytest.mark.slow
def test_whitening_takes_out_colour_and_size() -> None:
    rng = np.random.default_rng(1)
    n = 20000
    w = np.empty(n)
    w[0] = 0.0
    for i in range(1, n):
        w[i] = 0.5 * w[i - 1] + 3.0 * rng.standard_normal()
    w[::500] *= 20.0
    channel = np.zeros(n, np.int64)
    phi = rng.standard_normal((n, 1))
    whitener = fit_whitener(w, channel)
    rows = white_rows(whitener, w, phi, np.arange(n, dtype=float), channel, w)
    assert abs(np.mean(rows.w[1:] * rows.w[:-1])) < 0.05
    # one in 500 that is 20 times as large would add eight tenths, were it to count in full
    assert np.mean(rows.w**2) == pytest.approx(1.0, abs=0.2)
    # the score of a regressor that is not there scatters as its information says
    g = np.array(
        [
            white_rows(
                whitener, w, rng.standard_normal((n, 1)), np.arange(n, dtype=float), channel, w
            )
            for _ in range(60)
        ],
        dtype=object,
    )
    z = [float(r.phi[:, 0] @ r.w / np.sqrt(r.phi[:, 0] @ r.phi[:, 0])) for r in g]
    assert 0.75 < float(np.std(z)) < 1.3


def test_an_effect_is_screened_first_with_its_value() -> None:
    model = base_model()
    drive = simulated({"gnss_lever_arm": {"y": 0.6}})
    fit = fit_drive(open_drive(drive, model.options), model)
    selection = screened(fit, library(model.included, False, True))
    best = selection.best(Chosen())[0]
    assert selection.key(best.name, best.part) == ("gnss_lever_arm", ("y",))
    assert selection.holds(best)
    assert abs(best.evidence.estimate[0] - 0.6) < 5.0 * best.evidence.sd[0]


def test_what_is_in_the_model_is_not_tried() -> None:
    effects = library(frozenset({"gnss_latency", "gyro_scale"}), False, True)
    assert not {"gnss_latency", "imu_time_offset", "gyro_scale", "odometer_scale"} & set(effects)
    assert "earth_rotation" in library(frozenset(), True, False)


def test_a_drive_is_cut_into_parts() -> None:
    drive = simulated({})
    half = drive.part(0.0, 40.0, "half")
    assert half.length_s == pytest.approx(40.0, abs=0.05)
    assert 0 < len(half.fixes) < len(drive.fixes)


def test_too_short_drives_are_refused_in_one_sentence() -> None:
    drive = simulated({})
    with pytest.raises(InputError, match="too short to hold out"):
        find_gaps([drive.part(0.0, 15.0, "short")])
    with pytest.raises(InputError, match="usable fixes"):
        find_gaps([drive.part(0.0, 2.0, "tiny")], [drive])
    with pytest.raises(InputError, match="at least one"):
        find_gaps([])


def test_confusable_effects_come_with_a_manoeuvre() -> None:
    assert "brake" in advice("gnss_velocity_latency", ["gnss_velocity_lag"])
    assert advice("gyro_scale", []) == ""
    assert advice("gyro_scale", ["accel_scale"])
