"""The video with the signs that were found drawn into it, and nobody to be recognised in it."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np

from automap.io.atomic import atomic_path
from automap.io.frame_times import frame_times
from automap.io.video import VideoInput, video_chapters
from automap.io.video_decode import decode_frames
from automap.records import Detections
from automap.vision.annotate import draw, frame_labels
from automap.vision.privacy import street_hidden
from pipeline.shared.progress import Progress


def annotate_video(
    video: VideoInput,
    found: Detections,
    out: Path,
    warn: Callable[[str], None] = lambda text: None,
    progress: Progress = lambda fraction, text: None,
    hide: bool = True,
) -> None:
    """Write the whole video with the tracks drawn in, as H.264 in the container ``out`` names.

    With ``hide`` all but the signs is so coarse that nobody can be recognised. Raises StageError
    when ``out`` cannot be written.
    """
    import av

    chapters, _ = video_chapters(video)
    times = frame_times(video, chapters)
    if not chapters or not len(times):
        return
    labels = frame_labels(found, dict(zip(times.frame.tolist(), times.t_ns.tolist(), strict=True)))
    # players want even sides
    width, height = chapters[0].width // 2 * 2, chapters[0].height // 2 * 2
    matrix = video.section.camera_matrix
    focal_px = None if matrix is None else float(matrix[0][0])
    first_ns: int | None = None
    last_ms = -1
    with atomic_path(out) as temporary, av.open(str(temporary), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        stream.options = {"crf": "25", "preset": "veryfast"}
        for number, picture in enumerate(decode_frames(chapters, times, None, warn)):
            image = np.ascontiguousarray(picture.image[:height, :width])
            shown = labels.get(picture.frame, ())
            if hide:
                image = street_hidden(image, [label.box for label in shown], focal_px)
            draw(image, shown)
            frame = av.VideoFrame.from_ndarray(image, format="bgr24")
            first_ns = picture.t_ns if first_ns is None else first_ns
            last_ms = max(round((picture.t_ns - first_ns) * 1e-6), last_ms + 1)
            frame.pts, frame.time_base = last_ms, Fraction(1, 1000)
            for packet in stream.encode(frame):
                container.mux(packet)
            if number % 10 == 0:
                progress(number / len(times), f"drawing frame {number} of {len(times)}")
        for packet in stream.encode():
            container.mux(packet)
