"""A drive that looked nowhere has missed no sign."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from merge_folders import write_run
from merge_scene import Errors, drive_through, street

from automap.io import names
from automap.io.signs_table import write_signs
from automap.mapping.sightings import DriveSigns
from automap.mapping.visibility import DEFAULT_CAMERA
from pipeline.compare.command import compare_with_inventory
from pipeline.merge.cameras import cameras_of_run
from pipeline.merge.command import merge_runs
from pipeline.merge.inputs import read_run

PATH = np.array([[-1.5, -40.0], [-1.5, 340.0]])


def passes(count: int) -> list[DriveSigns]:
    """Drives through one short street, days apart."""
    rng = np.random.default_rng(11)
    town = street(rng, 300.0, 15.0)
    calm = Errors(clutter=0.0, missed=0.0, wrong_class=0.0)
    return [
        drive_through(rng, town, PATH, 12.0, f"d{number}", 1.45e9 + 86400.0 * number, calm, None)[0]
        for number in range(count)
    ]


def without_camera(folder: Path) -> Path:
    """A run as of a drive that has neither a video nor detections."""
    path = folder / names.RUN
    record = json.loads(path.read_text(encoding="utf-8"))
    record["stages"]["geolocate"]["manifest"] = {"name": "blind"}
    path.write_text(json.dumps(record), encoding="utf-8")
    write_signs(folder / names.SIGNS_RAW, [])
    return folder


def test_a_drive_without_a_camera_takes_no_belief_from_a_sign(tmp_path: Path) -> None:
    seeing, *others = passes(3)
    seen = write_run(tmp_path / "seen", seeing)
    blind = [without_camera(write_run(tmp_path / drive.name, drive)) for drive in others]
    alone = merge_runs([seen], tmp_path / "alone")
    both = merge_runs([seen, *blind], tmp_path / "both")
    assert len(both.signs) == len(alone.signs) > 3
    np.testing.assert_allclose(
        [s.existence for s in both.signs], [s.existence for s in alone.signs], rtol=1e-12
    )
    assert sum("neither signs nor a camera" in text for text in both.warnings) == 2


@pytest.mark.parametrize(
    ("manifest", "cameras"),
    [({"name": "a"}, ()), ({}, (DEFAULT_CAMERA,)), (None, (DEFAULT_CAMERA,))],
)
def test_a_run_that_does_not_say_has_a_usual_camera(
    manifest: dict[str, str] | None, cameras: tuple[object, ...], tmp_path: Path
) -> None:
    record = {"stages": {"geolocate": {"manifest": manifest}}}
    assert cameras_of_run(tmp_path, record) == cameras


def test_a_camera_whose_pictures_could_not_be_read_saw_nothing(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    folder = write_run(tmp_path / "run", passes(1)[0])
    pq.write_table(pa.table({"t_ns": pa.array([], pa.int64())}), folder / names.OBSERVATIONS)
    path = read_run(folder).signs.path
    assert path is not None
    assert np.isfinite(path.yaw_rad).all()
    pq.write_table(pa.table({"frame": pa.array([], pa.int64())}), folder / names.SEARCHED)
    path = read_run(folder).signs.path
    assert path is not None
    assert np.isnan(path.yaw_rad).all()


def test_what_of_a_run_cannot_be_read_is_told(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "run", passes(1)[0])
    assert not read_run(folder).warnings
    for name in (names.RUN, names.OBSERVATIONS):
        (folder / name).write_bytes(b'{"schema": "autom')
    record, boxes = read_run(folder).warnings
    assert names.RUN in record
    assert names.OBSERVATIONS in boxes


@pytest.mark.parametrize("merged", [False, True])
def test_nothing_is_missing_where_no_camera_looked(merged: bool, tmp_path: Path) -> None:
    drive = passes(1)[0]
    folder = without_camera(write_run(tmp_path / "blind", drive))
    if merged:
        folder = merge_runs([folder], tmp_path / "map").folder
    else:
        write_signs(folder / names.SIGNS_TABLE, [])
    places = zip(np.degrees(drive.lat_rad), np.degrees(drive.lon_rad), strict=True)
    rows = [f"{k},{lat:.8f},{lon:.8f}" for k, (lat, lon) in enumerate(places)]
    listed = tmp_path / "register.csv"
    listed.write_text("\n".join(["id,lat,lon", *rows]), encoding="utf-8")
    result = compare_with_inventory(folder, listed, tmp_path / "out")
    assert {row.kind for row in result.rows} == {"not_seen"}
    assert not any("coordinate system" in text for text in result.warnings)
