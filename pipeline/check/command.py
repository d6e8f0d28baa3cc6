"""What ``automap check`` says of a drive folder: what is there, what looks wrong, what to do."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import AutoMapError, InputError
from automap.evaluation.plausibility import Finding, Severity
from automap.io import names
from automap.io.drive import Drive, load_drive
from pipeline.check import camera, imu, timing, wheels
from pipeline.check.judge import has_other_positions, judge, of_file

if TYPE_CHECKING:
    from automap.io.recording import Recording

WIDTH = 80
"""Characters of a line: the width of a terminal that nobody made wider."""

_MARKS = {"ok": "ok", "info": "info", "warning": "WARNING", "error": "ERROR"}


@dataclass(frozen=True)
class FileFinding:
    """One finding about one file of the drive."""

    file: str
    severity: Severity
    text: str
    advice: str = ""
    code: str = ""


@dataclass(frozen=True)
class CheckReport:
    """All findings on a drive; ``usable`` is whether it can be run as it is."""

    drive: str
    name: str
    usable: bool
    findings: tuple[FileFinding, ...]

    def as_dict(self) -> dict[str, Any]:
        """The report in JSON's types."""
        return {
            "drive": self.drive,
            "name": self.name,
            "usable": self.usable,
            "findings": [vars(finding) for finding in self.findings],
        }

    def wrong(self) -> list[str]:
        """One sentence for each warning and error, errors last."""
        return [
            f"{finding.severity}: {finding.file}: {finding.text}"
            + (f"; {finding.advice}" if finding.advice else "")
            for severity in ("warning", "error")
            for finding in self.findings
            if finding.severity == severity
        ]

    def text(self) -> str:
        """The report for a terminal: a block for each file, then the verdict."""
        lines = [f"{self.name}  ({self.drive})"]
        file = None
        for finding in self.findings:
            if finding.file != file:
                file = finding.file
                lines.append(f"  {file}")
            lines += _wrapped(f"    {_MARKS[finding.severity]:8}", finding.text)
            if finding.advice:
                lines += _wrapped(f"    {'':8}-> ", finding.advice)
        count = {s: sum(f.severity == s for f in self.findings) for s in ("error", "warning")}
        verdict = "usable" if self.usable else "not usable as it is"
        counts = [f"{n} {what}{'s' if n != 1 else ''}" for what, n in count.items()]
        lines.append(f"  {verdict}: {', '.join(counts)}")
        return "\n".join(lines)


def _wrapped(start: str, text: str) -> list[str]:
    """A finding in lines of a terminal's width; words, and so paths, stay whole."""
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=start,
        subsequent_indent=" " * len(start),
        break_long_words=False,
        break_on_hyphens=False,
    )


class _Collector:
    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.findings: list[FileFinding] = []

    def add(self, path: Path | str, findings: Iterable[Finding]) -> None:
        for finding in findings:
            label = self.label(path)
            text = self._short(finding.text).removeprefix(f"{label}: ")
            self.findings.append(
                FileFinding(
                    label, finding.severity, text, self._short(finding.advice), finding.code
                )
            )

    def by_file(self) -> tuple[FileFinding, ...]:
        """All findings, those of one file together."""
        files = list(dict.fromkeys(finding.file for finding in self.findings))
        return tuple(sorted(self.findings, key=lambda finding: files.index(finding.file)))

    def label(self, path: Path | str) -> str:
        path = Path(path)
        return str(path.relative_to(self.folder)) if path.is_relative_to(self.folder) else str(path)

    def _short(self, text: str) -> str:
        """Without the folder, which stands above all findings."""
        return text.replace(f"{self.folder}/", "").rstrip(".")


