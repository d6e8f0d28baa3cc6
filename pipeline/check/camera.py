"""Checks of video, its stamps, the camera's numbers and external detections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.evaluation.plausibility import Finding
from automap.io.drive import Drive
from automap.io.video import VideoHeader, VideoInput, image_size, read_chapter, read_header
from automap.vision.limits import REJOIN_S
from pipeline.check import limits

_COUNTED_BYTES = 1 << 30
"""Files up to this size are gone through where the header does not give the frames."""

_NOTHING = "the camera gives no detections"


def judge(drive: Drive, video: VideoInput) -> Iterator[tuple[Path, list[Finding]]]:
    """What is wrong with the manifest's numbers, which put every sign in a wrong place."""
    size = image_size(video.chapters)
    found = geometry(drive, video, size)
    yield drive.manifest_file, [finding for finding in found if finding.code]
    mismatch = None if size is None else size_mismatch(video, *size)
    if mismatch is not None:
        yield video.chapters[0], [mismatch]


def check(drive: Drive, video: VideoInput) -> Iterator[tuple[Path | str, list[Finding]]]:
    """Findings on one camera, file by file, but for those that ``judge`` has."""
    headers: list[VideoHeader] = []
    for path in video.chapters:
        try:
            header = read_header(path)
        except InputError as error:
            yield path, [Finding("warning", str(error))]
            continue
        header, counted = _counted(path, header)
        if headers and header.created_s < headers[-1].created_s:
            counted.append(_out_of_order(header, headers[-1]))
        headers.append(header)
        yield path, [*_chapter(video, header), *counted]
    size = (headers[0].width, headers[0].height) if headers else None
    found = geometry(drive, video, size)
    yield drive.manifest_file, [finding for finding in found if not finding.code]
    if headers and video.frames is None:
        yield drive.manifest_file, _start(video, headers)
    if not headers and video.detections is None:
        section = f"[video.{video.name}]"
        yield (
            drive.manifest_file,
            [Finding("warning", f"{section} has neither a readable video nor detections")],
        )
    yield from _listed(video, headers)


def _counted(path: Path, header: VideoHeader) -> tuple[VideoHeader, list[Finding]]:
    """The header with number of frames and length; a file that does not say, as one that was
    written while it was recorded, is gone through unless it is large."""
    if (header.frames and np.isfinite(header.duration_s)) or path.stat().st_size > _COUNTED_BYTES:
        return header, []
    try:
        chapter = read_chapter(path)
    except InputError as error:
        return header, [Finding("warning", str(error))]
    length_s = (chapter.end_ns - int(chapter.pts_ns[0])) * 1e-9
    counted = replace(header, frames=len(chapter.pts_ns), duration_s=length_s)
    return counted, [Finding("warning", text) for text in chapter.warnings]


def _chapter(video: VideoInput, header: VideoHeader) -> list[Finding]:
    frames = f"{header.frames} frames" if header.frames else "frames not counted in the file"
    known = np.isfinite(header.duration_s)
    length = f"{header.duration_s:.1f} s" if known else "length not in the file"
    findings = [Finding("ok", f"{header.codec} {header.width}x{header.height}, {frames}, {length}")]
    if not header.first_frame:
        findings.append(
            Finding("warning", "its first picture cannot be decoded", "copy the file again")
        )
    return findings


def _out_of_order(header: VideoHeader, before: VideoHeader) -> Finding:
    """A warning where a chapter is older than the one before it."""
    return Finding(
        "warning",
        f"it was filmed {before.created_s - header.created_s:.0f} s before the file ahead of it, "
        "by the creation times in both",
        "files lists the chapters of a camera in the order in which they were filmed",
    )


def size_mismatch(video: VideoInput, wide: int, high: int) -> Finding | None:
    """An error when the manifest gives another image size than that of the video."""
    width, height = video.section.width, video.section.height
    if width is None or height is None or (width, height) == (wide, high):
        return None
    # of the same proportions but for a row that a coder rounds
    if abs(wide * height - high * width) <= 2 * max(width, height):
        advice = (
            f"correct width and height, and multiply the camera_matrix by {wide / width:.4g} if "
            "it was measured at the other size"
        )
    else:
        advice = (
            "its proportions are others, so a part of the picture is cut off and no factor makes "
            "the camera_matrix fit: calibrate with the settings of this video"
        )
    return Finding(
        "error",
        f"the manifest says {width}x{height}, the video has {wide}x{high}",
        advice,
        "camera_size",
    )


