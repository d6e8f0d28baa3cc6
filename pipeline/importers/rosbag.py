"""A ROS recording as a drive folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.atomic import make_folder, write_bytes
from automap.io.ros_mapping import (
    EXAMPLE,
    Mapped,
    TableFields,
    as_option,
    read_map_file,
    read_options,
)
from automap.records import FloatArray, IntArray
from automap.timebase import unix_to_gps
from pipeline.importers.parts import (
    gnss_section,
    imu_section,
    video_section,
    write_arrival,
    write_csv,
    write_frames,
    write_imu,
)
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.rosbag import Bag

_SOME_GRAVITY = 0.5 * 9.81
"""m/s^2; a mean of less is no gravity: a car's own accelerations are less, and so is any bias."""

_NOTES = (
    "Stamps are those of the message headers (of the recording where a header has none), taken",
    "as UNIX time of one clock.",
    "imu.csv            sensor_msgs/Imu, x forward, y left, z up unless --axes says otherwise, or",
    "                   what the mapping says.",
    "gnss.ubx           ublox_msgs/NavPVT as the receiver sends it.",
    "gnss.nmea          the receiver's sentences, with ZDA before them where none has a date.",
    "gnss.pos           sensor_msgs/NavSatFix with the velocities (east, north, up) of a topic.",
    "gnss.csv           fields of a message of another type, as a table of fixes.",
)


@dataclass(frozen=True)
class Topics:
    """Topics by their names, and fields by theirs; what is None is looked for."""

    imu: str | None = None
    gnss: str | None = None
    velocity: str | None = None
    image: str | None = None
    mapped: Mapped = field(default_factory=dict)


def import_rosbag(
    source: Path | Sequence[Path],
    out: Path,
    imu_topic: str | None = None,
    gnss_topic: str | None = None,
    velocity_topic: str | None = None,
    image_topic: str | None = None,
    no_video: bool = False,
    axes: str | None = None,
    maps: Sequence[str] = (),
    map_file: Path | None = None,
) -> list[str]:
    """Write the ROS recordings ``source`` of one drive as the drive ``out``; returns warnings.

    A topic that is not named is the one of its kind with most messages; ``maps`` and ``map_file``
    say which fields of messages of other types are which columns. ``axes`` None is FLU for
    sensor_msgs/Imu and unknown for other types.
    """
    from automap.io import rosbag

    sources = [source] if isinstance(source, Path) else list(source)
    mapped = ({} if map_file is None else read_map_file(map_file)) | read_options(maps)
    topics = Topics(imu_topic, gnss_topic, velocity_topic, image_topic, mapped)
    with new_drive("rosbag", sources[0], out) as run, rosbag.open_bag(*sources) as bag:
        for given in sources:
            found = [given] if given.is_file() else sorted(given.rglob("*"))
            run.sources += [path for path in found if path.is_file()]
        topics = _guessed(run, bag, topics)
        sections = _write_imu(run, bag, topics, axes)
        sections += _write_fixes(run, bag, topics)
        if not sections:
            raise InputError(
                f"{sources[0]} holds no readings and no positions of a known type or with fields "
                f"of known names; its topics are {bag.listed()}; say which field is what, for "
                f"example {EXAMPLE} --map imu.accel=/imu:linear_acceleration "
                "--map gnss.lat=/gps:latitude --map gnss.lon=/gps:longitude."
            )
        if not no_video:
            sections += _write_video(run, bag, image_topic)
        run.write_manifest(sections, _NOTES)
        _settle_axes(run, sections)
    return run.warnings


def _settle_axes(run: Import, sections: str) -> None:
    """Axes by gravity where the drive moves too little to tell them."""
    from pipeline.importers.level_axes import SLOW, axes_where_slow

    unknown = imu_section("unknown", "unix_ns")
    axes = axes_where_slow(run.folder) if unknown in sections else None
    if axes is not None:
        run.warn(f"{run.source}: {SLOW.format(axes=axes)}")
        run.write_manifest(sections.replace(unknown, imu_section(axes, "unix_ns")), _NOTES)


