"""A store of very many drives that are done, made without running any, for ``automap fleet merge``.

    python tests/benchmarks/fleet_store.py STORE FIRST COUNT TOWN...

Publishes drives FIRST to FIRST + COUNT - 1 of towns by their numbers, 1000 sightings each, as
``merge_store`` has them, with tracks of a row every 4 m. Several processes may do it at once, each
its own towns.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
from pathlib import Path

import numpy as np
from merge_store import one_drive, town_of

from pipeline.fleet.child import begin_of
from pipeline.fleet.orders import key_of, settings_of
from pipeline.fleet.store import DRIVE, Store
from pipeline.fleet.task import publish
from tests.unit.fleet_scene import answer
from tests.unit.merge_folders import write_run


def fill(store: Store, key: str, town: int, first: int, count: int) -> None:
    """Publish drives of a town as done with the settings ``key``."""
    city = town_of(town)
    rng = np.random.default_rng(1_000_000 + 1000 * town + first)
    for number in range(first, first + count):
        drive, _ = one_drive(rng, city, town, number)
        digest = hashlib.sha256(drive.name.encode()).hexdigest()[:20]
        told = answer(
            drive, number, hours=0.94, km=40.0, sd_m=[0.6, 0.6, 1.0], cell=begin_of(drive),
            recording=hashlib.sha256(drive.key.encode()).hexdigest()[:16],
        )  # fmt: skip
        store.mark(digest, DRIVE, {"path": f"/nowhere/{drive.name}", "bytes": 50_000_000})
        with tempfile.TemporaryDirectory() as folder:
            publish(store, digest, write_run(Path(folder) / "out", drive), told, key)


def main() -> None:
    store = Store.at(sys.argv[1], make=True)
    first, count, *towns = map(int, sys.argv[2:])
    key = key_of(settings_of(store, None, ()))
    for town in towns:
        fill(store, key, town, first, count)
        print(f"town {town}: drives {first} to {first + count - 1}", flush=True)


if __name__ == "__main__":
    main()
