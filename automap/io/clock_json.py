"""The clock of a drive as the sync stage writes it, ``sync.json``."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from automap.errors import InputError
from automap.io.atomic import write_json
from automap.records import ClockModel


def write_clock(path: Path, clock: ClockModel, diagnostics: dict[str, Any] | None = None) -> None:
    """Write the fields of the clock and, beside them, what else is known about it."""
    write_json(path, asdict(clock) | (diagnostics or {}))


def read_clock(path: Path) -> ClockModel:
    """Read what ``write_clock`` wrote; InputError when it is missing or damaged.

    A null sd stands for one that is infinite.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        sd_offset, delay = content["sd_offset_s"], content["output_delay_s"]
        return ClockModel(
            ref_ns=int(content["ref_ns"]),
            ref_gps_s=float(content["ref_gps_s"]),
            drift=float(content["drift"]),
            sd_offset_s=float("inf") if sd_offset is None else float(sd_offset),
            sd_drift=float(content["sd_drift"]),
            method=str(content["method"]),
            output_delay_s=None if delay is None else float(delay),
        )
    except FileNotFoundError:
        raise InputError(f"{path} is missing; run the sync stage.") from None
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is damaged ({error}); run again with --force.") from error
