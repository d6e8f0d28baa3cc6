"""Setting up a u-blox receiver: asking, setting, reading back, restoring.

Receivers of generation 9 on take keys and values (UBX-CFG-VALSET), older ones, down to
u-blox 5, one message for each matter (UBX-CFG-MSG, UBX-CFG-RATE, UBX-CFG-PRT). Everything
goes to the receiver's working memory only: a power cycle undoes it.

References: u-blox F9 HPG 1.32 interface description (UBX-22008968), 3.10 and 5; u-blox 8/M8
receiver description (UBX-13003221), 32.10; u-blox 5 receiver protocol specification
(GPS.G5-X-07036).
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from automap.io.ubx_names import message_name
from pipeline.record.messages import Message, ubx_frame
from pipeline.record.ublox_keys import (
    ACK,
    BAUD_KEYS,
    CFG_MSG,
    CFG_PRT,
    CFG_RATE,
    CFG_VALGET,
    CFG_VALSET,
    KEY_RATE_MEAS,
    KEY_RATE_NAV,
    MON_VER,
    MSGOUT,
    NAK,
    NAV_DOP,
    NAV_POSLLH,
    NAV_PVT,
    NAV_SOL,
    NAV_TIMEGPS,
    NAV_VELNED,
    PORTS,
    RAM,
    RXM_RAW,
    RXM_RAWX,
    RXM_SFRB,
    RXM_SFRBX,
    UBX_OUT,
    key_values,
    valset_payload,
)
from pipeline.record.ublox_version import Version, parse_version

Exchange = Callable[[bytes, Callable[[Message], bool], float], Message | None]
"""Sends bytes and gives the first message that the test accepts, None after so many seconds."""


class RefusedError(Exception):
    """The receiver said no (UBX-ACK-NAK)."""


class SilentError(Exception):
    """The receiver did not answer."""


@dataclass(frozen=True)
class Setup:
    """What a receiver is to send: fixes ``rate_hz`` times a second, raw data, a line rate."""

    pvt: bool = True
    raw: bool = False
    rate_hz: float | None = None
    baud: int | None = None

    @property
    def period_ms(self) -> int | None:
        """Time between fixes."""
        return None if self.rate_hz is None else round(1000.0 / self.rate_hz)


@dataclass
class Outcome:
    """What became of a setup.

    ``done`` and ``refused`` are sentences; ``before`` are the messages that bring back what
    the receiver did before, to be sent in this order.
    """

    version: Version | None = None
    done: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    before: list[bytes] = field(default_factory=list)
    baud_before: int | None = None


class Receiver:
    """The conversation with one receiver.

    ``exchange`` is given by whoever reads the port, so that the very same bytes go into the
    log. Every question is repeated ``tries`` times.
    """

    def __init__(
        self,
        exchange: Exchange,
        native_usb: bool = False,
        timeout_s: float = 1.0,
        tries: int = 3,
    ) -> None:
        self._exchange = exchange
        self._usb = native_usb
        self._timeout_s = timeout_s
        self._tries = tries

    def version(self) -> Version:
        """Ask who it is; SilentError when it says nothing."""
        answer = self._ask(MON_VER, b"", lambda m: m.key == MON_VER and len(m.payload) >= 40)
        return parse_version(answer.payload)

    def configure(self, setup: Setup, set_host_baud: Callable[[int], None]) -> Outcome:
        """Set what is wished, read it back, and remember what was before.

        ``set_host_baud`` changes our side of the line. Raises SilentError when the receiver does
        not answer at all; what it refuses stands in the outcome.
        """
        outcome = Outcome(version=self.version())
        assert outcome.version is not None
        if outcome.version.by_keys:
            self._by_keys(setup, outcome, set_host_baud)
        else:
            self._by_messages(setup, outcome, set_host_baud)
        return outcome

    def restore(self, before: list[bytes], set_host_baud: Callable[[int], None]) -> list[str]:
        """Send what brings an earlier state back; sentences on what was not taken."""
        failed = []
        for frame in before:
            key, payload = frame[2] << 8 | frame[3], frame[6:-2]
            baud = _baud_in(key, payload)
            if baud is not None and not self._usb:
                # its acknowledgement comes at one rate or the other
                self._exchange(frame, lambda m: m.key in (ACK, NAK), self._timeout_s)
                set_host_baud(baud)
                continue
            try:
                self._command(key, payload)
            except (RefusedError, SilentError) as error:
                failed.append(f"not restored: {error}")
        return failed

    # ---- generation 9 on

    def _ports(self) -> tuple[str, ...]:
        return ("USB",) if self._usb else ("UART1", "UART2")

    def _by_keys(
        self, setup: Setup, outcome: Outcome, set_host_baud: Callable[[int], None]
    ) -> None:
        if setup.period_ms is not None:
            values = {KEY_RATE_MEAS: setup.period_ms, KEY_RATE_NAV: 1}
            self._set_keys(values, f"a fix every {setup.period_ms} ms", outcome)
        for port in self._ports():
            only = port == self._ports()[0]
            keys = {UBX_OUT[port]: 1}
            if setup.pvt:
                keys[MSGOUT[NAV_PVT] + PORTS[port]] = 1
            self._set_keys(keys, f"NAV-PVT on {port}", outcome, must=only)
            if setup.raw:
                raw = {MSGOUT[m] + PORTS[port]: 1 for m in (RXM_RAWX, RXM_SFRBX)}
                self._set_keys(raw, f"RAWX and SFRBX on {port}", outcome, must=only)
        if setup.baud is not None and not self._usb:
            key = BAUD_KEYS["UART1"]
            before = self.get_keys([key])[key]
            frame = ubx_frame(CFG_VALSET, valset_payload({key: setup.baud}))
            self._change_baud(frame, before, setup.baud, outcome, set_host_baud)
            if outcome.baud_before is not None:
                outcome.before.append(ubx_frame(CFG_VALSET, valset_payload({key: before})))

    def _set_keys(
        self, values: dict[int, int], what: str, outcome: Outcome, must: bool = True
    ) -> None:
        try:
            before = self.get_keys(list(values))
            self._command(CFG_VALSET, valset_payload(values))
            now = self.get_keys(list(values))
        except RefusedError:
            if must:
                outcome.refused.append(f"{what}: the receiver refused it")
            return
        outcome.before.append(ubx_frame(CFG_VALSET, valset_payload(before)))
        wrong = {key: now.get(key) for key, value in values.items() if now.get(key) != value}
        if wrong:
            shown = ", ".join(f"0x{key:08X} = {value}" for key, value in wrong.items())
            outcome.refused.append(f"{what}: acknowledged, but it reads back {shown}")
        else:
            outcome.done.append(what)

    def get_keys(self, keys: list[int]) -> dict[int, int]:
        """Values of configuration keys in use; RefusedError when it knows one of them not."""
        payload = struct.pack("<BBH", 0, RAM, 0) + struct.pack(f"<{len(keys)}I", *keys)
        answer = self._ask(CFG_VALGET, payload, lambda m: m.key == CFG_VALGET)
        return dict(key_values(answer.payload[4:]))

    # ---- down to u-blox 5

    def _by_messages(
        self, setup: Setup, outcome: Outcome, set_host_baud: Callable[[int], None]
    ) -> None:
        assert outcome.version is not None
        if setup.period_ms is not None:
            self._set_rate(setup.period_ms, outcome)
        messages: list[int] = []
        if setup.pvt and outcome.version.has_pvt:
            messages = [NAV_PVT]
        elif setup.pvt:
            # before generation 7 there is no NAV-PVT; together these say the same
            messages = [NAV_SOL, NAV_POSLLH, NAV_VELNED, NAV_TIMEGPS, NAV_DOP]
        for message in messages:
            self._set_message(message, outcome)
        if setup.raw:
            self._set_raw(outcome)
        if setup.baud is not None and not self._usb:
            self._set_port(setup.baud, outcome, set_host_baud)

    def _set_raw(self, outcome: Outcome) -> None:
        """Raw data under the name that this generation has for them."""
        assert outcome.version is not None
        newer = outcome.version.protocol >= 15.0
        for message in (RXM_RAWX, RXM_SFRBX) if newer else (RXM_RAW, RXM_SFRB):
            self._set_message(message, outcome)

    def _set_rate(self, period_ms: int, outcome: Outcome) -> None:
        what = f"a fix every {period_ms} ms"
        try:
            before = self._ask(CFG_RATE, b"", _is(CFG_RATE, 6)).payload[:6]
            reference = before[4:6]
            wanted = struct.pack("<HH", period_ms, 1) + reference
            self._command(CFG_RATE, wanted)
            now = self._ask(CFG_RATE, b"", _is(CFG_RATE, 6)).payload[:6]
        except RefusedError:
            outcome.refused.append(f"{what}: the receiver refused it")
            return
        outcome.before.append(ubx_frame(CFG_RATE, before))
        if now[:4] != wanted[:4]:
            period, cycles = struct.unpack("<HH", now[:4])
            outcome.refused.append(f"{what}: acknowledged, but it reads back {period * cycles} ms")
        else:
            outcome.done.append(what)

    def _set_message(self, message: int, outcome: Outcome) -> None:
        what = f"{_name(message)} in every epoch"
        address = bytes((message >> 8, message & 255))

        def of_message(m: Message) -> bool:
            return m.key == CFG_MSG and len(m.payload) >= 6 and m.payload[:2] == address

        try:
            before = self._ask(CFG_MSG, address, of_message).payload
            self._command(CFG_MSG, address + b"\x01")
            now = self._ask(CFG_MSG, address, of_message).payload
        except RefusedError:
            outcome.refused.append(f"{what}: the receiver refused it")
            return
        outcome.before.append(ubx_frame(CFG_MSG, before))
        if not any(now[2:]):
            outcome.refused.append(f"{what}: acknowledged, but it reads back as off")
        else:
            outcome.done.append(what)

    def _set_port(self, baud: int, outcome: Outcome, set_host_baud: Callable[[int], None]) -> None:
        try:
            before = self._ask(CFG_PRT, b"", _is(CFG_PRT, 20)).payload[:20]
        except RefusedError:
            outcome.refused.append(f"{baud} baud: the receiver does not tell its port")
            return
        wanted = before[:8] + struct.pack("<I", baud) + before[12:]
        speed = struct.unpack_from("<I", before, 8)[0]
        frame = ubx_frame(CFG_PRT, wanted)
        self._change_baud(frame, int(speed), baud, outcome, set_host_baud)
        if outcome.baud_before is not None:
            outcome.before.append(ubx_frame(CFG_PRT, before))

    # ---- common

    def _change_baud(
        self,
        frame: bytes,
        before: int,
        baud: int,
        outcome: Outcome,
        set_host_baud: Callable[[int], None],
    ) -> None:
        """Both sides to another rate; back to the old one when the receiver is not heard."""
        if before == baud:
            outcome.done.append(f"{baud} baud, as it was")
            return
        for _ in range(self._tries):
            # the acknowledgement comes at either rate: what counts is hearing it at the new one
            self._exchange(frame, lambda m: m.key in (ACK, NAK), self._timeout_s)
            set_host_baud(baud)
            try:
                self.version()
            except SilentError:
                # it may have missed the command
                set_host_baud(before)
                continue
            outcome.baud_before = before
            outcome.done.append(f"{baud} baud")
            return
        outcome.refused.append(f"{baud} baud: it is not heard at that rate; left at {before}")

    def _command(self, key: int, payload: bytes) -> None:
        """Send a setting and wait for its acknowledgement."""
        address = bytes((key >> 8, key & 255))

        def answers(m: Message) -> bool:
            return m.key in (ACK, NAK) and m.payload[:2] == address

        for _ in range(self._tries):
            answer = self._exchange(ubx_frame(key, payload), answers, self._timeout_s)
            if answer is not None:
                if answer.key == NAK:
                    raise RefusedError(f"{_name(key)} was refused")
                return
        raise SilentError(f"{_name(key)} was not answered")

    def _ask(self, key: int, payload: bytes, accept: Callable[[Message], bool]) -> Message:
        """Poll a message."""
        address = bytes((key >> 8, key & 255))

        def answers(m: Message) -> bool:
            return accept(m) or (m.key == NAK and m.payload[:2] == address)

        for _ in range(self._tries):
            answer = self._exchange(ubx_frame(key, payload), answers, self._timeout_s)
            if answer is not None:
                if answer.key == NAK:
                    raise RefusedError(f"{_name(key)} was refused")
                return answer
        raise SilentError(f"{_name(key)} was not answered")


def _baud_in(key: int, payload: bytes) -> int | None:
    """The line rate that a setting brings, None for other settings."""
    if key == CFG_PRT and len(payload) == 20:
        return int(struct.unpack_from("<I", payload, 8)[0])
    if key == CFG_VALSET:
        values = dict(key_values(payload[4:]))
        return next((values[k] for k in BAUD_KEYS.values() if k in values), None)
    return None


def _is(key: int, size: int) -> Callable[[Message], bool]:
    return lambda m: m.key == key and len(m.payload) >= size


def _name(key: int) -> str:
    return message_name(key)


def setup_from(pvt: bool, raw: bool, rate_hz: float | None, baud: int | None) -> Setup | None:
    """A setup from what was asked for, None when nothing was."""
    if not (pvt or raw or rate_hz or baud):
        return None
    return Setup(pvt=True, raw=raw, rate_hz=rate_hz, baud=baud)


def line_load(setup: Setup, satellites: int = 32) -> float:
    """Bytes a second that a setup will send, at most, for so many signals."""
    rate = setup.rate_hz or 1.0
    raw = 24 + 32 * satellites if setup.raw else 0
    # a subframe of each satellite in about six seconds
    return rate * (100 + raw) + (satellites * 60 / 6 if setup.raw else 0)


def frames_from_hex(lines: Any) -> list[bytes]:
    """Messages from the hexadecimal lines in which a drive keeps them."""
    return [bytes.fromhex(str(line)) for line in lines]
