"""``automap record``: a drive from the devices of a car, or a drive back to such devices."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import ConfigError, InputError, StageError
from automap.io import names

if TYPE_CHECKING:
    from automap.recording.camera import Source
    from automap.recording.imu_format import ImuFormat
    from automap.recording.ports import PortSpec
    from automap.recording.probe import Finding
    from automap.recording.recorder import Ending, Recorder
    from automap.recording.ublox import Wish
    from pipeline.record_view import View

AUTO, NONE = "auto", "none"
_TICK_S = 0.2


@dataclass(frozen=True)
class RecordRequest:
    """What the command line asks for. ``gnss`` and ``imu`` are a port, "auto" or "none"."""

    out: Path | None = None
    gnss: str = AUTO
    imu: str = AUTO
    imu_format: str | None = None
    cameras: tuple[str, ...] = ()
    rig: Path | None = None
    rate_hz: float | None = None
    raw: bool = False
    pvt: bool = False
    gnss_baud: int | None = None
    restore: bool = False
    duration_s: float | None = None
    plain: bool = False
    time_scale: float = 1.0


@dataclass
class Stop:
    """Whether and by what the recording is to end."""

    signal: int | None = None
    reasons: list[str] = field(default_factory=list)

    @property
    def wanted(self) -> bool:
        """Whether to end now."""
        return self.signal is not None


def default_folder() -> Path:
    """A new folder's name by date and time."""
    return Path(f"drive-{datetime.now(UTC):%Y-%m-%dT%H%M%SZ}")


def record(request: RecordRequest) -> tuple[Ending, bool]:
    """Record until the duration is over or a signal comes; whether it was cut short.

    Raises InputError when there is nothing to record, StageError when bytes that came in are
    on no disk in the end.
    """
    from automap.recording.clock import HostClock
    from automap.recording.manifest_text import read_rig
    from automap.recording.recorder import Plan, Recorder
    from automap.recording.ublox import wish_from

    folder = request.out or default_folder()
    if (folder / names.MANIFEST).exists():
        raise ConfigError(f"{folder} holds a drive already; choose another folder with -o.")
    wish = wish_from(request.pvt, request.raw, request.rate_hz, request.gnss_baud)
    rig = read_rig(request.rig) if request.rig is not None else None
    cameras = _cameras(request)
    gnss, imu, form = _find_devices(request)
    _warn_narrow_line(gnss, wish)
    plan = Plan(
        gnss=gnss, imu=imu, imu_format=form, cameras=cameras, rig=rig, wish=wish,
        restore=request.restore,
    )  # fmt: skip
    recorder = Recorder(folder, plan, HostClock(request.time_scale))
    with _signals() as stop:
        recorder.start()
        try:
            _watch(recorder, request, stop)
        finally:
            ending = recorder.stop()
    if ending.lost_bytes:
        raise StageError(
            f"{folder}: {ending.lost_bytes} bytes that came in could not be written, the rest is "
            "there and usable; see recording.log for when."
        )
    return ending, stop.wanted and request.duration_s is not None


def _watch(recorder: Recorder, request: RecordRequest, stop: Stop) -> None:
    """Show the recording until it is to end."""
    from pipeline.record_view import open_view

    end = None if request.duration_s is None else time.monotonic() + request.duration_s
    with open_view(recorder.folder, request.plain or not sys.stdout.isatty()) as view:
        while not stop.wanted and (end is None or time.monotonic() < end):
            _show(view, recorder)
            left = _TICK_S if end is None else min(_TICK_S, max(end - time.monotonic(), 0.0))
            time.sleep(left)
        _show(view, recorder)


def _show(view: View, recorder: Recorder) -> None:
    """A picture that fails is no reason to lose the drive."""
    try:
        view.show(recorder.snapshot())
    except Exception as error:
        with contextlib.suppress(OSError):
            _say(f"the view failed ({type(error).__name__}: {error}); recording goes on")


