"""Freed arrays of a long drive go back to the system."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import sys
import numpy as np
from pipeline.shared.freed import give_freed_back

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

# after the first large array is freed such ones are kept
del (first := [np.ones(3_900_000)])[:]
if len(sys.argv) == 1:
    give_freed_back()
held, between = [], []
for _ in range(25):
    held.append(np.ones(800_000))
    # a small one beside each, which nothing can move
    between.append(bytes(2000))
before = resident()
del held
print(before - resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_freed_arrays_go_back_to_the_system() -> None:
    given, kept = (
        float(
            subprocess.run(
                [sys.executable, "-c", CODE, *words], capture_output=True, text=True, check=True,
                cwd=Path(__file__).parents[2],
            ).stdout
        )
        for words in ([], ["as it is"])
    )  # fmt: skip
    assert given > 150.0
    assert given >= kept
