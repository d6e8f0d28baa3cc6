"""From video, images or an external table to detections."""

from __future__ import annotations

import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from automap.errors import InputError
from automap.io import names
from automap.io.crops_table import read_crops, write_crops
from automap.io.detections_csv import read_detections_csv
from automap.io.detections_table import read_detections, write_detections
from automap.io.drive import load_drive
from automap.io.searched_table import read_searched
from automap.records import TRACK_PROBABILITIES, Detections, FrameTimes, Image
from automap.signs.faces import draw_face
from automap.vision.detector import FoundSigns
from automap.vision.voting import View, pooling, vote
from pipeline.detect.command import detect_to_csv
from pipeline.run.runner import Request, run_drive
from pipeline.run.stage import StageContext
from pipeline.run.stages.detect import STAGE
from pipeline.settings.detect import DetectSettings
from pipeline.settings.load import Settings

STOP = "regulatory--stop--g1"


class RedFinder:
    """Stands in for the trained detector: every red patch is a stop sign."""

    name = "red"

    def detect(self, image: Image) -> FoundSigns:
        blue, green, red = (image[:, :, i].astype(int) for i in range(3))
        mask = ((red - np.maximum(blue, green)) > 60).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(mask)
        boxes = [
            (x - 0.5, y - 0.5, x + w - 0.5, y + h - 0.5) for x, y, w, h, n in stats[1:] if n > 99
        ]
        n = len(boxes)
        return FoundSigns((STOP,) * n, np.array(boxes, float).reshape(-1, 4), np.full(n, 0.9))


@pytest.fixture(autouse=True)
def _red_finder(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("pipeline.detect.command", "pipeline.run.stages.detect"):
        monkeypatch.setattr(f"{module}.open_detector", lambda settings, country: RedFinder())


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


def run(folder: Path, tmp_path: Path, **settings: object) -> StageContext:
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
    context = run(folder, tmp_path, every_frame=True)
    found = read_detections(context.work / names.DETECTIONS)["front"]
    assert found.frame.tolist() == list(range(6))
    assert set(found.class_name) == {STOP}
    assert found.view_class is not None
    assert set(found.view_class) == {STOP}
    np.testing.assert_allclose(np.diff(found.t_ns), 1e8, atol=1)
    assert found.t_ns[0] == 500
    looked = read_searched(context.work / names.SEARCHED)["front"]
    assert looked.frame.tolist() == list(range(6))
    assert looked.region.shape == (6, 4)
    assert looked.region[0].tolist()[::2] == [0.0, 240.0]
    # its letters are as white as a picture can be
    assert found.contrast is not None
    assert found.contrast_note is not None
    assert np.isnan(found.contrast).all()
    assert set(found.contrast_note) == {"too bright"}
    np.testing.assert_allclose(np.diff(found.box[:, 0]), 4.0, atol=1.0)
    assert found.box[-1, 0] - found.box[0, 0] == pytest.approx(20.0, abs=1.0)
    assert (found.track == 0).all()
    assert context.metrics["n_detections"] == 6
    assert context.metrics["n_tracks"] == 1
    (crop,) = read_crops(context.work / names.CROPS)
    assert crop.class_name == STOP
    assert crop.jpeg[:2] == b"\xff\xd8"
    sheet = cv2.imread(str(context.work / names.CONTACT_SHEET))
    assert sheet is not None
    assert folder / "video" / "front.mp4" in STAGE.inputs(load_drive(folder))


def test_fewer_frames_and_higher_scores_are_settings(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["video/front.mp4"]\nstart_ns = 0\n')
    video(folder / "video" / "front.mp4")
    context = run(folder, tmp_path, frames_per_s=5.0, min_score=0.2)
    assert read_detections(context.work / names.DETECTIONS)["front"].frame.tolist() == [0, 2, 4]
    assert context.metrics["n_frames_searched"] == 3
    assert len(read_searched(context.work / names.SEARCHED)["front"]) == 3


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


@pytest.mark.parametrize(
    ("own", "tracks"), [("", [0, 1, 0, 1, 1, -1]), (",7", [7] * 6), (",-1", [0, 1, 0, 1, 1, -1])]
)
def test_boxes_without_tracks_get_some(own: str, tracks: list[int], tmp_path: Path) -> None:
    folder = drive(
        tmp_path / "d",
        '[video.front]\nframes = "f.csv"\ndetections = "b.csv"\nwidth = 240\nheight = 180\n'
        "camera_matrix = [[200.0, 0.0, 120.0], [0.0, 200.0, 90.0], [0.0, 0.0, 1.0]]\n",
    )
    (folder / "f.csv").write_text("frame,t_ns\n" + "".join(f"{k},{k}00000000\n" for k in range(4)))
    rows = ["0,a,10,20,30,40,0.5", "0,a,150,20,180,50,0.5", "1,a,10,20,30,40,0.5"]
    rows += ["1,a,150,20,180,50,0.5", "2,a,150,20,180,50,0.5", "3,a,60,120,70,130,0.5"]
    head = "frame,class,x_min,y_min,x_max,y_max,score" + (",track" if own else "")
    (folder / "b.csv").write_text("\n".join([head, *(row + own for row in rows), ""]))
    context = run(folder, tmp_path)
    found = read_detections(context.work / names.DETECTIONS)["front"]
    assert found.track.tolist() == tracks


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
    context = run(folder, tmp_path, every_frame=True)
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
            view_class=np.array([f"v{i % 3}" for i in range(n)], dtype=object),
        )
        for n, name in ((4, "front"), (3, "rear"))
    ]
    write_detections(tmp_path / "d.parquet", cameras)
    read = read_detections(tmp_path / "d.parquet")
    assert list(read) == ["front", "rear"]
    for camera in cameras:
        for field in ("frame", "t_ns", "class_name", "view_class", "box", "score", "track"):
            np.testing.assert_array_equal(getattr(read[camera.camera], field),
                                          getattr(camera, field))  # fmt: skip


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.parquet"):
        read_detections(tmp_path / "nowhere.parquet")