def _guessed(run: Import, bag: Bag, topics: Topics) -> Topics:
    """The topics with the fields of messages of other types where no known type is there."""
    from automap.io import rosbag
    from automap.io.ros_guess import guess

    kinds = {"imu": rosbag.IMU, "gnss": (*rosbag.UBLOX, *rosbag.FIX, *rosbag.NOVATEL)}
    named = {"imu": topics.imu, "gnss": topics.gnss}
    mapped = dict(topics.mapped)
    for fields in mapped.values():
        bag.choose((), fields.topic, "--map")
    for table in kinds:
        if table in mapped or bag.choose(kinds[table], named[table], f"--{table}-topic"):
            continue
        known = {kind for of_table in kinds.values() for kind in of_table}
        only = {named[table] or topic for topic in bag.topics}
        found = guess(bag, table, only, known)
        if found is not None:
            mapped[table] = found
            run.warn(f"{run.source}: taken by its names: {as_option(table, found)}")
        elif named[table] is not None:
            raise ConfigError(
                f"--{table}-topic {named[table]}: its fields are not known by their names; say "
                f"which they are with --map {table}.COLUMN={named[table]}:FIELD."
            )
    return replace(topics, mapped=mapped)


def _write_imu(run: Import, bag: Bag, topics: Topics, axes: str | None) -> str:
    from automap.io import rosbag
    from automap.io.ros_tables import read_imu_columns

    fields = topics.mapped.get("imu")
    standard = bag.choose(rosbag.IMU, topics.imu, "--imu-topic") if fields is None else None
    if standard is not None:
        fields = TableFields(standard, rosbag.IMU_FIELDS)
    if fields is None:
        run.warn(
            f"{run.source}: no sensor_msgs/Imu; the drive has positions alone. Topics are "
            f"{bag.listed()}; name fields with {EXAMPLE}"
        )
        return ""
    t_ns, gyro, accel = read_imu_columns(bag, fields)
    if standard is not None and not _measured(run, bag, standard, gyro, accel):
        return ""
    write_imu(run, t_ns, gyro, accel)
    if axes is None:
        axes = _usual_axes(run, fields.topic, standard is not None, accel)
    return imu_section(axes, "unix_ns")


def _measured(run: Import, bag: Bag, topic: str, gyro: FloatArray, accel: FloatArray) -> bool:
    """Whether Imu messages have readings of both kinds: those of some devices have one alone."""
    from automap.io import rosbag

    unmeasured = rosbag.says_unmeasured(bag, topic)
    readings = {"angular_velocity": gyro, "linear_acceleration": accel}
    for name, values in readings.items():
        if len(values) > 1 and not np.any(values != values[0]):
            run.warn(
                f"{run.source}: {topic} measures no {name}, which is the same in all its messages, "
                "and is left out; name a topic that has both with --imu-topic, or record one "
                "(RealSense: unite_imu_method)"
            )
            return False
        if name in unmeasured:
            run.warn(
                f"{run.source}: {topic} says that {name} was not measured (covariance -1), but its "
                "numbers vary and are taken; if they are not readings, name another topic with "
                "--imu-topic"
            )
    return True


def _usual_axes(run: Import, topic: str, standard: bool, accel: FloatArray) -> str:
    """FLU as REP-103 has it, unknown where gravity or another type says that it may not be."""
    mean = np.mean(accel, axis=0)
    upward = bool(mean[2] > 0.0)
    if standard and (upward or float(np.linalg.norm(mean)) < _SOME_GRAVITY):
        # where gravity was taken out it tells no axes; the check of the drive tells that it was
        return "FLU"
    why = "its type is no standard one" if upward else "gravity is on its z axis upside down"
    run.warn(
        f"{run.source}: the axes of {topic} are not taken as x forward, y left, z up ({why}); name "
        "them with --axes if you know them"
    )
    return "unknown"


