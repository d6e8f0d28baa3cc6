"""Signs written a second in each format, and GDAL's GeoJSON writer on the same signs.

Processor time of this process, best of three, so that what else the machine does counts little.
Files are written to a temporary folder; a format's time includes that.

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

from automap.export import geoparquet, gis, kml, layers
from automap.export.geojson import geojson_bytes
from automap.export.pieces import write_pieces
from automap.export.sign_columns import sign_columns
from automap.io.atomic import write_bytes


def seconds(task: Callable[[], object]) -> float:
    """Best of three runs, processor time."""
    times = []
    for _ in range(3):
        start = time.process_time()
        task()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50_000
    signs = [sign(i % 9000 + 1, id=f"s{i:06d}") for i in range(1, count + 1)]
    columns = sign_columns(signs, CLOCK)
    options = kml.KmlOptions(np.full(count, 48.0))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        layer = layers.sign_layer(columns)
        peer = seconds(lambda: gis.write_layers(out / "peer.geojson", [layer], driver="GeoJSON"))
        tasks: dict[str, Callable[[], object]] = {
            "columns": lambda: sign_columns(signs, CLOCK),
            "geojson": lambda: write_bytes(out / "a.geojson", geojson_bytes(columns)),
            "kml": lambda: write_pieces(out / "a.kml", kml.kml_texts("a", columns, None, options)),
            "parquet": lambda: geoparquet.write_geoparquet(out / "a.parquet", columns),
            "gpkg": lambda: gis.write_layers(out / "a.gpkg", [layers.sign_layer(columns)]),
        }
        print(f"{count} signs; GDAL's GeoJSON writer: {count / peer:,.0f} signs/s")
        for name, task in tasks.items():
            took = seconds(task)
            print(f"{name:8s} {count / took:10,.0f} signs/s   {peer / took:6.2f} x GDAL GeoJSON")


if __name__ == "__main__":
    main()
