"""``automap run --only fuse --tune`` finds the noise levels of a drive and says so."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from automap.fusion.options import FusionOptions
from automap.io import names
from automap.io.tables import floats, read_table
from automap.simulation.scenario import Gnss, Imu
from pipeline.cli.root import run_command
from pipeline.simulate.drive_writer import write_drive
from tests.slow.test_effect_recovery import _scenario

pytestmark = pytest.mark.slow

OFF = 3.0
"""How far all levels lie from what the settings and the receiver say."""
DEFAULT = FusionOptions()
STATED = Gnss()
FIGURE = float(np.hypot(STATED.sigma_correlated_m[0], STATED.sigma_white_m[0]))
EXPECTED = {
    "accel": OFF,
    "gyro": OFF,
    "position_h": OFF * STATED.sigma_white_m[0] / (DEFAULT.white_share * FIGURE),
    "position_v": OFF * STATED.sigma_white_m[0] / (DEFAULT.white_share * FIGURE),
    "velocity_h": OFF,
    "velocity_v": OFF,
    "wander": OFF * STATED.sigma_correlated_m[0] / FIGURE,
    "accel_bias_walk": OFF,
    "gyro_bias_walk": OFF,
}
WITHIN = {"accel_bias_walk": 2.1, "gyro_bias_walk": 2.1, "accel": 1.6}
"""The rest 1.5. Ten minutes hold only so many independent stretches of a random walk, and the
accelerometer's noise hides below that of the receiver's velocity."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The drive fused with the settings as they are, and tuned."""
    folder = tmp_path_factory.mktemp("tuning")
    short = _scenario(
        {
            "accel_bias_walk": dict.fromkeys("xyz", OFF * DEFAULT.accel_bias_walk),
            "gyro_bias_walk": dict.fromkeys("xyz", OFF * DEFAULT.gyro_bias_walk),
            "gnss_noise_scale": {"factor": OFF},
        },
        roughness_deg=0.12,
    )
    scenario = short.model_copy(
        update={
            "route": short.route.model_copy(update={"legs": short.route.legs * 4}),
            "imu": Imu(gyro_noise=OFF * DEFAULT.gyro_noise, accel_noise=OFF * DEFAULT.accel_noise),
        }
    )
    drive = folder / "drive"
    drive.mkdir()
    write_drive(scenario, drive, 3)
    out = {name: folder / name for name in ("plain", "tuned")}
    plain = ["run", str(drive), "-o", str(out["plain"]), "--to", "fuse"]
    assert run_command([*plain, "--set", "fuse.adapt=false"]) == 0
    tuned = ["run", str(drive), "-o", str(out["tuned"])]
    assert run_command([*tuned, "--to", "sync"]) == 0
    assert run_command([*tuned, "--only", "fuse", "--tune"]) == 0
    return out


def _read(out: Path, name: str) -> dict[str, Any]:
    return dict(json.loads((out / name).read_text()))


def _log_likelihood(out: Path) -> float:
    """Of the receiver's measurements; what the vehicle is assumed to do is none."""
    table = read_table(out / names.INNOVATIONS)
    kinds = np.array(table["channel"].to_pylist())
    measured = np.char.startswith(kinds, "position") | np.char.startswith(kinds, "velocity")
    nu, sd = floats(table, "innovation")[measured], floats(table, "sd")[measured]
    return float(-0.5 * np.sum((nu / sd) ** 2 + 2.0 * np.log(sd)))


def _levels() -> list[Any]:
    """Walks of the biases stay the setting's: what tuning finds beside them on five minutes, sizes
    and times of the receiver's lasting errors, explains the other five worse (by 16 nats where the
    levels of a plain run are found on the same five), though the walks alone are found well."""
    walks = pytest.mark.xfail(reason="tuning of ten minutes is given up as a whole")
    return [pytest.param(k, marks=walks if k.endswith("_walk") else ()) for k in EXPECTED]


@pytest.mark.parametrize("level", _levels())
def test_the_levels_are_found(level: str, runs: dict[str, Path]) -> None:
    found = tomllib.loads((runs["tuned"] / names.TUNED).read_text())["fuse"]["factors"]
    allowed = WITHIN.get(level, 1.5)
    assert EXPECTED[level] / allowed < found[level] < EXPECTED[level] * allowed


def test_the_measurements_become_more_likely(runs: dict[str, Path]) -> None:
    assert _log_likelihood(runs["tuned"]) > _log_likelihood(runs["plain"]) + 100.0


def test_the_path_is_as_sure_as_it_says_only_when_tuned(runs: dict[str, Path]) -> None:
    for name, honest in (("plain", False), ("tuned", True)):
        metrics = _read(runs[name], names.RUN)["metrics"]
        sizes = [v for k, v in metrics["innovations_rms"].items() if k.startswith(("pos", "vel"))]
        assert (min(sizes) > 0.8 and max(sizes) < 1.25) == honest
        whiteness = metrics["innovations_lag1"]
        assert set(whiteness) == set(metrics["innovations_rms"])


def test_the_report_says_what_was_found(runs: dict[str, Path]) -> None:
    from pipeline.report.fusion_section import fusion_section
    from pipeline.shared.products import RunProducts

    section = fusion_section(RunProducts(runs["tuned"]))
    text = " ".join([*section.sentences, *(words for _, words in section.verdicts)])
    assert "slow error of GPS positions" in text


def test_the_tuned_file_serves_other_runs(runs: dict[str, Path], tmp_path: Path) -> None:
    words = ["run", str(runs["tuned"].parent / "drive"), "-o", str(tmp_path / "again")]
    config = str(runs["tuned"] / names.TUNED)
    assert run_command([*words, "--to", "fuse", "--config", config]) == 0
    again = _read(tmp_path / "again", names.FUSION)["noise_factors"]
    assert again == pytest.approx(_read(runs["tuned"], names.FUSION)["noise_factors"], rel=1e-5)
