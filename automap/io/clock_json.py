"""The clock of a drive as the sync stage writes it, ``sync.json``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from automap.errors import InputError
from automap.io.atomic import write_json
from automap.io.json_text import parse_json
from automap.records import ClockModel, DriveClocks, ReceiverFilter

_T = TypeVar("_T")
_MOST_GPS_S = 9.0e9
"""More seconds do not fit into the nanoseconds of 64 bits."""
_MOST_FILTER_S = 60.0
"""No bend is left behind a filter of a minute."""
_MOST_DRIFT = 0.1
"""Far more than any clock; from 1 on times would turn round."""


def write_clock(path: Path, clock: ClockModel, diagnostics: dict[str, Any] | None = None) -> None:
    """Write the fields of the clock and, beside them, what else is known about it."""
    write_json(path, asdict(clock) | (diagnostics or {}))


def read_clock(path: Path) -> ClockModel:
    """Read what ``write_clock`` wrote; InputError when it is missing or damaged.

    A null sd stands for one that is infinite.
    """
    return _read(path, _clock)


def write_clocks(path: Path, clocks: DriveClocks, diagnostics: dict[str, Any]) -> None:
    """Write the drive's clock as ``write_clock`` does, with the names of all its clocks."""
    named: dict[str, Any] = {"time_base": clocks.time_base}
    if clocks.arrival is not None:
        named["arrival_clock"] = asdict(clocks.arrival)
        named["arrival_time_base"] = clocks.arrival_time_base
    if clocks.receiver_filter is not None:
        named["receiver_filter"] = asdict(clocks.receiver_filter)
    if clocks.shown_offset_s is not None:
        named["shown_offset_s"] = clocks.shown_offset_s
    write_clock(path, clocks.clock, named | diagnostics)


def read_clocks(path: Path) -> DriveClocks:
    """Read what ``write_clocks`` wrote; InputError when it is missing or damaged."""
    return _read(path, _clocks)


def _read(path: Path, parse: Callable[[dict[str, Any]], _T]) -> _T:
    try:
        return parse(parse_json(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise InputError(f"{path} is missing; run the sync stage.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); check the file.") from None
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise InputError(f"{path} is damaged ({error}); run again with --force.") from error


_MOST_NS = 1 << 62  # a 64-bit integer, and differences of two are one too


def _clock(content: dict[str, Any]) -> ClockModel:
    sd_offset, delay = content["sd_offset_s"], content["output_delay_s"]
    ref_gps_s, drift = float(content["ref_gps_s"]), float(content["drift"])
    ref_ns = int(content["ref_ns"])
    if abs(ref_ns) > _MOST_NS:
        raise ValueError(f"a stamp of {ref_ns:.1e} ns")
    if not (abs(ref_gps_s) < _MOST_GPS_S and abs(drift) < _MOST_DRIFT):
        raise ValueError(f"a clock at {ref_gps_s:g} s that drifts by {drift:g}")
    return ClockModel(
        ref_ns=ref_ns,
        ref_gps_s=ref_gps_s,
        drift=drift,
        sd_offset_s=float("inf") if sd_offset is None else float(sd_offset),
        sd_drift=float(content["sd_drift"]),
        method=str(content["method"]),
        output_delay_s=None if delay is None else float(delay),
    )


def _clocks(content: dict[str, Any]) -> DriveClocks:
    arrival = content.get("arrival_clock")
    return DriveClocks(
        clock=_clock(content),
        time_base=str(content["time_base"]),
        arrival=None if arrival is None else _clock(arrival),
        arrival_time_base=None if arrival is None else str(content["arrival_time_base"]),
        receiver_filter=_filter(content.get("receiver_filter")),
        shown_offset_s=_offset(content.get("shown_offset_s")),
    )


def _offset(content: Any) -> float | None:
    if content is None:
        return None
    if not abs(float(content)) < _MOST_GPS_S:
        raise ValueError(f"an offset of {content} s")
    return float(content)


def _filter(content: dict[str, Any] | None) -> ReceiverFilter | None:
    if content is None:
        return None
    velocity_s, position_s = float(content["velocity_s"]), float(content["position_s"])
    if not (0.0 <= velocity_s < _MOST_FILTER_S and 0.0 <= position_s < _MOST_FILTER_S):
        raise ValueError(f"filters of {velocity_s:g} and {position_s:g} s")
    return ReceiverFilter(velocity_s, position_s)
