"""Which devices a recording is to have: the ports that were named, and those that are found."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from automap.errors import ConfigError, InputError
from pipeline.record.request import AUTO, NONE, RecordRequest

if TYPE_CHECKING:
    from pipeline.record.imu_format import ImuFormat
    from pipeline.record.ports import PortSpec
    from pipeline.record.probe import Finding
    from pipeline.record.ublox import Setup
    from pipeline.record.video_source import Source


def named_cameras(request: RecordRequest) -> tuple[tuple[str, Source], ...]:
    if not request.cameras:
        return ()
    from pipeline.record.video_source import parse_camera

    cameras = tuple(parse_camera(text) for text in request.cameras)
    called = [name for name, _ in cameras]
    twice = sorted({name for name in called if called.count(name) > 1})
    if twice:
        raise ConfigError(f"two cameras are called {twice[0]}; give each a name of its own.")
    return cameras


def find_devices(
    request: RecordRequest,
) -> tuple[PortSpec | None, PortSpec | None, ImuFormat | None]:
    """The ports of receiver and sensor with their line rates, and the sensor's format."""
    from pipeline.record.imu_format import known_formats, load_format
    from pipeline.record.ports import PortSpec, parse_port

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
        say(f"no {what} was found; recording without it")
    return found["gnss"], found["imu"], form if found["imu"] is not None else None


def _probe_named(kind: str, spec: PortSpec, formats: list[ImuFormat]) -> Finding:
    from pipeline.record.ports import BAUDS, PortLostError, port_sentence
    from pipeline.record.probe import probe_port

    usual = [baud for form in formats for baud in form.baud] if kind == "imu" else []
    bauds = [spec.baud] if spec.baud else list(dict.fromkeys([*usual, *BAUDS]))
    finding = probe_port(spec.device, formats, bauds, ask=kind == "gnss")
    if finding.kind == kind:
        return finding
    if finding.kind == "busy":
        raise port_sentence(spec, PortLostError(finding.detail))
    what = {
        "silent": "nothing was heard",
        "unknown": "bytes were heard that no rate and no known format explain",
    }.get(finding.kind, f"what --{finding.kind} names ({finding.detail}) was heard")
    look = "check the cable"
    if finding.kind in ("gnss", "imu"):
        look = "exchange --gnss and --imu"
    how = "PORT@BAUD" if kind == "gnss" else "PORT@BAUD and --imu-format"
    raise InputError(
        f"{spec.device}: {what} there; {look}, or give {how} to record it all the same."
    )


def probe_all(formats: list[ImuFormat], without: set[str], wanted: set[str]) -> list[Finding]:
    """Listen on all ports at once."""
    from pipeline.record.ports import BAUDS, list_ports
    from pipeline.record.probe import probe_port

    devices = [port.device for port in list_ports() if port.device not in without]
    if not devices:
        return []
    usual = [baud for form in formats for baud in form.baud]
    bauds = list(dict.fromkeys([*BAUDS[:4], *usual, *BAUDS]))
    chosen = formats if "imu" in wanted else []
    with ThreadPoolExecutor(len(devices)) as pool:
        return list(pool.map(lambda device: probe_port(device, chosen, bauds), devices))


def warn_narrow_line(spec: PortSpec | None, setup: Setup | None) -> None:
    from pipeline.record.ublox import line_load

    if spec is None or setup is None or spec.baud is None:
        return
    baud = setup.baud or spec.baud
    if line_load(setup) * 10 > 0.8 * baud and "ACM" not in spec.device:
        say(
            f"{baud} baud may be too slow for that many messages "
            f"(up to {line_load(setup) * 10:.0f}); give --gnss-baud a higher rate"
        )


def say(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr, flush=True)


def port_lines(probe: bool = True) -> list[str]:
    """A line for each port: its name, the hardware, what was heard."""
    from pipeline.record.imu_format import known_formats, load_format
    from pipeline.record.ports import list_ports

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
