"""Checks of wheel speed: its rate and step, and whether it is the speed that the receiver tells."""

from __future__ import annotations

import numpy as np

from automap.errors import InputError
from automap.evaluation.plausibility import Finding
from automap.io.drive import Drive
from automap.io.odometer_csv import read_odometer_csv
from automap.io.recording import Recording, imu_time
from automap.records import WheelSpeed
from automap.sync.clock import has_arrival
from pipeline.check import limits
from pipeline.check.timing import gps_time


def check(drive: Drive, recording: Recording) -> list[Finding]:
    """What the file holds, and how it lies to the receiver's speed."""
    assert drive.odometer_file is not None
    try:
        found = read_odometer_csv(drive.odometer_file, drive.manifest.odometer.form)
    except InputError as error:
        advice = "the drive goes on without it"
        return [Finding("warning", str(error).rstrip("."), advice)]
    wheels = found.data
    findings = [
        Finding("info", text.removeprefix(f"{drive.odometer_file}: ")) for text in found.notes
    ]
    findings += [Finding("warning", text) for text in found.warnings]
    if len(wheels) < 2:
        text = "fewer than two wheel speeds: they are not used"
        return [*findings, Finding("warning", text)]
    seconds = float(wheels.t_ns[-1] - wheels.t_ns[0]) * 1e-9
    rate = 1e9 / float(np.median(np.diff(wheels.t_ns)))
    fastest = float(np.abs(wheels.speed).max())
    text = (
        f"{len(wheels)} wheel speeds over {seconds:.1f} s, {rate:.3g} Hz, up to {fastest:.1f} m/s"
    )
    findings.append(Finding("ok", text))
    if rate < limits.SLOW_WHEELS_HZ:
        text = f"wheel speed comes once in {1.0 / rate:.1f} s"
        findings.append(Finding("info", text, "let the adapter ask for the speed alone"))
    loose = untied(drive, recording)
    return findings + ([loose] if loose else _against_receiver(drive, recording, wheels))


def untied(drive: Drive, recording: Recording) -> Finding | None:
    """A warning for stamps that nothing ties to the IMU's; else None."""
    time, fixes = drive.manifest.odometer.time, recording.fixes
    if time != "boot_ns" or recording.imu is None or imu_time(drive, recording) == time:
        return None
    if has_arrival(fixes) and drive.gnss.arrival_time == time:
        return None
    own = imu_time(drive, recording)
    return Finding(
        "warning",
        f"[odometer] time = {time!r} and the {own!r} of [imu] have nothing in common",
        "the drive goes on without it; write the clock that its stamps are in as time, or record "
        "gnss_arrival.csv",
    )


def _against_receiver(drive: Drive, recording: Recording, wheels: WheelSpeed) -> list[Finding]:
    from automap.fusion.nodes import model_fixes
    from automap.fusion.options import FusionOptions
    from automap.fusion.wheels import contradiction, judge_wheels, path_speed

    fixes = recording.fixes
    gps_s = gps_time(drive, recording, wheels.t_ns, drive.manifest.odometer.time)
    if fixes is None or gps_s is None:
        text = "wheel speed and fixes have no clock in common yet; the run compares them"
        return [Finding("info", text)]
    base, options = float(gps_s[0]), FusionOptions()
    told = path_speed(model_fixes(fixes, fixes.gps_s - base, options))
    found = judge_wheels(gps_s - base, wheels.speed, told, options)
    findings = []
    if found.step > limits.COARSE_STEP:
        text = f"it counts in steps of {found.step:.2f} m/s ({3.6 * found.step:.2g} km/h)"
        findings.append(Finding("info", text, "its variance has the step in it"))
    if found.stuck:
        findings.append(
            Finding(
                "warning",
                f"{found.stuck} of {len(wheels)} wheel speeds are stuck while the vehicle drives",
                "they are left out; look at the adapter and its cable",
            )
        )
    match = found.match
    if match is None and found.warnings and not found.stuck:
        text, _, advice = found.warnings[0].partition("; it is left out: ")
        return [*findings, Finding("warning", f"{text}; it is not used", advice)]
    if match is None:
        text = "too little of it is beside the receiver's speed to compare the two"
        return [*findings, Finding("info", text, "are its stamps on the IMU's clock?")]
    wrong = contradiction(match)
    if wrong is not None:
        return [*findings, Finding("warning", f"{wrong[0]}; it is not used", wrong[1])]
    side = "late" if match.late_s >= 0.0 else "early"
    text = (
        f"against the receiver's speed {1e3 * abs(match.late_s):.0f} ms {side} (sigma "
        f"{1e3 * match.late_sd_s:.0f} ms), {match.scale:.4f} times as much (sigma "
        f"{match.scale_sd:.4f}); the run estimates both"
    )
    lagging = match.late_s < -limits.LAGGING_RECEIVER_S
    advice = "receivers of phones tell their own speed up to a second late" if lagging else ""
    return [*findings, Finding("ok", text, advice)]