@contextlib.contextmanager
def _signals() -> Iterator[Stop]:
    """The first Ctrl-C, hang-up or termination ends the recording in order, a second at once."""
    stop = Stop()

    def handle(number: int, frame: Any) -> None:
        if stop.wanted:
            raise KeyboardInterrupt
        stop.signal = number

    wanted = [getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP")]
    before = {}
    for number in wanted:
        if number is not None:
            with contextlib.suppress(ValueError):  # not in the main thread
                before[number] = signal.signal(number, handle)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


# ---- devices


def _cameras(request: RecordRequest) -> tuple[tuple[str, Source], ...]:
    if not request.cameras:
        return ()
    from automap.recording.camera import parse_camera

    cameras = tuple(parse_camera(text) for text in request.cameras)
    called = [name for name, _ in cameras]
    twice = sorted({name for name in called if called.count(name) > 1})
    if twice:
        raise ConfigError(f"two cameras are called {twice[0]}; give each a name of its own.")
    return cameras


def _find_devices(
    request: RecordRequest,
) -> tuple[PortSpec | None, PortSpec | None, ImuFormat | None]:
    """The ports of receiver and sensor with their line rates, and the sensor's format."""
    from automap.recording.imu_format import known_formats, load_format
    from automap.recording.ports import PortSpec, parse_port

    form = load_format(request.imu_format) if request.imu_format else None
    formats = [form] if form is not None else [load_format(name) for name in known_formats()]
    named = {
        kind: None if text in (AUTO, NONE) else parse_port(text)
        for kind, text in (("gnss", request.gnss), ("imu", request.imu))
    }
    found: dict[str, PortSpec | None] = {"gnss": None, "imu": None}
    for kind, spec in named.items():
        if spec is None:
            continue
        if spec.baud is not None and (kind == "gnss" or form is not None):
            found[kind] = spec
            continue
        finding = _probe_named(kind, spec, formats)
        found[kind] = PortSpec(spec.device, finding.baud)
        if kind == "imu":
            form = finding.form
    wanted = {k for k, text in (("gnss", request.gnss), ("imu", request.imu)) if text == AUTO}
    if wanted:
        taken = {spec.device for spec in named.values() if spec is not None}
        for finding in probe_all(formats, taken, wanted):
            if finding.kind in wanted and found[finding.kind] is None:
                found[finding.kind] = PortSpec(finding.device, finding.baud)
                if finding.kind == "imu":
                    form = finding.form
    missing = [kind for kind in sorted(wanted) if found[kind] is None]
    if missing and (any(found.values()) or request.cameras):
        what = " and no ".join({"gnss": "receiver", "imu": "inertial sensor"}[k] for k in missing)
        _say(f"no {what} was found; recording without it")
    return found["gnss"], found["imu"], form if found["imu"] is not None else None


def _probe_named(kind: str, spec: PortSpec, formats: list[ImuFormat]) -> Finding:
    from automap.recording.ports import BAUDS, PortLostError, port_sentence
    from automap.recording.probe import probe_port

    usual = [baud for form in formats for baud in form.baud] if kind == "imu" else []
    bauds = [spec.baud] if spec.baud else list(dict.fromkeys([*usual, *BAUDS]))
    finding = probe_port(spec.device, formats if kind == "imu" else [], bauds, ask=kind == "gnss")
    if finding.kind == kind:
        return finding
    if finding.kind == "busy":
        raise port_sentence(spec, PortLostError(finding.detail))
    what = {
        "silent": "nothing was heard",
        "unknown": "bytes were heard that no rate and no known format explain",
    }.get(finding.kind, f"a device of another kind ({finding.detail}) was heard")
    how = "PORT@BAUD" if kind == "gnss" else "PORT@BAUD and --imu-format"
    raise InputError(
        f"{spec.device}: {what} there; check the cable, or give {how} to record it all the same."
    )


def probe_all(formats: list[ImuFormat], without: set[str], wanted: set[str]) -> list[Finding]:
    """Listen on all ports at once."""
    from automap.recording.ports import BAUDS, list_ports
    from automap.recording.probe import probe_port

    devices = [port.device for port in list_ports() if port.device not in without]
    if not devices:
        return []
    usual = [baud for form in formats for baud in form.baud]
    bauds = list(dict.fromkeys([*BAUDS[:4], *usual, *BAUDS]))
    chosen = formats if "imu" in wanted else []
    with ThreadPoolExecutor(len(devices)) as pool:
        return list(pool.map(lambda device: probe_port(device, chosen, bauds), devices))


def _warn_narrow_line(spec: PortSpec | None, wish: Wish | None) -> None:
    from automap.recording.ublox import line_load

    if spec is None or wish is None or spec.baud is None:
        return
    baud = wish.baud or spec.baud
    if line_load(wish) * 10 > 0.8 * baud and "ACM" not in spec.device:
        _say(
            f"{baud} baud may be too slow for that many messages "
            f"(up to {line_load(wish) * 10:.0f}); give --gnss-baud a higher rate"
        )


def _say(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr, flush=True)


def port_lines(probe: bool = True) -> list[str]:
    """A line for each port: its name, the hardware, what was heard."""
    from automap.recording.imu_format import known_formats, load_format
    from automap.recording.ports import list_ports

    ports = list_ports()
    if not ports:
        return ["no serial ports"]
    found = {}
    if probe:
        formats = [load_format(name) for name in known_formats()]
        found = {f.device: f for f in probe_all(formats, set(), {"gnss", "imu"})}
    lines = []
    for port in ports:
        finding = found.get(port.device)
        heard = ""
        if finding is not None:
            rate = f" at {finding.baud} baud" if finding.baud else ""
            heard = f"{finding.kind}{rate}{': ' + finding.detail if finding.detail else ''}"
        lines.append(
            "  ".join(x for x in (port.device, port.description, port.hardware, heard) if x)
        )
    return lines


# ---- undoing the settings of a receiver


def restore_receiver(drive: Path) -> list[str]:
    """Send a receiver what a recording kept of its settings; sentences on what was not taken."""
    import json

    from automap.recording.ports import PortLostError, PortSpec, port_sentence
    from automap.recording.recorder import BEFORE
    from automap.recording.restore import restore_on_port
    from automap.recording.ublox import SilentError, frames_from_hex

    path = drive / BEFORE
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        port, baud = str(kept["port"]), int(kept["baud"])
        frames = frames_from_hex(kept["messages"])
    except FileNotFoundError:
        raise InputError(
            f"{path} is missing: that recording changed nothing on its receiver."
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path} cannot be read ({error}); restart the receiver instead."
        ) from None
    try:
        return restore_on_port(port, baud, frames)
    except PortLostError as error:
        raise port_sentence(PortSpec(port, baud), error) from error
    except SilentError as error:
        raise InputError(
            f"{port}: {error}; unplug the receiver, its settings are gone with its power."
        ) from error


