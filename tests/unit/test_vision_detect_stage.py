"""From video, images or an external table to detections."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from automap.errors import InputError
from automap.io import names
from automap.io.detections_table import read_detections, write_detections
from automap.io.drive import load_drive
from automap.io.video import FrameTimes
from automap.records import Detections
from automap.vision.faces import draw_face
from automap.vision.search import choose_frames
from pipeline.config import Settings
from pipeline.detect import detect_to_csv
from pipeline.stage import StageContext
from pipeline.stages.detect import STAGE

STOP = "regulatory--stop--g1"


def picture(shift: int = 0) -> np.ndarray:
    image = np.full((180, 240, 3), 130, np.uint8)
    face = draw_face(STOP, 48).astype(float)
    cover = face[:, :, 3:] / 255.0
    x = 90 + shift
    part = image[60:108, x : x + 48]
    part[:] = (part * (1 - cover) + face[:, :, :3] * cover).astype(np.uint8)
    return image


def video(path: Path, frames: int = 6) -> None:
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = 240, 180, "yuv420p"
        stream.options = {"crf": "15"}
        for i in range(frames):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(4 * i), "bgr24")))
        container.mux(stream.encode())


def drive(folder: Path, section: str = "") -> Path:
    folder.mkdir(exist_ok=True)
    manifest = f'schema = "automap.drive/1"\nname = "d"\n{section}'
    (folder / "drive.toml").write_text(manifest)
    (folder / "imu.csv").write_text("t_ns,gx,gy,gz,ax,ay,az\n")
    return folder


def run(folder: Path, tmp_path: Path, **settings: float) -> StageContext:
    (tmp_path / "work").mkdir()
    context = StageContext(
        drive=load_drive(folder),
        out=tmp_path / "out",
        work=tmp_path / "work",
        settings=Settings.model_validate({"detect": settings}),
    )
    STAGE.run(context)
    return context


def test_the_video_is_searched(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["video/front.mp4"]\nstart_ns = 500\n')
    video(folder / "video" / "front.mp4")
    context = run(folder, tmp_path)
    found = read_detections(context.work / names.DETECTIONS)["front"]
    assert found.frame.tolist() == list(range(6))
    assert set(found.class_name) == {STOP}
    np.testing.assert_allclose(np.diff(found.t_ns), 1e8, atol=1)
    assert found.t_ns[0] == 500
    np.testing.assert_allclose(np.diff(found.box[:, 0]), 4.0, atol=0.1)
    assert (found.track == -1).all()
    assert context.metrics["n_detections"] == 6
    assert folder / "video" / "front.mp4" in STAGE.inputs(load_drive(folder))


def test_fewer_frames_and_higher_scores_are_settings(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["video/front.mp4"]\nstart_ns = 0\n')
    video(folder / "video" / "front.mp4")
    context = run(folder, tmp_path, frames_per_s=5.0, min_score=0.2)
    assert read_detections(context.work / names.DETECTIONS)["front"].frame.tolist() == [0, 2, 4]


def test_an_external_detector_wins_over_the_video(tmp_path: Path) -> None:
    folder = drive(
        tmp_path / "d",
        '[video.front]\nframes = "f.csv"\ndetections = "b.csv"\nwidth = 240\nheight = 180\n',
    )
    (folder / "f.csv").write_text("frame,t_ns\n0,100\n1,200\n")
    (folder / "b.csv").write_text(
        "frame,class,x_min,y_min,x_max,y_max,score\n1,mine,10,20,30,50,0.5\n7,lost,1,2,3,4,0.5\n"
    )
    context = run(folder, tmp_path)
    found = read_detections(context.work / names.DETECTIONS)["front"]
    assert found.class_name.tolist() == ["mine"]
    assert found.t_ns.tolist() == [200]
    assert any("without a stamp" in text for text in context.warnings)


def test_without_video_the_table_is_empty_and_says_so(tmp_path: Path) -> None:
    context = run(drive(tmp_path / "d"), tmp_path)
    assert read_detections(context.work / names.DETECTIONS) == {}
    assert any("no signs are found" in text for text in context.warnings)


@pytest.mark.parametrize("content", [b"", b"this is no video at all"])
def test_a_broken_video_is_a_warning(tmp_path: Path, content: bytes) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["front.mp4"]\nstart_ns = 0\n')
    (folder / "front.mp4").write_bytes(content)
    context = run(folder, tmp_path)
    assert sum(map(len, read_detections(context.work / names.DETECTIONS).values())) == 0
    assert any("front.mp4" in text for text in context.warnings)


def test_a_truncated_video_gives_what_can_be_read(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["front.ts"]\nstart_ns = 0\n')
    video(folder / "front.ts", frames=20)
    whole = (folder / "front.ts").read_bytes()
    (folder / "front.ts").write_bytes(whole[: len(whole) // 2])
    context = run(folder, tmp_path)
    found = read_detections(context.work / names.DETECTIONS)["front"]
    assert 3 <= len(found) < 20


def test_tables_survive_writing_and_reading(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    cameras = [
        Detections(
            frame=np.arange(n),
            t_ns=np.arange(n) * 10**8 + 2**60,
            class_name=np.array([f"c{i % 2}" for i in range(n)], dtype=object),
            box=rng.random((n, 4)),
            score=rng.random(n),
            track=np.arange(n) - 1,
            camera=name,
        )
        for n, name in ((4, "front"), (3, "rear"))
    ]
    write_detections(tmp_path / "d.parquet", cameras)
    read = read_detections(tmp_path / "d.parquet")
    assert list(read) == ["front", "rear"]
    for camera in cameras:
        for field in ("frame", "t_ns", "class_name", "box", "score", "track"):
            np.testing.assert_array_equal(getattr(read[camera.camera], field),
                                          getattr(camera, field))  # fmt: skip


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.parquet"):
        read_detections(tmp_path / "nowhere.parquet")


@pytest.mark.parametrize(
    ("rate", "per_second", "expected"), [(10, 10, 100), (30, 10, 100), (10, 3, 30), (5, 10, 50)]
)
def test_frames_are_chosen_evenly_in_time(rate: int, per_second: float, expected: int) -> None:
    rng = np.random.default_rng(rate)
    t = np.arange(10 * rate) / rate + rng.normal(0, 0.03 / rate, 10 * rate)
    times = FrameTimes(np.arange(10 * rate), np.rint(t * 1e9).astype(np.int64))
    chosen = choose_frames(times, per_second)
    assert len(chosen) == pytest.approx(expected, rel=0.12)
    assert np.diff(t[chosen]).max() < 2.2 * max(1 / rate, 1 / per_second)


def test_images_become_a_table(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    cv2.imwrite(str(folder / "b.png"), picture())
    cv2.imwrite(str(folder / "a.jpg"), np.full((50, 60, 3), 128, np.uint8))
    (folder / "c.png").write_bytes(b"broken")
    (folder / "notes.txt").write_text("no image")
    warnings: list[str] = []
    count = detect_to_csv(folder, tmp_path / "out.csv", warn=warnings.append)
    with (tmp_path / "out.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert count == len(rows) == 1
    assert rows[0]["image"] == "b.png"
    assert rows[0]["class"] == STOP
    assert float(rows[0]["x_min"]) == pytest.approx(89.5, abs=0.3)
    assert len(warnings) == 1
    assert "c.png" in warnings[0]


def test_a_video_and_a_drive_give_the_same_boxes(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["front.mp4"]\nstart_ns = 0\n')
    video(folder / "front.mp4", frames=3)
    detect_to_csv(folder, tmp_path / "drive.csv")
    detect_to_csv(folder / "front.mp4", tmp_path / "video.csv")
    text = (tmp_path / "drive.csv").read_text()
    assert text == (tmp_path / "video.csv").read_text()
    assert text.startswith("frame,class,x_min,y_min,x_max,y_max,score\n")
    assert len(text.splitlines()) == 4


def test_nothing_to_search_is_an_error(tmp_path: Path) -> None:
    for source, said in ((tmp_path / "nowhere", "is missing"), (tmp_path, "neither")):
        with pytest.raises(InputError, match=said):
            detect_to_csv(source, tmp_path / "out.csv")
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"bad\.mp4"):
        detect_to_csv(tmp_path / "bad.mp4", tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()
