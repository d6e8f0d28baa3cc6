"""Stage detect: signs in the video, or an external detector's boxes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError
from automap.io import names
from pipeline.stage import Stage, StageContext

if TYPE_CHECKING:
    from automap.io.drive import Drive, VideoInput
    from automap.records import Detections


def run(context: StageContext) -> None:
    """Write detections.parquet; an external detector's boxes win over the video."""
    from automap.io.detections_table import write_detections

    found: list[Detections] = []
    cameras = len(context.drive.videos)
    for index, video in enumerate(context.drive.videos.values()):

        def progress(
            fraction: float, text: str, index: int = index, cameras: int = cameras
        ) -> None:
            context.progress((index + fraction) / cameras, text)

        try:
            part = _camera(context, video, progress)
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
    write_detections(context.work / names.DETECTIONS, found)
    total = sum(len(part) for part in found)
    context.metric("n_detections", total)
    context.metric("n_detection_frames", sum(len(set(part.frame.tolist())) for part in found))
    context.result = f"{total} detections" if found else "no video and no detections"


def _camera(
    context: StageContext, video: VideoInput, progress: Callable[[float, str], None]
) -> Detections | None:
    from automap.io.detections_csv import read_detections_csv
    from automap.io.video import frame_times

    _warn_of_geometry(context, video)
    if video.detections is not None:
        times = frame_times(video)
        camera = context.drive.cameras().get(video.name)
        size = None if camera is None else (camera.width, camera.height)
        table = read_detections_csv(video.detections, times, video.name, size)
        for text in (*times.warnings, *table.warnings):
            context.warn(text)
        return table.data
    if not video.chapters:
        return None
    from automap.vision.search import search_video

    settings = context.settings.detect
    return search_video(video, settings.frames_per_s, settings.min_score, context.warn, progress)


def _warn_of_geometry(context: StageContext, video: VideoInput) -> None:
    """Numbers of the camera that would put every sign in the wrong place."""
    from automap.io.video import image_size
    from pipeline.checks.camera import geometry, size_mismatch

    manifest = context.drive.manifest_file
    for finding in geometry(context.drive, video, []):
        if finding.severity == "error":
            context.warn(f"{manifest}: {finding.sentence()}")
    size = image_size(video.chapters)
    mismatch = None if size is None else size_mismatch(video, *size)
    if mismatch is not None:
        context.warn(f"{video.chapters[0]}: {mismatch.sentence()}")


def _inputs(drive: Drive) -> list[Path]:
    files = [drive.manifest_file] if drive.manifest_file.is_file() else []
    for video in drive.videos.values():
        if video.detections is not None:
            files.append(video.detections)
            # without a table of stamps the video's own times date the boxes
            files += [video.frames] if video.frames is not None else list(video.chapters)
            continue
        files += video.chapters
        files += [video.frames] if video.frames is not None else []
    return files


STAGE = Stage(
    name="detect",
    version=1,
    run=run,
    inputs=_inputs,
    needs=(),
    outputs=(names.DETECTIONS,),
    settings=("detect",),
)
