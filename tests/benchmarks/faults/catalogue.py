"""All faults, and the drive as it is."""

from __future__ import annotations

import numpy as np

from tests.benchmarks.faults import (
    axes_faults,
    imu_faults,
    log_faults,
    position_faults,
    velocity_faults,
)
from tests.benchmarks.faults.fault import Fault, Stretch, whole
from tests.benchmarks.faults.recording import Recording

CONTROL = "none"


def _nothing(recording: Recording, _: np.random.Generator) -> Stretch:
    return whole(recording)


FAULTS: dict[str, Fault] = {
    fault.name: fault
    for fault in (
        Fault(CONTROL, "nothing: the drive as it is", _nothing, ()),
        *velocity_faults.FAULTS,
        *position_faults.FAULTS,
        *log_faults.FAULTS,
        *imu_faults.FAULTS,
        *axes_faults.FAULTS,
    )
}


def put(fault: Fault, recording: Recording) -> Stretch:
    """Put a fault into a recording; the same draw at every call."""
    seed = sum(ord(letter) * 31**k for k, letter in enumerate(fault.name)) % 2**32
    return fault.put(recording, np.random.default_rng(seed))
