"""What is to be expected of fixes where they err by more than elsewhere."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.doubts.larger_errors import LargerErrors, larger_errors
from automap.fusion.doubts.position_jump import Jump
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult
from automap.fusion.worse_stretches import WorseStretches
from automap.records import Fixes
from automap.sync.velocity_findings import Interval
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive
from tests.unit.test_fusion_verdict import consistency


def _fixes() -> Fixes:
    return receive(city_drive(60.0, 11), Receiver(), 13)


def _result(factor: float = 6.0, level: float = 1.0) -> tuple[Fixes, FusionResult]:
    """Fixes that err by so much more from 20 to 30 s."""
    fixes = _fixes()
    t = fixes.gps_s - GPS0
    there = (t >= 20.0) & (t < 30.0)
    worse = WorseStretches(factor, ((20.0, 30.0),), np.where(there, factor, 1.0))
    levels = dict.fromkeys(("wander", "multipath", "wander_v", "position_h", "position_v"), level)
    return fixes, cast(FusionResult, SimpleNamespace(worse=worse, noise_factors=levels))


def _larger(factor: float = 6.0, level: float = 1.0) -> LargerErrors:
    fixes, result = _result(factor, level)
    return larger_errors(fixes, result, FusionOptions())


def test_fixes_state_what_they_err_by_there_and_nothing_else_changes() -> None:
    fixes, result = _result()
    found = larger_errors(fixes, result, FusionOptions())
    plain = model_fixes(fixes, fixes.gps_s, FusionOptions())
    told = model_fixes(found.fixes, fixes.gps_s, FusionOptions())
    assert result.worse is not None
    there = result.worse.there
    assert told.stated_sd[there] == pytest.approx(6.0 * plain.stated_sd[there], rel=0.3)
    assert told.stated_sd[~there] == pytest.approx(plain.stated_sd[~there], rel=0.3)


def test_fixes_that_state_nothing_do_so_elsewhere() -> None:
    fixes, result = _result()
    silent = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), np.nan))
    stated = larger_errors(silent, result, FusionOptions()).fixes.sd_pos_ned
    assert result.worse is not None
    assert np.isfinite(stated[result.worse.there]).all()
    assert np.isnan(stated[~result.worse.there]).all()


def test_without_such_stretches_all_is_as_it_was() -> None:
    fixes = _fixes()
    result = cast(FusionResult, SimpleNamespace(worse=None))
    found = larger_errors(fixes, result, FusionOptions())
    assert found.fixes is fixes
    jump = Jump(GPS0 + 25.0, np.array([0.01, 0.0, 0.0]))
    assert found.unheld([jump]) == [jump]


@pytest.mark.parametrize("axes", [[0], [1], [0, 1], [2]])
@pytest.mark.parametrize("level", [0.5, 2.0])
def test_jumps_are_held_where_errors_are_as_large(axes: list[int], level: float) -> None:
    larger = _larger(level=level)
    by = np.zeros(3)
    by[axes] = larger.sd[:, axes].max() / np.sqrt(len(axes))
    # two errors of one sigma differ by this, and once in a million by six times as much
    assert larger.unheld([Jump(GPS0 + 25.0, by), Jump(GPS0 + 18.0, by)]) == []
    assert len(larger.unheld([Jump(GPS0 + 25.0, 20.0 * by)])) == 1
    assert len(larger.unheld([Jump(GPS0 + 50.0, by)])) == 1


def test_what_parts_there_is_no_contradiction_and_leaves_none_aside() -> None:
    larger = _larger()
    inside = Interval(GPS0 + 21.0, GPS0 + 24.0, float(larger.sd[:, 0].max()))
    outside = Interval(GPS0 + 45.0, GPS0 + 48.0, 12.0)
    aside = (Interval(GPS0, GPS0 + 60.0, 9.0),)
    both = consistency(parted=(inside, outside), aside=aside)
    assert larger.unheld_of(both).parted == (outside,)
    assert larger.unheld_of(both).aside == aside
    alone = replace(both, parted=(inside,))
    assert larger.unheld_of(alone).parted == ()
    assert larger.unheld_of(alone).aside == ()