def geometry(drive: Drive, video: VideoInput, size: tuple[int, int] | None) -> list[Finding]:
    """Findings on what the manifest says of a camera's optics; ``size`` of its pictures
    where the manifest has none, width and height."""
    section = video.section
    findings = [
        Finding("warning", text)
        for text in drive.camera_warnings()
        if f"[video.{video.name}]" in text
    ]
    if section.camera_matrix is None:
        return findings
    (fx, _, cx), (_, fy, cy), _ = section.camera_matrix
    if section.width is not None and section.height is not None:
        size = section.width, section.height
    if size is None:
        return findings
    width, height = size
    view = float(np.degrees(2.0 * np.arctan(0.5 * width / fx)))
    shown = f"[video.{video.name}] camera_matrix: {view:.0f} deg of horizontal view"
    if view > limits.WIDEST_DEG:
        advice = f"fx is {fx:g}: it is in pixels, not in millimetres or parts of the width"
        return [*findings, Finding("error", shown, advice, "camera_view")]
    off_centre = max(abs(cx / width - 0.5), abs(cy / height - 0.5))
    if off_centre > limits.OFF_CENTRE:
        findings.append(
            Finding(
                "error",
                f"{shown}, its centre ({cx:.0f}, {cy:.0f}) is far from that of {width}x{height}",
                "the matrix belongs to another resolution or its rows are mixed up",
                "camera_matrix",
            )
        )
    elif off_centre > limits.OFF_CENTRE_DOUBTED:
        findings.append(
            Finding(
                "warning",
                f"{shown}, its centre ({cx:.0f}, {cy:.0f}) is {100 * off_centre:.0f} % off that of "
                f"{width}x{height}",
                "was it measured at other proportions, as 4:3? Calibrate with the settings of this "
                "video",
                "camera_matrix",
            )
        )
    elif view > limits.STRAIGHT_DEG and not any(section.distortion or ()):
        findings.append(
            Finding(
                "warning",
                f"{shown}, and no distortion, which no lens so wide is without",
                "does the matrix belong to another resolution? Calibrate with the settings of this "
                "video",
                "camera_matrix",
            )
        )
    elif not limits.VIEW_DEG[0] < view < limits.VIEW_DEG[1]:
        advice = "check fx: it is in pixels of this resolution"
        findings.append(Finding("warning", shown, advice, "camera_matrix"))
    elif abs(fx / fy - 1.0) > limits.ASPECT:
        text = f"{shown}, fx and fy differ by {100 * abs(fx / fy - 1):.0f} %"
        findings.append(Finding("warning", text, code="camera_matrix"))
    else:
        findings.append(Finding("ok", shown))
    return findings


def _start(video: VideoInput, headers: list[VideoHeader]) -> list[Finding]:
    """Where the stamps begin: the creation time of a file is often its end."""
    start_ns = video.section.start_ns
    name = f"[video.{video.name}]"
    if start_ns is None:
        return [
            Finding(
                "warning",
                f"{name} has neither start_ns nor a frames file; 0 is taken",
                "add start_ns, the time of the first frame in the clock that time names",
            )
        ]
    created = headers[0].created_s
    if video.section.time != "unix_ns" or not np.isfinite(created):
        return []
    seconds = headers[0].duration_s
    length = f"{seconds:.1f} s" if np.isfinite(seconds) else "the length of the video"
    if abs(start_ns * 1e-9 - created) < limits.SAME_START_S:
        return [
            Finding(
                "warning",
                f"{name} start_ns equals the creation time in the file",
                f"many cameras write the end there: if so, subtract {length}; "
                "whole seconds are not enough either way",
            )
        ]
    return []


def _other_video(listed: int, shown: int) -> list[Finding]:
    """A warning where more frames are listed than a video has, or fewer."""
    if listed == shown:
        return []
    text = f"it lists {listed} frames, the video has {shown}"
    return [Finding("warning", text, "are both of this drive? Frames without a stamp are left out")]


def _listed(video: VideoInput, headers: list[VideoHeader]) -> Iterator[tuple[Path, list[Finding]]]:
    """The frames file, beside how many frames the video has, and the detections."""
    from automap.io.detections_csv import read_detections_csv
    from automap.io.frame_times import frame_times
    from automap.records import FrameTimes

    times: FrameTimes | None = None
    if video.frames is not None:
        try:
            times = frame_times(video)
        except InputError as error:
            yield video.frames, [Finding("warning", str(error), _NOTHING)]
        else:
            span = float(times.t_ns[-1] - times.t_ns[0]) * 1e-9
            findings = [Finding("ok", f"stamps of {len(times)} frames over {span:.1f} s")]
            counts = [header.frames for header in headers]
            if counts and len(counts) == len(video.chapters) and all(counts):
                findings += _other_video(len(times), sum(counts))
            yield video.frames, findings + [Finding("warning", text) for text in times.warnings]
    if video.detections is None:
        return
    if times is None and video.chapters:
        try:
            times = frame_times(video)
        except InputError:
            times = None
    if times is None or not len(times):
        yield (
            video.detections,
            [
                Finding(
                    "warning",
                    "detections without the times of their frames",
                    f"add {video.name}_frames.csv (frame, t_ns) or the video; {_NOTHING}",
                )
            ],
        )
        return
    size = None
    if video.section.width is not None and video.section.height is not None:
        size = (video.section.width, video.section.height)
    try:
        found = read_detections_csv(video.detections, times, video.name, size)
    except InputError as error:
        yield video.detections, [Finding("warning", str(error), _NOTHING)]
        return
    classes = len(set(found.data.class_name.tolist()))
    frames = len(np.unique(found.data.frame))
    text = f"{len(found.data)} detections of {classes} classes in {frames} frames"
    findings = [Finding("ok", text)]
    steps = np.diff(np.unique(found.data.t_ns)) * 1e-9
    apart_s = float(np.median(steps)) if len(steps) else 0.0
    if apart_s > REJOIN_S and not (found.data.track >= 0).any():
        findings.append(
            Finding(
                "info",
                "no column track tells which boxes are of one thing, and in frames that are "
                f"{apart_s:.1f} s apart nothing that moves can be followed, so signs on "
                "vehicles ahead are taken for signs of the road",
                "write the numbers that the detector's tracker gives (docs/howto/own-detector.md)",
            )
        )
    yield video.detections, findings + [Finding("warning", text) for text in found.warnings]
