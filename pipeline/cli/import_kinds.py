"""The kinds of recordings that can be imported; light, so that help costs nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import click

from pipeline.cli.options import ANY_PATH, Finite


def _choice(*words: str) -> click.Choice[str]:
    return click.Choice(words)


@dataclass(frozen=True)
class Option:
    """An option of one kind: ``flag`` as typed, perhaps after the name of the function's argument,
    the rest as click takes it."""

    flag: str
    help: str
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """A kind: where its function ``(source, out, **options) -> warnings`` is, what it reads and
    what it was tested on."""

    name: str
    function: str
    source: str
    summary: str
    text: str
    options: tuple[Option, ...] = ()
    several: bool = False
    """Whether several sources make one drive; the function then gets a tuple of them."""


_LINK = Option("--link", "Hard-link videos instead of copying them.", {"is_flag": True})

_AXES = Option(
    "--axes",
    "How the IMU is mounted, as in drive.toml: FRD, FLU, RFU ... or unknown.",
    {"default": "unknown", "show_default": True},
)

_NO_VIDEO = Option("--no-video", "Leave the images out.", {"is_flag": True})

KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "comma2k19",
            "pipeline.importers.comma2k19:import_comma2k19",
            "SEGMENT",
            "A segment of comma2k19.",
            """SEGMENT is the folder that holds processed_log and global_pose.

            IMU, live positions, the car's speed, the video where it is there, and the reference
            poses as truth. Tested on a segment of the data set.""",
        ),
        Kind(
            "gopro",
            "pipeline.importers.gopro:import_gopro",
            "VIDEO",
            "A GoPro's video with the IMU and positions inside it.",
            """VIDEO is the file as the camera wrote it (HERO5 and later, MAX); chapters that
            follow it in the same folder are found by their numbers.

            IMU and positions (GPS5, GPS9) come from the GPMF track, on the video's clock. Tested
            on a file of a MAX; GPS9 (HERO11 and later) and cameras without time stamps (HERO5)
            on made files only. A 360 video must be reframed before signs can be found in it.""",
            (_LINK,),
        ),
        Kind(
            "bearings",
            "pipeline.importers.bearings:import_bearings",
            "CSV",
            "Finished sightings: camera position, bearing, perhaps depth.",
            """CSV is a table with columns for latitude, longitude and bearing (degrees clockwise
            from north) of each sighting, and perhaps depth in metres, class and sd of the bearing
            in degrees; the usual other names (lat, lng, azimuth, distance) are understood.

            Tested on the sightings of Krylov, Kenny and Dahyot's street objects.""",
            (
                Option(
                    "--truth",
                    "Known positions, CSV or GeoJSON, for automap evaluate.",
                    {"type": ANY_PATH},
                ),
                Option(
                    "--truth-sd",
                    "Their own error in metres, one sigma.",
                    {"type": Finite(min=0), "default": 0.0},
                ),
            ),
        ),
        Kind(
            "rtklib",
            "pipeline.importers.rtklib:import_rtklib",
            "FOLDER",
            "A receiver's and an IMU's stream logged by RTKLIB with .tag time files.",
            """FOLDER holds the receiver's log (.ubx, .nmea), the IMU's lines (.csv, .txt), the
            .tag of each, and perhaps a .pos solution.

            The log stays as it is, arrival times come from its tag; the IMU's clock is put on
            that of the logging computer by the least delay. Fixed epochs of the solution become
            the truth. Tested on a walk with a u-blox receiver, logged by RTKLIB EX.""",
            (
                Option(
                    "--columns",
                    "Columns of the IMU's lines, - for one to pass over; time as t_s, t_ms, t_us "
                    "or t_ns.",
                    {"default": "ax,ay,az,gx,gy,gz,t_ms", "show_default": True},
                ),
                Option(
                    "--accel-unit",
                    "Unit of the accelerometer.",
                    {"default": "g", "show_default": True, "type": _choice("m/s^2", "g")},
                ),
                Option(
                    "--gyro-unit",
                    "Unit of the gyro.",
                    {"default": "deg/s", "show_default": True, "type": _choice("rad/s", "deg/s")},
                ),
                _AXES,
            ),
        ),
        Kind(
            "rosbag",
            "pipeline.importers.rosbag:import_rosbag",
            "BAG...",
            "A ROS 1 bag or a ROS 2 recording (MCAP, SQLite).",
            """Each BAG is a .bag, an .mcap, or the folder of a ROS 2 recording; several are one
            drive.

            Read are sensor_msgs Imu, NavSatFix, CompressedImage or Image with CameraInfo,
            ublox_msgs NavPVT, gps_common GPSFix, NovAtel's positions, nmea_msgs Sentence and the
            velocity of a geometry_msgs TwistStamped. A topic that is not named is the one of its
            kind with most messages.

            Messages of other types are known by the names of their fields, and it is said which
            were taken; or say it:

            \b
            --map imu.gyro=/vectornav/imu:angularrate
            --map imu.accel=/vectornav/imu:accel[g]
            --map gnss.lat=/gps:latitude --map gnss.lon=/gps:longitude
            --map gnss.nmea=/gps:sentence

            Tested on bags written with the package rosbags and on three of a VectorNav and a
            serial receiver in a car.""",
            (
                Option("--imu-topic", "Topic of the IMU."),
                Option("--gnss-topic", "Topic of the receiver."),
                Option("--velocity-topic", "Topic of the receiver's velocity, east-north-up."),
                Option("--image-topic", "Topic of the camera."),
                Option(
                    "maps --map",
                    "Which field is which column of imu or gnss; may be given again.",
                    {"multiple": True, "metavar": "TABLE.COLUMN=TOPIC:FIELD[UNIT]"},
                ),
                Option(
                    "--map-file",
                    "The same as TOML: [imu] and [gnss], each with topic and COLUMN = FIELD.",
                    {"type": ANY_PATH},
                ),
                _NO_VIDEO,
                Option(
                    "--axes",
                    "How the IMU is mounted: FRD, RFU ... or unknown. Else FLU, as ROS has it, "
                    "for sensor_msgs/Imu with gravity that way, unknown for other types.",
                ),
            ),
            several=True,
        ),
        Kind(
            "kitti",
            "pipeline.importers.kitti:import_kitti",
            "FOLDER",
            "A drive of KITTI raw.",
            """FOLDER is DATE_drive_NNNN_sync or _extract; calib_*.txt of the day are looked for
            beside it.

            The OXTS unit's readings are the IMU, its poses the positions and the truth, image_02
            the video. Tested on a folder made in this layout, not on a download.""",
            (_NO_VIDEO,),
        ),
        Kind(
            "euroc",
            "pipeline.importers.euroc:import_euroc",
            "FOLDER",
            "A recording in the ASL format of EuRoC.",
            """FOLDER is mav0 or holds it.

            imu0, cam0 and, where there is one, gps0 (stamp, latitude, longitude, altitude).
            Without gps0 there is nothing to make a map of, and automap check says so. Tested on
            a folder made in this layout, not on a download.""",
            (_AXES, _NO_VIDEO),
        ),
        Kind(
            "sensor-logger",
            "pipeline.importers.phone:import_sensor_logger",
            "FOLDER|ZIP",
            "A phone's recording by Sensor Logger.",
            """FOLDER|ZIP is the exported recording with its CSV files.

            Gyroscope; TotalAcceleration, AccelerometerUncalibrated or Accelerometer with Gravity;
            Location. Tested on an archive of a phone in a car and on made files.""",
            (_AXES,),
        ),
        Kind(
            "gnss-logger",
            "pipeline.importers.phone:import_gnss_logger",
            "LOG",
            "An Android phone's log by Google's GnssLogger.",
            """LOG is a gnss_log_*.txt with fixes and sensors switched on.

            Accel, Gyro (the uncalibrated ones where they are there) and Fix lines of the GPS
            provider; raw measurements are not used. Tested on a log of a Pixel and on made
            files.""",
            (_AXES,),
        ),
        Kind(
            "openpilot",
            "pipeline.importers.openpilot:import_openpilot",
            "SEGMENT",
            "A segment of openpilot in the form of comma2k19.",
            """SEGMENT is a folder with processed_log and global_pose.

            rlog and qlog themselves are not read: they need openpilot's own schema, of which
            there is no package that is kept up. Tested on a segment of comma2k19.""",
        ),
        Kind(
            "mapillary",
            "pipeline.importers.mapillary:import_mapillary",
            "FOLDER",
            "A sequence of images with EXIF places and times.",
            """FOLDER holds the .jpg images of one sequence.

            EXIF GPS tags, or the description that mapillary_tools writes. There is no IMU, so the
            path is that of the places. Tested on made images, not on a camera's.""",
        ),
    )
}
