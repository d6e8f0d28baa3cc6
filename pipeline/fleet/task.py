"""What a worker does with one drive: have a process run it, then publish what came of it."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import signal
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automap.errors import AutoMapError
from automap.io import names
from pipeline.fleet.add import parent_of
from pipeline.fleet.child import kind_of
from pipeline.fleet.fork_server import LOG, fork_server
from pipeline.fleet.orders import Order
from pipeline.fleet.places import Folder
from pipeline.fleet.store import DONE, DRIVES, Entry, Store, StoreGoneError, result_name
from pipeline.shared.verdicts import doubted

_EVERY_S = 0.2
"""How often the memory of a drive's process is looked at."""
_LEFT_OUT = frozenset({names.IMU, names.TRAJECTORY_FILTER, names.INNOVATIONS, ".digests.json"})
"""What only a further run in the same folder reads: two thirds of the bytes."""
_SCRATCH = "automap-fleet."
_LEAST_ROOM = 1 << 16
"""Bytes: a disk that cannot take so many is full, whatever a library says of it."""


@dataclass(frozen=True)
class Result:
    """What became of a drive: ``kind`` "done"; "memory", "io", "lost" (its process was ended from
    outside) or "data" with the ``error`` in a sentence; "store" where nothing can be written to
    the store and "full" where the machine has no room to work on it, which is no drive's fault;
    "away" where its folder and all others beside it are not there, or it was done before."""

    digest: str
    kind: str
    error: str = ""
    doubtful: bool = False


def run_task(url: str, digest: str, path: str, order: Order) -> Result:
    """Run a drive and put the result into the store; nothing where it is there already.

    Whatever happens at any time, the store has the drive done or not: ``done.json`` comes last.
    """
    store = Store.at(url)
    entry = store.entry(digest)
    if entry.done and entry.done.get("key") == order.key:
        return _done(digest, entry.done)
    order.settings()
    _remove_abandoned()
    try:
        folder = tempfile.TemporaryDirectory(prefix=f"{_SCRATCH}{os.getpid()}.")
    except OSError as error:
        return _no_room(digest, path) if kind_of(error) == "full" else _unread(digest, path, error)
    with folder as scratch:
        out = Path(scratch) / "out"
        try:
            drive = _fetched(path, Path(scratch) / "drive")
            answer = _supervised(drive, out, Path(scratch), order)
        except OSError as error:
            if kind_of(error) == "full":
                return _no_room(digest, path)
            return _unread(digest, path, error)
        except AutoMapError as error:
            return Result(digest, "io", str(error))
        if "error" in answer:
            if answer["kind"] == "full" or not _has_room(Path(scratch)):
                return _no_room(digest, path)
            return _failed(entry, answer, path, drive)
        try:
            marker = publish(store, digest, out, answer, order.key)
        except (OSError, AutoMapError) as error:
            of_store = kind_of(error) == "full" or isinstance(error, StoreGoneError)
            return Result(digest, "store" if of_store else "io", str(error))
    return _done(digest, marker)


def _remove_abandoned() -> None:
    """Remove what workers on this machine that were killed have left."""
    for path in Path(tempfile.gettempdir()).glob(f"{_SCRATCH}*.*"):
        pid = path.name.removeprefix(_SCRATCH).partition(".")[0]
        if pid.isdigit() and not Path(f"/proc/{pid}").exists():
            shutil.rmtree(path, ignore_errors=True)


def _no_room(digest: str, path: str) -> Result:
    """What is worked on lies there until the drive is done."""
    return Result(
        digest, "full",
        f"{path}: the disk of temporary files on {platform.node()} is full "
        f"({tempfile.gettempdir()}); free some space, or name another folder in TMPDIR.",
    )  # fmt: skip


def _unread(digest: str, path: str, error: OSError) -> Result:
    return Result(digest, "io", f"{path}: {error.strerror or error}")


def _has_room(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_LEAST_ROOM))
    except OSError as error:
        return kind_of(error) != "full"
    return True


def _done(digest: str, marker: dict[str, Any]) -> Result:
    return Result(digest, "done", doubtful=bool(doubted(marker)))


def _failed(entry: Entry, answer: dict[str, Any], path: str, drive: Path) -> Result:
    kind, text = str(answer["kind"]), str(answer["error"]).replace(str(drive), path)
    if kind == "data" and not drive.is_dir():
        # a share that has gone, or drives that went to an archive: the map keeps what they saw
        away = entry.done or not Folder(drive.parent).names("")
        kind = "away" if away else "io"
    return Result(entry.digest, kind, text)


def _fetched(path: str, scratch: Path) -> Path:
    """The drive's folder on this machine."""
    place, name = parent_of(path)
    if place.folder is not None:
        return Path(path)
    place.get(name, scratch / name)
    return scratch / name


def _supervised(drive: Path, out: Path, scratch: Path, order: Order) -> dict[str, Any]:
    """The answer of the drive's process, which may take no more memory than stated."""
    request, answer = scratch / "request.json", scratch / "answer.json"
    told = {
        "drive": str(drive),
        "out": str(out),
        "answer": str(answer),
        "settings": order.echo,
        "outside": order.outside,
    }
    request.write_text(json.dumps(told), encoding="utf-8")
    killed_before = _killed_for_memory()
    over = False

    def look(pid: int) -> None:
        nonlocal over
        if _memory(pid) > order.memory:
            over = True
            os.kill(pid, signal.SIGKILL)

    with fork_server() as server:
        code = server.run(request, look, _EVERY_S)
    if answer.is_file() and not over:
        found: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
        return found
    if over:
        said = f"it took more than the {order.memory / 1e9:.1f} GB of memory that it may take"
        return {"kind": "memory", "error": f"{drive}: {said}."}
    if code in (-signal.SIGKILL, -signal.SIGTERM):
        if _killed_for_memory() > killed_before:
            return {"kind": "memory", "error": f"{drive}: its machine ran out of memory."}
        return {"kind": "lost", "error": f"{drive}: its process was ended by signal {-code}."}
    last = (scratch / LOG).read_text(errors="replace").strip().rpartition("\n")[2]
    return {"kind": "io", "error": f"{drive}: its process ended with code {code} ({last})."}


def _memory(pid: int) -> int:
    """Bytes that a process holds."""
    with suppress(OSError, ValueError, IndexError):
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE")
    return 0


def _killed_for_memory() -> int:
    """How many processes the kernel has ended for lack of memory."""
    with suppress(OSError, ValueError):
        for line in Path("/proc/vmstat").read_text().splitlines():
            name, _, value = line.partition(" ")
            if name == "oom_kill":
                return int(value)
    return 0


def publish(
    store: Store, digest: str, out: Path, answer: dict[str, Any], key: str
) -> dict[str, Any]:
    """Write the files aside, then the marker; what is published already stays."""
    already = store.entry(digest).done
    if already.get("key") == key:
        # by an attempt whose client was killed: its marker names the digests of its own report
        return already
    result = result_name(key)
    files = {}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if path.is_file() and name not in _LEFT_OUT:
            with path.open("rb") as stream:
                digest_of = hashlib.file_digest(stream, "sha256").hexdigest()
            files[name] = {"sha256": digest_of, "bytes": path.stat().st_size}
            store.place.put(path, f"{DRIVES}/{digest}/{result}/{name}")
    marker = {"key": key, "result": result, **answer, "files": files}
    store.mark(digest, DONE, marker)
    return marker
