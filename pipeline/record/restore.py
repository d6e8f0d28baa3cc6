"""Bringing a receiver back to its earlier settings, outside a recording."""

from __future__ import annotations

import time
from collections.abc import Callable

from pipeline.record.messages import Message, MessageStream
from pipeline.record.ports import PortLostError, SerialPort, list_ports
from pipeline.record.ublox import Receiver


def restore_on_port(device: str, baud: int, frames: list[bytes]) -> list[str]:
    """Send the messages ``frames`` to a receiver; sentences on what it did not take.

    Raises PortLostError when the port cannot be opened, SilentError when nobody answers.
    """
    port = SerialPort(device, baud)
    native = any(p.device == device and p.u_blox for p in list_ports())
    try:
        receiver = Receiver(port_exchange(port), native)
        receiver.version()
        return receiver.restore(frames, port.set_baud)
    finally:
        port.close()


def port_exchange(
    port: SerialPort,
) -> Callable[[bytes, Callable[[Message], bool], float], Message | None]:
    """Questions and answers on a port that nobody else reads."""
    stream = MessageStream()

    def exchange(
        data: bytes, accept: Callable[[Message], bool], timeout_s: float
    ) -> Message | None:
        port.write(data)
        end = time.monotonic() + timeout_s
        while (left := end - time.monotonic()) > 0:
            try:
                t_ns, piece = port.read(min(left, 0.1))
            except PortLostError:
                return None
            for message in stream.feed(t_ns, piece) if piece else ():
                if accept(message):
                    return message
        return None

    return exchange
