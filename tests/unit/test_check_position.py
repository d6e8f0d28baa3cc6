"""Where on Earth the fixes are, and when; positions that are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from input_drive import write_drive

from automap.evaluation.plausibility import Finding
from automap.io.drive import load_drive
from automap.io.recording import read_recording, without_placeholders
from automap.records import Fixes, FixType
from automap.timebase import gps_to_unix
from pipeline.check.command import check_drive
from pipeline.check.position import boxes, check, inside
from tests.unit.receiver_scene import simulated_fixes


def at(lat_deg: float, lon_deg: float) -> Fixes:
    fixes = simulated_fixes(1, seconds=20.0)
    n = len(fixes)
    return replace(
        fixes, lat_rad=np.full(n, np.radians(lat_deg)), lon_rad=np.full(n, np.radians(lon_deg))
    )


CITIES = [
    ("DE", 49.0, 8.4),
    ("GB", 51.5, -0.1),
    ("US", 37.4, -122.1),
    ("us", 30.3, -97.7),
    ("AU", -27.5, 153.0),
    ("NZ", -41.3, 174.8),
    ("FR", 42.1, 9.4),
    ("NO", 69.6, 18.9),
]


@pytest.mark.parametrize(("country", "lat", "lon"), CITIES)
def test_a_city_is_in_its_country(country: str, lat: float, lon: float) -> None:
    assert check(at(lat, lon), country, None) == []


@pytest.mark.parametrize(
    ("country", "lat", "lon", "said"),
    [
        ("DE", 8.4, 49.0, "latitude and longitude are swapped"),
        ("DE", -49.0, 8.4, "north and south are swapped"),
        ("DE", 49.0, -8.4, "east and west are swapped"),
        ("AU", 27.5, 153.0, "north and south are swapped"),
        ("US", 37.4, 122.1, "east and west are swapped"),
        ("US", -37.4, 122.1, "both signs are turned"),
        ("DE", 35.0, 139.0, "correct country"),
    ],
)
def test_a_place_in_another_country_is_an_error(
    country: str, lat: float, lon: float, said: str
) -> None:
    (finding,) = check(at(lat, lon), country, None)
    assert (finding.severity, finding.code) == ("error", "wrong_country")
    assert said in finding.advice


def test_countries_that_are_not_known_are_not_judged() -> None:
    assert check(at(49.0, 8.4), None, None) == []
    assert check(at(49.0, 8.4), "XX", None) == []
    assert len(boxes()) > 170
    assert not inside(0.0, 0.0, "DE")


def test_a_log_of_the_future_is_told() -> None:
    fixes = at(49.0, 8.4)
    written = float(gps_to_unix(np.median(fixes.gps_s)))
    assert check(fixes, None, written) == []
    finding: Finding
    (finding,) = check(fixes, None, written - 1024 * 7 * 86400.0)
    assert (finding.severity, finding.code) == ("warning", "date_ahead")
    assert "7168 days after" in finding.text


def test_dates_of_a_past_era_are_told() -> None:
    fixes = at(49.0, 8.4)
    written = float(gps_to_unix(np.median(fixes.gps_s))) + 1024 * 7 * 86400.0
    (finding,) = check(fixes, None, written + 3 * 86400.0)
    assert (finding.severity, finding.code) == ("warning", "date_rolled_over")
    # a log of years ago is one
    for years in (-1, 1):
        assert check(fixes, None, written + years * 365 * 86400.0) == []


@pytest.mark.parametrize("place", [(0.0, 0.0), (90.0, 11.0), (-90.0, 0.0)])
def test_placeholders_are_no_fixes(place: tuple[float, float]) -> None:
    fixes = simulated_fixes(1, seconds=20.0)
    lat, lon = fixes.lat_rad.copy(), fixes.lon_rad.copy()
    lat[3:5], lon[3:5] = np.radians(place)
    told: list[str] = []
    clean = without_placeholders(replace(fixes, lat_rad=lat, lon_rad=lon), "log", told)
    assert np.flatnonzero(clean.fix_type == FixType.NONE).tolist() == [3, 4]
    assert np.isnan(clean.lat_rad[3:5]).all()
    assert "2 positions" in told[0]
    same = without_placeholders(fixes, "log", told)
    assert same is fixes


def test_positions_typed_in_by_hand_are_accepted_by_name(tmp_path: Path) -> None:
    drive = write_drive(tmp_path / "d")
    log = drive / "gnss.nmea"
    lines = []
    for line in log.read_text().splitlines():
        fields = line.split("*")[0].split(",")
        if "GGA" in fields[0]:
            fields[6] = "7"
        body = ",".join(fields)[1:]
        total = 0
        for character in body.encode():
            total ^= character
        lines.append(f"${body}*{total:02X}\r\n")
    log.write_text("".join(lines), newline="")
    report = check_drive(drive)
    (wrong,) = [f for f in report.findings if f.severity == "error"]
    assert wrong.code == "gnss_quality"
    assert 'accept = ["gnss_quality"]' in wrong.advice
    manifest = drive / "drive.toml"
    manifest.write_text('accept = ["gnss_quality"]\n' + manifest.read_text())
    assert check_drive(drive).usable
    recording = read_recording(load_drive(drive))
    assert recording.fixes is not None
    assert (recording.fixes.fix_type == FixType.THREE_D).all()
    assert any("are used" in text for text in recording.warnings)


def test_a_dilution_that_stands_for_none_is_unknown() -> None:
    fixes = simulated_fixes(1, seconds=20.0)
    told: list[str] = []
    clean = without_placeholders(replace(fixes, hdop=np.full(len(fixes), 99.99)), "log", told)
    assert np.isnan(clean.hdop).all()
    assert told == [
        "log: HDOP is 99.99 or more throughout, as receivers write where they compute none; it is "
        "taken as unknown"
    ]
    # the most that is written, for a moment, is a bad fix
    hdop = np.where(np.arange(len(fixes)) < 3, 99.99, 1.0)
    np.testing.assert_array_equal(
        without_placeholders(replace(fixes, hdop=hdop), "log", told).hdop, hdop
    )
    assert len(told) == 1


@pytest.mark.parametrize(
    ("parts", "said"),
    [(1e4, "steps of 11.1 m, with 4 decimals of a degree"),
     (6e3, "steps of 18.5 m, with 2 decimals of a minute"), (1e5, None), (1e7, None), (6e5, None)],
)  # fmt: skip
def test_coarse_positions_are_told(parts: float, said: str | None) -> None:
    """Where the step is far above a receiver's errors: four decimals of a minute are usual."""
    fixes = at(49.0, 8.4)
    way = np.linspace(0.0, 4e-3, len(fixes))
    cut = [np.radians(np.rint((each + way) * parts) / parts) for each in (49.0, 8.4)]
    fixes = replace(fixes, lat_rad=cut[0], lon_rad=cut[1])
    told = [finding.text for finding in check(fixes, None, None)]
    assert (told == []) if said is None else (said in told[0])
