"""Errors of recorded phones on simulated drives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from automap.io.truth_trajectory import read_truth_trajectory
from automap.simulation.sensors import random_streams, simulate_sensors
from pipeline.simulate.command import load_scenario
from pipeline.simulate.replay import recorded_errors
from tests.benchmarks.receivers import LAGS_S, figures, simulated

TOWN = Path(__file__).resolve().parents[2] / "configs" / "scenarios" / "town.toml"


@pytest.mark.parametrize(
    ("name", "horizontal", "speed_delay", "course_delay"),
    [("gsdc-mtv1", 1.03, 0.26, 0.62), ("gsdc-mtv1-xl", 2.14, 0.66, 0.32)],
)
def test_a_phones_errors_and_delays(
    shared_data: Path, name: str, horizontal: float, speed_delay: float, course_delay: float
) -> None:
    drive = shared_data / "drives" / name
    errors = recorded_errors(drive)
    level = np.sqrt(np.mean(np.sum(errors.position[:, :2] ** 2, axis=1)))
    assert level == pytest.approx(horizontal, abs=0.02)
    assert errors.speed_delay_s == pytest.approx(speed_delay, abs=0.05)
    assert errors.course_delay_s == pytest.approx(course_delay, abs=0.05)
    # no vertical velocity
    assert np.isnan(errors.velocity[:, 2]).all()
    scenario = load_scenario(TOWN, "phone", drive)
    sensors = simulate_sensors(scenario, random_streams(3), recorded=errors)
    assert sensors.fixes is not None
    assert sensors.replayed is not None
    t = np.arange(len(sensors.fixes.gps_s)) + sensors.replayed.start_s
    known = errors.gps_s - errors.gps_s[0]
    truth = sensors.drive.at(sensors.fixes.gps_s - sensors.begin_gps_s)
    # the scenario's antenna stands 1.2 m above the IMU
    up = sensors.fixes.height_m - truth.height_m - 1.2
    assert up == pytest.approx(-np.interp(t, known, errors.position[:, 2]), abs=0.1)


@pytest.mark.slow
def test_the_simulated_phone_errs_like_recorded_ones(shared_data: Path) -> None:
    """Between the two, or by no more beyond them than two phones differ."""
    drives = [shared_data / "drives" / name for name in ("gsdc-mtv1", "gsdc-mtv1-xl")]
    truth = read_truth_trajectory(drives[0] / "truth" / "trajectory.csv")
    real = [figures(recorded_errors(d), truth) for d in drives]
    made = simulated("phone", truth, 4)
    sizes = np.array([f.rms for f in real])
    # north and east are one kind of error, along and across another
    for kind in (slice(0, 2), slice(2, 3), slice(3, 5)):
        size = np.sqrt(np.mean(made.rms[kind] ** 2))
        assert sizes[:, kind].min() < size < 1.4 * sizes[:, kind].max()
        remembered = made.correlation[kind].mean(axis=0)
        recorded = np.array([f.correlation[kind] for f in real]).reshape(-1, len(LAGS_S))
        assert (remembered > recorded.min(axis=0) - 0.1).all()
        assert (remembered < recorded.max(axis=0) + 0.1).all()
    for i in range(2):
        late = [f.delays[i] for f in real]
        assert min(late) - 0.1 < made.delays[i] < max(late) + 0.1