# ---- the other way round


@dataclass(frozen=True)
class ReplayRequest:
    """A drive to be played, ``speed`` times as fast, into terminals in ``links``."""

    drive: Path
    links: Path
    speed: float = 1.0
    baud: int = 460_800
    logs: bool = False
    timeout_s: float | None = None


def replay(request: ReplayRequest) -> list[str]:
    """Play a drive into pseudo-terminals once a recorder has opened them; lines on how it went.

    ``replay.json`` in the folder of the terminals says which host time is which of the drive.
    Raises InputError for a drive with nothing to play, StageError when nobody listens.
    """
    from automap.io.atomic import write_json
    from automap.io.drive import load_drive
    from automap.recording.replay import Replay, drive_feeds
    from pipeline.terminal import progress_bar

    drive = load_drive(request.drive)
    player = Replay(drive_feeds(drive), request.links, request.baud)
    try:
        for name, terminal in player.terminals.items():
            print(f"{name}: {terminal.link}  ({terminal.device}, {request.baud} baud)", flush=True)
        limit = float("inf") if request.timeout_s is None else request.timeout_s
        if not player.wait_opened(limit):
            raise StageError(f"nobody opened the terminals within {limit:g} s; start a recorder.")
        with progress_bar("replay") as progress:
            results, origin, start = player.play(
                request.speed,
                logs=request.links if request.logs else None,
                tick=lambda fraction: progress(fraction, ""),
            )
        time.sleep(0.5)  # the reader fetches the last bytes before the hang-up
    finally:
        player.close()
    write_json(
        request.links / "replay.json",
        {"drive": str(request.drive), "drive_ns": origin, "host_ns": start, "speed": request.speed},
    )
    short = [r for r in results if r.sent < r.total]
    if short:
        raise StageError(
            f"{short[0].name}: only {short[0].sent} of {short[0].total} bytes were taken; the "
            "recorder stopped reading."
        )
    return [
        f"{r.name}: {r.sent} bytes in {r.seconds:.1f} s, at most {r.late_s * 1e3:.1f} ms late"
        for r in results
    ]
