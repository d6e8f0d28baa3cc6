"""Small drives in the formats of published data sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from import_sources import FIX_NS, IMAGE_NS, IMU_NS, N_FIX, N_IMAGE, SPEED, force, gyro, place, png


def write_kitti(folder: Path) -> Path:
    """A drive of KITTI raw with calibration beside it; the folder of the drive."""
    drive = folder / "2011_09_26" / "2011_09_26_drive_0001_sync"
    data = drive / "oxts" / "data"
    data.mkdir(parents=True)
    yaw = np.pi / 4.0
    lines = []
    for i in range(N_FIX):
        lat, lon, height = place(i)
        half = SPEED * np.sqrt(0.5)
        row = [lat, lon, height, 0.02, -0.03, yaw, half, half, SPEED, 0.0, 0.1]
        row += [*force(i), *force(i), *gyro(i), *gyro(i), 0.05, 0.02, 4, 9, 6, 6, 0]
        (data / f"{i:010d}.txt").write_text(" ".join(str(v) for v in row))
        lines.append(f"2011-09-26 13:02:{25.0 + 0.2 * i:012.9f}")
    (drive / "oxts" / "timestamps.txt").write_text("\n".join(lines) + "\n")
    images = drive / "image_02" / "data"
    images.mkdir(parents=True)
    for i in range(N_IMAGE):
        (images / f"{i:010d}.png").write_bytes(png(i))
    stamps = "\n".join(lines[:N_IMAGE]) + "\n"
    (drive / "image_02" / "timestamps.txt").write_text(stamps)
    identity = "1 0 0 0 1 0 0 0 1"
    day = drive.parent
    (day / "calib_cam_to_cam.txt").write_text(
        f"R_rect_00: {identity}\nP_rect_02: 700 0 32 70 0 700 24 0 0 0 1 0\n"
    )
    # camera x right, y down, z forward; the laser x forward, y left, z up
    (day / "calib_velo_to_cam.txt").write_text("R: 0 -1 0 0 0 -1 1 0 0\nT: 0 0 -0.3\n")
    (day / "calib_imu_to_velo.txt").write_text(f"R: {identity}\nT: -0.8 0.3 -0.8\n")
    return drive


def write_euroc(folder: Path, gps: bool = True) -> Path:
    """A recording in the ASL format; the folder that holds mav0."""
    root = folder / "mav0"
    for name in ("imu0", "cam0/data", "gps0"):
        (root / name).mkdir(parents=True)
    rows = [f"{t}," + ",".join(map(str, [*gyro(i), *force(i)])) for i, t in enumerate(IMU_NS)]
    head = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n"
    (root / "imu0/data.csv").write_text(head + "\n".join(rows))
    lines = (", ".join("1.0" if i == j else "0.0" for j in range(4)) for i in range(4))
    identity = f"[{(',' + chr(10) + ' ').join(lines)}]"
    transform = f"T_BS:\n  cols: 4\n  rows: 4\n  data: {identity}\n"
    (root / "imu0/sensor.yaml").write_text(transform)
    for i in range(N_IMAGE):
        (root / f"cam0/data/{IMAGE_NS[i]}.png").write_bytes(png(i))
    listing = "".join(f"{t},{t}.png\r\n" for t in IMAGE_NS)
    (root / "cam0/data.csv").write_text("#timestamp [ns],filename\r\n" + listing, newline="")
    (root / "cam0/sensor.yaml").write_text(
        transform + "intrinsics: [458.6, 457.3, 31.5, 23.5] #fu, fv, cu, cv\n"
        "distortion_model: radial-tangential\n"
        "distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n"
    )
    if gps:
        fixes = [f"{FIX_NS[i]}," + ",".join(f"{v:.9f}" for v in place(i)) for i in range(N_FIX)]
        (root / "gps0/data.csv").write_text("#timestamp,lat,lon,alt\n" + "\n".join(fixes))
    return folder
