"""``automap record --restore-receiver``: undoing what a recording set."""

from __future__ import annotations

from pathlib import Path

from automap.errors import InputError
from automap.io.json_text import parse_json


def restore_receiver(drive: Path) -> list[str]:
    """Send a receiver what a recording kept of its settings; sentences on what was not taken."""
    from pipeline.record.ports import PortLostError, PortSpec, port_sentence
    from pipeline.record.receiver_setup import BEFORE
    from pipeline.record.restore import restore_on_port
    from pipeline.record.ublox import SilentError, frames_from_hex

    path = drive / BEFORE
    try:
        kept = parse_json(path.read_text(encoding="utf-8"))
        port, baud = str(kept["port"]), int(kept["baud"])
        frames = frames_from_hex(kept["messages"])
    except (FileNotFoundError, NotADirectoryError):
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
