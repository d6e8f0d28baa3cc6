"""Speed of the search in a video: every frame on one processor, and the default choice.

    python tests/benchmarks/detect_video.py [VIDEO] [--times N]

VIDEO is a 30 fps drive at town speed; without one, the approach of the shared recordings is
joined to itself N times. Decoding alone, by the same library on one thread, is the peer and the
limit: it is measured before and after, and ratios to it hold on a busy machine too.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

# as the command line does: small matrices gain nothing from threads
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from automap.io.manifest import VideoSection
from automap.io.video import VideoInput
from pipeline.detect.search_setup import open_detector, search_rules
from pipeline.detect.video_search import search_video
from pipeline.settings.load import Settings

SHARED = Path(os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data"))


def decoding(path: Path) -> tuple[float, int]:
    """Processor seconds and frames of decoding one file to pictures on one thread."""
    import av

    started, frames = time.process_time(), 0
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "NONE"
        for picture in container.decode(stream):
            picture.to_ndarray(format="bgr24")
            frames += 1
    return time.process_time() - started, frames


def searching(video: VideoInput, every: bool, workers: int) -> tuple[float, float, int, int, int]:
    """Processor and wall seconds, frames, searched frames and tracks."""
    from dataclasses import replace

    settings = Settings().detect.model_copy(update={"every_frame": every})
    detector = open_detector(settings, None)
    rules = replace(search_rules(settings), workers=workers)
    started, wall = time.process_time(), time.monotonic()
    result = search_video(video, detector, rules)
    tracks = len(set(result.detections.track.tolist()))
    return (
        time.process_time() - started, time.monotonic() - wall, result.frames, result.searched,
        tracks,
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("video", nargs="?", type=Path)
    parser.add_argument("--times", type=int, default=1)
    chosen = parser.parse_args()
    path = chosen.video or SHARED / "video" / "approach-720p.mp4"
    video = VideoInput("front", VideoSection(start_ns=0), (path,) * chosen.times)
    searching(VideoInput("front", VideoSection(start_ns=0), (path,)), False, 1)  # loads the model

    alone, count = decoding(path)
    every = searching(video, True, 1)
    default = searching(video, False, 2)
    again, _ = decoding(path)
    decode_ms = 500.0 * (alone + again) / count
    every_ms = 1e3 * every[0] / every[2]
    default_ms = 1e3 * default[0] / default[2]
    print(
        f"load of the machine            {os.getloadavg()[0]:8.1f} on {os.cpu_count()} processors"
    )
    print(f"decoding alone, one thread     {decode_ms:8.1f} ms a frame")
    print(
        f"every frame, one thread        {every_ms:8.1f} ms a frame   {1e3 / every_ms:.1f} a second"
    )
    print(f"  of that decoding             {100 * decode_ms / every_ms:8.0f} %")
    print(f"  against decoding             {every_ms / decode_ms:8.1f}")
    print(f"default choice, two threads    {default_ms:8.1f} ms a frame of the video, "
          f"{default[3]} of {default[2]} searched")  # fmt: skip
    print(
        f"  processor time over length   {default_ms * 30e-3:8.2f}   (two processors: below 0.67)"
    )
    print(f"  against decoding             {default_ms / decode_ms:8.1f}")
    print(f"signs                          {every[4]} by every frame, {default[4]} by choice")


if __name__ == "__main__":
    main()
