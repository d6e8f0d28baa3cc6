"""A .zip of tables, as applications on phones export a recording."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Literal

from automap.errors import InputError
from automap.io import limits

TABLES = (".csv", ".tsv", ".tab", ".txt", ".dat", ".log")
GYROSCOPES = {"Gyroscope.csv", "GyroscopeUncalibrated.csv"}
"""Tables that Sensor Logger's recordings have, and other programs' as well."""
_LINE = 4096
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError)


def kind_of_archive(path: Path) -> Literal["sensor-logger", "tables"] | str:
    """What a .zip holds; where nothing of use is in it, a sentence that says so."""
    try:
        with zipfile.ZipFile(path) as archive:
            inside = _tables(archive)
            for info in inside:
                if Path(info.filename).name in GYROSCOPES:
                    with archive.open(info) as stream:
                        if is_of_sensor_logger(stream.read(_LINE)):
                            return "sensor-logger"
            others = [name for name in archive.namelist() if not name.endswith("/")]
    except _DAMAGE as error:
        return f"it is no whole .zip ({error or 'its end is missing'}); copy it again"
    if inside:
        return "tables"
    shown = ", ".join(Path(name).name for name in others[:6])
    return f"it holds no table but {shown}" if others else "it is empty"


def is_of_sensor_logger(head: bytes) -> bool:
    """Whether a table that begins so is one of Sensor Logger, whose columns are named like this."""
    first = head.decode("utf-8-sig", "replace").partition("\n")[0]
    return {"time", "x", "y", "z"} <= {name.strip().lower() for name in first.split(",")}


def begins(path: Path) -> bytes:
    """The first bytes of a file, its header among them."""
    with path.open("rb") as stream:
        return stream.read(_LINE)


def extract_tables(path: Path, folder: Path) -> None:
    """Put the tables of an archive into a folder, all of them side by side.

    Raises InputError where it is damaged or a table is larger than any recording.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            for info in _tables(archive):
                target = folder / Path(info.filename).name
                if target.exists():
                    target = folder / info.filename.replace("/", "-").replace("\\", "-")
                target.write_bytes(_unpacked(path, archive, info))
    except _DAMAGE as error:
        raise InputError(
            f"{path} is no whole .zip ({error or 'its end is missing'}); export it again."
        ) from error


def _unpacked(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    with archive.open(info) as stream:
        # a header may say less than is unpacked
        data = stream.read(limits.MAX_UNPACKED_BYTES + 1)
    if len(data) > limits.MAX_UNPACKED_BYTES:
        raise InputError(
            f"{path}: {Path(info.filename).name} unpacks to more than any recording; export it "
            "again."
        )
    return data


def _tables(archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    """The tables inside but for what a Mac puts beside them."""
    return [
        info
        for info in archive.infolist()
        if not info.is_dir()
        and Path(info.filename).suffix.lower() in TABLES
        and not Path(info.filename).name.startswith(".")
        and "__MACOSX" not in Path(info.filename).parts
    ]
