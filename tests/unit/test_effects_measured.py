"""Effects on fixes, vehicle and clocks: the simulator distorts by what the filter's rows say."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
import pytest

from automap import earth
from automap.effects import CATALOGUE
from automap.effects.gnss import (
    OUTLIER_M,
    gauss_markov,
    low_pass,
    noise_factor,
    outliers,
    wander,
)
from automap.effects.measured import MEASURED, Values, distortion
from automap.effects.terms import POSITION, VELOCITY, Kind
from automap.effects.user import user_signal
from automap.effects.vehicle import (
    nose_angles,
    parameters,
    sensor_to_vehicle,
    stamp_error_s,
)
from automap.fusion.layout import N_NAV
from automap.fusion.model import StateModel, build_state_model
from automap.fusion.options import FusionOptions
from automap.simulation.gnss import ideal_epochs
from automap.simulation.imu import true_signals
from automap.simulation.odometer import reported_speed
from automap.simulation.scenario import Gnss, Leg, Route, Scenario, Start, Vehicle
from automap.simulation.trajectory import DriveMotion, drive_motion
from tests.unit import measured_node
from tests.unit.measured_node import measured

EFFECTS = tuple(n for n, e in CATALOGUE.items() if e.acts_on(*MEASURED) and e.markov is None)
STEP = {"m/s": 0.01, "m": 0.02, "s": 2e-3, "s/s": 1e-5, "rad": 1e-3, "rad/(m/s^2)": 2e-4, "": 1e-3}
CASES = [(e, p.name, p.unit) for e in EFFECTS for p in CATALOGUE[e].parameters]
INSTANTS = np.array([9.0, 15.5, 17.2, 20.4])
"""Gathering speed, into a bend, in it, and out of it again."""
ON_WHEELS = tuple(e for e in EFFECTS if CATALOGUE[e].family == "vehicle")
INSTALLED: Values = {
    "imu_mounting": {"roll": 0.02, "pitch": -0.03, "yaw": 0.03},
    "gnss_lever_arm": {"x": 1.2, "y": 0.4, "z": -1.1},
    "nhc_lever_arm": {"x": -1.4, "y": 0.2, "z": 0.9},
    "odometer_scale": {"relative": 0.02},
}
"""A model with everything that changes how other effects show."""


def _drive(errors: Values) -> DriveMotion:
    start = Start(
        utc=datetime(2026, 3, 14, 9, 20, tzinfo=UTC),
        lat_deg=-35.28,
        lon_deg=149.13,
        heading_deg=62.0,
    )
    legs = [
        Leg(length_m=120.0, speed_m_s=13.0, grade_percent=2.0),
        Leg(turn_deg=-80.0, radius_m=25.0, speed_m_s=9.0),
        Leg(length_m=60.0, speed_m_s=13.0),
    ]
    scenario = Scenario(
        schema="automap.scenario/1",
        name="short",
        start=start,
        route=Route(legs=legs),
        vehicle=Vehicle(road_roughness_deg=0.0),
        errors={name: dict(values) for name, values in errors.items()},
    )
    return drive_motion(scenario, np.random.default_rng(1))


@dataclass(frozen=True)
class Seen:
    """Residuals [k, 9] of a filter that knows of no effect, and rows [k, 9, n]: position,
    velocity, vehicle constraint, odometer."""

    z: np.ndarray
    h: np.ndarray


def _seen(errors: Values, model: StateModel, told: Values | None = None) -> Seen:
    """What is left when the truth of a drive with these errors is taken for error-free, but for
    what the filter is ``told``."""
    drive = _drive(errors)
    place, velocity = ideal_epochs(drive, Gnss(), INSTANTS, errors)
    wheels = reported_speed(drive, INSTANTS, errors)
    # nodes stand on IMU stamps: there the vehicle is where it was when the sample was taken
    motion = drive.at(INSTANTS - stamp_error_s(INSTANTS, errors))
    C_v_s = sensor_to_vehicle(errors)
    xi = np.zeros(model.size - N_NAV)
    for effect, values in (told or {}).items():
        for parameter, value in values.items():
            xi[model.index(f"{effect}_{parameter}") - N_NAV] = value
    quantities = true_signals(motion)
    signals = np.stack([user_signal(name, quantities) for name in model.signals], axis=1)
    z_all, h_all = [], []
    for k, t in enumerate(INSTANTS):
        c = np.ascontiguousarray(motion.C_n_b[k] @ C_v_s)
        pos = np.array([motion.lat_rad[k], motion.lon_rad[k], motion.height_m[k]])
        seen = [
            measured(
                number,
                model,
                pos,
                motion.vel_ned[k],
                c,
                xi,
                np.concatenate([place[k], velocity[k]]),
                wheels[k],
                motion.turn_rate[k] @ C_v_s,
                motion.accel_ned[k],
                t,
                signals=signals[k],
            )
            for number in range(measured_node.WHEELS + 1)
        ]
        h_all.append(np.concatenate([h for h, _ in seen]))
        z_all.append(np.concatenate([z for _, z in seen]))
    return Seen(np.array(z_all), np.array(h_all))


@pytest.fixture(scope="module")
def model() -> StateModel:
    return build_state_model(FusionOptions(effects=EFFECTS))


@pytest.mark.parametrize("installed", [{}, INSTALLED], ids=["bare", "installed"])
@pytest.mark.parametrize(("effect", "parameter", "unit"), CASES)
def test_distortion_has_the_derivative_that_the_filter_takes(
    effect: str, parameter: str, unit: str, installed: Values, model: StateModel
) -> None:
    """Every parameter of the catalogue that acts on fixes or vehicle, also where a mounting, lever
    arms and a scale are in the model."""
    step, base = STEP[unit], installed.get(effect, {}).get(parameter, 0.0)

    def seen(amount: float) -> Seen:
        own = {**installed.get(effect, {}), parameter: base + amount}
        return _seen({**installed, effect: own}, model, told=installed)

    # a time constant cannot be negative
    one_sided = parameter == "tau"
    here = seen(0.0)
    numeric = (seen(step).z - (here.z if one_sided else seen(-step).z)) / step
    numeric /= 1.0 if one_sided else 2.0
    row = here.h[:, :, model.index(f"{effect}_{parameter}")].copy()
    scale = np.abs(row).max()
    assert scale > 5e-3
    slack = np.zeros_like(row)
    for term in CATALOGUE[effect].terms_of(parameter):
        if term.on == VELOCITY and term.kind in (Kind.TIME, Kind.LAG):
            # the filter leaves out that a turn begins or ends meanwhile
            begins, _ = _swing_of("gnss_lever_arm", installed)
            row[:, 3:6] += (-1.0 if term.kind == Kind.LAG else term.weight) * begins
        if term.kind == Kind.SLIP:
            # the filter takes the acceleration of the IMU, not that of the point on the road
            for part in _swing_of("nhc_lever_arm", installed):
                slack[:, 6:] += 15.0 * np.linalg.norm(part, axis=1)[:, None]
    # a low-pass is a delay to first order only, and a car that leans slips a little downwards
    # too, which the filter leaves out
    rough = one_sided or effect == "vehicle_sideslip"
    assert np.all(np.abs(numeric - row) < (0.03 if rough else 0.01) * scale + slack)


def _swing_of(arm: str, installed: Values) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration [k, 3] NED of the end of an arm by the beginning of a turn, and by the turn."""
    drive, step = _drive(installed), 1e-3
    arm_m = np.array([installed.get(arm, {}).get(axis, 0.0) for axis in "xyz"])
    motion = drive.at(INSTANTS)
    change = drive.at(INSTANTS + step).turn_rate - drive.at(INSTANTS - step).turn_rate
    rate = motion.turn_rate
    parts = np.cross(change / (2.0 * step), arm_m), np.cross(rate, np.cross(rate, arm_m))
    return tuple(np.einsum("kij,kj->ki", motion.C_n_b, part) for part in parts)  # type: ignore[return-value]


