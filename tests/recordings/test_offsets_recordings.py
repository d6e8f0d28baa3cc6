"""Positions aside of their velocities: recorded receivers as they are, and with fixes moved."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from automap.fusion.verdict_alone import weigh_alone
from automap.io.drive import load_drive
from automap.io.receiver import read_receiver_log
from automap.records import ClockModel, Fixes
from automap.sync.velocity_consistency import velocity_consistency
from pipeline.run.fusion_inputs import own_velocities, usable_fixes
from tests.slow_cases import others_slow
from tests.unit.fusion_receiver import GPS0
from tests.unit.test_fusion_offsets import (
    OPTIONS,
    every_second,
    older,
    second_half,
    throughout,
)

CODES = ("fixes_alternate", "positions_shift", "positions_beside")
OTHERS = ("positions_jump", "age_changes")


def told(shared_data: Path, name: str, spoil: Callable[[Fixes], Fixes]) -> list[str]:
    folder = shared_data / "drives" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    file = load_drive(folder).gnss_file
    assert file is not None
    fixes = spoil(read_receiver_log(file).fixes)
    found = velocity_consistency(fixes)
    fixes = own_velocities(usable_fixes(fixes, found), found)
    clock = ClockModel(0, float(np.nanmin(fixes.gps_s)), 0.0, 1e-4, 1e-9, "identity")
    reasons = weigh_alone(fixes, clock, OPTIONS, found).verdict.reasons
    return [reason.code for reason in reasons if reason.code in CODES + OTHERS]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("gsdc-mtv1", []),
        ("gsdc-mtv1-xl", []),
        ("balzer-car", []),
        ("kitti-20110926-0101", []),
        ("kitti-20111003-0034", []),
        ("rtk-car-a", []),
        # its last quarter minute lies 11 m aside of the minute before, by the car's own positions
        ("iphone-austin", ["positions_shift"]),
    ],
)
def test_recorded_receivers_are_not_accused(
    shared_data: Path, name: str, expected: list[str]
) -> None:
    assert told(shared_data, name, lambda fixes: fixes) == expected


@pytest.mark.parametrize("name", others_slow(["kitti-20110930-0020", "gsdc-mtv1", "gsdc-mtv1-xl"]))
@pytest.mark.parametrize(
    ("spoil", "code"),
    list(zip((every_second, second_half, throughout), CODES, strict=True)),
)
def test_what_lies_aside_is_told(
    shared_data: Path, name: str, spoil: Callable[[Fixes], Fixes], code: str
) -> None:
    assert told(shared_data, name, spoil) == [code]


def test_another_antenna_of_a_fixed_receiver_is_told_without_velocities(shared_data: Path) -> None:
    """Its velocities are the ways between positions, and left out."""
    assert told(shared_data, "rtk-car-a", second_half) == ["positions_jump", "positions_shift"]


@pytest.mark.parametrize("name", others_slow(["kitti-20110930-0020", "gsdc-mtv1", "gsdc-mtv1-xl"]))
def test_fixes_that_become_older_part_way_are_told(shared_data: Path, name: str) -> None:
    def half(fixes: Fixes) -> Fixes:
        return older(fixes, float(np.nanmedian(fixes.gps_s)) - GPS0, 0.4)

    assert told(shared_data, name, half) == ["age_changes"]
