"""A short drive that is in order, and the ways in which drives come broken."""

from __future__ import annotations

import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

from tests.unit.input_drive import BOOT_NS, RATE_HZ, write_drive

Break = Callable[[Path], None]

SECONDS = 30
_VIDEO = """
[video.front]
frames = "video/front_frames.csv"
detections = "video/front_detections.csv"
width = 1280
height = 720
camera_matrix = [[1000.0, 0.0, 639.5], [0.0, 1000.0, 359.5], [0.0, 0.0, 1.0]]
"""


def write_short_drive(folder: Path) -> Path:
    """Half a minute: IMU, NMEA with arrival times, ten boxes of a sign; returns the folder."""
    write_drive(folder, 'file = "imu.csv"', 'file = "gnss.nmea"\narrival = "gnss_arrival.csv"')
    _edit(folder / "imu.csv", lambda rows: rows[: 1 + SECONDS * RATE_HZ])
    _edit(folder / "gnss.nmea", lambda rows: rows[: 2 * SECONDS])
    _edit(folder / "gnss_arrival.csv", lambda rows: rows[: 1 + SECONDS])
    video = folder / "video"
    video.mkdir()
    frames = [f"{n},{BOOT_NS + 10_000_000_000 + n * 100_000_000}" for n in range(10)]
    (video / "front_frames.csv").write_text("\n".join(["frame,t_ns", *frames]) + "\n")
    boxes = [f"{n},stop,{700 + 9 * n},250,{730 + 11 * n},280,0.9" for n in range(10)]
    header = "frame,class,x_min,y_min,x_max,y_max,score"
    (video / "front_detections.csv").write_text("\n".join([header, *boxes]) + "\n")
    manifest = folder / "drive.toml"
    manifest.write_text(manifest.read_text() + _VIDEO)
    return folder


def _edit(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    # newline as it is: offsets of arrival times count these bytes
    text = path.read_bytes().decode()
    end = "\r\n" if "\r\n" in text else "\n"
    path.write_bytes((end.join(change(text.split(end)[:-1])) + end).encode())


def rows(name: str, change: Callable[[list[str]], list[str]]) -> Break:
    """Change the lines of a file."""
    return lambda drive: _edit(drive / name, change)


def cells(name: str, columns: str, change: Callable[[str], str]) -> Break:
    """Change the cells of some columns."""

    def edit(lines: list[str]) -> list[str]:
        at = [lines[0].split(",").index(column) for column in columns.split()]
        table = [line.split(",") for line in lines]
        for row in table[1:]:
            for column in at:
                row[column] = change(row[column])
        return [",".join(row) for row in table]

    return rows(name, edit)


def times(factor: float) -> Callable[[str], str]:
    """A number multiplied."""
    return lambda cell: f"{float(cell) * factor:.9g}"


def later(seconds: float) -> Callable[[str], str]:
    """A stamp in nanoseconds moved on."""
    return lambda cell: str(int(cell) + round(seconds * 1e9))


def second_half_later(seconds: float) -> Callable[[list[str]], list[str]]:
    """The stamps in the last column of the second half moved on."""

    def edit(lines: list[str]) -> list[str]:
        half = len(lines) // 2
        moved = (line.rsplit(",", 1) for line in lines[half:])
        return lines[:half] + [f"{first},{later(seconds)(last)}" for first, last in moved]

    return edit


def content(name: str, data: bytes) -> Break:
    """Replace the whole of a file."""

    def change(drive: Path) -> None:
        (drive / name).write_bytes(data)

    return change


def cut(name: str, share: float = 0.6) -> Break:
    """Keep the first part of a file, to the middle of a line or message."""

    def change(drive: Path) -> None:
        data = (drive / name).read_bytes()
        (drive / name).write_bytes(data[: int(share * len(data)) + 7])

    return change


def noise(name: str) -> Break:
    """Bytes that mean nothing."""
    return content(name, random.Random(1).randbytes(5000))


def without(name: str, *words: str) -> Break:
    """Remove a file or folder, and the manifest's lines that hold one of the words."""

    def change(drive: Path) -> None:
        path = drive / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()
        if words:
            keep = lambda line: not any(word in line for word in words)  # noqa: E731
            _edit(drive / "drive.toml", lambda lines: [line for line in lines if keep(line)])

    return change


def manifest(old: str, new: str) -> Break:
    """Replace a piece of the manifest."""

    def change(drive: Path) -> None:
        text = (drive / "drive.toml").read_text()
        assert old in text
        (drive / "drive.toml").write_text(text.replace(old, new))

    return change


def both(*changes: Break) -> Break:
    """Several changes in turn."""

    def change(drive: Path) -> None:
        for each in changes:
            each(drive)

    return change


def wrong_checksums(every: int) -> Break:
    """A checksum in so many is replaced."""

    def change(drive: Path) -> None:
        count = 0

        def replace(match: re.Match[bytes]) -> bytes:
            nonlocal count
            count += 1
            wrong = b"*%02X" % (int(match.group(1), 16) ^ 0xFF)
            return wrong if count % every == 0 else match.group(0)

        path = drive / "gnss.nmea"
        path.write_bytes(re.sub(rb"\*([0-9A-F]{2})", replace, path.read_bytes()))

    return change


def sentences(change: Callable[[list[str]], list[str]]) -> Break:
    """Change the fields of every sentence, and set its checksum right; the length stays."""

    def edit(lines: list[str]) -> list[str]:
        changed = []
        for line in lines:
            body = ",".join(change(line[1:].split("*")[0].split(",")))
            checksum = 0
            for character in body.encode():
                checksum ^= character
            changed.append(f"${body}*{checksum:02X}")
            assert len(changed[-1]) == len(line)
        return changed

    return rows("gnss.nmea", edit)


def no_fix(fields: list[str]) -> list[str]:
    """The status of a receiver that sees no satellites."""
    if fields[0].endswith("GGA"):
        fields[6] = "0"
    else:
        fields[2] = "V"
        fields[-1] = "N"
    return fields


def finished_trajectory(header: str = "t_ns,lat_deg,lon_deg,height_m") -> Break:
    """A trajectory of other software in place of the recordings."""

    def change(drive: Path) -> None:
        for name in ("imu.csv", "gnss.nmea", "gnss_arrival.csv"):
            (drive / name).unlink()
        text = (drive / "drive.toml").read_text()
        (drive / "drive.toml").write_text('schema = "automap.drive/1"\n' + _VIDEO)
        assert "[video.front]" in text
        points = (
            f"{BOOT_NS + n * 100_000_000},{-35.0 + 1e-5 * n:.6f},149.0,600.0" for n in range(300)
        )
        (drive / "trajectory.csv").write_text("\n".join([header, *points]) + "\n")

    return change


def bearings(text: str) -> Break:
    """Finished sightings in place of everything else."""

    def change(drive: Path) -> None:
        shutil.rmtree(drive)
        drive.mkdir()
        (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
        (drive / "bearings.csv").write_text(text)

    return change
