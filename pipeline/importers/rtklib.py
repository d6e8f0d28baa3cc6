"""An RTKLIB recording with time tags as a drive folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.io import names
from automap.io.atomic import make_folder, write_text
from automap.io.toml_file import toml_value
from pipeline.importers.level_axes import SLOW, is_slow, level_axes
from pipeline.importers.parts import write_arrival, write_csv
from pipeline.importers.target import Import, new_drive

if TYPE_CHECKING:
    from automap.io.rtklib_recording import RtklibFiles
    from automap.records import Fixes

_GEOID_AGREES_M = 1.0


def import_rtklib(
    source: Path,
    out: Path,
    columns: str = "ax,ay,az,gx,gy,gz,t_ms",
    accel_unit: str = "g",
    gyro_unit: str = "deg/s",
    axes: str = "unknown",
) -> list[str]:
    """Write the RTKLIB recording in the folder ``source`` as the drive ``out``.

    ``columns`` names those of the IMU's log. Stream and solution stay as they are; where there
    are both, the solution's fixed epochs are the truth. Returns warnings.
    """
    from automap.io.rtklib_recording import find_files

    with new_drive("rtklib", source, out) as run:
        files = find_files(run.source)
        run.sources += [
            path
            for path in (
                files.receiver,
                files.receiver_tag,
                files.imu,
                files.imu_tag,
                files.solution,
            )
            if path is not None
        ]
        names_of = [name.strip() for name in columns.split(",")]
        receiver, slow = _write_receiver(run, files)
        sections = _write_imu(run, files, names_of, accel_unit, gyro_unit, axes, slow)
        run.write_manifest(sections + receiver, _notes(files))
    return run.warnings


def _write_imu(
    run: Import,
    files: RtklibFiles,
    columns: list[str],
    accel_unit: str,
    gyro_unit: str,
    axes: str,
    slow: bool,
) -> str:
    """``imu.csv`` and its section; ``slow``: no vehicle moved, so motion cannot tell the axes."""
    from automap.io.rtklib_recording import line_arrivals, read_imu_lines, read_tag
    from automap.sync.logger_clock import on_logger_clock

    if files.imu is None:
        run.warn(f"{run.source}: no IMU log (.csv, .txt); the drive has positions alone")
        return ""
    lines = read_imu_lines(files.imu, columns)
    if lines.left_out:
        run.warn(f"{files.imu}: {lines.left_out} lines that are cut off or no numbers left out")
    tag = read_tag(files.imu_tag)
    t_ns = lines.stamp_ns
    if tag is None:
        run.warn(
            f"{files.imu} has no .tag file; its stamps are the IMU's own clock, and the drive is "
            "put together by its motion"
        )
    else:
        arrival_ns = line_arrivals(lines, tag, files.imu)
        try:
            t_ns = on_logger_clock(lines.stamp_ns, arrival_ns)
        except InputError as error:
            raise InputError(f"{files.imu}: {error}") from None
    write_csv(
        run.folder / "imu.csv",
        ("t_ns", "gx", "gy", "gz", "ax", "ay", "az"),
        t_ns,
        lines.readings,
    )
    if axes == "unknown" and slow:
        axes = level_axes(lines.readings[:, 3:]) or axes
        if axes != "unknown":
            run.warn(f"{files.imu}: {SLOW.format(axes=axes)}")
    return (
        f'[imu]\nfile = "imu.csv"\naxes = {toml_value(axes)}\ntime = "boot_ns"\n'
        f"gyro_unit = {toml_value(gyro_unit)}\naccel_unit = {toml_value(accel_unit)}\n"
    )


def _write_receiver(run: Import, files: RtklibFiles) -> tuple[str, bool]:
    """The log and its section, and whether it shows no speed of a vehicle."""
    from automap.io.receiver import read_receiver_log
    from automap.io.rtklib_recording import read_tag

    if files.receiver is None:
        assert files.solution is not None
        shutil.copyfile(files.solution, run.folder / "gnss.pos")
        return '\n[gnss]\nfile = "gnss.pos"\n', is_slow(read_receiver_log(files.solution).fixes)
    log = read_receiver_log(files.receiver)
    name = f"gnss.{'nmea' if log.kind == 'nmea' else 'ubx'}"
    shutil.copyfile(files.receiver, run.folder / name)
    sections = f'\n[gnss]\nfile = "{name}"\n'
    tag = read_tag(files.receiver_tag)
    if tag is None:
        run.warn(f"{files.receiver} has no .tag file; when its bytes came is not known")
    else:
        inside = tag.offset < files.receiver.stat().st_size
        write_arrival(run, tag.offset[inside], tag.t_ns[inside])
        sections += 'arrival = "gnss_arrival.csv"\narrival_time = "boot_ns"\n'
    if files.solution is not None:
        solution = read_receiver_log(files.solution).fixes
        _write_truth(run, files.solution, solution, log.fixes)
    return sections, is_slow(log.fixes)


def _write_truth(run: Import, path: Path, solution: Fixes, live: Fixes) -> None:
    """The solution's fixed epochs as truth of the antenna, heights above the ellipsoid."""
    from automap.records import FixType

    fixed = np.flatnonzero(solution.fix_type == FixType.FIXED)
    if len(fixed) == 0:
        run.warn(f"{path}: no epoch is fixed, so the drive has no truth")
        return
    height = solution.height_m[fixed] + _geoid_shift(run, path, solution, live)
    columns = np.column_stack(
        [
            np.degrees(solution.lat_rad[fixed]),
            np.degrees(solution.lon_rad[fixed]),
            height,
            solution.vel_ned[fixed],
        ]
    )
    # t_ns is not known of a solution; the truth goes by GPS time
    rows = (
        f"{gps:.6f},{r[0]:.10f},{r[1]:.10f},"
        + ",".join(f"{v:.4f}" if np.isfinite(v) else "" for v in r[2:])
        for gps, r in zip(solution.gps_s[fixed].tolist(), columns.tolist(), strict=True)
    )
    folder = make_folder(run.folder / names.TRUTH_DIR)
    text = "gps_s,lat_deg,lon_deg,height_m,vn,ve,vd\n" + "\n".join(rows) + "\n"
    write_text(folder / names.TRUTH_TRAJECTORY, text)


def _geoid_shift(run: Import, path: Path, solution: Fixes, live: Fixes) -> float:
    """What takes the solution's heights to the ellipsoid; some programs write those above the
    sea without saying so, which the receiver's own heights give away."""
    at = np.interp(solution.gps_s, live.gps_s, live.height_m)
    offset = float(np.nanmedian(solution.height_m - at)) if len(live) else float("nan")
    known = np.isfinite(live.geoid_sep_m)
    if not known.any() or not np.isfinite(offset):
        return 0.0
    separation = float(np.median(live.geoid_sep_m[known]))
    if abs(separation) > 2.0 * _GEOID_AGREES_M and abs(offset + separation) < _GEOID_AGREES_M:
        run.warn(
            f"{path}: its heights are above the sea; the truth's are brought to the ellipsoid by "
            f"the receiver's separation of {separation:.2f} m"
        )
        return separation
    return 0.0


def _notes(files: RtklibFiles) -> list[str]:
    notes = [
        "Times are ticks of the computer that logged the streams.",
        "imu.csv            the IMU's lines; their own clock put on the computer's by the least",
        "                   delay of their arrival.",
        "gnss_arrival.csv   from the receiver's .tag file.",
    ]
    if files.receiver is not None and files.solution is not None:
        notes.append("truth/             fixed epochs of the .pos solution: of the antenna.")
    return notes
