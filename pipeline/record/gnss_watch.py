"""What the receiver's stream says of itself while it is recorded."""

from __future__ import annotations

import struct
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

from automap.io.ubx_names import message_name
from pipeline.record.messages import Message
from pipeline.record.ublox_keys import NAV_PVT, NAV_SOL, RXM_RAW, RXM_RAWX

_WINDOW_NS = 5_000_000_000
_FIX_NAMES = {0: "no fix", 1: "dead reckoning", 2: "2D", 3: "3D", 4: "3D + sensors", 5: "time only"}
_QUALITY = {0: "no fix", 1: "GPS", 2: "DGPS", 4: "RTK fixed", 5: "RTK float", 6: "dead reckoning"}


@dataclass(frozen=True)
class GnssState:
    """The receiver as seen now. NaN or None where unknown.

    ``rate_hz`` of epochs and ``bytes_per_s`` over the last seconds; ``clock_offset_s`` is the
    computer's UTC minus the receiver's, message delay included.
    """

    fix: str = "nothing yet"
    good: bool = False
    satellites: int | None = None
    accuracy_m: float = float("nan")
    lat_deg: float = float("nan")
    lon_deg: float = float("nan")
    speed: float = float("nan")
    rate_hz: float = 0.0
    raw_hz: float = 0.0
    bytes_per_s: float = 0.0
    epochs: int = 0
    gaps: int = 0
    longest_gap_s: float = 0.0
    clock_offset_s: float = float("nan")
    messages: int = 0
    bad: int = 0


