"""A process that compiles, one that finds everything compiled, and one that finds every second
function compiled give the same bits: merging, calibration, and a whole run of the sample drive.
The gap finder and the fusion under it have ``test_gap_same_answer.py``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PROJECT = Path(__file__).resolve().parents[2]
MERGING = """
from hashlib import sha256
import numpy as np
from automap.mapping.merge import merge_drives
from tests.unit.merge_scene import street_scene
bits = sha256()
merged = merge_drives(street_scene(7, 12, length_m=600.0).drives)
for sign in merged.signs:
    bits.update(repr(sign).encode())
print(len(merged.signs), bits.hexdigest())
"""
CALIBRATION = """
from hashlib import sha256
import numpy as np
from automap.calibration.dynamic import calibrate_dynamic
from automap.calibration.static import calibrate_static
from tests.unit.calibration_scene import GRAVITY, random_errors, random_poses, recorded
from tests.unit.calibration_scene import turned_by_hand
bits = sha256()
rng = np.random.default_rng(3)
log = recorded(rng, turned_by_hand(rng, random_poses(rng, 16)), random_errors(rng))
static = calibrate_static([log], GRAVITY)
for array in (static.accel.covariance, static.gyro.covariance, static.gyro.matrix):
    bits.update(array.tobytes())
dynamic = calibrate_dynamic(log, log.gyro, log.accel, GRAVITY)
bits.update(dynamic.final.tobytes() + dynamic.sd.tobytes())
print(static.gyro.scale, bits.hexdigest())
"""
RUN = """
from hashlib import sha256
from pathlib import Path
import sys, tempfile
from pipeline.cli.root import run_command
# a run says when it was and how long it took, in these alone
TOLD = {"run.json", "automap.log", "report.html", ".digests.json"}
with tempfile.TemporaryDirectory() as out:
    assert run_command(["run", "data/sample-drive", "-o", out, "--quiet"]) == 0
    for path in sorted(Path(out).rglob("*")):
        if path.is_file() and path.name not in TOLD:
            print(path.name, sha256(path.read_bytes()).hexdigest())
"""


def printed(code: str, cache: Path) -> str:
    """What a process prints that has this folder of compiled code."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-c", code]
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=PROJECT, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("code", [MERGING, CALIBRATION, RUN], ids=["merge", "calibrate", "run"])
def test_what_was_compiled_before_changes_no_bit(tmp_path: Path, code: str) -> None:
    compiled_now = printed(code, tmp_path)
    assert compiled_now
    assert printed(code, tmp_path) == compiled_now
    for first in (0, 1):
        for index in sorted(tmp_path.rglob("*.nbi"))[first::2]:
            index.unlink()
        assert printed(code, tmp_path) == compiled_now
