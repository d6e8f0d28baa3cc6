"""Importing finished sightings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.bearings_csv import read_bearings
from automap.io.drive import load_drive
from pipeline.importers.bearings import import_bearings


def test_other_names_and_the_truth(tmp_path: Path) -> None:
    source, known = tmp_path / "seen.csv", tmp_path / "known.csv"
    source.write_text("lat,lng,azimuth,distance,label\n51.5,-0.1,15,5.6,lamp\n51.5,-0.1,160,0,\n")
    known.write_text("lon,lat\n-0.14,51.51\n")
    out = tmp_path / "drive"
    assert import_bearings(source, out, known, 0.5) == []
    drive = load_drive(out)
    assert drive.bearings_file is not None
    rays, _ = read_bearings(drive.bearings_file)
    assert np.degrees(rays.bearing_rad) == pytest.approx([15.0, 160.0])
    assert rays.depth_m[0] == pytest.approx(5.6)
    assert np.isnan(rays.depth_m[1])
    assert rays.class_name.tolist() == ["lamp", ""]
    (feature,) = json.loads((out / "truth/signs.geojson").read_text())["features"]
    assert feature["geometry"]["coordinates"] == [-0.14, 51.51]
    assert feature["properties"]["sd_m"] == 0.5


def test_rows_without_a_place_are_counted(tmp_path: Path) -> None:
    source = tmp_path / "seen.csv"
    source.write_text("lat,lon,bearing\n95,0,10\n51,0,20\n")
    (text,) = import_bearings(source, tmp_path / "drive")
    assert "1 of 2 sightings" in text
    assert "line 2" in text


@pytest.mark.parametrize("text", ["", "lat,lon\n1,2\n", "lat,lon,bearing\n151,2,3\n"])
def test_an_unusable_table_is_one_sentence(tmp_path: Path, text: str) -> None:
    source = tmp_path / "seen.csv"
    source.write_text(text)
    with pytest.raises(InputError, match=r"seen\.csv"):
        import_bearings(source, tmp_path / "drive")
    assert not (tmp_path / "drive").exists()
