"""The geolocate stage and its tables: what goes in, what comes out, what may be missing."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from geolocation_scene import ORIGIN, boxes, camera, drive_path, roadside

from automap.earth import from_local_ned
from automap.errors import InputError
from automap.io import names
from automap.io.camera_turns import read_camera_turns, write_camera_turns
from automap.io.detections_table import write_detections
from automap.io.drive import load_drive
from automap.io.signs_table import read_signs, write_signs
from automap.io.trajectory_table import read_trajectory, write_trajectory
from automap.records import Detections, PictureTurns, Sign
from pipeline.run.stage import StageContext
from pipeline.run.stages.geolocate import STAGE
from pipeline.settings.load import load_settings
from tests.slow_cases import others_slow

MANIFEST = """
schema = "automap.drive/1"
name = "loop"
[video.front]
width = 1280
height = 720
camera_matrix = [[1000.0, 0.0, 640.0], [0.0, 1000.0, 360.0], [0.0, 0.0, 1.0]]
lever_arm_m = [1.4, 0.1, -0.6]
mount_rpy_deg = [0.5, -1.0, 2.0]
mount_rpy_sigma_deg = 0.2
time_offset_sigma_s = 0.005
"""


@pytest.fixture
def context(tmp_path: Path) -> StageContext:
    drive = tmp_path / "drive"
    out, work = tmp_path / "out", tmp_path / "work"
    for folder in (drive, out, work):
        folder.mkdir()
    (drive / "drive.toml").write_text(MANIFEST)
    (drive / names.FINISHED_TRAJECTORIES[0]).write_text("t_ns,lat_deg,lon_deg,height_m\n")
    return StageContext(load_drive(drive), out, work, load_settings())


def seen(camera_name: str = "front") -> Detections:
    path = drive_path(duration_s=14.0)
    found, _ = boxes(path, roadside(path), camera(), np.random.default_rng(0))
    return replace(found, camera=camera_name)


def test_signs_and_observations(context: StageContext) -> None:
    found = seen()
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [found])
    STAGE.run(context)
    signs = read_signs(context.work / names.SIGNS_RAW)
    table = pq.read_table(context.work / names.OBSERVATIONS)
    assert [s.id for s in signs] == ["s0001", "s0002"]
    assert signs[0].drives == ("loop",)
    assert len(table) == len(found)
    ids = table["sign_id"].to_pylist()
    for sign in signs:
        assert {ids[row] for row in sign.detection_rows} == {sign.id}
        assert sign.n_views == len(sign.detection_rows)
        assert 0.9 < sign.existence <= 1.0
    assert context.metrics["detections_used"] == table["used"].to_pylist().count(True)
    assert "2 signs" in context.result


def test_frames_outside_the_drive_are_the_result(context: StageContext) -> None:
    found = seen()
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    later = replace(found, t_ns=found.t_ns + 200_000_000_000)
    write_detections(context.out / names.DETECTIONS, [later])
    STAGE.run(context)
    n = len(found)
    assert context.result == (
        f"0 signs from {n} detections; all of them are of no sign: {n} lie outside the trajectory "
        "or in a long gap of it"
    )


@pytest.mark.slow
def test_signs_are_unsure_along_a_road_that_is_dated_by_fixes_of_unknown_age(
    context: StageContext,
) -> None:
    """A tenth of a second at 12 m/s; a bend of one rate tells stamps from turns not at all."""
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [seen()])
    variance = []
    for age_sd in (0.0, 0.1):
        (context.out / names.FUSION).write_text(json.dumps({"age_sd_s": age_sd}))
        STAGE.run(context)
        first = read_signs(context.work / names.SIGNS_RAW)[0]
        variance.append(float(np.trace(first.cov_enu[:2, :2])))
    assert variance[1] - variance[0] == pytest.approx(1.2**2, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("picture", others_slow(["mirrored", "", "upside down"]))
def test_boxes_are_taken_as_the_bends_of_their_video_say(
    context: StageContext, picture: str
) -> None:
    """Stamps 0.7 s late and a turned picture: two signs tell nothing of either."""
    found = seen()
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [found])
    STAGE.run(context)
    right = read_signs(context.work / names.SIGNS_RAW)
    left, top, right_px, low = found.box.T
    box = found.box
    if picture:
        box = np.column_stack([1279 - right_px, top, 1279 - left, low])
    if picture == "upside down":
        box = box[:, [0, 3, 2, 1]] * [1, -1, 1, -1] + [0, 719, 0, 719]
    late = replace(found, t_ns=found.t_ns + 700_000_000, box=box)
    write_detections(context.out / names.DETECTIONS, [late])
    told = PictureTurns(4, int(found.t_ns[0]), -0.7, 0.03, 0.0, (picture,) if picture else ())
    write_camera_turns(context.out / names.CAMERA_TURNS, {"front": told})
    STAGE.run(context)
    signs = read_signs(context.work / names.SIGNS_RAW)
    assert len(signs) == len(right)
    for one, other in zip(signs, right, strict=True):
        assert abs(one.lat_rad - other.lat_rad) * 6.4e6 < 0.5
        assert abs(one.lon_rad - other.lon_rad) * 6.4e6 < 0.5


def test_what_bends_say_survives_writing_and_reading(tmp_path: Path) -> None:
    turns = {"front": PictureTurns(3, 2**60, -0.7, 0.03, 0.01, ("mirrored",)), "b": PictureTurns(0)}
    turns["c"] = PictureTurns(2, 0, -0.4, 0.03, allowed=True)
    write_camera_turns(tmp_path / "t.json", turns)
    assert read_camera_turns(tmp_path / "t.json") == turns
    (tmp_path / "t.json").write_text('{"front": {"bends": 1, "at_ns": 0, "offset_s": NaN}}')
    with pytest.raises(InputError, match="damaged"):
        read_camera_turns(tmp_path / "t.json")


@pytest.mark.slow
def test_heights_above_the_road_are_as_well_known_as_the_imus_above_it(
    context: StageContext, tmp_path: Path
) -> None:
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [seen()])
    STAGE.run(context)
    assumed = read_signs(context.work / names.SIGNS_RAW)
    (said,) = (text for text in context.warnings if "above the road" in text)
    assert "[vehicle]" in said
    folder = tmp_path / "measured"
    shutil.copytree(context.drive.path, folder)
    section = "[vehicle]\nimu_above_road_m = 1.65\nimu_above_road_sigma_m = 0.02\n"
    (folder / "drive.toml").write_text(MANIFEST + section)
    work = tmp_path / "work-measured"
    work.mkdir()
    told = StageContext(load_drive(folder), context.out, work, load_settings())
    STAGE.run(told)
    assert not any("above the road" in text for text in told.warnings)
    for before, after in zip(assumed, read_signs(work / names.SIGNS_RAW), strict=True):
        assert after.height_above_road_m - before.height_above_road_m == pytest.approx(0.65)
        shown = after.sd_above_road_m**2 - 0.02**2
        assert 0.0 < shown < before.cov_enu[2, 2]
        assert before.sd_above_road_m**2 == pytest.approx(shown + 0.4**2)


@pytest.mark.slow
def test_a_cameras_place_that_is_measured_makes_heights_surer(
    context: StageContext, tmp_path: Path
) -> None:
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [seen()])
    shown = {}
    for sigma in ("", "lever_arm_sigma_m = 0.02\n"):
        folder, work = tmp_path / f"drive{len(shown)}", tmp_path / f"work{len(shown)}"
        shutil.copytree(context.drive.path, folder)
        work.mkdir()
        text = MANIFEST.replace("mount_rpy_sigma_deg", sigma + "mount_rpy_sigma_deg")
        text += "[vehicle]\nimu_above_road_m = 1.0\nimu_above_road_sigma_m = 0.0\n"
        (folder / "drive.toml").write_text(text)
        STAGE.run(StageContext(load_drive(folder), context.out, work, load_settings()))
        shown[sigma] = [s.sd_above_road_m for s in read_signs(work / names.SIGNS_RAW)]
    for loose, tight in zip(*shown.values(), strict=True):
        assert loose**2 - tight**2 == pytest.approx(0.3**2 - 0.02**2, rel=0.1)


def test_detections_of_an_unknown_camera_are_listed_but_not_used(context: StageContext) -> None:
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    write_detections(context.out / names.DETECTIONS, [seen("rear"), seen()])
    STAGE.run(context)
    table = pq.read_table(context.work / names.OBSERVATIONS).to_pydict()
    rear = [k for k, name in enumerate(table["camera"]) if name == "rear"]
    assert {table["note"][k] for k in rear} == {"no_camera"}
    assert any("[video.rear]" in text for text in context.warnings)
    for sign in read_signs(context.work / names.SIGNS_RAW):
        assert not set(sign.detection_rows.tolist()) & set(rear)


@pytest.mark.parametrize("missing", ["detections", "trajectory", "boxes"])
def test_without_something_the_map_is_empty_and_says_so(
    context: StageContext, missing: str
) -> None:
    found = seen()
    if missing == "boxes":
        found = replace(
            found,
            **{n: getattr(found, n)[:0] for n in ("frame", "t_ns", "class_name", "score", "track")},
            box=np.zeros((0, 4)),
        )
    if missing != "trajectory":
        write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    if missing != "detections":
        write_detections(context.out / names.DETECTIONS, [found])
    STAGE.run(context)
    assert read_signs(context.work / names.SIGNS_RAW) == []
    if missing != "boxes":
        assert context.warnings


def test_a_damaged_table_is_one_sentence(context: StageContext) -> None:
    write_trajectory(context.out / names.TRAJECTORY, drive_path(duration_s=14.0))
    (context.out / names.DETECTIONS).write_bytes(b"PAR1 nothing")
    with pytest.raises(InputError, match=r"detections\.parquet"):
        STAGE.run(context)


def test_a_drive_of_sightings(tmp_path: Path) -> None:
    drive, out = tmp_path / "sightings", tmp_path / "out"
    drive.mkdir()
    out.mkdir()
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
    lamp = np.array([20.0, 8.0])
    cameras = np.array([[0.0, 0.0], [10.0, 0.0], [30.0, 0.0]])
    lat, lon, _ = from_local_ned(np.column_stack([cameras, np.zeros(3)]), (*ORIGIN[:2], 0.0))
    bearing = np.degrees(np.arctan2(lamp[1] - cameras[:, 1], lamp[0] - cameras[:, 0]))
    rows = zip(np.degrees(lat), np.degrees(lon), bearing, strict=True)
    (drive / names.BEARINGS).write_text(
        "lat_deg,lon_deg,bearing_deg\n" + "".join(f"{a:.9f},{b:.9f},{c:.6f}\n" for a, b, c in rows)
    )
    context = StageContext(load_drive(drive), out, out, load_settings())
    STAGE.run(context)
    (sign,) = read_signs(out / names.SIGNS_RAW)
    want = from_local_ned(np.array([*lamp, 0.0]), (*ORIGIN[:2], 0.0))
    assert sign.lat_rad == pytest.approx(float(want[0]), abs=1e-7)
    assert sign.lon_rad == pytest.approx(float(want[1]), abs=1e-7)
    assert pq.read_table(out / names.OBSERVATIONS)["sign_id"].to_pylist() == ["s0001"] * 3


def test_signs_survive_the_table(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 3))
    sign = Sign(
        *("s0001", "regulatory--stop--g1", -0.6, 2.6, float("nan"), A @ A.T, 0.9, 3, -5, 7),
        *(2.5, 1.0, 0.7, "overhead", "weak_geometry", ("a", "b"), np.array([4, 9, 11])),
    )
    write_signs(tmp_path / "signs.parquet", [sign])
    (back,) = read_signs(tmp_path / "signs.parquet")
    for name in Sign.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back, name), getattr(sign, name))


@pytest.mark.parametrize("content", [None, b"", b"no parquet"])
def test_unreadable_signs_are_one_sentence(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "signs.parquet"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"signs\.parquet"):
        read_signs(path)


@pytest.mark.slow
def test_control_signs_of_the_folder_adjust_the_trajectory(context: StageContext) -> None:
    path = drive_path(duration_s=14.0, sd_m=2.0)
    scene = roadside(path)
    lat, lon, _ = from_local_ned(scene.position + np.array([1.5, 0.0, 0.0]), ORIGIN)
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [float(x), float(y)]},
            "properties": {"sd_m": 0.02},
        }
        for x, y in zip(np.degrees(lon), np.degrees(lat), strict=True)
    ]
    text = json.dumps({"type": "FeatureCollection", "features": features})
    (context.drive.path / names.CONTROL_SIGNS).write_text(text)
    assert context.drive.path / names.CONTROL_SIGNS in STAGE.inputs(context.drive)
    write_trajectory(context.out / names.TRAJECTORY, path)
    write_detections(context.out / names.DETECTIONS, [seen()])
    STAGE.run(context)
    adjusted = read_trajectory(context.work / names.TRAJECTORY_ADJUSTED)
    north = (adjusted.lat_rad - path.lat_rad) * 6.36e6
    assert np.median(north) == pytest.approx(1.5, abs=0.6)
    assert adjusted.sd_pos_ned[:, 0].mean() < 1.5
