"""The computation that times are measured in, and the clock they are measured with."""

from __future__ import annotations

import os

import numpy as np


def processor_seconds() -> float:
    """Processor time of this process and of its children that have ended, s.

    Unlike the clock on the wall it hardly depends on what else the machine does.
    """
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def reference_seconds() -> float:
    """Processor time of a fixed piece of work, s.

    Interpreter, sorting, Fourier transform and small matrices, as the stages mix them; a tenth
    of a second. A stage's time in this unit is a property of the code more than of the machine,
    also of a machine whose caches others fill: they slow both.
    """
    random = np.random.default_rng(1)
    started = processor_seconds()
    total = 0
    for i in range(400_000):
        total += i * i % 7
    values = random.standard_normal(400_000)
    for _ in range(3):
        np.sort(values)
        np.abs(np.fft.rfft(values[: 1 << 18])).sum()
    blocks = values[: 9 * 20_000].reshape(-1, 3, 3)
    for _ in range(3):
        np.einsum("nij,njk->nik", blocks, blocks)
    return max(processor_seconds() - started, 1e-3)
