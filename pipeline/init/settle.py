"""What the names of columns do not tell and the readings do: units, clock, axes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import AutoMapError
from automap.evaluation import limits, plausibility
from automap.io import names
from automap.io.axes import axes_value
from automap.io.drive import Drive, load_drive
from automap.io.recording import Recording, read_recording
from automap.io.table_units import UNITS
from automap.records import FloatArray
from automap.sync.velocity_consistency import velocity_consistency
from automap.timebase import unix_to_gps
from pipeline.check.axes import SCALE_CODE, WeighedAxes, weigh_axes
from pipeline.check.steadiness import usable_receiver
from pipeline.importers.level_axes import SLOW, is_slow, level_axes
from pipeline.init.draft import Draft

_ZONES_H = (-12.0, 14.25, 0.25)
"""The zones of the world and their steps, h."""


def settle(draft: Draft) -> None:
    """Read the recordings as the draft says and put in what they show.

    A file that cannot be read leaves the draft as it is; ``check`` says why.
    """
    if draft.get("imu", "file") is None:
        _speed_unit(draft)
        return
    _accel_unit(draft)
    _clock(draft)
    _speed_unit(draft)
    weighed = _gyro_unit(draft)
    if weighed is not None:
        _axes(draft, *weighed)


def _read(draft: Draft) -> tuple[Drive, Recording] | None:
    """The recordings by the draft, None where they cannot be read."""
    with tempfile.TemporaryDirectory() as folder:
        manifest = Path(folder) / names.MANIFEST
        manifest.write_text(draft.manifest("draft", absolute=True), encoding="utf-8")
        try:
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
            draft.set("imu", "accel_unit", unit, f"readings are {size:.4g} long, as gravity is")


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
    shared = {
        "unix_ns": plausibility.overlap_s(unix_to_gps(seconds), span),
        "gps_ns": plausibility.overlap_s(seconds, span),
    }
    best = max(shared, key=lambda clock: shared[clock])
    if shared[best] > 0.0:
        why = f"so its stamps and the fixes overlap, for {shared[best]:.0f} s"
        draft.set("imu", "time", best, why)
    elif draft.get("imu", "utc_offset_h") is not None:
        _zone(draft, seconds, span)


def _zone(draft: Draft, unix_s: FloatArray, span: FloatArray) -> None:
    """The hours by which dates of readings [n] are ahead of UTC, where they meet the fixes then."""
    both = {
        float(hours): plausibility.overlap_s(unix_to_gps(unix_s - 3600.0 * hours), span)
        for hours in np.arange(*_ZONES_H)
    }
    hours = max(both, key=lambda each: both[each])
    if both[hours] > 0.5 * min(np.ptp(unix_s), np.ptp(span)):
        why = f"dates are not in UTC: so they and the fixes overlap, for {both[hours]:.0f} s"
        draft.set("imu", "utc_offset_h", hours, why)


def _speed_unit(draft: Draft) -> None:
    """The unit in which a table's speeds are those of its positions."""
    columns, units = draft.get("gnss", "columns") or {}, draft.get("gnss", "units") or {}
    read = None if "speed" not in columns or "speed" in units else _read(draft)
    if read is None or read[1].fixes is None:
        return
    unit = velocity_consistency(read[1].fixes).unit
    if unit is not None and unit.expected == "m/s" and unit.logged in UNITS["speed"]:
        why = f"speeds are those of the positions in {unit.logged}"
        draft.set("gnss", "units", {**units, "speed": unit.logged}, why)


def _gyro_unit(draft: Draft) -> tuple[Recording, WeighedAxes] | None:
    """The unit in which the gyro turns as the course does; what was seen in it."""
    told = draft.get("imu", "gyro_unit")
    seen: dict[str, tuple[Recording, WeighedAxes]] = {}
    for unit in (told,) if told else ("rad/s", "deg/s"):
        if not told:
            draft.set(
                "imu", "gyro_unit", unit, "so turns are a car's, and the receiver's if it saw"
            )
        read = _read(draft)
        if read is None or read[1].imu is None:
            return None
        drive, recording = read
        seen[unit] = recording, weigh_axes(drive, recording, *usable_receiver(drive, recording))
        scaled = any(f.code == SCALE_CODE for f in seen[unit][1].findings)
        assert recording.imu is not None
        fast = plausibility.gyro_size(recording.imu.gyro).severity != "ok"
        if not scaled and not (unit == "rad/s" and fast):
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
