"""Times of fixes that a program cut to whole seconds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.io.cut_times import uncut_times
from automap.io.fix_table import read_fix_table
from automap.io.table_form import TableForm
from automap.records import Fixes, FloatArray
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


def logged(rate: float) -> Fixes:
    fixes = receive(city_drive(120.0, 4), Receiver(rate=rate), 4)
    # receivers' epochs lie on whole steps
    return replace(fixes, gps_s=np.rint(fixes.gps_s[0]) + np.arange(len(fixes)) / rate)


def cut(fixes: Fixes, step: float = 1.0) -> Fixes:
    return replace(fixes, gps_s=np.floor(fixes.gps_s / step + 1e-6) * step)


@pytest.mark.parametrize("rate", [2.0, 5.0, 10.0])
def test_fixes_that_share_whole_seconds_are_spread_over_them(rate: float) -> None:
    fixes = logged(rate)
    part = replace(
        fixes, **{name: value[1:-1] for name, value in vars(fixes).items() if value is not None}
    )
    mended, said = uncut_times(cut(part))
    np.testing.assert_allclose(mended.gps_s, part.gps_s, atol=1e-6)
    assert said is not None
    assert f"cut to 1 s, and {rate:g} fixes share each" in said


@pytest.mark.parametrize("lost", [[], [-2], [-2, -3], [-2, -3, -12]])
def test_seconds_that_lack_a_fix_at_the_end_of_a_log_are_spread_too(lost: list[int]) -> None:
    fixes = logged(5.0)
    part = _rows(fixes, np.delete(np.arange(len(fixes)), lost))
    mended, said = uncut_times(cut(part))
    assert said is not None
    # what is lost of a second is not told: the others may be a fix early
    assert np.abs(mended.gps_s - part.gps_s).max() < 0.2 * max(len(lost), 1) + 1e-6


def _unchanged(fixes: Fixes) -> None:
    mended, said = uncut_times(fixes)
    np.testing.assert_array_equal(mended.gps_s, fixes.gps_s)
    assert said is None


def _rows(fixes: Fixes, rows: FloatArray) -> Fixes:
    return replace(
        fixes, **{name: value[rows] for name, value in vars(fixes).items() if value is not None}
    )


def test_rows_that_stand_twice_and_two_receivers_keep_their_times() -> None:
    fixes = logged(1.0)
    _unchanged(fixes)
    _unchanged(logged(5.0))
    twice = _rows(fixes, np.repeat(np.arange(len(fixes)), 2))
    _unchanged(twice)
    aside = twice.lat_rad + np.where(np.arange(len(twice)) % 2, 4.0 / 6.4e6, 0.0)
    _unchanged(replace(twice, lat_rad=aside))


@pytest.mark.parametrize("blank", [0, 7])
def test_rows_of_a_table_that_share_whole_seconds_are_no_held_fixes(
    blank: int, tmp_path: Path
) -> None:
    """Before the first fix there may be rows without a position."""
    fixes = logged(5.0)
    path = tmp_path / "fixes.csv"
    rows = zip(cut(fixes).gps_s, np.degrees(fixes.lat_rad), np.degrees(fixes.lon_rad), strict=True)
    none = "".join(f"{fixes.gps_s[0] - 9.0 + k // 5:.0f},,\n" for k in range(blank))
    lines = "".join(f"{t:.0f},{a:.8f},{o:.8f}\n" for t, a, o in rows)
    path.write_text("t_s,lat,lon\n" + none + lines)
    table = read_fix_table(path, TableForm(time_format="gps_s"))
    known = np.isfinite(table.fixes.lat_rad)
    np.testing.assert_allclose(table.fixes.gps_s[known], fixes.gps_s, atol=1e-6)
    assert table.held <= blank
    assert any("5 fixes share each" in text for text in table.warnings)


def test_a_vehicle_that_stands_tells_no_rate() -> None:
    fixes = cut(logged(5.0))
    _unchanged(replace(fixes, lat_rad=np.full(len(fixes), 0.5), lon_rad=np.full(len(fixes), 0.2)))