def _write_fixes(run: Import, bag: Bag, topics: Topics) -> str:
    from automap.io import rosbag

    fields = topics.mapped.get("gnss")
    if fields is None:
        # a receiver's own message says more than what was made of it
        chosen = next(
            filter(
                None,
                (
                    bag.choose(tuple(kinds), topics.gnss, "--gnss-topic")
                    for kinds in (rosbag.UBLOX, rosbag.NOVATEL, rosbag.FIX)
                ),
            ),
            None,
        )
        if chosen is None:
            run.warn(
                f"{run.source}: no positions (sensor_msgs/NavSatFix or ublox_msgs/NavPVT). Topics "
                f"are {bag.listed()}; name fields with --map gnss.lat=/gps:latitude"
            )
            return ""
        kind = bag.topics[chosen][0]
        if kind in rosbag.UBLOX:
            return _write_log(run, "gnss.ubx", *rosbag.read_ublox(bag, chosen))
        if kind in rosbag.FIX:
            return _write_solution(run, bag, chosen, topics.velocity)
        fields = TableFields(chosen, rosbag.NOVATEL[kind])
    return _write_mapped(run, bag, fields)


def _write_mapped(run: Import, bag: Bag, fields: TableFields) -> str:
    from automap.io.ros_tables import read_columns, read_sentences

    if "nmea" in fields:
        t_ns, texts, dated = read_sentences(bag, fields)
        if dated:
            run.warn(f"{run.source}: no sentence of {fields.topic} tells the date; it is that of "
                     "the stamps")  # fmt: skip
        return _write_log(run, "gnss.nmea", t_ns, texts)
    columns = read_columns(bag, "gnss", fields)
    missing = [name for name in ("lat", "lon") if name not in columns]
    if missing:
        raise InputError(f"the mapping of {fields.topic} lacks gnss.{missing[0]}; add it.")
    t_ns = columns.pop("t_ns")
    formats = [".10f" if name in ("lat", "lon") else ".9g" for name in columns]
    write_csv(run.folder / "gnss.csv", ("t", *columns), t_ns, np.column_stack([*columns.values()]),
              formats)  # fmt: skip
    return gnss_section("gnss.csv") + 'time_format = "unix_ns"\n'


def _write_log(run: Import, name: str, t_ns: IntArray, messages: list[bytes]) -> str:
    """A receiver's log with the time of each message."""
    write_bytes(run.folder / name, b"".join(messages))
    starts = np.cumsum([0, *(len(message) for message in messages)])[:-1].astype(np.int64)
    order = np.maximum.accumulate(t_ns) if len(t_ns) else t_ns
    write_arrival(run, starts, order)
    return gnss_section(name, "unix_ns")


def _write_solution(run: Import, bag: Bag, chosen: str, velocity: str | None) -> str:
    from automap.io import rosbag
    from automap.io.pos_writer import pos_log

    speeds = bag.choose(rosbag.VELOCITY, velocity, "--velocity-topic")
    if speeds is not None and velocity is None and "vel" not in speeds.lower():
        run.warn(
            f"{run.source}: {speeds} is not taken as the receiver's velocity; name it with "
            "--velocity-topic if it is (east, north, up)"
        )
        speeds = None
    fixes = rosbag.read_fixes(bag, chosen, speeds)
    for text in fixes.warnings:
        run.warn(f"{run.source}: {text}")
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
    from automap.io.ros_images import read_camera, read_images

    chosen = bag.choose(rosbag.IMAGE, topic, "--image-topic")
    if chosen is None:
        return ""
    folder = make_folder(run.folder / "video")
    stamps: list[int] = []

    def images() -> Iterator[tuple[int, bytes]]:
        for stamp, data in read_images(bag, chosen):
            stamps.append(stamp)
            yield stamp, data

    write_image_video(folder / "front.mp4", images())
    write_frames(run, np.array(stamps, np.int64))
    near = chosen.rsplit("/", 1)[0].removesuffix("/image_raw").removesuffix("/image_rect")
    infos = [t for t, (kind, n) in bag.topics.items() if kind in rosbag.INFO and n]
    info = next((t for t in infos if t.startswith(near)), None)
    camera = read_camera(bag, info) if info is not None else None
    if camera is None:
        run.warn(f"{run.source}: no CameraInfo beside {chosen}; add camera_matrix to drive.toml")
        return video_section("front.mp4", "unix_ns")
    size, matrix, distortion = camera
    return video_section("front.mp4", "unix_ns", size, matrix, distortion)
