"""Commands that go on until they are told to end: the recorder and the viewer."""

from __future__ import annotations

import json
import random
import re
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from pipeline.record.replay import Replay
from tests.faults.child import Ended, Running, start
from tests.faults.judge import wrong_end
from tests.faults.shim import FAULTS, SIGNAL, Op, arm

TIMED = {"killed": signal.SIGKILL, "interrupted": signal.SIGINT, "ended": signal.SIGTERM}
_OPS = 40
"""Operations on files of a session of some requests, about; of a recording of half a second."""
_SECONDS = 0.6
_TOLD = 12
"""Lines of stderr of a recorder: what its ports and files went through, and what was left out."""
_PRELOADED = 30.0
"""Seconds that a viewer may take to say where it is."""


def _fault(kind: str, draw: random.Random, folder: Path) -> Callable[[], None]:
    if kind not in FAULTS:
        return lambda: None
    made = FAULTS[kind]
    many = made.ops in (Op.files(), Op.READ, Op.WRITE, Op.CLOCK)
    at = draw.randint(1, _OPS if many else 6)
    return lambda: arm(folder, made.ops, made.how, made.what, at)


def _ends(kind: str) -> bool:
    """Whether the fault itself ends the process."""
    return kind in TIMED or (kind in FAULTS and FAULTS[kind].how == SIGNAL)


def _ask(port: int, request: str, body: bytes = b"") -> int:
    """The status of a request; 0 where it was not answered."""
    head = f"{request}\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n"
    if body:
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
    with suppress(OSError, ValueError, IndexError):
        with socket.create_connection(("127.0.0.1", port), timeout=20) as connection:
            connection.sendall(f"{head}\r\n".encode() + body)
            answer = b""
            while part := connection.recv(65536):
                answer += part
        return int(answer.split()[1])
    return 0


def _address(running: Running) -> tuple[int, str] | None:
    """Port and token of a viewer, None where it has ended."""
    end = time.monotonic() + _PRELOADED
    while time.monotonic() < end and not running.ended():
        if found := re.search(r"127\.0\.0\.1:(\d+)/\?token=([\w-]+)", running.said()):
            return int(found[1]), found[2]
        time.sleep(0.01)
    return None


def view(kind: str, draw: random.Random, folder: Path) -> tuple[str, str]:
    """A viewer that is asked for everything and told a decision."""
    from tests.unit.export_inputs import write_run

    out = write_run(folder / "out", signs=5, seconds=20.0)
    (out / "report.html").write_text("<!doctype html>")
    words = ["view", str(out), "--no-browser"]
    running = start(words, _fault(kind, draw, folder))
    at = draw.randrange(6)
    address = _address(running)
    if address is not None:
        statuses = _session(running, address, TIMED.get(kind), at)
        if 0 in statuses and not _ends(kind):
            return "wrong", f"requests were not answered: {statuses}"
    if not running.ended():
        running.signal(signal.SIGINT)
    ended = running.wait()
    if said := wrong_end(ended, kind.startswith("killed")):
        return "wrong", said
    before = _decisions(out)
    if before is None:
        return "wrong", "review.json is half written"
    again = start(words)
    address = _address(again)
    if address is None:
        return "wrong", f"once more: {again.wait().err.strip()[:200]}"
    statuses = _session(again, address, None, -1)
    again.signal(signal.SIGINT)
    after = _decisions(out)
    if set(statuses) != {200} or again.wait().code or after is None or after != before + 1:
        return "wrong", f"once more: {statuses}, {before} decisions, then {after}"
    return _word(ended), ""


def _session(
    running: Running, address: tuple[int, str], number: signal.Signals | None, at: int
) -> list[int]:
    """Statuses of requests; a signal comes before that of number ``at``."""
    port, token = address
    accept = json.dumps({"row": 0, "kind": "accept"}).encode()
    asked = [
        (f"GET /?token={token} HTTP/1.1", b""),
        (f"GET /{token}/api/map HTTP/1.1", b""),
        (f"GET /{token}/api/signs HTTP/1.1", b""),
        (f"GET /{token}/out/report.html HTTP/1.1", b""),
        (f"POST /{token}/api/review HTTP/1.1", accept),
        (f"GET /{token}/api/review HTTP/1.1", b""),
    ]
    statuses = []
    for number_of, (request, body) in enumerate(asked):
        if number is not None and number_of == at and not running.ended():
            running.signal(number)
        statuses.append(_ask(port, request, body))
    return statuses


def _decisions(out: Path) -> int | None:
    """How many a review file holds; None where it is no review."""
    path = out / "review.json"
    if not path.exists():
        return 0
    with suppress(ValueError, KeyError):
        return len(json.loads(path.read_bytes())["actions"])
    return None


def record(kind: str, draw: random.Random, folder: Path) -> tuple[str, str]:
    """A recorder of two pseudo-terminals for half a second."""
    from tests.unit.recorded_drive import feed_of, terminals, wait_until, write_drive

    drive, out = write_drive(folder / "drive", 1.0), folder / "out"
    words = ["record", "-o", str(out), "--imu-format", "automap-csv", "--duration", str(_SECONDS)]
    words += [w for n in ("gnss", "imu") for w in (f"--{n}", f"{folder / 'car' / n}@460800")]
    with terminals(drive, folder / "car") as player:
        sent = {name: feed_of(player, name).data for name in ("gnss", "imu")}
        stop = threading.Event()

        def play(player: Replay = player, stop: threading.Event = stop) -> None:
            # a port that is opened loses what came before
            wait_until((out / "recording.log").exists, 3.0)
            if player.wait_opened(30.0, stop.is_set):
                player.play(speed=4.0, settle_s=0.3)

        playing = threading.Thread(target=play, daemon=True)
        playing.start()
        running = start(words, _fault(kind, draw, out))
        if kind in TIMED:
            time.sleep(draw.uniform(0.0, 2.0 * _SECONDS))
            running.signal(TIMED[kind])
        ended = running.wait(30.0)
        stop.set()
        playing.join(10.0)
    if said := wrong_end(ended, kind.startswith("killed"), _TOLD):
        return "wrong", said
    return _recorded(out, sent, ended)


def _recorded(out: Path, sent: dict[str, bytes], ended: Ended) -> tuple[str, str]:
    """Whether what is there is what was sent, as far as it goes, and is read as a drive."""
    for name, file in (("gnss", "gnss.ubx"), ("imu", "imu.raw")):
        path = out / file
        data = path.read_bytes() if path.exists() else b""
        if data not in sent[name]:
            return "wrong", f"{file} holds what was not sent: {_apart(data, sent[name])}"
    if (out / "drive.toml").exists():
        checked = start(["check", str(out)]).wait()
        if said := wrong_end(checked, False, _TOLD):
            return "wrong", f"check: {said}"
    return _word(ended), ""


def _apart(data: bytes, sent: bytes) -> str:
    """Where bytes leave what was sent."""
    start = sent.find(data[:24])
    same = next((i for i in range(len(data)) if data[i : i + 1] != sent[start + i :][:1]), 0)
    return f"{len(data)} bytes, {data[same : same + 30]!r} at {same} from {start}"


def _word(ended: Ended) -> str:
    words = {0: "done", 130: "interrupted", -signal.SIGKILL: "killed"}
    return words.get(ended.code, "told")


LIVE: dict[str, Callable[[str, random.Random, Path], tuple[str, str]]] = {
    "view": view,
    "record": record,
}
