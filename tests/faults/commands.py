"""Whole commands on small inputs of two versions: their words, inputs and outputs."""

from __future__ import annotations

import re
import shutil
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# these say when a run was and how long it took; the results do not
TOLD = frozenset({"run.json", "automap.log", "report.html", ".digests.json"})

if str(ROOT / "tests/unit") not in sys.path:
    sys.path.insert(0, str(ROOT / "tests/unit"))


@dataclass(frozen=True)
class Scene:
    """``make(folder, version)`` writes the inputs into an empty folder; ``words`` are the command
    with IN and OUT in place of the folders; ``keeps``: what OUT holds may be written over."""

    make: Callable[[Path, int], None]
    words: tuple[str, ...]
    keeps: bool = True
    told: frozenset[str] = TOLD

    def command(self, inputs: Path, out: Path) -> list[str]:
        """The command line."""
        return [w.replace("IN", str(inputs)).replace("OUT", str(out)) for w in self.words]


def _drive(folder: Path, version: int) -> None:
    from tests.unit.broken_drive import cells as change
    from tests.unit.broken_drive import times, write_short_drive

    write_short_drive(folder / "trip")
    change("imu.csv", "gz", times(1.0 + 1e-3 * version))(folder / "trip")


def _runs(folder: Path, version: int) -> None:
    from tests.unit.export_inputs import write_run

    write_run(folder / "a", signs=6 + version, seconds=20.0)


def _merged(folder: Path, version: int) -> None:
    import numpy as np

    from tests.unit.merge_folders import write_run
    from tests.unit.merge_scene import Errors, drive_through, street

    rng = np.random.default_rng(11 + version)
    town, path = street(rng, 200.0, 20.0), np.array([[-1.5, -40.0], [-1.5, 240.0]])
    for k in range(2):
        calm = Errors(clutter=0.0, missed=0.03, wrong_class=0.0)
        drive, _ = drive_through(rng, town, path, 12.0, f"d{k}", 1.45e9 + 86400.0 * k, calm)
        write_run(folder / f"d{k}", drive)


def _phone(folder: Path, version: int) -> None:
    from tests.unit.import_phones import write_sensor_logger

    write_sensor_logger(folder / "phone")
    location = folder / "phone" / "Location.csv"
    location.write_text(location.read_text().replace(",45,", f",{45 + version},"))


def _longer(folder: Path, version: int) -> None:
    from tests.unit.broken_drive import cells, times
    from tests.unit.input_drive import write_drive

    write_drive(folder / "trip", 'file = "imu.csv"', 'file = "gnss.nmea"')
    cells("imu.csv", "gz", times(1.0 + 1e-3 * version))(folder / "trip")


def _desk(folder: Path, version: int) -> None:
    import numpy as np

    from tests.unit.calibration_scene import random_errors, random_poses, recorded, turned_by_hand
    from tests.unit.test_calibration_command import write_csv

    rng = np.random.default_rng(8 + version)
    write_csv(
        folder / "desk.csv",
        recorded(rng, turned_by_hand(rng, random_poses(rng, 12)), random_errors(rng)),
    )


def _export(form: str, name: str) -> Scene:
    words = ("export", "IN/a", "--format", form, "-o", f"OUT/{name}")
    return Scene(_runs, words)


SCENES: dict[str, Scene] = {
    "run": Scene(_drive, ("run", "IN/trip", "-o", "OUT")),
    "merge": Scene(
        _merged,
        ("merge", "IN/d0", "IN/d1", "-o", "OUT"),
        # they say what is new since the map that was there
        told=TOLD | {"changes.geojson", "merge.json"},
    ),
    "export gpkg": _export("gpkg", "map.gpkg"),
    "export kmz": _export("kmz", "map.kmz"),
    "export xlsx": _export("xlsx", "map.xlsx"),
    "export shapefile": _export("shapefile", "map.zip"),
    "export parquet": _export("parquet", "map.parquet"),
    "export flatgeobuf": _export("flatgeobuf", "map.fgb"),
    "export pmtiles": _export("pmtiles", "map.pmtiles"),
    "export gpx": _export("gpx", "path.gpx"),
    "import": Scene(_phone, ("import", "sensor-logger", "IN/phone", "-o", "OUT"), keeps=False),
    "calibrate": Scene(
        _desk, ("calibrate", "static", "IN/desk.csv", "--gravity", "9.80665", "-o", "OUT")
    ),
    "gap": Scene(_longer, ("gap", "IN/trip", "-o", "OUT")),
}


def fresh(folder: Path) -> Path:
    """An empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


_DATE = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d")


def undated(path: Path) -> bytes:
    """A file's bytes without dates: a calibration says when it was made.

    Of a GeoPackage all rows of all tables: after an error that SQLite gets over the pages may be
    other ones with the same in them.
    """
    raw = path.read_bytes()
    if path.suffix == ".gpkg":
        with (
            suppress(sqlite3.Error),
            closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db,
        ):
            raw = _rows(db)
    return _DATE.sub(b"", raw)


_INDEX = re.compile("rtree_.*_(node|parent|rowid)")
"""What a spatial index keeps its pages in."""


def _rows(db: sqlite3.Connection) -> bytes:
    """Everything that a sound database holds; sqlite3.Error where it is none."""
    if db.execute("PRAGMA integrity_check").fetchall() != [("ok",)]:
        raise sqlite3.DatabaseError("damaged")
    made = sorted(db.execute("SELECT name, type, sql FROM sqlite_master").fetchall(), key=repr)
    tables = [name for name, kind, _ in made if kind == "table" and not _INDEX.fullmatch(name)]
    rows = {
        name: sorted(db.execute(f'SELECT * FROM "{name}"').fetchall(), key=repr) for name in tables
    }
    return repr((made, rows)).encode()


def contents(out: Path, told: frozenset[str] = TOLD) -> dict[str, bytes]:
    """The files below a folder that are the same after every run; dates left out."""
    return {
        str(path.relative_to(out)): undated(path)
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.name not in told
    }
