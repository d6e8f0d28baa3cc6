"""Dask's scheduler, nannies, workers and ``automap fleet run``, any of which may be killed."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAIN = "from pipeline.cli import main; main()"
_DASK = "from distributed.cli.dask_{0} import main; main({1!r}, standalone_mode=False)"
_BEGINS_S = 120.0
"""For a scheduler to listen, on a busy machine."""
_WORKER, _FORK = "spawn_main", "pipeline.fleet.fork_server"
ROLES = ("scheduler", "client", "nanny", "worker", "server", "drive")


def start(
    code: str, folder: Path, *arguments: str, environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Python code in a process of its own, of which nothing is heard."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments], cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def kill(process: subprocess.Popen[bytes] | None) -> None:
    """Kill a process and wait for its end."""
    if process is not None:
        process.kill()
        process.wait()


def children(pid: int, having: str) -> list[int]:
    """Processes that a process has started and whose command line has a word."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += [int(word) for word in path.read_text().split()]
    return [pid for pid in found if having in _command(pid)]


def _command(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    return ""


@dataclass
class Crew:
    """What runs the drives of the store ``url``, begun again by ``keep_up`` whatever ended.

    The scheduler keeps its address, so that nobody else has to be begun again with it. The first
    of the workers has the ``environment`` besides.
    """

    folder: Path
    url: str
    size: int = 2
    environment: Mapping[str, str] = field(default_factory=dict)
    scheduler: subprocess.Popen[bytes] | None = None
    nannies: list[subprocess.Popen[bytes]] = field(default_factory=list)
    client: subprocess.Popen[bytes] | None = None
    port: int = 0
    codes: list[int] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def keep_up(self) -> bool:
        """Start what does not run; True where the client has done all."""
        if self.client is not None and self.client.poll() is not None:
            self.codes.append(self.client.returncode)
            if self.client.returncode == 0:
                return True
            self.client = None
        if self.scheduler is None or self.scheduler.poll() is not None:
            self._schedule()
        self.nannies = [nanny for nanny in self.nannies if nanny.poll() is None]
        while len(self.nannies) < self.size:
            words = [self.address, "--nthreads", "1", "--no-dashboard", "--memory-limit", "0"]
            code, more = _DASK.format("worker", words), {} if self.nannies else self.environment
            self.nannies.append(start(code, self.folder, environment=more))
        if self.client is None:
            words = ["fleet", "run", self.url, "--scheduler", self.address, "--quiet"]
            self.client = start(MAIN, self.folder, *words)
        return False

    def _schedule(self) -> None:
        if not self.port:
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.port = free.getsockname()[1]
        words = ["--port", str(self.port), "--host", "127.0.0.1", "--no-dashboard"]
        self.scheduler = start(_DASK.format("scheduler", words), self.folder)
        until = time.monotonic() + _BEGINS_S
        while True:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
                return
            assert time.monotonic() < until, "no scheduler began"
            assert self.scheduler.poll() is None, "the scheduler ended as it began"
            time.sleep(0.2)

    def processes(self) -> dict[str, list[int]]:
        """Those that run now, by their ROLES."""
        alone = {"scheduler": self.scheduler, "client": self.client}
        found = {
            role: [process.pid] for role, process in alone.items()
            if process is not None and process.poll() is None
        }  # fmt: skip
        found["nanny"] = [nanny.pid for nanny in self.nannies if nanny.poll() is None]
        found["worker"] = [pid for nanny in found["nanny"] for pid in children(nanny, _WORKER)]
        found["server"] = [pid for worker in found["worker"] for pid in children(worker, _FORK)]
        found["drive"] = [pid for server in found["server"] for pid in children(server, _FORK)]
        return found

    def kill_one(self, draw: random.Random) -> str:
        """Kill a process of a role drawn at random: which it was, "" where there was none."""
        role = draw.choice(ROLES)
        running = self.processes().get(role, [])
        if not running:
            return ""
        os.kill(draw.choice(running), signal.SIGKILL)
        return role

    def end(self) -> None:
        """Kill all."""
        workers = self.processes()["worker"]
        for process in (self.client, *self.nannies, self.scheduler):
            kill(process)
        for pid in workers:
            # it ends with its nanny, but not at once
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
