"""The files and sections of the drive folder that an import writes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from automap.io import names
from automap.io.atomic import make_folder, write_text
from automap.io.axes import axes_matrix
from automap.io.toml_file import toml_value
from pipeline.importers.target import Import


def write_csv(
    path: Path,
    header: Sequence[str],
    t_ns: np.ndarray[Any, Any],
    values: np.ndarray[Any, Any],
    formats: Sequence[str] | str = ".9g",
) -> None:
    """A table with stamps [n], ns or seconds, in the first column and floats [n, k] beside them.

    ``formats`` is one format for all columns or one for each. What is not finite stays empty.
    """
    whole = np.issubdtype(t_ns.dtype, np.integer)
    columns = [[str(t) if whole else f"{t:.6f}" for t in t_ns.tolist()]]
    values = values.reshape(len(t_ns), -1)
    each = [formats] * values.shape[1] if isinstance(formats, str) else list(formats)
    for column, form in zip(values.T.tolist(), each, strict=True):
        columns.append([format(v, form) if v - v == 0.0 else "" for v in column])
    rows = "\n".join(map(",".join, zip(*columns, strict=True)))
    write_text(path, ",".join(header) + "\n" + rows + ("\n" if rows else ""))


IMU_HEADER = ("t_ns", "gx", "gy", "gz", "ax", "ay", "az")


def write_imu(
    run: Import,
    t_ns: np.ndarray[Any, Any],
    gyro: np.ndarray[Any, Any],
    accel: np.ndarray[Any, Any],
) -> None:
    """``imu.csv`` from stamps [n], rad/s and m/s^2 [n, 3]."""
    write_csv(run.folder / "imu.csv", IMU_HEADER, t_ns, np.column_stack([gyro, accel]))


def write_arrival(run: Import, offset: np.ndarray[Any, Any], t_ns: np.ndarray[Any, Any]) -> None:
    """``gnss_arrival.csv``: the byte [n] where a message starts and when it came."""
    rows = zip(offset.tolist(), t_ns.tolist(), strict=True)
    text = "offset,t_ns\n" + "".join(f"{at},{t}\n" for at, t in rows)
    write_text(run.folder / "gnss_arrival.csv", text)


def copy_or_link(source: Path, target: Path, link: bool) -> None:
    """Put a large file into the drive: a copy, or as ``link`` a second name of the same file, which
    needs no room and leads nowhere. On another disk a file has no second name and is copied."""
    if link:
        with suppress(OSError):
            os.link(source.resolve(), target)
            return
    shutil.copyfile(source, target)


def write_frames(run: Import, t_ns: np.ndarray[Any, Any], camera: str = "front") -> None:
    """``video/NAME_frames.csv``: the stamp [n] of each frame."""
    rows = "".join(f"{frame},{t}\n" for frame, t in enumerate(t_ns.tolist()))
    write_text(run.folder / "video" / f"{camera}_frames.csv", "frame,t_ns\n" + rows)


def write_image_files(
    run: Import, images: Sequence[Path], t_ns: np.ndarray[Any, Any], camera: str = "front"
) -> str:
    """Image files [n] with their stamps [n] as ``video/NAME.mp4`` and its frames file.

    Returns the name of the video; raises InputError for a file that is no image, and for one
    of another size than the first.
    """
    from automap.io.image_video import as_jpeg, write_image_video

    def encoded() -> Iterator[tuple[int, bytes]]:
        for path, stamp in zip(images, t_ns.tolist(), strict=True):
            yield stamp, as_jpeg(path.read_bytes(), str(path))

    name = f"{camera}.mp4"
    write_image_video(make_folder(run.folder / "video") / name, encoded())
    write_frames(run, t_ns, camera)
    return name


def imu_section(axes: str, time: str = "boot_ns") -> str:
    """``[imu]`` of a file in rad/s and m/s^2; ConfigError for axes that there are not."""
    axes_matrix(axes)
    return (
        f'[imu]\nfile = "imu.csv"\naxes = {toml_value(axes)}\ntime = "{time}"\n'
        'gyro_unit = "rad/s"\naccel_unit = "m/s^2"\n'
    )


def gnss_section(file: str, arrival: str | None = None) -> str:
    """``[gnss]``, with the clock of the arrival times where there are any."""
    text = f'\n[gnss]\nfile = "{file}"\n'
    if arrival is not None:
        text += f'arrival = "gnss_arrival.csv"\narrival_time = "{arrival}"\n'
    return text


def video_section(
    file: str,
    time: str,
    size: tuple[int, int] | None = None,
    matrix: np.ndarray[Any, Any] | None = None,
    distortion: Sequence[float] = (),
    camera: str = "front",
    more: str = "",
) -> str:
    """``[video.NAME]`` of one file with a frames file; ``more`` are lines as they stand."""
    text = (
        f'\n[video.{camera}]\nfiles = ["video/{file}"]\n'
        f'frames = "video/{camera}_frames.csv"\ntime = "{time}"\n'
    )
    if size is not None:
        text += f"width = {size[0]}\nheight = {size[1]}\n"
    if matrix is not None:
        rows = ", ".join("[" + ", ".join(f"{v:.10g}" for v in row) + "]" for row in matrix)
        text += f"camera_matrix = [{rows}]\n"
    if len(distortion):
        text += "distortion = [" + ", ".join(f"{v:.10g}" for v in distortion) + "]\n"
    return text + more


def write_truth(
    run: Import,
    time: str,
    stamps: np.ndarray[Any, Any],
    lat_lon_height: np.ndarray[Any, Any],
    vel_ned: np.ndarray[Any, Any],
    rpy_deg: np.ndarray[Any, Any] | None,
    file: Path | None = None,
) -> None:
    """``truth/trajectory.csv`` (or ``file``) from stamps ``t_ns`` or ``gps_s`` [n], degrees and
    m [n, 3], m/s [n, 3] and degrees [n, 3]."""
    columns = [lat_lon_height, vel_ned] + ([] if rpy_deg is None else [rpy_deg])
    names_of = ["lat_deg", "lon_deg", "height_m", "vn", "ve", "vd"]
    names_of += [] if rpy_deg is None else ["roll_deg", "pitch_deg", "yaw_deg"]
    formats = [".10f", ".10f"] + [".4f"] * (len(names_of) - 2)
    path = file or run.folder / names.TRUTH_DIR / names.TRUTH_TRAJECTORY
    write_csv(path, (time, *names_of), stamps, np.column_stack(columns), formats)
