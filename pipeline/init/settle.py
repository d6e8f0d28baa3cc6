"""What the names of columns do not tell and the readings do: units, clock, axes."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import AutoMapError
from automap.evaluation import limits, plausibility
from automap.io import names
from automap.io.axes import axes_value
from automap.io.drive import Drive, load_drive
from automap.io.fix_table import read_fix_table
from automap.io.named_table import look_at_table
from automap.io.odometer_csv import read_odometer_csv
from automap.io.recording import Recording, read_recording
from automap.io.table_form import TIME_ROLES
from automap.io.table_units import UNITS
from automap.io.trust import allowing
from automap.records import FloatArray
from automap.timebase import gps_to_unix, unix_to_gps
from pipeline.check.axes import SCALE_CODE, WeighedAxes, seen_motion, weigh_axes
from pipeline.check.same_drive import usable_receiver
from pipeline.importers.level_axes import SLOW, is_slow, level_axes
from pipeline.init.dates import settle_dates
from pipeline.init.draft import AS_UTC, Draft
from pipeline.init.video_start import ZONES_H, start_videos

_UNDATED_S = 7e8
"""GPS time of 2002: times of fixes that tell no date count from the beginning of 1980."""

_RATES = ("rad/s", "deg/s", "mrad/s", "mdeg/s")
"""Units of turn rates, the largest first: in one that is too large no car turns so fast."""


def settle(draft: Draft) -> None:
    """Read the recordings as the draft says and put in what they show.

    A file that cannot be read leaves the draft as it is; ``check`` says why.
    """
    if draft.get("imu", "file") is None:
        _videos(draft)
        _fix_units(draft)
        return
    _accel_unit(draft)
    settle_dates(draft, _apart_s)
    _clock(draft)
    _videos(draft)
    _wheels(draft)
    _fix_units(draft)
    weighed = _gyro_unit(draft)
    if weighed is not None:
        _axes(draft, *weighed)


def _read(draft: Draft) -> tuple[Drive, Recording] | None:
    """The recordings by the draft, None where they cannot be read."""
    with tempfile.TemporaryDirectory() as folder:
        manifest = Path(folder) / names.MANIFEST
        manifest.write_text(draft.manifest("draft", absolute=True), encoding="utf-8")
        try:
            # the draft lies elsewhere, and only files that were looked at are in it
            with allowing([draft.folder]):
                drive = load_drive(folder)
            recording = read_recording(drive)
        except AutoMapError:
            return None
    return drive, recording


def _accel_unit(draft: Draft) -> None:
    """The unit in which gravity is gravity."""
    read = None if draft.get("imu", "accel_unit") else _read(draft)
    if read is None or read[1].imu is None:
        return
    size = float(np.median(np.linalg.norm(read[1].imu.accel, axis=1)))
    for unit, factor in UNITS["acceleration"].items():
        if abs(size * factor / STANDARD_GRAVITY - 1.0) < limits.GRAVITY_TOLERANCE:
            # mg and cm/s^2 are 2 % apart, less than many sensors err: the usual ones come first
            draft.set("imu", "accel_unit", unit, f"readings are {size:.4g} long, as gravity is")
            return


def _apart_s(draft: Draft) -> float | None:
    """By how many s readings and fixes that have dates miss one another, 0 where they meet."""
    read = _read(draft)
    imu, fixes = (None, None) if read is None else (read[1].imu, read[1].fixes)
    if imu is None or fixes is None or draft.get("imu", "time") != "unix_ns":
        return None
    seconds = np.asarray(unix_to_gps(imu.t_ns[[0, -1]] * 1e-9), np.float64)
    dated = fixes.gps_s[fixes.gps_s > _UNDATED_S]
    if len(dated) < 2:
        return None
    return max(0.0, float(dated.min() - seconds[1]), float(seconds[0] - dated.max()))


def _clock(draft: Draft) -> None:
    """The clock of the stamps, by where the fixes lie, unless arrival times tie the two."""
    read = _read(draft)
    if read is None or draft.get("gnss", "arrival_time") is not None:
        return
    _, recording = read
    imu, fixes = recording.imu, recording.fixes
    dated = np.zeros(0) if fixes is None else fixes.gps_s[np.isfinite(fixes.gps_s)]
    if imu is None or len(dated) < 2:
        return
    span = np.array([dated.min(), dated.max()])
    seconds = np.asarray(imu.t_ns * 1e-9, np.float64)
    if span[1] < _UNDATED_S:
        if plausibility.overlap_s(seconds, span) > 0.0:
            draft.set("gnss", "arrival_time", "boot_ns", "its times are of the readings' clock")
        return
    shared = {
        "unix_ns": plausibility.overlap_s(unix_to_gps(seconds), span),
        "gps_ns": plausibility.overlap_s(seconds, span),
    }
    best = max(shared, key=lambda clock: shared[clock])
    if shared[best] > 0.0:
        why = f"so its stamps and the fixes overlap, for {shared[best]:.0f} s"
        draft.set("imu", "time", best, why)
        for section, other in (("imu", "gnss"), ("gnss", "imu")):
            told = draft.get(section, "utc_offset_h") is not None
            if told and draft.get(other, "utc_offset_h") is None:
                draft.set(section, "utc_offset_h", 0, why)
    elif draft.get("imu", "utc_offset_h") is not None:
        _zone(draft, "imu", unix_to_gps(seconds), span)
    elif draft.get("gnss", "utc_offset_h") is not None:
        clock = draft.get("imu", "time")
        if clock in ("unix_ns", "gps_ns"):
            _zone(draft, "gnss", span, unix_to_gps(seconds) if clock == "unix_ns" else seconds)


def _videos(draft: Draft) -> None:
    """When videos began, on the clock of the stamps."""
    read = _read(draft) if any(name.startswith("video.") for name in draft.sections) else None
    if read is None:
        return
    imu, fixes = read[1].imu, read[1].fixes
    clock = draft.get("imu", "time")
    if imu is not None and clock in ("unix_ns", "gps_ns"):
        seconds = np.asarray(imu.t_ns * 1e-9, np.float64)
    else:
        # a count of the readings that begins anywhere has its date from the fixes, as a path of
        # fixes alone has
        clock = "gps_ns"
        seconds = np.zeros(0) if fixes is None else fixes.gps_s[np.isfinite(fixes.gps_s)]
        seconds = seconds[seconds > _UNDATED_S]
    if len(seconds) > 1:
        span = np.array([seconds.min(), seconds.max()])
        start_videos(draft, span if clock == "unix_ns" else gps_to_unix(span))


def _wheels(draft: Draft) -> None:
    """The clock of the wheel speeds: one that the readings share, else dates and their zone, by
    where the fixes lie."""
    read = None if draft.get("odometer", "file") is None else _read(draft)
    if read is None or read[0].odometer_file is None or read[1].imu is None:
        return
    drive, recording = read
    wheels = _wheel_stamps(drive)
    if wheels is None:
        return
    if draft.get("odometer", "time") is None:
        assert recording.imu is not None
        imu_s = np.asarray(recording.imu.t_ns[[0, -1]] * 1e-9, np.float64)
        if plausibility.overlap_s(wheels, imu_s) > 0.0 or not _dated_wheels(draft, drive):
            return
        read = _read(draft)
        wheels = None if read is None else _wheel_stamps(read[0])
    if wheels is None or recording.fixes is None:
        return
    dated = recording.fixes.gps_s[np.isfinite(recording.fixes.gps_s)]
    if draft.get("odometer", "utc_offset_h") is not None and len(dated) > 1:
        _zone(draft, "odometer", unix_to_gps(wheels), dated)


def _wheel_stamps(drive: Drive) -> FloatArray | None:
    """Stamps [n] of the wheel speeds in s of their own clock."""
    assert drive.odometer_file is not None
    try:
        found = read_odometer_csv(drive.odometer_file, drive.manifest.odometer.form).data
    except AutoMapError:
        return None
    return np.asarray(found.t_ns * 1e-9, np.float64) if len(found) > 1 else None


def _dated_wheels(draft: Draft, drive: Drive) -> bool:
    """Read the wheel speeds by the dates beside their count, where there are any."""
    path = drive.odometer_file
    assert path is not None
    try:
        # fixes want a date where there is one
        guess = look_at_table(path, "gnss")
    except AutoMapError:
        return False
    time = guess.time
    if time is None or time.clock not in ("unix", "gps"):
        return False
    columns = {k: v for k, v in draft.get("odometer", "columns").items() if k not in TIME_ROLES}
    columns |= {k: v for k, v in guess.form.columns.items() if k in TIME_ROLES}
    why = "the count beside them is of no clock that the readings have"
    draft.set("odometer", "columns", columns, why)
    draft.set("odometer", "time", f"{time.clock}_ns", "its stamps have a date")
    draft.set("odometer", "time_format", time.spelled, "by what the times look like")
    if time.is_local:
        draft.set("odometer", "utc_offset_h", 0, AS_UTC)
    return True


def _zone(draft: Draft, section: str, gps_s: FloatArray, other_s: FloatArray) -> None:
    """The hours by which the dates of a section [n] are ahead of UTC, where with them they meet
    others [k] that are in it."""
    span = np.array([other_s.min(), other_s.max()])
    both = {float(hours): plausibility.overlap_s(gps_s - 3600.0 * hours, span) for hours in ZONES_H}
    hours = max(both, key=lambda each: both[each])
    if hours and both[hours] > 0.5 * min(np.ptp(gps_s), np.ptp(span)):
        what = "the readings" if section == "gnss" else "the fixes"
        why = f"dates are not in UTC: so they and {what} overlap, for {both[hours]:.0f} s"
        draft.set(section, "utc_offset_h", hours, why)


def _fix_units(draft: Draft) -> None:
    """The units of a table of fixes that its numbers tell."""
    read = None if draft.get("gnss", "columns") is None else _read(draft)
    if read is None or read[0].gnss_file is None:
        return
    try:
        found = read_fix_table(read[0].gnss_file, read[0].gnss.form).units
    except AutoMapError:
        return
    if found:
        units = (draft.get("gnss", "units") or {}) | dict(found)
        draft.set("gnss", "units", units, "the names tell some at most, the numbers the rest")


def _gyro_unit(draft: Draft) -> tuple[Recording, WeighedAxes] | None:
    """The unit in which the gyro turns as the course does; what was seen in it."""
    told = draft.get("imu", "gyro_unit")
    seen: dict[str, tuple[Recording, WeighedAxes]] = {}
    for unit in (told,) if told else _RATES:
        if not told:
            draft.set(
                "imu", "gyro_unit", unit, "so turns are a car's, and the receiver's if it saw"
            )
        read = _read(draft)
        if read is None or read[1].imu is None:
            return None
        drive, recording = read
        fixes, clock, *_ = usable_receiver(drive, recording)
        weighed = weigh_axes(drive, recording, seen_motion(read[1].imu, fixes, clock))
        # speeds in a wrong unit do not say how fast the vehicle is
        seen[unit] = replace(recording, fixes=fixes), weighed
        scaled = any(f.code == SCALE_CODE for f in seen[unit][1].findings)
        assert recording.imu is not None
        fast = plausibility.gyro_size(recording.imu.gyro).severity != "ok"
        if not scaled and not fast:
            if not told:
                compared = "turns with" in seen[unit][1].findings[0].text
                why = "those of the receiver's course" if compared else "no faster than a car's"
                draft.set("imu", "gyro_unit", unit, f"its turns are then {why}")
            break
    else:
        # neither fits: as it is usual, and check says what it finds
        if not told:
            draft.set("imu", "gyro_unit", "rad/s", "nothing told it")
        unit = told or "rad/s"
    return seen[unit]


def _axes(draft: Draft, recording: Recording, weighed: WeighedAxes) -> None:
    """What gravity, turns and speed changes say of the axes."""
    imu, fixes = recording.imu, recording.fixes
    assert imu is not None
    if fixes is None:
        return
    if is_slow(fixes):
        axes = level_axes(imu.accel)
        if axes is not None:
            draft.set("imu", "axes", axes, SLOW.format(axes=axes))
        return
    said = weighed.findings[0].text.removesuffix(": mended for this drive")
    draft.set("imu", "axes", "unknown", said.removeprefix("axes unknown, "))
    if weighed.mended is not None:
        draft.set("imu", "axes", "unknown", "the mounting is estimated from the drive")
        for key, matrix in (
            ("accel_axes", weighed.mended.accel),
            ("gyro_axes", weighed.mended.gyro),
        ):
            if not np.allclose(matrix, np.eye(3)):
                draft.set("imu", key, axes_value(matrix).strip('"'), said)