@pytest.mark.parametrize("effect", ON_WHEELS)
def test_effects_on_the_vehicle_leave_the_fixes_of_the_imu_alone(
    effect: str, model: StateModel
) -> None:
    errors = {effect: {p.name: 0.01 for p in CATALOGUE[effect].parameters}}
    assert np.abs(_seen(errors, model).z[:, :6]).max() < 1e-6


def test_the_antenna_stays_on_the_vehicle_when_the_imu_is_turned(model: StateModel) -> None:
    """A lever arm is along the vehicle's axes, the filter's attitude is the sensor's."""
    errors: Values = {
        "imu_mounting": {"roll": 0.02, "pitch": -0.03, "yaw": 0.03},
        "gnss_lever_arm": {"x": 1.2, "y": 0.4, "z": -1.1},
    }
    seen = _seen(errors, model, told=errors)
    # m of the antenna; the mounting is a small angle to first order
    assert np.abs(seen.z[:, :3]).max() < 2e-3
    assert np.abs(seen.z[:, 3:6]).max() < 1e-3
    turned = dict(errors["imu_mounting"])
    for parameter in ("roll", "pitch", "yaw"):
        step = 1e-4
        ends = [
            _seen(
                errors,
                model,
                told={**errors, "imu_mounting": {**turned, parameter: turned[parameter] + moved}},
            ).z
            for moved in (step, -step)
        ]
        numeric = -(ends[0] - ends[1])[:, :6] / (2.0 * step)
        row = seen.h[:, :6, model.index(f"imu_mounting_{parameter}")]
        assert np.abs(row).max() > 0.1
        assert numeric == pytest.approx(row, abs=1e-6)


