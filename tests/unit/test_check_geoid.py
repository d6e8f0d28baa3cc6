"""The sign of a receiver's separation of the geoid, against a coarse geoid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from input_drive import write_drive

from automap.geoid import geoid_height
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.records import Fixes
from pipeline.check import geoid
from pipeline.check.judge import judge
from tests.unit.receiver_scene import simulated_fixes

# EGM96 by NGA's calculator
PLACES = [
    (38.6281550, 269.7791550, -31.6),
    (-14.6212170, 305.0211140, -3.0),
    (46.8743190, 102.4487290, -43.6),
    (-23.6174460, 133.8747120, 15.9),
    (38.6254730, 359.9995000, 50.1),
]


def at(lat_deg: float, lon_deg: float, separation_m: float) -> Fixes:
    fixes = simulated_fixes(1, seconds=20.0)
    lat, lon, separation = (
        np.full(len(fixes), value)
        for value in (np.radians(lat_deg), np.radians(lon_deg), separation_m)
    )
    return replace(fixes, lat_rad=lat, lon_rad=lon, geoid_sep_m=separation)


@pytest.mark.parametrize(("lat", "lon", "height"), PLACES)
def test_the_geoid_is_good_to_some_metres(lat: float, lon: float, height: float) -> None:
    assert geoid_height(lat, lon) == pytest.approx(height, abs=6.0)
    assert geoid_height(lat, lon - 360.0) == pytest.approx(geoid_height(lat, lon))


def test_the_geoid_reaches_around_the_earth() -> None:
    assert geoid_height(90.0, 77.0) == pytest.approx(14.0)
    assert geoid_height(-90.0, -180.0) == pytest.approx(-30.0, abs=1.0)
    assert geoid_height(10.0, 180.0) == geoid_height(10.0, -180.0)


FAR = [place for place in PLACES if abs(place[2]) > 15.0]


@pytest.mark.parametrize(("lat", "lon", "height"), FAR)
def test_a_turned_sign_is_an_error(lat: float, lon: float, height: float) -> None:
    assert geoid.check(at(lat, lon, height)) == []
    (finding,) = geoid.check(at(lat, lon, -height))
    assert (finding.severity, finding.code) == ("error", "geoid_sign")
    assert "wrong sign" in finding.text


@pytest.mark.parametrize(
    ("lat", "lon", "separation"),
    [
        (-14.62, 305.02, -3.0),  # too near the ellipsoid to tell
        (-14.62, 305.02, 3.0),
        (-35.28, 149.13, 19.4),
        (49.0, 8.4, 19.4),
        (49.0, 8.4, np.nan),
    ],
)
def test_what_cannot_be_told_is_not(lat: float, lon: float, separation: float) -> None:
    assert geoid.check(at(lat, lon, separation)) == []


@pytest.mark.parametrize(("accept", "severity"), [("", "error"), ("geoid_sign", "warning")])
def test_a_drive_stops_for_it_unless_accepted(tmp_path: Path, accept: str, severity: str) -> None:
    folder = write_drive(tmp_path / "drive")
    if accept:
        manifest = folder / "drive.toml"
        manifest.write_text(f'accept = ["{accept}"]\n{manifest.read_text()}')
    drive = load_drive(folder)
    recording = read_recording(drive)
    assert recording.fixes is not None
    lat, lon, height = PLACES[2]
    fixes = at(lat, lon, -height)
    found = judge(drive, replace(recording, fixes=fixes)).found
    (finding,) = [item.finding for item in found if item.finding.code == "geoid_sign"]
    assert finding.severity == severity


def test_heights_of_which_nothing_tells_above_what_they_are_are_told() -> None:
    """A receiver that states no separation says of heights either the one or the other; where one
    of them would be below the sea they are the other."""
    europe = at(50.0, 8.0, 0.0)
    high = replace(europe, height_m=np.full(len(europe), 120.0))
    (finding,) = geoid.check(high)
    assert (finding.severity, finding.code) == ("warning", "height_surface")
    # above the ellipsoid this is under water, so that it is not
    low = replace(europe, height_m=np.full(len(europe), 5.0))
    assert [finding.code for finding in geoid.check(low)] == ["height_surface"]
    assert geoid.check(replace(high, geoid_sep_m=np.full(len(high), 48.0))) == []
    assert geoid.check(replace(high, geoid_sep_m=np.full(len(high), np.nan))) == []
    coast = at(37.4, -122.1, 0.0)
    assert geoid.check(replace(coast, height_m=np.full(len(coast), -31.0))) == []