def test_images_become_a_table(tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    cv2.imwrite(str(folder / "b.png"), picture())
    cv2.imwrite(str(folder / "a.jpg"), np.full((50, 60, 3), 128, np.uint8))
    (folder / "c.png").write_bytes(b"broken")
    (folder / "notes.txt").write_text("no image")
    warnings: list[str] = []
    outcome = detect_to_csv(folder, tmp_path / "out.csv", warn=warnings.append, annotate=True)
    with (tmp_path / "out.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert outcome.boxes == len(rows) == 1
    assert (outcome.searched, outcome.frames) == (2, 3)
    assert sorted(path.name for path in outcome.files) == [
        "out.csv", "out_annotated", "out_signs.jpg",
    ]  # fmt: skip
    assert [path.name for path in (tmp_path / "out_annotated").iterdir()] == ["b.jpg"]
    assert rows[0]["image"] == "b.png"
    assert rows[0]["class"] == STOP
    assert float(rows[0]["x_min"]) == pytest.approx(89.5, abs=2.0)
    assert len(warnings) == 1
    assert "c.png" in warnings[0]


def test_a_video_and_a_drive_give_the_same_boxes(tmp_path: Path) -> None:
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["front.mp4"]\nstart_ns = 0\n')
    video(folder / "front.mp4", frames=3)
    every = DetectSettings(every_frame=True)
    detect_to_csv(folder, tmp_path / "drive.csv", settings=every)
    detect_to_csv(folder / "front.mp4", tmp_path / "video.csv", settings=every)
    text = (tmp_path / "drive.csv").read_text()
    assert text == (tmp_path / "video.csv").read_text()
    assert text.startswith("frame,class,x_min,y_min,x_max,y_max,score,track,view_class,"
                           "class_probability,group_probability\n")  # fmt: skip
    assert len(text.splitlines()) == 4
    # nobody fitted how sure a detector of the user's own is
    assert all(line.endswith(f",{STOP},,") for line in text.splitlines()[1:])


def test_what_is_told_of_a_track_comes_back_from_its_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = "regulatory--no-entry--g1"

    class Fitted(RedFinder):
        country = None

        def detect(self, image: Image) -> FoundSigns:
            found = super().detect(image)
            return replace(found, alternatives=(((STOP, 0.9), (other, 0.1)),) * len(found))

    for module in ("pipeline.detect.command", "pipeline.run.stages.detect"):
        monkeypatch.setattr(f"{module}.open_detector", lambda *_: Fitted())
    video(tmp_path / "front.mp4", frames=3)
    detect_to_csv(
        tmp_path / "front.mp4", tmp_path / "out.csv", settings=DetectSettings(every_frame=True)
    )
    told = vote([View(((STOP, 0.9), (other, 0.1)), 48.0)] * 3, pooling(None))
    frames = np.arange(3, dtype=np.int64)
    found = read_detections_csv(tmp_path / "out.csv", FrameTimes(frames, frames * 100)).data
    assert set(found.class_name) == {STOP}
    assert found.told("class_probability") == pytest.approx(told.probability, abs=1e-3)
    assert found.told("group_probability") == pytest.approx(told.group_probability, abs=1e-3)
    write_detections(tmp_path / "out.parquet", [found])
    again = read_detections(tmp_path / "out.parquet")["front"]
    for name in TRACK_PROBABILITIES:
        assert np.array_equal(again.told(name), found.told(name))
    # what the views give to each class only the table of a run keeps
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["front.mp4"]\nstart_ns = 500\n')
    (tmp_path / "front.mp4").rename(folder / "front.mp4")
    context = run(folder, tmp_path, every_frame=True)
    kept = read_detections(context.work / names.DETECTIONS)["front"].class_shares
    assert kept is not None
    assert set(kept) == {f"{STOP} 0.900; {other} 0.100"}


def test_the_annotated_video_shows_every_frame(tmp_path: Path) -> None:
    import av

    video(tmp_path / "front.mp4")
    outcome = detect_to_csv(tmp_path / "front.mp4", tmp_path / "out.csv", annotate=True)
    assert outcome.tracks == 1
    with av.open(str(tmp_path / "out_annotated.mp4")) as container:
        pictures = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    assert len(pictures) == 6
    for number, shown in enumerate(pictures):
        changed = np.abs(shown.astype(int) - picture(4 * number)).max(axis=2) > 60
        rows, columns = np.nonzero(changed)
        # the frame and the label around the sign, and nothing far from it
        assert len(rows) > 50
        assert columns.min() > 80 + 4 * number
        assert rows.max() < 120


def test_half_an_image_is_searched_with_a_warning(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.jpg"), picture())
    whole = (tmp_path / "a.jpg").read_bytes()
    (tmp_path / "b.jpg").write_bytes(whole[: len(whole) * 2 // 3])
    warnings: list[str] = []
    outcome = detect_to_csv(tmp_path, tmp_path / "out.csv", warn=warnings.append)
    assert outcome.searched == 2
    assert len(warnings) == 1
    assert "b.jpg ends in the middle" in warnings[0]


def test_images_that_are_all_broken_are_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"broken")
    with pytest.raises(InputError, match="none of the 1 images"):
        detect_to_csv(tmp_path, tmp_path / "out.csv", warn=lambda text: None)
    assert not (tmp_path / "out.csv").exists()


def test_nothing_to_search_is_an_error(tmp_path: Path) -> None:
    for source, said in ((tmp_path / "nowhere", "is missing"), (tmp_path, "neither")):
        with pytest.raises(InputError, match=said):
            detect_to_csv(source, tmp_path / "out.csv")
    (tmp_path / "bad.mp4").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"bad\.mp4"):
        detect_to_csv(tmp_path / "bad.mp4", tmp_path / "out.csv")
    assert not (tmp_path / "out.csv").exists()


def test_crops_of_a_run_from_before_streets_were_hidden_are_taken_anew(tmp_path: Path) -> None:
    """Versions 1 and 2 of the stage kept the street around a box as sharp as the video has it."""
    folder = drive(tmp_path / "d", '[video.front]\nfiles = ["video/front.mp4"]\nstart_ns = 500\n')
    video(folder / "video" / "front.mp4")
    settings = Settings.model_validate({"detect": {"every_frame": True}})
    request = Request([STAGE], ("detect",), settings, force=False, dry_run=False, command=[])
    out = tmp_path / "out"
    assert run_drive(folder, out, request).exit_code == 0
    (hidden,) = read_crops(out / names.CROPS)
    # what such a run left: its record and its sharp crops
    write_crops(out / names.CROPS, [replace(hidden, jpeg=b"\xff\xd8 sharp")])
    digest = hashlib.sha256((out / names.CROPS).read_bytes()).hexdigest()
    record = json.loads((out / names.RUN).read_text())
    stage = record["stages"]["detect"]
    stage["version"] = 2
    stage["outputs"][names.CROPS]["sha256"] = digest
    (out / names.RUN).write_text(json.dumps(record))
    assert run_drive(folder, out, request).exit_code == 0
    assert read_crops(out / names.CROPS)[0].jpeg == hidden.jpeg
    record = json.loads((out / names.RUN).read_text())
    assert record["stages"]["detect"]["reason"] == f"version 2 -> {STAGE.version}"
