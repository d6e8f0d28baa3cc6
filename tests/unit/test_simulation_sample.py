"""The sample drive is what its scenario gives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.simulate.command import load_scenario
from pipeline.simulate.drive_writer import write_drive

PROJECT = Path(__file__).resolve().parents[2]
SAMPLE = PROJECT / "data" / "sample-drive"


@pytest.fixture(scope="module")
def again(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sample")
    scenario = load_scenario(PROJECT / "configs" / "scenarios" / "sample.toml")
    write_drive(scenario.model_copy(update={"camera": None}), folder)
    return folder


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("imu.csv", 2e-5), ("truth/trajectory.csv", 2e-4), ("gnss_arrival.csv", 2.0)],
)
def test_sensors_and_truth_come_out_again(again: Path, name: str, tolerance: float) -> None:
    ours = np.genfromtxt(again / name, delimiter=",", skip_header=1)
    theirs = np.genfromtxt(SAMPLE / name, delimiter=",", skip_header=1)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance)


def test_the_receiver_log_comes_out_again(again: Path) -> None:
    (log,) = (f.name for f in again.glob("gnss.*"))
    ours, theirs = (f.joinpath(log).read_bytes() for f in (again, SAMPLE))
    assert len(ours) == len(theirs)
    # a rounding that falls the other way changes a message's last digit and checksum
    different = sum(ours[i : i + 100] != theirs[i : i + 100] for i in range(0, len(ours), 100))
    assert different < 5


def test_the_signs_come_out_again(again: Path) -> None:
    ours, theirs = (
        json.loads((f / "truth" / "signs.geojson").read_text())["features"] for f in (again, SAMPLE)
    )
    assert len(ours) == len(theirs) == 18
    for a, b in zip(ours, theirs, strict=True):
        assert a["properties"]["class"] == b["properties"]["class"]
        np.testing.assert_allclose(
            a["geometry"]["coordinates"], b["geometry"]["coordinates"], rtol=0, atol=2e-3
        )
        np.testing.assert_allclose(
            a["geometry"]["coordinates"][:2], b["geometry"]["coordinates"][:2], rtol=0, atol=1e-8
        )


def test_it_is_small_enough_to_carry() -> None:
    size = sum(p.stat().st_size for p in SAMPLE.rglob("*") if "_automap" not in p.parts)
    assert size < 10e6
