"""Checks of the clocks: whether IMU, receiver and video speak of the same time."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.evaluation.plausibility import Finding, overlap_s
from automap.fusion.limits import DRIVING_SPEED, FIX_EDGE_S, LEAST_FIXES, UNSTATED_SD_M
from automap.fusion.unread import lost_holes
from automap.interpolation import LONGEST_GAP_S
from automap.io.arrival import read_arrival
from automap.io.drive import Drive
from automap.io.frame_times import frame_times
from automap.io.recording import Recording, imu_time
from automap.io.video import VideoInput, read_header
from automap.records import NO_TIME, Fixes, FixType, FloatArray, IntArray
from automap.timebase import MOST_ZONE_H, QUARTER_S, ROLLOVER_S, gps_to_iso, unix_to_gps
from pipeline.check import clock_set, limits

ARRIVAL_CODE = "arrival_times"
"""Of a finding about arrival times that make no clock."""


def imu_gps_time(drive: Drive, recording: Recording) -> FloatArray | None:
    """GPS time [n] of the readings, good to some tenths of a second, None when unknown."""
    return None if recording.imu is None else gps_time(drive, recording, recording.imu.t_ns)


def gps_time(
    drive: Drive, recording: Recording, t_ns: IntArray, clock: str | None = None
) -> FloatArray | None:
    """GPS time [n] of stamps of a clock, by default the IMU's, good to some tenths of a second;
    None when unknown."""
    fixes = recording.fixes
    time = clock or imu_time(drive, recording)
    if time == "gps_ns":
        return np.asarray(t_ns * 1e-9)
    if time == "unix_ns":
        return unix_to_gps(t_ns * 1e-9)
    if fixes is None or drive.gnss.arrival_time != time:
        return None
    known = (fixes.arrival_ns != NO_TIME) & np.isfinite(fixes.gps_s)
    if not np.any(known):
        return None
    offset = float(np.median(fixes.gps_s[known] - fixes.arrival_ns[known] * 1e-9))
    # arrival lies some tenths of a second behind the epoch
    late = drive.gnss.output_delay_s or limits.USUAL_OUTPUT_DELAY_S
    return np.asarray(t_ns * 1e-9 + offset + late)


def check(drive: Drive, recording: Recording) -> list[Finding]:
    """Arrival times, clock rate, and whether IMU and fixes overlap."""
    fixes = recording.fixes
    if fixes is None or not len(fixes):
        return []
    findings = _arrivals(drive, recording)
    was_set = clock_set.fixes_set(fixes)
    if was_set is not None:
        return [*findings, was_set]
    gps_s = imu_gps_time(drive, recording)
    dated = fixes.gps_s[np.isfinite(fixes.gps_s)]
    if gps_s is None or len(dated) < 2:
        return findings
    span = np.array([dated.min(), dated.max()])
    shared = overlap_s(gps_s, span)
    shorter = min(gps_s[-1] - gps_s[0], span[1] - span[0])
    spans = (
        f"IMU {gps_to_iso(float(gps_s[0]))} to {gps_to_iso(float(gps_s[-1]))}, "
        f"fixes {gps_to_iso(float(span[0]))} to {gps_to_iso(float(span[1]))}"
    )
    if shared <= 0:
        advice = f"they are not of one drive, or time = {drive.imu.time!r} in [imu] is wrong"
        if overlap_s(gps_s - ROLLOVER_S, span) > 0:
            advice = (
                "the receiver's dates are 1024 weeks early, as of receivers that are older than "
                "that: write the dates of the drive into the log, or update the receiver"
            )
        off = float(span[0] - gps_s[0])
        zone = round(off / QUARTER_S) * QUARTER_S
        if abs(zone) <= MOST_ZONE_H * 3600.0 and overlap_s(gps_s + zone, span) > 0.9 * shorter:
            advice = (
                f"the fixes are {zone / 3600.0:+g} h from the IMU, as where one of the two is in "
                "local time: bring both to UTC"
            )
        text = f"IMU and fixes do not overlap in time: {spans}"
        findings.append(Finding("error", text, advice, "no_overlap"))
        return findings
    at = dated[np.isfinite(fixes.lat_rad[np.isfinite(fixes.gps_s)])]
    used = np.count_nonzero((at > gps_s[0] - FIX_EDGE_S) & (at < gps_s[-1] + FIX_EDGE_S))
    if used < LEAST_FIXES:
        text = f"{used} of {len(at)} fixes lie in the IMU's time, and a path needs two: {spans}"
        advice = "wait for a fix before driving, and record the IMU for the whole drive"
        findings.append(Finding("error", text, advice, "few_fixes"))
        return findings
    was_set = clock_set.one_set(gps_s, fixes)
    if was_set is not None:
        findings.append(was_set)
        return findings
    findings += _trips(gps_s, fixes)
    unread_s = _driven_unread_s(gps_s, fixes)
    if shared < limits.SHORT_OVERLAP * shorter:
        text = f"IMU and fixes overlap for {shared:.1f} s only: {spans}"
        findings.append(Finding("warning", text, "", "short_overlap"))
    elif unread_s > LONGEST_GAP_S:
        text = f"{unread_s:.0f} s were driven before or after all readings of the IMU: {spans}"
        advice = "is the rest of the IMU's file missing?"
        findings.append(Finding("warning", text, advice, "short_overlap"))
    else:
        findings.append(Finding("ok", f"IMU and fixes overlap for {shared:.1f} s"))
    return findings


def _driven_unread_s(gps_s: FloatArray, fixes: Fixes) -> float:
    """For how many s the receiver tells of driving before or behind all readings at ``gps_s``."""
    rows = np.flatnonzero(np.isfinite(fixes.gps_s))
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    t, speed = fixes.gps_s[rows], np.hypot(fixes.vel_ned[rows, 0], fixes.vel_ned[rows, 1])
    outside = (t < gps_s[0]) | (t > gps_s[-1])
    step = np.diff(t, append=t[-1:])
    return float(step[outside & (speed > DRIVING_SPEED) & (step <= LONGEST_GAP_S)].sum())


def _trips(gps_s: FloatArray, fixes: Fixes) -> list[Finding]:
    """Of more than one trip in a recording, with readings at ``gps_s`` [n]."""
    rows = np.flatnonzero(np.isfinite(fixes.gps_s + fixes.lat_rad + fixes.lon_rad))
    rows = rows[np.argsort(fixes.gps_s[rows], kind="stable")]
    at = fixes.gps_s[rows], fixes.lat_rad[rows], fixes.lon_rad[rows]
    return [
        Finding(
            "warning",
            f"for {(end - begin) / 60.0:.0f} min from {gps_to_iso(begin)} on there are neither "
            f"readings nor fixes, and the vehicle was moved by {metres:.0f} m",
            "cut the recording there, into a drive for each trip: the IMU is read on the longest "
            "one alone, for nothing tells how it stands behind the hole",
            "trips",
        )
        for begin, end, metres in lost_holes(gps_s, *at, UNSTATED_SD_M[FixType.THREE_D])
    ]


def camera_clock(drive: Drive, recording: Recording, video: VideoInput) -> list[Finding]:
    """Whether the frame stamps of a camera can be brought to the clock of the trajectory."""
    fixes = recording.fixes
    arrived = fixes is not None and bool(np.any(fixes.arrival_ns != NO_TIME))
    if recording.imu is not None:
        base = imu_time(drive, recording)
    else:
        base = drive.gnss.arrival_time if arrived else "gps_ns"
    own = video.section.time
    if own == base and recording.imu is not None:
        return _outside(video, np.asarray(recording.imu.t_ns, np.int64))
    if fixes is None or own == base:
        return []
    section = f"[video.{video.name}] time = {own!r}"
    if own == "boot_ns" and not (arrived and drive.gnss.arrival_time == own):
        return [
            Finding(
                "warning",
                f"{section} and the trajectory's {base!r} have nothing in common",
                "its signs cannot be placed: write the clock that the stamps are in as time, or "
                "record gnss_arrival.csv",
            )
        ]
    return [Finding("info", f"{section} is brought to the trajectory's {base!r}")]


def _outside(video: VideoInput, t_ns: IntArray) -> list[Finding]:
    """A warning where a camera's frames lie before or after the readings' stamps [n], ns, of the
    same clock."""
    try:
        if video.frames is not None:
            stamps = frame_times(video).t_ns[[0, -1]]
        else:
            length_s = sum(read_header(path).duration_s for path in video.chapters)
            start = video.section.start_ns or 0
            stamps = np.array([start, start + int(np.nan_to_num(length_s) * 1e9)])
    except (InputError, IndexError):
        # said of the file itself
        return []
    if not (video.frames or video.chapters) or overlap_s(stamps, t_ns) >= 0.0:
        return []
    frames, drive = (f"{each[0] * 1e-9:.1f} to {each[-1] * 1e-9:.1f} s" for each in (stamps, t_ns))
    return [
        Finding(
            "warning",
            f"[video.{video.name}] no frame was taken during the drive: its stamps are {frames} of "
            f"{video.section.time}, the readings' {drive}",
            "its signs cannot be placed: correct time and start_ns, or the frames file",
        )
    ]


def _arrivals(drive: Drive, recording: Recording) -> list[Finding]:
    fixes = recording.fixes
    assert fixes is not None
    known = fixes.arrival_ns != NO_TIME
    if not np.any(known):
        if recording.imu is None or drive.arrival_file is not None:
            return []
        if imu_time(drive, recording) != "boot_ns":
            return []
        dated = unix_to_gps(recording.imu.t_ns[[0, -1]] * 1e-9)
        if overlap_s(np.asarray(dated), fixes.gps_s[np.isfinite(fixes.gps_s)][[0, -1]]) > 0.0:
            return [
                Finding(
                    "warning",
                    "the stamps of the IMU are dates, of the time of the fixes",
                    'write time = "unix_ns" in [imu]; without it they are matched by the motions',
                )
            ]
        return [
            Finding(
                "warning",
                "no arrival times, and the IMU is on the host's clock",
                "the offset is found by correlating the two, to some 10 ms; record "
                "gnss_arrival.csv next time",
            )
        ]
    if recording.imu is None and drive.gnss.arrival_time == "gps_ns":
        return []
    from automap.sync.arrival import fit_arrival_clock

    try:
        fit = fit_arrival_clock(fixes.arrival_ns, fixes.gps_s, drive.gnss.output_delay_s)
    except InputError as error:
        return [Finding("error", _of_other_log(drive) or str(error).rstrip("."), "", ARRIVAL_CODE)]
    text = (
        f"arrival times of {np.count_nonzero(known)} of {len(fixes)} epochs, median "
        f"{1e3 * fit.waiting_s:.0f} ms beyond the least, host clock off in rate by "
        f"{1e6 * fit.clock.drift:+.1f} ppm"
    )
    findings = [Finding("ok", text)]
    findings += [Finding("warning", warning) for warning in fit.warnings]
    if drive.gnss.output_delay_s is None and recording.imu is not None:
        findings.append(
            Finding("info", "output_delay_s is not given; it is estimated with the trajectory")
        )
    return findings


def _of_other_log(drive: Drive) -> str | None:
    """The sentence for arrival times, wrong ones, of more bytes than the log has; else None."""
    if drive.arrival_file is None or drive.gnss_file is None:
        return None
    last = int(read_arrival(drive.arrival_file, drive.gnss.arrival_table.form).offset[-1])
    size = drive.gnss_file.stat().st_size
    if last <= size:
        return None
    return (
        f"it tells when {last} bytes of the log arrived, and {drive.gnss_file.name} has {size}: "
        "the two are not of one recording, or the log was cut; put those of one drive together, or "
        "leave the arrival times out"
    )