def check_drive(path: Path | str) -> CheckReport:
    """Look into every file of a drive folder and say what was found.

    Never raises for a bad drive: what is wrong is a finding, and ``usable`` is False when any of
    them is an error, at which a run stops.
    """
    folder = Path(path)
    try:
        drive = load_drive(folder)
    except AutoMapError as error:
        finding = FileFinding(names.MANIFEST, "error", str(error).rstrip("."), code="manifest")
        return CheckReport(str(folder), folder.resolve().name, False, (finding,))
    collector = _Collector(drive.path)
    collector.add(drive.manifest_file, _manifest(drive))
    recording = _recordings(drive, collector)
    for video in drive.videos.values():
        for file, findings in camera.check(drive, video):
            collector.add(file, findings)
        if recording is not None and drive.trajectory_file is None:
            collector.add(drive.manifest_file, timing.camera_clock(drive, recording, video))
    _finished(drive, collector)
    if drive.truth_dir is not None:
        collector.add(drive.truth_dir, [Finding("info", "truth is there, for evaluate alone")])
    for file in drive.input_files():
        if not os.access(file, os.R_OK):
            wrong = Finding("error", "nobody may read it", "change its rights", "rights")
            collector.add(file, [wrong])
    usable = not any(finding.severity == "error" for finding in collector.findings)
    return CheckReport(str(drive.path), drive.name, usable, collector.by_file())


def _manifest(drive: Drive) -> list[Finding]:
    findings = [Finding("ok", f"drive {drive.name}, {len(drive.input_files()) - 1} input files")]
    findings += [Finding("warning", text) for text in drive.warnings]
    findings += _presets(drive)
    site = drive.site
    if site.country is None:
        findings.append(
            Finding(
                "info",
                "no country in [site]",
                'add country = "DE", or another of two letters, for the right sign faces and codes',
            )
        )
    return findings


def _presets(drive: Drive) -> list[Finding]:
    """The named sensor and receiver, whose figures the fusion will use."""
    from pipeline.settings.load import load_settings
    from pipeline.settings.presets import fusion_options

    try:
        _, presets = fusion_options(drive, load_settings().fuse)
    except AutoMapError as error:
        return [Finding("error", str(error).rstrip("."), code="manifest")]
    return [
        Finding("ok", f"{'sensor' if p.role == 'imu' else 'receiver'} {p.file.stem}: {p.name}")
        for p in presets
    ]


def _recordings(drive: Drive, collector: _Collector) -> Recording | None:
    """Check IMU, receiver log and wheel speed, alone and together."""
    from automap.io.recording import read_recording

    try:
        recording = read_recording(drive)
    except AutoMapError as error:
        collector.add(drive.manifest_file, [Finding("error", str(error), code="manifest")])
        return None
    for text in recording.warnings:
        file, body = of_file(drive, text)
        harmless = file == drive.imu_file and imu.is_harmless(recording, body)
        collector.add(file, [Finding("info" if harmless else "warning", body)])
    for text in dict.fromkeys(recording.notes):
        file, body = of_file(drive, text)
        collector.add(file, [Finding("info", body)])
    for item in judge(drive, recording).found:
        collector.add(item.file, [item.finding])
    if recording.imu is None and drive.imu_file is None and not has_other_positions(drive):
        collector.add(names.MANIFEST, [imu.ABSENT])
    if drive.odometer_file is not None:
        collector.add(drive.odometer_file, wheels.check(drive, recording))
    return recording


def _finished(drive: Drive, collector: _Collector) -> None:
    """Check a finished trajectory and bearings."""
    if drive.trajectory_file is not None:
        from automap.io.trajectory_file import read_finished
        from automap.sync.finished import trajectory_clock

        try:
            finished = read_finished(drive.trajectory_file)
            if finished.time == "both":
                trajectory_clock(finished.data.t_ns, finished.data.gps_s)
        except InputError as error:
            wrong = Finding("error", str(error), code="trajectory_unreadable")
            collector.add(drive.trajectory_file, [wrong])
        else:
            text = f"{len(finished.data)} rows; used instead of the IMU and the receiver"
            findings = [Finding("ok", text)]
            findings += [Finding("warning", text) for text in finished.warnings]
            if drive.trajectory_file.suffix == ".pos" and drive.lever_arm.any():
                text = "positions are taken as the IMU's; lever_arm_m is not applied to them"
                findings.append(Finding("info", text))
            collector.add(drive.trajectory_file, findings)
    if drive.bearings_file is not None:
        from automap.io.bearings_csv import read_bearings

        try:
            bearings, sentences = read_bearings(drive.bearings_file)
        except InputError as error:
            wrong = Finding("error", str(error), code="bearings_unreadable")
            collector.add(drive.bearings_file, [wrong])
        else:
            findings = [Finding("ok" if len(bearings) else "warning", f"{len(bearings)} bearings")]
            findings += [Finding("warning", text) for text in sentences]
            collector.add(drive.bearings_file, findings)
