"""Room for the steps of integration between nodes."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.fusion.kernel_runs import empty_legs
from automap.fusion.kernels import Samples
from automap.fusion.kernels.integrate import GAP_STEP_S
from automap.records import FloatArray

GAP_S = 0.15


def steps_of(times: FloatArray, nodes: FloatArray) -> int:
    """How many steps the kernel takes: to the next sample or node, within a gap by its step; before
    the first sample and after the last it goes on as beside them."""
    i, count = 0, 0
    while i < len(times) - 2 and times[i + 1] <= nodes[0]:
        i += 1
    for t, end in zip(nodes[:-1].tolist(), nodes[1:].tolist(), strict=True):
        while t < end:
            after = end if times[i + 1] > end or i == len(times) - 2 else float(times[i + 1])
            if times[i + 1] - times[i] > GAP_S and after - t > GAP_STEP_S:
                after = t + GAP_STEP_S
            count += after > t
            t = after
            if i < len(times) - 2 and t >= times[i + 1]:
                i += 1
    return count


@pytest.mark.parametrize("seed", range(40))
def test_there_is_room_for_every_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 30))
    step = np.where(rng.random(n) < 0.2, rng.uniform(0.1, 1.0, n), rng.uniform(0.005, 0.02, n))
    # gaps at both ends, where nodes lie beyond the samples
    step[[1, -1]] = rng.choice([0.01, 0.7], 2)
    times = np.cumsum(step)
    beyond = rng.uniform(0.0, 0.14, 2)
    inner = rng.uniform(times[0], times[-1], int(rng.choice([0, 1, 40])))
    nodes = np.sort(np.concatenate([inner, [times[0] - beyond[0], times[-1] + beyond[1]]]))
    wide = np.zeros((len(times), 6))
    samples = Samples(times, wide, wide[:, :0], wide, wide[:, :2])
    problem: Any = SimpleNamespace(
        arrays=SimpleNamespace(longest_step=GAP_S), model=SimpleNamespace(size=20)
    )
    room = len(empty_legs(problem, samples, nodes, 1).dt)
    taken = steps_of(times, nodes)
    assert taken <= room <= taken + len(times) + 2 * len(nodes) + 60
