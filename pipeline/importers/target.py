"""The drive folder that an import writes: whole or not at all, with its lineage."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import struct
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from automap import __version__
from automap.errors import ConfigError, InputError
from automap.io import names
from automap.io.atomic import make_folder, write_failure, write_json, write_text

MARK = "# Made by automap import"
LINEAGE = "import.json"
SCHEMA = "automap.import/1"
_DAMAGE = (ValueError, KeyError, IndexError, TypeError, struct.error, EOFError, OverflowError)
"""What reading bytes that are not what they should be can end in."""
_EARLIER = ("truth", "video", "can_speed.csv")
"""What imports wrote before they kept a list of it."""


@dataclass
class Import:
    """An import under way: ``folder`` receives the files, ``sources`` are those read and
    ``warnings`` what the user should know, one sentence each."""

    kind: str
    source: Path
    out: Path
    folder: Path
    sources: list[Path] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def warn(self, text: str) -> None:
        """Keep a sentence for the user."""
        if text not in self.warnings:
            self.warnings.append(text)

    def write_manifest(self, sections: str, notes: Sequence[str] = ()) -> None:
        """Write ``drive.toml``: where it is from, ``notes`` on the files, then ``sections``."""
        head = [f"{MARK} {self.kind} from {_one_line(self.source.resolve().name)}", "#"]
        head += [f"# {note}".rstrip() for note in notes]
        body = f'schema = "automap.drive/1"\nname = {toml(self.out.name)}\n\n{sections.strip()}\n'
        write_text(self.folder / names.MANIFEST, "\n".join(head) + "\n" + body)


@contextmanager
def new_drive(kind: str, source: Path, out: Path) -> Iterator[Import]:
    """A folder to fill; on success it becomes ``out`` with its lineage, else nothing remains.

    Raises ConfigError when ``out`` holds anything but an earlier import, InputError when
    ``source`` does not exist, StageError when it cannot be written.
    """
    source, out = Path(source), Path(out)
    _check_target(out)
    if not source.exists():
        raise InputError(f"{source}: there is no such file or folder; check the path.")
    make_folder(out.parent)
    try:
        temporary = tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.")
    except OSError as error:
        raise write_failure(out, error) from error
    with temporary:
        folder = make_folder(Path(temporary.name) / "drive")
        run = Import(kind, source, out, folder)
        try:
            yield run
        except OSError as error:
            raise _reworded(error, run) from error
        except _DAMAGE as error:
            raise InputError(
                f"{source} cannot be imported as {kind}: it is damaged or of another kind "
                f"({type(error).__name__}: {error}); check that KIND is right and copy it again."
            ) from error
        try:
            _write_lineage(run)
            _move(folder, out)
        except OSError as error:
            raise _reworded(error, run) from error


def _reworded(error: OSError, run: Import) -> Exception:
    """A failed write is the target's fault, a failed read the source's."""
    named = Path(os.fsdecode(error.filename)) if error.filename else None
    if named is None or named.is_relative_to(run.folder.parent) or named.is_relative_to(run.out):
        return write_failure(run.out, error)
    return InputError(f"{named} cannot be read ({error.strerror}); check the file and its rights.")


def _check_target(out: Path) -> None:
    if not out.exists():
        return
    if not out.is_dir():
        raise ConfigError(f"{out} is a file; name a folder for the drive.")
    manifest = out / names.MANIFEST
    if manifest.is_file():
        with manifest.open(encoding="utf-8", errors="replace") as stream:
            if stream.readline().startswith(MARK):
                return
    if any(out.iterdir()):
        raise ConfigError(f"{out} is not empty and was not made by an import; name another folder.")


def _write_lineage(run: Import) -> None:
    written = [p for p in sorted(run.folder.rglob("*")) if p.is_file()]
    write_json(
        run.folder / LINEAGE,
        {
            "schema": SCHEMA,
            "kind": run.kind,
            "automap": __version__,
            "source": run.source.resolve().name,
            "source_files": [_described(path, run.source) for path in run.sources],
            "written": {str(p.relative_to(run.folder)): _digest(p) for p in written},
            "warnings": run.warnings,
        },
    )


def _described(path: Path, source: Path) -> dict[str, Any]:
    root = source if source.is_dir() else source.parent
    name = path.relative_to(root) if path.is_relative_to(root) else Path(path.name)
    return {"file": str(name), "bytes": path.stat().st_size, "sha256": _digest(path)}


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _move(folder: Path, out: Path) -> None:
    """Put the finished folder in its place; an earlier import's files give way, results stay."""
    if not out.exists():
        os.replace(folder, out)
        return
    for name in _written_before(out):
        old = out / name
        if old.is_dir() and not old.is_symlink():
            shutil.rmtree(old)
        else:
            old.unlink(missing_ok=True)
    # the manifest goes last: until then the old one marks the folder as ours
    for item in sorted(folder.rglob("*"), key=lambda path: path.name == names.MANIFEST):
        if item.is_file():
            target = out / item.relative_to(folder)
            make_folder(target.parent)
            os.replace(item, target)


def _written_before(out: Path) -> list[str]:
    """Files of the import that made ``out``, the manifest not among them."""
    try:
        written = json.loads((out / LINEAGE).read_text(encoding="utf-8"))["written"]
        found = [str(name) for name in written]
    except (OSError, ValueError, KeyError, TypeError):
        return list(_EARLIER)
    inside = [n for n in found if not Path(n).is_absolute() and ".." not in Path(n).parts]
    return [name for name in inside if name != names.MANIFEST]


def toml(text: str) -> str:
    """Text as a TOML basic string, which a JSON string is."""
    return json.dumps(text)


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)


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
    """Put a large file into the drive, as a copy or as a link to where it is."""
    if link:
        target.symlink_to(source.resolve())
    else:
        shutil.copyfile(source, target)


def write_frames(run: Import, t_ns: np.ndarray[Any, Any], camera: str = "front") -> None:
    """``video/NAME_frames.csv``: the stamp [n] of each frame."""
    rows = "".join(f"{frame},{t}\n" for frame, t in enumerate(t_ns.tolist()))
    write_text(run.folder / "video" / f"{camera}_frames.csv", "frame,t_ns\n" + rows)


def imu_section(axes: str, time: str = "boot_ns") -> str:
    """``[imu]`` of a file in rad/s and m/s^2."""
    return (
        f'[imu]\nfile = "imu.csv"\naxes = {toml(axes)}\ntime = "{time}"\n'
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