def test_data_are_older_than_their_tag() -> None:
    errors = {"gnss_latency": {"s": 0.1}, "gnss_velocity_latency": {"s": 0.05}}
    late = [distortion(errors, on, 2, lambda name: np.ones(2)).late for on in (POSITION, VELOCITY)]
    assert late[0] == pytest.approx([-0.1, -0.1])
    assert late[1] == pytest.approx([-0.15, -0.15])


def test_stamps_run_late_and_fast() -> None:
    errors = {"imu_time_offset": {"s": 0.02}, "imu_clock_skew": {"skew": 1e-4}}
    assert stamp_error_s(np.array([0.0, 100.0]), errors) == pytest.approx([0.02, 0.03])


def test_a_low_pass_follows_a_ramp_by_its_time_constant_and_damps_a_wave() -> None:
    step, tau = 0.01, 0.2
    t = np.arange(0.0, 20.0, step)
    ramp = low_pass(np.stack([3.0 + 2.0 * t, np.full_like(t, 5.0)], axis=1), step, tau)
    assert ramp[0] == pytest.approx([3.0, 5.0])
    assert ramp[500:, 0] == pytest.approx(3.0 + 2.0 * (t[500:] - tau))
    assert ramp[:, 1] == pytest.approx(5.0)
    w = 4.0
    wave = low_pass(np.sin(w * t)[:, None], step, tau)[500:, 0]
    gain = 1.0 / np.hypot(1.0, w * tau)
    assert wave == pytest.approx(gain * np.sin(w * t[500:] - np.arctan(w * tau)), abs=2e-4)
    assert low_pass(ramp, step, 0.0) == pytest.approx(ramp)


def test_outliers_are_as_many_and_as_far_as_said() -> None:
    rng = np.random.default_rng(3)
    off = np.linalg.norm(outliers(20_000, {"gnss_outliers": {"fraction": 0.05}}, rng), axis=1)
    assert (off > 0).mean() == pytest.approx(0.05, abs=0.006)
    assert off[off > 0] == pytest.approx(OUTLIER_M)
    assert not outliers(50, {}, rng).any()


def test_correlated_noise_takes_the_place_of_the_receivers_own() -> None:
    own = np.array([0.8, 0.8, 1.4])
    assert wander(own, 60.0, {})[0] is own
    sigma, tau = wander(own, 60.0, {"gnss_correlated_noise": {"sigma": 2.0, "tau": 20.0}})
    assert sigma == pytest.approx([2.0, 2.0, 2.0])
    assert tau == 20.0
    x = gauss_markov(200_000, sigma[:1], 0.2 / tau, np.random.default_rng(5))[:, 0]
    assert x.std() == pytest.approx(2.0, rel=0.07)
    assert np.corrcoef(x[:-100], x[100:])[0, 1] == pytest.approx(np.exp(-1.0), abs=0.06)


def test_values_that_are_not_given_change_nothing() -> None:
    assert noise_factor({}) == 1.0
    assert noise_factor({"gnss_noise_scale": {"factor": 1.8}}) == 1.8
    nothing = distortion({}, POSITION, 3, lambda name: np.ones(3))
    assert not nothing.added.any()
    assert not nothing.arm.any()
    assert sensor_to_vehicle({}) == pytest.approx(np.eye(3))
    assert parameters({"imu_mounting": {"yaw": 0.1}}, "imu_mounting") == pytest.approx([0, 0, 0.1])


def test_a_car_in_a_right_hand_bend_points_inwards() -> None:
    errors = {"vehicle_sideslip": {"coefficient": 0.01}}
    one = np.ones(1)
    assert nose_angles(errors, 10.0 * one, 0.0 * one, 2.0 * one, lambda name: one)[0, 2] == 0.02


def test_the_point_that_does_not_slide_stays_on_the_path() -> None:
    """With an axle behind the IMU, the IMU swings out and the axle does not."""
    axle = {"x": -1.4, "y": 0.1, "z": 0.4}
    with_axle, without = _drive({"nhc_lever_arm": axle}), _drive({})
    t = np.linspace(0.5, without.duration_s - 0.5, 300)
    imu, path = with_axle.at(t), without.at(t)
    ref = (float(path.lat_rad[0]), float(path.lon_rad[0]), float(path.height_m[0]))
    offset = imu.C_n_b @ np.array([axle[a] for a in "xyz"])
    at_axle = earth.local_ned(imu.lat_rad, imu.lon_rad, imu.height_m, ref) + offset
    on_path = earth.local_ned(path.lat_rad, path.lon_rad, path.height_m, ref)
    assert np.abs(at_axle - on_path).max() < 2e-3
    lateral = np.einsum("nj,nj->n", imu.C_n_b[:, :, 1], imu.vel_ned)
    assert np.abs(lateral).max() > 0.3