class GnssWatch:
    """Follows fixes, rates and gaps. ``wall`` gives the computer's UTC in seconds."""

    def __init__(self, wanted_hz: float | None = None, raw: bool = False,
                 wall: Callable[[], float] = time.time) -> None:  # fmt: skip
        self.state = GnssState()
        self.kinds: Counter[str] = Counter()
        self.wanted_hz = wanted_hz
        self.wants_raw = raw
        self._wall = wall
        self._epochs: deque[int] = deque(maxlen=400)
        self._raws: deque[int] = deque(maxlen=400)
        self._bytes: deque[tuple[int, int]] = deque()
        self._tag: object = None
        self._first_ns: int | None = None
        self._good_ns: int | None = None
        self._message_ns: int | None = None
        self._noise_bytes = 0
        self._by_pvt = False
        self._own_ns: int | None = None
        self._was_fast = False

    def count_bytes(self, t_ns: int, size: int) -> None:
        """Bytes arrived."""
        if self._first_ns is None:
            self._first_ns = t_ns
        self._noise_bytes += size
        self._bytes.append((t_ns, size))
        while self._bytes and t_ns - self._bytes[0][0] > _WINDOW_NS:
            self._bytes.popleft()

    def take(self, message: Message) -> None:
        """A whole message arrived."""
        name = message_name(message.key) if message.key else message.address
        if name in self.kinds or len(self.kinds) < 500:
            self.kinds[name] += 1
        self._message_ns = message.t_ns
        self._noise_bytes = 0
        self.state = replace(self.state, messages=self.state.messages + 1)
        if message.key in (NAV_PVT, NAV_SOL):
            self._own_ns = message.t_ns
        if message.key == NAV_PVT and len(message.payload) >= 84:
            self._by_pvt = True
            self._pvt(message)
        elif message.key == NAV_SOL and len(message.payload) >= 52 and not self._by_pvt:
            self._sol(message)
        elif message.key in (RXM_RAWX, RXM_RAW):
            self._raws.append(message.t_ns)
        elif not message.key and message.address[2:] == "GGA" and not self._by_pvt:
            self._gga(message)
        elif not message.key and message.address[2:] == "RMC" and not self._by_pvt:
            self._rmc(message)

    def _pvt(self, message: Message) -> None:
        p = message.payload
        fix, flags, sats = p[20], p[21], p[23]
        lon, lat = struct.unpack_from("<ii", p, 24)
        (h_acc,) = struct.unpack_from("<I", p, 40)
        (speed,) = struct.unpack_from("<i", p, 60)
        good = bool(flags & 1) and fix in (2, 3, 4)
        text = _FIX_NAMES.get(fix, "unknown")
        if flags >> 6:
            text = "RTK fixed" if flags >> 6 == 2 else "RTK float"
        self._epoch(p[0:4], message.t_ns, good, text if good or not fix else f"{text}, not valid")
        self.state = replace(
            self.state, satellites=sats, accuracy_m=h_acc * 1e-3, lat_deg=lat * 1e-7,
            lon_deg=lon * 1e-7, speed=speed * 1e-3,
        )  # fmt: skip
        if p[11] & 3 == 3:
            year, month, day, hour, minute, second = struct.unpack_from("<HBBBBB", p, 4)
            (nano,) = struct.unpack_from("<i", p, 16)
            self._clock(year, month, day, hour * 3600 + minute * 60 + second + nano * 1e-9)

    def _sol(self, message: Message) -> None:
        p = message.payload
        (accuracy,) = struct.unpack_from("<I", p, 24)
        good = bool(p[11] & 1) and p[10] in (2, 3, 4)
        self._epoch(p[0:4], message.t_ns, good, _FIX_NAMES.get(p[10], "unknown"))
        self.state = replace(self.state, satellites=p[47], accuracy_m=accuracy * 1e-2)

    def _gga(self, message: Message) -> None:
        cells = message.payload.decode("ascii", "replace").split(",")
        if len(cells) < 10:
            return
        quality = int(cells[6]) if cells[6].isdigit() else 0
        self._epoch(cells[1], message.t_ns, quality not in (0, 6), _QUALITY.get(quality, "GPS"))
        lat, lon = _degrees(cells[2], cells[3]), _degrees(cells[4], cells[5])
        sats = int(cells[7]) if cells[7].isdigit() else None
        self.state = replace(self.state, satellites=sats, lat_deg=lat, lon_deg=lon)

    def _rmc(self, message: Message) -> None:
        cells = message.payload.decode("ascii", "replace").split(",")
        if len(cells) < 10:
            return
        self._epoch(cells[1], message.t_ns, cells[2] == "A", None)
        try:
            self.state = replace(self.state, speed=float(cells[7]) * 0.514444)
            day, month, year = int(cells[9][:2]), int(cells[9][2:4]), 2000 + int(cells[9][4:6])
            of_day = int(cells[1][:2]) * 3600 + int(cells[1][2:4]) * 60 + float(cells[1][4:])
            self._clock(year, month, day, of_day)
        except (ValueError, IndexError):
            return

    def _epoch(self, tag: object, t_ns: int, good: bool, text: str | None) -> None:
        """Count an epoch once, whichever message speaks of it first."""
        state = self.state
        if text is not None:
            state = replace(state, fix=text, good=good)
        if tag != self._tag:
            self._tag = tag
            steps = list(self._epochs)
            if len(steps) >= 5:
                usual = sorted(b - a for a, b in pairwise(steps))
                step = t_ns - steps[-1]
                if step > 2.5 * usual[len(usual) // 2] and step > 250_000_000:
                    longest = max(state.longest_gap_s, step * 1e-9)
                    state = replace(state, gaps=state.gaps + 1, longest_gap_s=longest)
            self._epochs.append(t_ns)
            state = replace(state, epochs=state.epochs + 1)
        if good:
            self._good_ns = t_ns
        self.state = state

    def _clock(self, year: int, month: int, day: int, of_day_s: float) -> None:
        try:
            utc = datetime(year, month, day, tzinfo=UTC) + timedelta(seconds=of_day_s)
        except ValueError:
            return
        self.state = replace(self.state, clock_offset_s=self._wall() - utc.timestamp())

    def update(self, now_ns: int) -> GnssState:
        """The state with its rates as of now."""
        size = sum(n for t, n in self._bytes if now_ns - t <= _WINDOW_NS)
        self.state = replace(
            self.state,
            rate_hz=_rate(self._epochs, now_ns),
            raw_hz=_rate(self._raws, now_ns),
            bytes_per_s=size / (_WINDOW_NS * 1e-9),
        )
        return self.state

    def understood(self, now_ns: int, within_s: float = 3.0) -> bool:
        """Whether messages were recognised lately."""
        return self._message_ns is not None and now_ns - self._message_ns < within_s * 1e9

    def forgot(self, now_ns: int) -> bool:
        """Whether a receiver that did what it was set to does so no more: UBX fixes have stopped
        among other messages, or come too seldom."""
        wanted = self.wanted_hz or 1.0
        rate = self.update(now_ns).rate_hz
        self._was_fast = self._was_fast or rate > 0.8 * wanted
        if self._own_ns is None or not self.understood(now_ns):
            return False
        stopped = now_ns - self._own_ns > 4e9 + 2.5e9 / wanted
        return stopped or (self._was_fast and rate < 0.6 * wanted)

    def unreadable(self) -> bool:
        """Whether bytes come of which none make a message: a wrong line rate."""
        return self._noise_bytes > 1500

    def conditions(self, now_ns: int, started_ns: int, last_byte_ns: int | None,
                   baud: int | None) -> dict[str, str]:  # fmt: skip
        """What is wrong now."""
        found: dict[str, str] = {}
        state = self.update(now_ns)
        running_s = (now_ns - started_ns) * 1e-9
        silent_s = (now_ns - (last_byte_ns or started_ns)) * 1e-9
        if silent_s > 2.5:
            found["gnss-silent"] = "gnss: no bytes from the receiver; look at its cable and power"
            return found
        if self.unreadable() and not self.understood(now_ns):
            found["gnss-noise"] = "gnss: bytes come but no messages; is the line rate right?"
            return found
        since_s = (now_ns - (self._good_ns or started_ns)) * 1e-9
        if not state.good and since_s > (5.0 if self._good_ns else 30.0):
            found["gnss-fix"] = "gnss: no fix; does the antenna see the sky?"
        elif state.good and state.satellites is not None and state.satellites < 5:
            found["gnss-satellites"] = f"gnss: only {state.satellites} satellites"
        if self.wanted_hz and running_s > 15 and state.rate_hz < 0.8 * self.wanted_hz:
            found["gnss-rate"] = (
                f"gnss: {state.rate_hz:.1f} fixes a second instead of {self.wanted_hz:g}"
            )
        if self.wants_raw and running_s > 15 and state.raw_hz == 0:
            found["gnss-raw"] = "gnss: no raw data (RAWX) come"
        if baud and state.bytes_per_s * 10 > 0.9 * baud:
            found["gnss-line"] = (
                f"gnss: the line is full ({state.bytes_per_s * 10 / baud:.0%} of {baud} baud); "
                "messages will be lost, raise the line rate"
            )
        if abs(state.clock_offset_s) > 2.0:
            found["clock"] = (
                f"the computer's clock is {offset_text(state.clock_offset_s)} off UTC; the "
                "recording does not depend on it"
            )
        return found


def _rate(times: deque[int], now_ns: int) -> float:
    """Events a second over the last seconds; 0 when they have stopped."""
    recent = [t for t in times if now_ns - t <= _WINDOW_NS]
    if len(recent) < 2 or now_ns - recent[-1] > 2.5 * _WINDOW_NS / len(recent) + 1e9:
        return 0.0
    return (len(recent) - 1) / max((recent[-1] - recent[0]) * 1e-9, 1e-3)


def _degrees(text: str, side: str) -> float:
    """Degrees of ddmm.mm and a letter; NaN when empty."""
    try:
        value = float(text)
    except ValueError:
        return float("nan")
    whole = int(value / 100)
    degrees = whole + (value - 100 * whole) / 60.0
    return -degrees if side in ("S", "W") else degrees


def offset_text(seconds: float) -> str:
    """A signed span of time in a unit that suits it."""
    if abs(seconds) < 600.0:
        return f"{seconds:+.2f} s"
    return f"{seconds / 3600:+.1f} h" if abs(seconds) < 2e5 else f"{seconds / 86400:+.0f} days"
