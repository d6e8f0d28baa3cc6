"""Arrays of a long drive take what is in them, and go back to the system when they are freed."""

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


SPARSE = """
import pipeline.cli.root
import numpy as np

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6

before = resident()
room = np.empty(8_000_000)
# a number in each page of 2 MB
room[:: 1 << 18] = 1.0
print(resident() - before)
"""
HUGE_PAGES = Path("/sys/kernel/mm/transparent_hugepage/enabled")


@pytest.mark.skipif(
    not HUGE_PAGES.is_file() or "[madvise]" not in HUGE_PAGES.read_text(),
    reason="this system has no huge pages, or gives them unasked",
)
def test_an_array_takes_no_more_than_what_was_written_into_it() -> None:
    found = subprocess.run(
        [sys.executable, "-c", SPARSE], capture_output=True, text=True, check=True,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert float(found.stdout) < 8.0
