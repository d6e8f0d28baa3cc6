"""The judgements that ``check``, ``run``, ``import`` and ``record`` share.

What is an error here stops a run, with the same sentence, unless the manifest accepts it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from automap.evaluation.plausibility import Finding
from automap.io.axes import ImuAxes
from automap.io.drive import Drive
from automap.io.recording import Recording
from automap.records import ImuData
from pipeline.check import camera, gnss, imu, timing, velocity

NEEDED = frozenset(
    (
        *("no_fix", "few_fixes", "no_positions", "gnss_unreadable"),
        *("no_overlap", "arrival_times", "imu_clock_offset", "imu_clock_unknown"),
        *("manifest", "camera_view"),
    )
)
"""Codes of errors that leave nothing to go on with: they cannot be accepted."""
GOES_ON = "the drive goes on without it"


@dataclass(frozen=True)
class Judged:
    """A ``finding`` about ``file``; ``told_later`` where the stages of a run say as much in
    their warnings or in the verdict on the path."""

    file: Path
    finding: Finding
    told_later: bool = False

    def sentence(self) -> str:
        """File, finding and advice, as a run stops or warns with them."""
        sentence = self.finding.sentence()
        return sentence if sentence.startswith(str(self.file)) else f"{self.file}: {sentence}"


@dataclass(frozen=True)
class Judgement:
    """What was ``found`` in the recordings of a drive, the readings as they are to be used (None
    where there are none), and the axes they were ``mended`` by, None where they are as recorded."""

    found: tuple[Judged, ...]
    imu: ImuData | None = None
    mended: ImuAxes | None = None

    def told(self, code: str) -> str | None:
        """The sentence of the finding of a ``code``, None where there is none."""
        return next((item.sentence() for item in self.found if item.finding.code == code), None)


def judge(drive: Drive, recording: Recording) -> Judgement:
    """Judge the recordings of a drive; errors that its manifest accepts are warnings."""
    found = [*_unreadable(drive, recording)]
    weighed = None
    if recording.imu is not None:
        few = imu.sparse(recording.imu)
        measured, weighed = ([few], None) if few else imu.check(drive, recording)
        found += _all(drive.imu_file or drive.gnss_file or drive.manifest_file, measured)
        if any(finding.code in imu.LEFT_OUT for finding in measured):
            recording = replace(recording, imu=None)
    found += [*_receiver(drive, recording), *_cameras(drive)]
    if drive.trajectory_file is not None:
        found = [replace(item, finding=_unused(item.finding)) for item in found]
    found = [replace(item, finding=accepted(drive, item.finding)) for item in found]
    idle = _idle(drive, [item.finding for item in found])
    told = (*found, *_all(drive.manifest_file, idle))
    if weighed is None:
        return Judgement(told, recording.imu)
    return Judgement(told, weighed.imu, weighed.mended)


def has_other_positions(drive: Drive) -> bool:
    """Whether something besides the receiver log says where the drive was."""
    return drive.trajectory_file is not None or drive.bearings_file is not None


def of_file(drive: Drive, sentence: str) -> tuple[Path, str]:
    """The file that a sentence begins with, the receiver log where it names none, and the sentence
    without it."""
    files = sorted(drive.input_files(), key=lambda path: -len(str(path)))
    default = drive.gnss_file or drive.manifest_file
    file = next((path for path in files if sentence.startswith(str(path))), default)
    return file, sentence.removeprefix(f"{file}: ")


def _unreadable(drive: Drive, recording: Recording) -> Iterator[Judged]:
    """What could not be read at all: the receiver log alone is needed."""
    for sentence in recording.failures:
        file, body = of_file(drive, sentence)
        text = body.rstrip(".")
        if file == drive.gnss_file and not has_other_positions(drive):
            yield Judged(file, Finding("error", text, code="gnss_unreadable"))
        else:
            code = {drive.imu_file: "imu_unreadable", drive.gnss_file: "gnss_unreadable"}
            finding = Finding("warning", text, GOES_ON, code.get(file, "arrival_unreadable"))
            yield Judged(file, finding)
    if drive.gnss_file is None and not has_other_positions(drive):
        yield Judged(drive.manifest_file, gnss.ABSENT)


def _receiver(drive: Drive, recording: Recording) -> Iterator[Judged]:
    if recording.log is not None:
        assert drive.gnss_file is not None
        receiver = gnss.check(drive, recording)
        if drive.bearings_file is not None:
            few = ("no_fix", "few_fixes")
            receiver = [_warned(item) if item.code in few else item for item in receiver]
        yield from _all(drive.gnss_file, receiver)
        if gnss.has_fix(recording):
            assert recording.fixes is not None
            told = velocity.check(recording.fixes)
            yield from _all(drive.gnss_file, told, told_later=True)
            clocks = timing.check(drive, recording)
            yield from _all(drive.arrival_file or drive.gnss_file, clocks, told_later=True)
    yield from _all(drive.manifest_file, gnss.lever_arms(drive))


def _cameras(drive: Drive) -> Iterator[Judged]:
    for video in drive.videos.values():
        for file, findings in camera.judge(drive, video):
            yield from _all(file, findings)


def _all(file: Path, findings: Sequence[Finding], told_later: bool = False) -> Iterator[Judged]:
    for finding in findings:
        yield Judged(file, finding, told_later)


def accepted(drive: Drive, finding: Finding) -> Finding:
    """A finding as the manifest's ``accept`` has it: a warning for an error, else with the line
    to write."""
    if finding.severity != "error" or not finding.code or finding.code in NEEDED:
        return finding
    if finding.code in drive.manifest.accept:
        return replace(finding, severity="warning", advice=f'accepted as "{finding.code}"')
    way_on = f'to go on all the same, write accept = ["{finding.code}"] at the top of drive.toml'
    advice = f"{finding.advice}; {way_on}" if finding.advice else way_on
    return replace(finding, advice=advice)


def _idle(drive: Drive, found: Sequence[Finding]) -> list[Finding]:
    """A warning for codes in ``accept`` that nothing was found of, as a misspelt one."""
    codes = {finding.code for finding in found if finding.severity in ("warning", "error")}
    codes.add("gnss_quality")  # where the reader used such positions, it says so
    idle = [code for code in drive.manifest.accept if code not in codes]
    if not idle:
        return []
    text = f"accept names {', '.join(idle)}, and nothing of that name was found"
    return [Finding("warning", text, "take it out, or write it as automap check does", "accept")]


def _warned(finding: Finding) -> Finding:
    return replace(finding, severity="warning") if finding.severity == "error" else finding


def _unused(finding: Finding) -> Finding:
    """What is wrong with a recording that a finished trajectory stands in for."""
    if finding.severity != "error" or finding.code.startswith("camera"):
        return finding
    advice = "the finished trajectory is used instead"
    return replace(finding, severity="warning", advice=advice)


def stop_or_tell(
    judged: Sequence[Judged], stop: Callable[[str], Exception], tell: Callable[[str], None]
) -> None:
    """Raise ``stop`` of the first error's sentence; ``tell`` what is wrong and not told later."""
    for item in judged:
        if item.finding.severity == "error":
            raise stop(f"{item.sentence().rstrip('.')}.")
    for item in judged:
        if item.finding.severity == "warning" and not (item.told_later and not _is_accepted(item)):
            tell(item.sentence())


def _is_accepted(item: Judged) -> bool:
    return item.finding.advice.startswith("accepted as")
