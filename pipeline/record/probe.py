"""Finding out what hangs on a port, and at which line rate."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass

from pipeline.record.imu_decode import ImuDecoder
from pipeline.record.imu_format import ImuFormat
from pipeline.record.messages import Message, MessageStream, ubx_frame
from pipeline.record.ports import BAUDS, PortLostError, SerialPort
from pipeline.record.ublox_keys import MON_VER

_LISTEN_S = 2.6
_GIVE_UP_S = 1.1
_GIVE_UP_BYTES = 150
_ENOUGH_SAMPLES = 8
_POLL_BAUDS = (9600, 38400, 115200, 460800)


@dataclass(frozen=True)
class Finding:
    """What was heard on a port.

    ``kind`` is "gnss", "imu", "unknown" (bytes that nothing explains), "silent" or "busy"
    (``detail`` says why it cannot be opened). ``detail`` else names protocols or format.
    """

    device: str
    kind: str
    baud: int | None = None
    detail: str = ""
    form: ImuFormat | None = None


def probe_port(
    device: str,
    formats: Iterable[ImuFormat],
    bauds: Iterable[int] = BAUDS,
    ask: bool = False,
) -> Finding:
    """Listen on a port at one rate after another.

    A receiver counts by two messages with correct checksums, a sensor by samples that nearly
    all fit one of ``formats``. With ``ask`` a silent port is asked for a u-blox receiver's
    version (which other devices could misunderstand).
    """
    formats = list(formats)
    rates = list(bauds)
    heard = False
    for baud in rates:
        try:
            port = SerialPort(device, baud)
        except PortLostError as error:
            if baud != rates[0]:
                continue  # a rate that this driver does not have
            return Finding(device, "busy", detail=str(error))
        try:
            port.discard()
            finding, n_bytes = _listen(port, formats, _LISTEN_S)
        except PortLostError as error:
            return Finding(device, "busy", detail=str(error))
        finally:
            port.close()
        if finding is not None:
            return finding
        if not n_bytes:
            break
        heard = True
    if heard:
        return Finding(device, "unknown", detail="bytes that are neither UBX, NMEA nor a format")
    if ask:
        found = _ask(device, [b for b in rates if b in _POLL_BAUDS] or rates)
        if found is not None:
            return found
    return Finding(device, "silent")


def _listen(
    port: SerialPort, formats: list[ImuFormat], seconds: float
) -> tuple[Finding | None, int]:
    stream = MessageStream()
    decoders = [ImuDecoder(form) for form in formats]
    receiver: list[Message] = []
    n_bytes = 0
    begin = time.monotonic()
    while (passed := time.monotonic() - begin) < seconds:
        t_ns, data = port.read(0.1)
        n_bytes += len(data)
        if data:
            receiver += [m for m in stream.feed(t_ns, data) if _of_receiver(m)]
            for decoder in decoders:
                decoder.feed(t_ns, data)
        if len(receiver) >= 2:
            kinds = {"UBX" if message.key else "NMEA" for message in receiver}
            detail = " and ".join(sorted(kinds, reverse=True))
            return Finding(port.device, "gnss", port.baud, detail), n_bytes
        fitting = _best(decoders)
        if fitting is not None and not receiver:
            form = fitting.form
            return Finding(port.device, "imu", port.baud, form.name, form), n_bytes
        alone = not receiver and not any(decoder.samples for decoder in decoders)
        if alone and passed > _GIVE_UP_S and n_bytes > _GIVE_UP_BYTES:
            break
    return None, n_bytes


def _best(decoders: list[ImuDecoder]) -> ImuDecoder | None:
    """The format that explains what came; one with a checksum or a prefix before others."""
    fitting = [
        decoder
        for decoder in decoders
        if decoder.samples >= _ENOUGH_SAMPLES and decoder.bad <= 0.1 * decoder.samples
    ]
    if not fitting:
        return None
    return max(fitting, key=lambda d: (bool(d.form.checksum or d.form.prefix), d.samples - d.bad))


def _of_receiver(message: Message) -> bool:
    """Whether a message is a GNSS receiver's: any UBX, NMEA of a talker G? or u-blox's own."""
    address = message.address
    return (
        bool(message.key)
        or address.startswith("PUBX")
        or (len(address) == 5 and address[0] in "GB" and address[2:].isalpha())
    )


def _ask(device: str, bauds: list[int]) -> Finding | None:
    for baud in bauds:
        try:
            port = SerialPort(device, baud)
        except PortLostError:
            continue
        try:
            port.write(ubx_frame(MON_VER))
            finding = _answer(port)
        except PortLostError:
            finding = None
        finally:
            port.close()
        if finding is not None:
            return finding
    return None


def _answer(port: SerialPort) -> Finding | None:
    stream = MessageStream()
    end = time.monotonic() + 0.8
    while time.monotonic() < end:
        t_ns, data = port.read(0.1)
        if any(message.key for message in stream.feed(t_ns, data)):
            return Finding(port.device, "gnss", port.baud, "UBX, silent until it is set up")
    return None
