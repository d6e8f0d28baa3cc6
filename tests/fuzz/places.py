"""Readers of what is no single file: results folders, merged maps, stores of a fleet, a viewer.

A whole one is made once and copied; one of its files is the damaged one.
"""

from __future__ import annotations

import atexit
import io
import re
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from automap.io import names

ROOT = Path(__file__).resolve().parents[2]
# helpers of the unit tests import each other as from beside them
if str(ROOT / "tests/unit") not in sys.path:
    sys.path.insert(0, str(ROOT / "tests/unit"))

DIGEST = "d" * 64
RESULTS = {
    "signs": names.SIGNS_RAW,
    "trajectory": names.TRAJECTORY,
    "observations": names.OBSERVATIONS,
    "sync": names.SYNC,
    "run": names.RUN,
    "review": names.REVIEW,
}
MERGED = {"record": names.MERGE, "sightings": "sightings.parquet", "coverage": "coverage.parquet"}
FLEET = {
    "store": "fleet.json",
    "drive": f"drives/{DIGEST}/drive.json",
    "done": f"drives/{DIGEST}/done.json",
    "aside": f"drives/{DIGEST}/aside.json",
    "merge": "maps/000001/merge.json",
}
_REQUESTS = 300
"""Of one viewer; then a new one, so that the review that requests add to stays small."""


def kept(prefix: str) -> Path:
    """A folder until the process ends."""
    folder = tempfile.mkdtemp(prefix=prefix)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@cache
def results() -> Path:
    """Results of a run of 8 s with five signs."""
    from tests.unit.export_inputs import write_run

    return write_run(kept("results") / "out", signs=5, seconds=8.0)


@cache
def merged() -> Path:
    """A map of two drives."""
    import numpy as np

    from pipeline.cli.root import run_command
    from tests.unit.merge_folders import write_run
    from tests.unit.merge_scene import Errors, drive_through, street

    root, rng = kept("merged"), np.random.default_rng(11)
    town, path = street(rng, 200.0, 20.0), np.array([[-1.5, -40.0], [-1.5, 240.0]])
    folders = []
    for k in range(2):
        calm = Errors(clutter=0.0, missed=0.03, wrong_class=0.0)
        drive, _ = drive_through(rng, town, path, 12.0, f"d{k}", 1.45e9 + 86400.0 * k, calm)
        folders.append(str(write_run(root / f"d{k}", drive)))
    if run_command(["merge", *folders, "-o", str(root / "map"), "--quiet"]):
        raise RuntimeError("a whole map cannot be made")
    return root / "map"


@cache
def fleet() -> Path:
    """A store with a drive that is done and a map."""
    import json

    from pipeline.fleet.store import SCHEMA

    root = kept("fleet") / "store"
    (root / "drives" / DIGEST / "r1").mkdir(parents=True)
    (root / "maps/000001").mkdir(parents=True)
    done = {"result": "r1", "key": "k", "name": "d0", "signs": 5, "hours": 0.5, "km": 12.0}
    done |= {"seconds": 60.0, "peak_bytes": 3, "files": {"signs.parquet": {"bytes": 9}}}
    done |= {"verdict": {"state": "doubtful", "reasons": [{"text": "for 9 s: look"}]}}
    summary = {"last_pass": {"1/2": 1.4e9}, "drives": ["d0"], "signs": 5, "sightings": 9}
    summary |= {"changes": {"new": 1, "gone": 0, "class": 0, "moved": 0}, "cells": 1}
    summary |= {"warnings": [], "history": [{"map": "m1", "drives": 1, "signs": 5}]}
    told = {
        "store": {"schema": SCHEMA},
        "drive": {"path": "/drives/d0", "bytes": 99},
        "done": done,
        "aside": {"error": "no fix", "kind": "input"},
        "merge": summary,
    }
    for name, value in told.items():
        if name != "aside":
            (root / FLEET[name]).write_text(json.dumps(value))
    (root / "settings.json").write_text('{"key": "k"}')
    (root / "map").symlink_to("maps/000001")
    return root


def _put(path: Path, data: bytes, cells: bool) -> bool:
    """Write the damaged file, ``cells`` as a table from CSV; False where that is no table."""
    if cells:
        try:
            table = pa.csv.read_csv(io.BytesIO(data))
            pq.write_table(table, path)
        except (pa.ArrowException, ValueError, TypeError):
            return False
    else:
        path.write_bytes(data)
    return True


def as_cells(path: Path, rows: int = 40) -> bytes:
    """The first rows of a table as CSV, lists left out."""
    table = pq.read_table(path).slice(0, rows)
    flat = [n for n in table.column_names if not pa.types.is_nested(table.schema.field(n).type)]
    out = io.BytesIO()
    pa.csv.write_csv(table.select(flat), out)
    return out.getvalue()


