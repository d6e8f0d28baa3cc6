"""What ``automap check`` says of a receiver's velocities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.evaluation.plausibility import Finding
from automap.records import Fixes
from pipeline.check.velocity import check
from tests.unit.receiver_damage import derived, driving, held, redirected, scaled, shifted, zeroed
from tests.unit.receiver_scene import Receiver, simulated_fixes

LATE = Receiver(speed_lag_s=0.7, course_lag_s=0.6)


def by_severity(findings: list[Finding]) -> dict[str, list[str]]:
    return {
        severity: [finding.text for finding in findings if finding.severity == severity]
        for severity in ("ok", "info", "warning", "error")
    }


def test_a_sound_receiver_has_one_line() -> None:
    (finding,) = check(simulated_fixes(1, Receiver(), seconds=240.0))
    assert finding.severity == "ok"
    assert finding.text.startswith("velocities are 1.00")
    (late,) = check(simulated_fixes(1, LATE, seconds=400.0))
    assert late.severity == "info"
    assert "late" in late.text
    (too_late,) = check(simulated_fixes(1, replace(LATE, speed_lag_s=3.0), seconds=240.0))
    assert too_late.severity == "warning"
    (still,) = check(simulated_fixes(1, LATE, fast=0.0))
    assert (still.severity, "moves too little" in still.text) == ("info", True)


def test_ways_between_positions_are_told_in_the_place_of_their_lags() -> None:
    fixes = simulated_fixes(1, seconds=240.0)
    (finding,) = check(derived(fixes, "before"))
    assert (finding.severity, finding.code) == ("info", "velocity_of_positions")
    assert "from the row before to it" in finding.text
    assert "late" not in finding.text


def test_no_line_without_velocities() -> None:
    fixes = simulated_fixes(1, seconds=60.0)
    assert check(replace(fixes, vel_ned=np.full_like(fixes.vel_ned, np.nan))) == []


@pytest.mark.parametrize(
    ("damage", "severity", "said"),
    [
        (lambda f: scaled(f, 1.852), "warning", "km/h where knots belong"),
        (lambda f: scaled(f, 1.3), "warning", "no mistake of a unit explains"),
        (lambda f: redirected(f, [[-1, 0], [0, -1]]), "warning", "turned by 180 deg"),
        (lambda f: redirected(f, [[0, 1], [1, 0]]), "warning", "north and east are swapped"),
        (lambda f: redirected(f, [[1, 0], [0, -1]]), "error", "east is told as west"),
        (lambda f: scaled(f, 1.05), "warning", "velocities are 1.0"),
        (lambda f: redirected(f, [[0.94, 0.34], [-0.34, 0.94]]), "warning", "deg off"),
        (lambda f: held(f, driving(f, 20.0), "vel_ned"), "warning", "velocities repeat"),
        (lambda f: zeroed(f, driving(f, 20.0)), "warning", "velocities repeat"),
        (lambda f: held(f, driving(f, 20.0), "lat_rad", "lon_rad"), "warning", "positions repeat"),
        (
            lambda f: held(f, driving(f, 20.0), "lat_rad", "lon_rad", "vel_ned"),
            "warning",
            "positions and velocities repeat",
        ),
        (lambda f: shifted(f, f.gps_s > f.gps_s[50], 40.0), "info", "part by more"),
    ],
)
def test_damage_is_said(damage: Callable[[Fixes], Fixes], severity: str, said: str) -> None:
    findings = check(damage(simulated_fixes(4, Receiver(), seconds=240.0)))
    texts = by_severity(findings)
    assert any(said in text for text in texts[severity]), findings
    worse = {"error": (), "warning": ("error",), "info": ("error", "warning")}[severity]
    assert not any(texts[name] for name in worse)
    assert all(finding.advice for finding in findings if finding.severity != "ok")


def test_velocities_of_another_drive() -> None:
    fixes = simulated_fixes(4, Receiver(), seconds=240.0)
    other = simulated_fixes(104, Receiver(), seconds=240.0)
    (finding,) = check(replace(fixes, vel_ned=other.vel_ned))
    assert finding.severity == "error"
    assert "nothing in common" in finding.text


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(48.0, 11.0), (-33.5, -70.6), (60.0, 25.0), (51.5, 0.1)]
)
def test_swapped_coordinates_are_named(lat_deg: float, lon_deg: float) -> None:
    fixes = placed(simulated_fixes(1, Receiver(), seconds=240.0), lat_deg, lon_deg)
    assert {finding.severity for finding in check(fixes)} == {"ok"}
    swapped = replace(fixes, lat_rad=fixes.lon_rad, lon_rad=fixes.lat_rad)
    errors = [finding for finding in check(swapped) if finding.severity == "error"]
    assert [finding.code for finding in errors] == ["coordinates_swapped"]


def test_velocities_of_another_drive_are_no_swapped_coordinates() -> None:
    fixes = placed(simulated_fixes(1, Receiver(), seconds=240.0), 48.0, 11.0)
    alien = simulated_fixes(2, Receiver(), seconds=240.0)
    codes = [finding.code for finding in check(replace(fixes, vel_ned=alien.vel_ned))]
    assert "coordinates_swapped" not in codes


def placed(fixes: Fixes, lat_deg: float, lon_deg: float) -> Fixes:
    """The same drive, in metres, at another place."""
    lat0, lon0 = float(fixes.lat_rad[0]), float(fixes.lon_rad[0])
    lat, lon = np.radians([lat_deg, lon_deg])
    was = metres_per_radian(np.array([lat0]), np.zeros(1))
    now = metres_per_radian(np.array([lat]), np.zeros(1))
    return replace(
        fixes,
        lat_rad=lat + (fixes.lat_rad - lat0) * was[0] / now[0],
        lon_rad=lon + (fixes.lon_rad - lon0) * was[1] / now[1],
    )
