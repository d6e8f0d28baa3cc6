"""The same drive gives the same answer: to the bit whatever was compiled before, and the same
names after a change of the readings in the twelfth digit."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from automap.gap import find_gaps
from tests.unit.test_gap import simulated

pytestmark = pytest.mark.slow

SEARCH = """
from hashlib import sha256
from automap.gap import find_gaps
from tests.unit.test_gap import simulated
result = find_gaps([simulated({"gyro_scale": {"z": 0.01}})])
bits = sha256()
for fit in result.held_out[1]:
    bits.update(fit.last.forward.store.nu.tobytes())
    bits.update(fit.last.smooth.nominal.tobytes())
print(bits.hexdigest(), [f.effect for f in result.findings])
"""


def searched(cache: Path) -> str:
    """Digest and names of a search in a process with this folder of compiled code."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", SEARCH],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
        cwd=Path(__file__).parents[2],
    )
    return done.stdout.strip()


def test_what_was_compiled_before_changes_no_bit(tmp_path: Path) -> None:
    compiled_now = searched(tmp_path)
    assert "gyro_scale" in compiled_now
    loaded = searched(tmp_path)
    assert loaded == compiled_now
    for index in sorted(tmp_path.rglob("*.nbi"))[::2]:
        index.unlink()
    assert searched(tmp_path) == compiled_now


@pytest.mark.parametrize("effect", ["gyro_scale", "gyro_misalignment", "accel_misalignment"])
def test_the_twelfth_digit_decides_nothing(effect: str) -> None:
    parameter = {"gyro_scale": "z", "gyro_misalignment": "xz", "accel_misalignment": "zy"}[effect]
    drive = simulated({effect: {parameter: 0.01}})
    imu = drive.imu
    moved = replace(
        drive,
        imu=replace(imu, gyro=imu.gyro * (1.0 + 1e-12), accel=imu.accel * (1.0 - 1e-12)),
    )
    names = [
        [f.effect for f in result.findings] + [u.formula for u in result.formulas]
        for result in (find_gaps([drive]), find_gaps([moved]))
    ]
    assert names[0] == names[1]
