"""The live view of a recording: a panel on a terminal, lines elsewhere."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from pipeline.record.recorder import Snapshot

_LINE_EVERY_S = 10.0
_REDRAW_S = 0.5


class View(Protocol):
    """Shows snapshots."""

    def show(self, snapshot: Snapshot) -> None:
        """Show this one."""


@contextmanager
def open_view(folder: Path, plain: bool) -> Iterator[View]:
    """A view until the block ends."""
    if plain:
        yield PlainView()
        return
    from rich.live import Live

    with Live(auto_refresh=False, transient=True) as live:
        yield PanelView(folder, live)


class PlainView:
    """A line every ten seconds, events at once; for logs and for terminals that cannot draw."""

    def __init__(self) -> None:
        self._next = 0.0
        self._seen = 0
        self._last: tuple[str, ...] = ()

    def show(self, snapshot: Snapshot) -> None:
        """Print what is new."""
        for text in new_events(self._last, snapshot.events):
            print(text.strip(), file=sys.stderr, flush=True)
        self._last = snapshot.events
        if time.monotonic() >= self._next:
            self._next = time.monotonic() + _LINE_EVERY_S
            print(status_line(snapshot), flush=True)


class PanelView:
    """The panel, with the bell at every warning."""

    def __init__(self, folder: Path, live: Any) -> None:
        self._folder = folder
        self._live = live
        self._last: tuple[str, ...] = ()
        self._drawn = 0.0

    def show(self, snapshot: Snapshot) -> None:
        """Redraw, twice a second at most."""
        fresh = new_events(self._last, snapshot.events)
        self._last = snapshot.events
        if any(" warning: " in text for text in fresh):
            self._live.console.bell()
        if fresh or time.monotonic() - self._drawn > _REDRAW_S:
            self._drawn = time.monotonic()
            self._live.update(panel(snapshot, self._folder), refresh=True)


def new_events(before: tuple[str, ...], now: tuple[str, ...]) -> tuple[str, ...]:
    """Events that came after those seen before; the list drops its oldest."""
    if not before:
        return now
    for at in range(len(now) - 1, -1, -1):
        if now[at] == before[-1]:
            return now[at + 1 :]
    return now


def panel(snapshot: Snapshot, folder: Path) -> Any:
    """The picture of a recording."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name, text, style in rows(snapshot):
        table.add_row(name, Text(text, style=style))
    parts: list[Any] = [table]
    if snapshot.troubles:
        parts.append(Text(""))
        parts += [Text(f"! {text}", style="bold white on red") for text in snapshot.troubles]
    parts.append(Text(""))
    for text in snapshot.events[-6:]:
        parts.append(Text(text, style="yellow" if " warning: " in text else "dim"))
    style = "red" if snapshot.troubles else "green"
    title = f"recording {clock_text(snapshot.elapsed_s)}  {folder}"
    return Panel(Group(*parts), title=title, subtitle="Ctrl-C ends", border_style=style)


def rows(snapshot: Snapshot) -> list[tuple[str, str, str]]:
    """Name, text and style of the panel's rows."""
    found = []
    gnss = snapshot.gnss
    if gnss is not None:
        sats = "?" if gnss.satellites is None else str(gnss.satellites)
        style = "green" if gnss.good else "red"
        fix = f"{gnss.fix}, {sats} satellites"
        if math.isfinite(gnss.accuracy_m):
            fix += f", {gnss.accuracy_m:.1f} m"
        found.append(("gnss", fix, style))
        if math.isfinite(gnss.lat_deg):
            speed = f"  {gnss.speed * 3.6:.0f} km/h" if math.isfinite(gnss.speed) else ""
            found.append(("", f"{gnss.lat_deg:.6f} {gnss.lon_deg:.6f}{speed}", ""))
        raw = f", raw {gnss.raw_hz:.1f}" if gnss.raw_hz else ""
        rates = f"{gnss.rate_hz:.1f} fixes/s{raw}, {gnss.bytes_per_s / 1e3:.1f} kB/s"
        found.append(("", f"{rates}  {snapshot.gnss_port}", ""))
        found.append(("", _gaps(gnss.epochs, "epochs", gnss.gaps, gnss.longest_gap_s), ""))
        if math.isfinite(gnss.clock_offset_s):
            from pipeline.record.gnss_watch import offset_text

            found.append(("clock", f"computer {offset_text(gnss.clock_offset_s)} off UTC", ""))
    imu = snapshot.imu
    if imu is not None:
        found.append(("imu", f"{imu.rate_hz:.1f} samples/s  {snapshot.imu_port}", ""))
        if imu.accel:
            accel = " ".join(f"{value:+7.2f}" for value in imu.accel)
            gyro = " ".join(f"{math.degrees(value):+7.1f}" for value in imu.gyro)
            found.append(("", f"gravity {imu.gravity:.2f} m/s²", ""))
            warm = f"   {imu.temp_c:.0f} °C" if math.isfinite(imu.temp_c) else ""
            found.append(("", f"{accel} m/s²   {gyro} °/s{warm}", ""))
        found.append(("", _gaps(imu.samples, "samples", imu.gaps, imu.longest_gap_s), ""))
        if imu.bad:
            found.append(("", f"{imu.bad} damaged lines", "yellow"))
    for name, camera in snapshot.cameras.items():
        size = f"{camera.width}x{camera.height}" if camera.width else "waiting"
        missed = f", {camera.missed} missed" if camera.missed else ""
        text = f"{size}, {camera.rate_hz:.1f} frames/s, {camera.frames} frames{missed}"
        found.append((name, text, "" if camera.connected else "red"))
    found.append(("disk", disk_text(snapshot), ""))
    return found


def _gaps(count: int, what: str, gaps: int, longest_s: float) -> str:
    if not gaps:
        return f"{count} {what}, no gaps"
    return f"{count} {what}, {gaps} gaps, the longest {longest_s:.1f} s"


def disk_text(snapshot: Snapshot) -> str:
    """What is written and what room is left."""
    text = f"{snapshot.bytes_written / 1e6:.1f} MB written, {snapshot.disk_free / 1e9:.1f} GB left"
    if math.isfinite(snapshot.disk_left_s):
        text += f" ({snapshot.disk_left_s / 3600:.0f} h)"
    if snapshot.bytes_waiting:
        text += f", {snapshot.bytes_waiting / 1e6:.1f} MB waiting in memory"
    return text


def status_line(snapshot: Snapshot) -> str:
    """The recording in one line."""
    parts = [clock_text(snapshot.elapsed_s)]
    gnss, imu = snapshot.gnss, snapshot.imu
    if gnss is not None:
        sats = "?" if gnss.satellites is None else str(gnss.satellites)
        parts.append(f"gnss {gnss.fix}, {sats} sats, {gnss.rate_hz:.1f}/s, {gnss.gaps} gaps")
    if imu is not None:
        parts.append(f"imu {imu.rate_hz:.1f}/s, gravity {imu.gravity:.2f}, {imu.gaps} gaps")
    for name, camera in snapshot.cameras.items():
        parts.append(f"{name} {camera.rate_hz:.1f}/s, {camera.frames} frames")
    parts.append(disk_text(snapshot))
    return " | ".join(parts)


def clock_text(seconds: float) -> str:
    """Hours, minutes and seconds."""
    whole = int(max(seconds, 0.0))
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
