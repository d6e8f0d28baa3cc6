"""A ROS recording as a drive folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.io.atomic import make_folder, write_bytes
from automap.timebase import unix_to_gps
from pipeline.importers.parts import (
    gnss_section,
    imu_section,
    video_section,
    write_arrival,
    write_frames,
    write_imu,
)
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.rosbag import Bag

_NOTES = (
    "Stamps are those of the message headers (of the recording where a header has none), taken",
    "as UNIX time of one clock.",
    "imu.csv            sensor_msgs/Imu, x forward, y left, z up unless --axes says otherwise.",
    "gnss.ubx|gnss.pos  ublox_msgs/NavPVT as the receiver sends it, else sensor_msgs/NavSatFix",
    "                   with the velocities (east, north, up) of a TwistStamped topic.",
)


def import_rosbag(
    source: Path,
    out: Path,
    imu_topic: str | None = None,
    gnss_topic: str | None = None,
    velocity_topic: str | None = None,
    image_topic: str | None = None,
    no_video: bool = False,
    axes: str = "FLU",
) -> list[str]:
    """Write the ROS recording ``source`` as the drive ``out``; returns warnings.

    A topic that is not named is the one of its kind with most messages.
    """
    from automap.io import rosbag

    with new_drive("rosbag", source, out) as run, rosbag.open_bag(run.source) as bag:
        found = [run.source] if run.source.is_file() else sorted(run.source.rglob("*"))
        run.sources += [path for path in found if path.is_file()]
        sections = ""
        imu = bag.choose(rosbag.IMU, imu_topic, "--imu-topic")
        if imu is None:
            run.warn(f"{source}: no sensor_msgs/Imu; the drive has positions alone")
        else:
            write_imu(run, *rosbag.read_imu(bag, imu))
            sections += imu_section(axes, "unix_ns")
        gnss = _write_fixes(run, bag, gnss_topic, velocity_topic)
        if imu is None and not gnss:
            there = ", ".join(f"{t} ({kind})" for t, (kind, _) in sorted(bag.topics.items())[:8])
            raise InputError(
                f"{source} has neither sensor_msgs/Imu nor NavSatFix nor ublox_msgs/NavPVT; its "
                f"topics are {there or 'none'}."
            )
        sections += gnss
        if not no_video:
            sections += _write_video(run, bag, image_topic)
        run.write_manifest(sections, _NOTES)
    return run.warnings


def _write_fixes(run: Import, bag: Bag, topic: str | None, velocity: str | None) -> str:
    from automap.io import rosbag
    from automap.io.pos_writer import pos_log

    kinds = (*rosbag.UBLOX, *rosbag.FIX)
    chosen = bag.choose(kinds, topic, "--gnss-topic")
    # a receiver's own message says more than what was made of it
    raw = bag.choose(rosbag.UBLOX, None, "--gnss-topic") if topic is None else None
    chosen = raw or chosen
    if chosen is None:
        run.warn(f"{run.source}: no positions (sensor_msgs/NavSatFix or ublox_msgs/NavPVT)")
        return ""
    if bag.topics[chosen][0] in rosbag.UBLOX:
        t_ns, frames = rosbag.read_ublox(bag, chosen)
        write_bytes(run.folder / "gnss.ubx", b"".join(frames))
        starts = np.cumsum([0, *(len(f) for f in frames)])[:-1].astype(np.int64)
        order = np.maximum.accumulate(t_ns) if len(t_ns) else t_ns
        write_arrival(run, starts, order)
        return gnss_section("gnss.ubx", "unix_ns")
    speeds = bag.choose(rosbag.VELOCITY, velocity, "--velocity-topic")
    if speeds is not None and velocity is None and "vel" not in speeds.lower():
        run.warn(
            f"{run.source}: {speeds} is not taken as the receiver's velocity; name it with "
            "--velocity-topic if it is (east, north, up)"
        )
        speeds = None
    fixes = rosbag.read_fixes(bag, chosen, speeds)
    order = np.argsort(fixes.t_ns, kind="stable")
    log, _ = pos_log(
        unix_to_gps(fixes.t_ns[order] * 1e-9),
        fixes.lat_deg[order],
        fixes.lon_deg[order],
        fixes.height_m[order],
        fixes.fix_type[order],
        fixes.sd_pos_ned[order],
        fixes.vel_ned[order],
        fixes.sd_vel_ned[order],
    )
    write_bytes(run.folder / "gnss.pos", log)
    if not np.isfinite(fixes.vel_ned).any():
        run.warn(f"{run.source}: no velocity with the positions of {chosen}")
    return gnss_section("gnss.pos")


def _write_video(run: Import, bag: Bag, topic: str | None) -> str:
    from automap.io import rosbag
    from automap.io.image_video import write_image_video

    chosen = bag.choose(rosbag.IMAGE, topic, "--image-topic")
    if chosen is None:
        return ""
    folder = make_folder(run.folder / "video")
    stamps: list[int] = []

    def images() -> Iterator[tuple[int, bytes]]:
        for stamp, data in rosbag.read_images(bag, chosen):
            stamps.append(stamp)
            yield stamp, data

    write_image_video(folder / "front.mp4", images())
    write_frames(run, np.array(stamps, np.int64))
    near = chosen.rsplit("/", 1)[0].removesuffix("/image_raw").removesuffix("/image_rect")
    infos = [t for t, (kind, n) in bag.topics.items() if kind in rosbag.INFO and n]
    info = next((t for t in infos if t.startswith(near)), None)
    camera = rosbag.read_camera(bag, info) if info is not None else None
    if camera is None:
        run.warn(f"{run.source}: no CameraInfo beside {chosen}; add camera_matrix to drive.toml")
        return video_section("front.mp4", "unix_ns")
    size, matrix, distortion = camera
    return video_section("front.mp4", "unix_ns", size, matrix, distortion)
