"""Stage detect: signs in the video, or an external detector's boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError
from automap.io import names
from pipeline.detect.camera_paths import path_finder
from pipeline.detect.search_setup import detector_files, open_detector, search_rules
from pipeline.run.stage import Stage, StageContext
from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from automap.io.video import VideoInput
    from automap.records import Camera, Crop, Detections, IntArray, PictureTurns
    from automap.vision.camera_path import CameraPath
    from automap.vision.search import SearchResult


def run(context: StageContext) -> None:
    """Write detections.parquet and what was seen; an external detector's boxes win over video."""
    from automap.io.camera_turns import write_camera_turns
    from automap.io.detections_table import write_detections
    from automap.io.searched_table import write_searched

    found: list[SearchResult] = []
    turns: dict[str, PictureTurns] = {}
    cameras = len(context.drive.videos)
    for index, video in enumerate(context.drive.videos.values()):

        def progress(
            fraction: float, text: str, index: int = index, cameras: int = cameras
        ) -> None:
            context.progress((index + fraction) / cameras, text)

        try:
            turns[video.name] = _turns(context, video)
            part = _camera(context, video, turns[video.name], progress)
        except InputError as error:
            context.warn(f"The camera {video.name} gives no detections: {error}")
            continue
        if part is not None:
            found.append(part)
    if not found and context.drive.bearings_file is None:
        context.warn(
            "The drive has neither a readable video nor detections, so no signs are found; the "
            "trajectory is all there is."
        )
    found = _numbered(found)
    write_detections(context.work / names.DETECTIONS, [part.detections for part in found])
    write_searched(context.work / names.SEARCHED, [part.detections for part in found])
    write_camera_turns(context.work / names.CAMERA_TURNS, turns)
    _write_crops(context, [crop for part in found for crop in part.crops])
    _report(context, found)
    others = [name for name, one in turns.items() if one.elsewhere]
    if others:
        context.result += f"; camera {', '.join(others)} turns otherwise than the path"


def _turns(context: StageContext, video: VideoInput) -> PictureTurns:
    """How the video turns against the path, told where that is not as stated."""
    from automap.records import PictureTurns
    from pipeline.detect.video_turns import video_turns

    path_of = path_finder(context.out, context.drive, video)
    turns = video_turns(video, context.drive.cameras().get(video.name), path_of)
    if turns.allowed and context.drive.imu_file is None:
        # a path without a gyro turns as late as its receiver tells
        turns = PictureTurns(turns.bends)
    told = turns.told(video.name)
    if told:
        context.warn(told)
    return turns


def _camera(
    context: StageContext, video: VideoInput, turns: PictureTurns, progress: Progress
) -> SearchResult | None:
    from automap.io.detections_csv import read_detections_csv
    from automap.io.frame_times import frame_times
    from automap.vision.search import SearchResult
    from pipeline.detect.video_search import search_video
    from pipeline.detect.video_turns import at_corrected

    camera = context.drive.cameras().get(video.name)
    path_of = at_corrected(path_finder(context.out, context.drive, video), turns)
    if video.detections is not None:
        times = frame_times(video)
        size = None if camera is None else (camera.width, camera.height)
        table = read_detections_csv(video.detections, times, video.name, size)
        for text in (*times.warnings, *table.warnings):
            context.warn(text)
        return SearchResult(_tracked(table.data, camera, path_of))
    if not video.chapters:
        return None
    settings = context.settings.detect
    detector = open_detector(settings, context.drive.site.country)
    return search_video(
        video,
        detector,
        search_rules(settings),
        camera,
        path_of,
        context.warn,
        progress,
    )


def _tracked(
    found: Detections, camera: Camera | None, path_of: Callable[[IntArray], CameraPath | None]
) -> Detections:
    """Boxes with the tracks that their detector gave them, else with our own."""
    import numpy as np

    from automap.vision.tracking import box_tracks

    if camera is None or not len(found) or (found.track >= 0).any():
        return found
    stamps = found.t_ns[np.unique(found.frame, return_index=True)[1]]
    return replace(found, track=box_tracks(found, camera, path_of(stamps)))


def _numbered(found: list[SearchResult]) -> list[SearchResult]:
    """The same with track numbers that no two cameras share."""
    first = 0
    numbered = []
    for part in found:
        tracks = part.detections.track
        crops = tuple(replace(crop, track=crop.track + first) for crop in part.crops)
        moved = replace(part.detections, track=tracks + first * (tracks >= 0))
        numbered.append(replace(part, detections=moved, crops=crops))
        first = max([first, *(int(t) + 1 for t in moved.track)])
    return numbered


def _write_crops(context: StageContext, crops: list[Crop]) -> None:
    """What was seen, as pictures; nothing where nothing was."""
    if not crops:
        return
    from automap.io.atomic import write_bytes
    from automap.io.crops_table import write_crops
    from automap.vision.contact_sheet import contact_sheet

    write_crops(context.work / names.CROPS, crops)
    write_bytes(context.work / names.CONTACT_SHEET, contact_sheet(crops))


def _report(context: StageContext, found: list[SearchResult]) -> None:
    boxes = [part.detections for part in found]
    total = sum(len(part) for part in boxes)
    tracks = sum(len({t for t in part.track.tolist() if t >= 0}) for part in boxes)
    searched, frames = sum(p.searched for p in found), sum(p.frames for p in found)
    context.metric("n_detections", total)
    context.metric("n_detection_frames", sum(len(set(part.frame.tolist())) for part in boxes))
    context.metric("n_tracks", tracks)
    if frames:
        context.metric("n_frames", frames)
        context.metric("n_frames_searched", searched)
    context.result = f"{total} detections" if found else "no video and no detections"
    if tracks:
        context.result += f" in {tracks} tracks"
    if searched:
        context.result += f", {searched} of {frames} frames searched"


def _inputs(drive: Drive) -> list[Path]:
    files = [drive.manifest_file] if drive.manifest_file.is_file() else []
    for video in drive.videos.values():
        if video.detections is not None:
            files.append(video.detections)
        files += video.chapters
        files += [video.frames] if video.frames is not None else []
    return files


STAGE = Stage(
    name="detect",
    # 3: the street around a box is hidden in the crops that are kept
    # 4: the contrast of each face, and the frames that were searched
    # 5: the classifier's last layers trained anew
    # 7: how the pictures turn against the path
    # 8: pictures that stay while the vehicle drives are not searched; networks trained in full
    # 9: bends that know an offset better than the manifest
    # 10: the classifier trained on, with what blue discs show and words on boards
    # 11: the detector trained on, with pictures in motion and what it found before kept
    # 12: boxes that come without tracks get some
    # 13: boxes of a file that a better one of their frame covers are left out
    version=16,
    run=run,
    inputs=_inputs,
    # where the camera was when says which frames are worth a search
    needs=(names.TRAJECTORY, names.SYNC),
    outputs=(
        names.DETECTIONS,
        names.SEARCHED,
        names.CAMERA_TURNS,
        names.CROPS,
        names.CONTACT_SHEET,
    ),
    settings=("detect",),
    setting_files=detector_files,
)
