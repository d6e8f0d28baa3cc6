"""Signs written a second in each format, and GDAL's GeoJSON writer on the same signs.

.venv/bin/python tests/benchmarks/export_signs.py [SIGNS]
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))

from export_inputs import CLOCK, sign

from automap.export import gis, kml, layers
from automap.export.geojson import signs_geojson
from automap.export.sign_columns import sign_columns


def seconds(task: Callable[[], object]) -> float:
    """Best of three runs."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        task()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    signs = [sign(i) for i in range(1, count + 1)]
    columns = sign_columns(signs, CLOCK)
    geoid = np.full(count, 48.0)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        layer = layers.sign_layer(columns)
        peer = seconds(lambda: gis.write_layers(out / "peer.geojson", [layer], driver="GeoJSON"))
        tasks: dict[str, Callable[[], object]] = {
            "columns": lambda: sign_columns(signs, CLOCK),
            "geojson": lambda: (out / "a.geojson").write_text(signs_geojson(columns)),
            "kml": lambda: (out / "a.kml").write_text(kml.map_kml("a", columns, None, geoid)),
            "parquet": lambda: gis.write_geoparquet(out / "a.parquet", columns),
            "gpkg": lambda: gis.write_layers(out / "a.gpkg", [layers.sign_layer(columns)]),
        }
        print(f"{count} signs; GDAL's GeoJSON writer: {count / peer:,.0f} signs/s")
        for name, task in tasks.items():
            took = seconds(task)
            print(f"{name:8s} {count / took:10,.0f} signs/s   {peer / took:6.2f} x GDAL GeoJSON")


if __name__ == "__main__":
    main()
