"""Why a stage runs again, and what files are known by."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

from tests.unit.scenarios import scenario


@scenario
def cache_reasons() -> Any:
    """Records of earlier runs, one thing changed in each; digests of files and folders."""
    from automap.io import names
    from pipeline.run import cache as of
    from pipeline.run.digests import DigestCache
    from pipeline.run.named_files import names_of

    settings, manifest = {"a.x": 1.5, "a.y": "long " * 12, "b": None}, {"imu.rate": 100}
    inputs = {"imu.csv": "11", "gps.csv": "22"}
    needs: dict[str, str | None] = {"path.parquet": "33", names.RUN: "44", "boxes.csv": None}
    now = of.Ingredients(3, settings, manifest, inputs, needs)
    found: dict[str, Any] = {"key": now.key("locate"), "json": now.as_json()}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        (out / "map.geojson").write_text("{}")
        (out / "within").mkdir()
        (out / "drive.toml").write_text("# x\n[imu]\nrate = 5\nday = 2026-01-02\n[gnss]\na = [1]\n")
        (out / "bad.toml").write_text("[imu\n")
        digests = DigestCache(out)
        paths = [out / n for n in ("map.geojson", "within", "gone", "map.geojson/beyond")]
        found["digests"] = [digests.digest(p) or "none" for p in paths]
        digests.save()
        kept = DigestCache(out)
        found["kept"] = [len(v) for v in kept._known.values()]
        before = (out / "map.geojson").stat()
        (out / "map.geojson").write_text("[]")
        os.utime(out / "map.geojson", ns=(before.st_atime_ns, before.st_mtime_ns + 10))
        found["again"] = kept.digest(paths[0])
        written = {"map.geojson": {"sha256": found["again"]}}
        record: dict[str, Any] = {"status": "done", "outputs": written, **now.as_json()}
        told = {
            "same": {},
            "running": {"status": "running"},
            "interrupted": {"status": "interrupted"},
            "failed": {"status": "failed"},
            "version": {"version": 2},
            "setting": {"settings": settings | {"a.y": "short"}},
            "gone": {"settings": {**settings, "c": 1}, "manifest": {}},
            "input": {"inputs": {"imu.csv": "12", "old.csv": "9", "gps.csv": "22"}},
            "needs": {"needs": needs | {"path.parquet": "34", "boxes.csv": "1"}},
            "run": {"needs": needs | {names.RUN: "45"}},
            "outputs": {"outputs": {**written, "lost.csv": {"sha256": "1"}}},
            "changed": {"outputs": {"map.geojson": {"sha256": "1"}}},
            "odd": {"outputs": {"map.geojson": "1"}, "inputs": 5},
            "many": {"settings": {}, "manifest": {}, "inputs": {}},
        }
        producers = {"path.parquet": "fuse", "boxes.csv": "detect"}
        for name, change in told.items():
            for ran in ([], ["import", "fuse"]):
                why = of.why_run(now, record | change, out, kept, producers, ran)
                found[f"{name} {len(ran)}"] = why or "holds"
        found["never"] = of.why_run(now, None, out, kept, producers, [])
        found["manifests"] = [
            str(of._manifest(out / name, sections, False))
            for name in ("drive.toml", "bad.toml", "gone.toml")
            for sections in (None, ("imu",), ())
        ]
        found["names"] = list(
            names_of([out / "within" / "x", Path("/else/y"), Path("/else/z/y")], out)
        )
        changed = kept._changed
        kept.save()
        found["saved"] = [changed, kept._changed]
    found["history"] = of._history([{"key": "k", "started": "s"}, {"key": "m"}])
    found["short"] = [of._short("x" * n) for n in (37, 38, 39, 60)]
    return found
