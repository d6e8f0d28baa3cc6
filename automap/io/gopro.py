"""What a GoPro keeps beside its video: IMU and positions on the camera's own clock."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.errors import InputError
from automap.io.gopro_positions import GoProPositions, join_positions, read_positions
from automap.io.gopro_streams import Channel, frame_zero_us, read_streams
from automap.io.gpmf import axis_order
from automap.records import FloatArray, IntArray

FRD_OF_CAMERA = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""C that takes the camera's X left, Y back, Z up to forward, right, down. As a MAX has it: its
Z reads +g upright, its Y +g sin(tilt) when the lens looks down."""


@dataclass(frozen=True)
class GoProRecording:
    """All chapters of a recording; times are nanoseconds of the video's own clock, its first
    frame at zero.

    ``accel`` m/s^2 and ``gyro`` rad/s [n, 3] at ``imu_t_ns``, in forward, right, down of the
    camera when ``axes_known``, else as stored. ``positions`` is None without a receiver.
    """

    device: str
    imu_t_ns: IntArray
    gyro: FloatArray
    accel: FloatArray
    axes_known: bool
    positions: GoProPositions | None
    counts: dict[str, int]
    warnings: tuple[str, ...]


def find_chapters(source: Path) -> list[Path]:
    """The files of one recording: ``source`` and the chapters that follow it in its folder.

    GoPro numbers them GX010042, GX020042 and on (GH, GS, GP and GL alike; the HERO5 begins with
    GOPR0042 and goes on with GP010042).
    """
    import re

    names = {path.name.upper(): path for path in source.parent.iterdir() if path.is_file()}
    match = re.fullmatch(r"(G[A-Z])(\d\d)(\d{4})(\..+)", source.name.upper())
    first = re.fullmatch(r"GOPR(\d{4})(\..+)", source.name.upper())
    if match:
        kind, number, video, suffix = match[1], int(match[2]), match[3], match[4]
    elif first:
        kind, number, video, suffix = "GP", 0, first[1], first[2]
    else:
        return [source]
    chapters = [source]
    while (following := f"{kind}{number + 1:02d}{video}{suffix}") in names:
        number += 1
        chapters.append(names[following])
    return chapters


def read_gopro(chapters: list[Path]) -> GoProRecording:
    """Read IMU and positions of the chapters; InputError names the file that has none."""
    warnings: list[str] = []
    parts = []
    start_us = 0.0
    for path in chapters:
        channels, device, length_us = read_streams(path, warnings)
        parts.append((path, channels, device, start_us, length_us))
        start_us += length_us
    imu = [_imu(path, channels, start, length) for path, channels, _, start, length in parts]
    t_ns = np.concatenate([one[0] for one in imu])
    gyro, accel = (np.concatenate([one[k] for one in imu]) for k in (1, 2))
    matrix = _camera_axes(parts[0][1]["ACCL"])
    known = matrix is not None
    if matrix is not None:
        gyro, accel = gyro @ matrix.T, accel @ matrix.T
        up = float(np.mean(accel[:, 2])) / max(float(np.mean(np.linalg.norm(accel, axis=1))), 1e-9)
        if up > -0.5:
            known = False
            warnings.append(
                f"{chapters[0]}: gravity is not along the camera's down axis, so it was mounted "
                'turned; the axes are left to be estimated (axes = "unknown")'
            )
    else:
        warnings.append(
            f"{chapters[0]}: the order of the IMU's axes is not in the file; they are left to be "
            'estimated (axes = "unknown")'
        )
    positions = [
        found
        for path, channels, _, start, length in parts
        if (found := read_positions(path, channels, start, length, warnings)) is not None
    ]
    keys = ("GPS9", "GPS5", "ACCL", "GYRO")
    counts = {
        key: sum(sum(len(b) for b in c[key].blocks) for _, c, *_ in parts if key in c)
        for key in keys
    }
    return GoProRecording(
        device=parts[0][2],
        imu_t_ns=t_ns,
        gyro=gyro,
        accel=accel,
        axes_known=known,
        positions=join_positions(positions) if positions else None,
        counts={key: n for key, n in counts.items() if n},
        warnings=tuple(warnings),
    )


def _imu(
    path: Path, channels: dict[str, Channel], start_us: float, length_us: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    accel, gyro = channels["ACCL"], channels["GYRO"]
    if accel.samples().shape[1] != 3 or gyro.samples().shape[1] != 3:
        raise InputError(f"{path}: its IMU samples have not three axes; it cannot be imported.")
    zero = frame_zero_us(channels)
    t_accel, t_gyro = accel.times_us(zero + length_us), gyro.times_us(zero + length_us)
    readings, turns = accel.samples(), gyro.samples()
    if len(t_accel) != len(t_gyro) or np.abs(t_accel - t_gyro).max() > 50.0:
        inside = (t_accel >= t_gyro[0]) & (t_accel <= t_gyro[-1])
        t_accel, readings = t_accel[inside], readings[inside]
        turns = np.column_stack([np.interp(t_accel, t_gyro, turns[:, k]) for k in range(3)])
    if len(t_accel) < 2:
        raise InputError(f"{path}: accelerometer and gyro share no time; it cannot be imported.")
    t_ns = np.rint((t_accel - zero + start_us) * 1e3).astype(np.int64)
    return t_ns, turns, readings


def _camera_axes(channel: Channel) -> FloatArray | None:
    """C from the stored order to forward, right, down; None where the file does not say."""
    stored = axis_order(channel.orin, "XYZ")
    return None if stored is None else FRD_OF_CAMERA @ stored
