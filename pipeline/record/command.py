"""``automap record``: a drive from the devices of a car."""

from __future__ import annotations

import contextlib
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import ConfigError, StageError
from automap.io import names
from pipeline.record.devices import find_devices, named_cameras, say, warn_narrow_line
from pipeline.record.request import RecordRequest

if TYPE_CHECKING:
    from pipeline.record.ending import Ending
    from pipeline.record.recorder import Recorder
    from pipeline.record.view import View

_TICK_S = 0.2


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
    from pipeline.record.clock import HostClock
    from pipeline.record.manifest_text import read_rig
    from pipeline.record.recorder import Plan, Recorder
    from pipeline.record.ublox import setup_from

    folder = request.out or default_folder()
    if (folder / names.MANIFEST).exists():
        raise ConfigError(f"{folder} holds a drive already; choose another folder with -o.")
    setup = setup_from(request.pvt, request.raw, request.rate_hz, request.gnss_baud)
    rig = read_rig(request.rig) if request.rig is not None else None
    cameras = named_cameras(request)
    gnss, imu, form = find_devices(request)
    warn_narrow_line(gnss, setup)
    plan = Plan(
        gnss=gnss, imu=imu, imu_format=form, cameras=cameras, rig=rig, setup=setup,
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
    from pipeline.record.view import open_view

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
            say(f"the view failed ({type(error).__name__}: {error}); recording goes on")


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
