"""Recorder and viewer at work for long: memory and open files stay as they are.

Two minutes each unless AUTOMAP_LONG_S says more; what takes hours is the same test with a larger
number.
"""

from __future__ import annotations

import json
import mmap
import os
import random
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.record.ports import PortSpec
from pipeline.record.recorder import Plan
from pipeline.record.replay import Terminal
from tests.unit.export_inputs import write_run
from tests.unit.recorded_drive import BAUD, recording, wait_until
from tests.unit.simulated_receiver import nav_pvt

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc"),
]

LONG_S = float(os.environ.get("AUTOMAP_LONG_S", "120"))
MAIN = "from pipeline.cli import main; main()"
BLOCK = int(os.environ.get("AUTOMAP_LONG_BLOCK", "40"))
"""Epochs that are sent together; more of them let the bytes of six hours pass in less."""


def state_of(pid: int) -> tuple[int, int]:
    """Resident memory in kB and open files of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() // 1024, len(os.listdir(f"/proc/{pid}/fd"))


def block_of(number: int) -> bytes:
    """Epochs that are sent together; made anew when they are looked for, so that the test's own
    memory does not grow."""
    return b"".join(nav_pvt(100 * (BLOCK * number + k)) for k in range(BLOCK))


def test_a_recorder_with_a_fault_after_every_few_blocks(tmp_path: Path) -> None:
    """Ports that go and come, bytes that are none of the receiver's, half messages, silence."""
    out, link, draw = tmp_path / "out", tmp_path / "gnss", random.Random(4)
    terminal = Terminal(link)
    log = out / "gnss.ubx"
    sent = 0
    states: list[tuple[int, int]] = []
    faults = 0
    end = time.monotonic() + LONG_S
    with recording(out, Plan(gnss=PortSpec(str(link), BAUD)), factor=5.0):
        while time.monotonic() < end:
            for _ in range(3):
                block = block_of(sent)
                whole = (log.stat().st_size if log.exists() else 0) + len(block)
                terminal.write(block)
                sent += 1
                assert wait_until(lambda n=whole: log.stat().st_size >= n, 30.0)
            match faults % 4:
                case 0:
                    terminal.close()
                    time.sleep(draw.uniform(0.0, 0.3))
                    terminal = Terminal(link)
                    assert wait_until(lambda t=terminal: t.opened, 30.0)
                    # what comes while a port is set up is the system's to lose
                    time.sleep(0.5)
                case 1:
                    terminal.write(draw.randbytes(700))
                case 2:
                    terminal.write(nav_pvt(0)[: draw.randrange(1, 90)])
                case _:
                    time.sleep(draw.uniform(0.2, 1.0))
            faults += 1
            states.append(state_of(os.getpid()))
    terminal.close()
    assert faults >= 10
    # every block between two faults is there whole, in its order
    place = 0
    with log.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for number in range(sent):
            place = data.find(block_of(number), place)
            assert place >= 0, number
            place += 1
    settled = states[len(states) // 4]
    assert states[-1][0] - settled[0] < 6_000
    assert states[-1][1] <= settled[1] + 1


def ask(port: int, request: bytes) -> int:
    """The status of a request."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as connection:
        connection.sendall(request)
        answer = b""
        while part := connection.recv(1 << 16):
            answer += part
    return int(answer.split()[1])


def test_a_viewer_under_requests_keeps_its_memory(tmp_path: Path) -> None:
    out = write_run(tmp_path / "out", signs=40, seconds=60.0)
    viewer = subprocess.Popen(
        [sys.executable, "-c", MAIN, "view", str(out), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert viewer.stdout is not None
        found = re.search(r":(\d+)/\?token=([\w-]+)", viewer.stdout.readline())
        assert found is not None
        port, token = int(found[1]), found[2]
        paths = ["api/map", "api/signs", "api/review", "api/sign/3", "api/drive/0", "nothing"]
        paths += ["out/signs_raw.parquet", "face/stop", "below/3/1/1"]
        states, asked, statuses = [], 0, set()
        end = time.monotonic() + LONG_S
        while time.monotonic() < end:
            for path in paths:
                head = f"GET /{token}/{path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
                statuses.add(ask(port, f"{head}Connection: close\r\n\r\n".encode()))
                asked += 1
            time.sleep(0.2)  # as a few people would ask
            if asked % (40 * len(paths)) == 0:
                # decisions are kept; now and then is what a reviewer makes of them
                body = json.dumps({"row": asked % 40, "kind": "accept"}).encode()
                head = f"POST /{token}/api/review HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
                head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
                statuses.add(ask(port, f"{head}Connection: close\r\n\r\n".encode() + body))
            states.append(state_of(viewer.pid))
        viewer.send_signal(signal.SIGINT)
        _, err = viewer.communicate(timeout=30)
    finally:
        viewer.kill()
    assert viewer.returncode in (0, 130)
    assert err == ""
    assert statuses <= {200, 204, 404}
    assert asked > 300
    settled = states[len(states) // 4]
    assert states[-1][0] - settled[0] < 8_000
    assert states[-1][1] <= settled[1] + 2