def read_results(name: str) -> Callable[[Path, Path], object]:
    """Export, merge and viewer on results one of whose files is damaged."""
    part, _, form = name.removeprefix("results_").partition("_")

    def read(path: Path, work: Path) -> object:
        from automap.errors import AutoMapError
        from pipeline.export.content import map_content
        from pipeline.export.formats import FORMATS
        from pipeline.merge.inputs import read_run
        from pipeline.view.opening import open_map

        out = work / "out"
        shutil.copytree(results(), out)
        if not _put(out / RESULTS[part], path.read_bytes(), form == "cells"):
            return None
        refusals = []

        def export() -> None:
            file, write = FORMATS["geojson"]
            write(map_content(out, "x"), work / file)

        def view() -> None:
            shown = open_map(out)
            shown.overview(), shown.payload, [drive.overview() for drive in shown.drives]

        for use in (export, lambda: read_run(out), view):
            try:
                use()
            except AutoMapError as error:
                refusals.append(error)
        if refusals:
            raise refusals[0]
        return None

    return read


def read_merged(name: str) -> Callable[[Path, Path], object]:
    """Viewer, export and the merge after it on a map one of whose files is damaged."""
    part, _, form = name.removeprefix("merged_").partition("_")

    def read(path: Path, work: Path) -> object:
        from automap.errors import AutoMapError
        from automap.io.map_tables import read_coverage, read_members
        from pipeline.export.content import map_content
        from pipeline.view.opening import open_map

        out = work / "map"
        shutil.copytree(merged(), out)
        if not _put(out / MERGED[part], path.read_bytes(), form == "cells"):
            return None
        refusals = []
        for use in (
            lambda: open_map(out).overview(),
            lambda: map_content(out, "x"),
            lambda: read_members(out / "sightings.parquet"),
            lambda: read_coverage(out / "coverage.parquet"),
        ):
            try:
                use()
            except AutoMapError as error:
                refusals.append(error)
        if refusals:
            raise refusals[0]
        return None

    return read


def read_fleet(name: str) -> Callable[[Path, Path], object]:
    """Where a store stands, one of whose files is damaged."""
    part = name.removeprefix("fleet_")

    def read(path: Path, work: Path) -> object:
        from pipeline.fleet.page import status_page
        from pipeline.fleet.status import metrics, status, summary_lines
        from pipeline.fleet.store import Store

        shutil.copytree(fleet(), work / "store", symlinks=True)
        (work / "store" / FLEET[part]).write_bytes(path.read_bytes())
        store = Store.at(str(work / "store"))
        told, drives = status(store)
        list(store.leftovers(store.entries(), "a" * 20))
        return summary_lines(told, drives), status_page(told, drives), metrics(told)

    return read


class _Viewer:
    """A server of the results, and how often it was asked."""

    def __init__(self) -> None:
        from pipeline.view.command import serving

        self.stack = ExitStack()
        out = kept("viewed") / "out"
        shutil.copytree(results(), out)
        self.server = self.stack.enter_context(serving(out))
        atexit.register(self.stack.close)
        self.asked = 0


_VIEWERS: list[_Viewer] = []


class UnansweredError(Exception):
    """The viewer hung up, or failed inside."""


def ask_viewer(path: Path, work: Path) -> object:
    """The answer to a request, byte for byte; an error where there is none or it says 500."""
    if not _VIEWERS or _VIEWERS[-1].asked >= _REQUESTS:
        for viewer in _VIEWERS:
            viewer.stack.close()
        _VIEWERS[:] = [_Viewer()]
    viewer = _VIEWERS[-1]
    viewer.asked += 1
    server = viewer.server
    request = path.read_bytes().replace(b"TOKEN", server.token.encode())
    request = request.replace(b"PORT", str(server.server_port).encode())
    answer = b""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=8) as connection:
        try:
            connection.sendall(request)
            with suppress(OSError):  # who refused it may have gone already
                connection.shutdown(socket.SHUT_WR)
            while part := connection.recv(1 << 20):
                answer += part
        except ConnectionError:
            # it answers what it refuses without reading all of it
            answer = answer or b"HTTP/1.1 400"
    first = re.match(rb"[^\r\n]*", request)
    # spaces are those of Latin-1, as HTTP has them; a line of them alone is passed over
    if not answer and first is not None and first[0].decode("latin-1").split():
        raise UnansweredError("no answer")
    if b"HTTP/1.1 500" in answer:
        raise UnansweredError(answer.partition(b"\r\n\r\n")[2][:100].decode("latin-1"))
    return len(answer)
