"""Maps for the tests and the benchmark of the viewer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.io import names


def write_large_map(out: Path, count: int, towns: int = 40, seed: int = 1) -> Path:
    """A map of ``count`` signs in towns over a country, some alone and some on one pole."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    centre = np.column_stack([rng.uniform(144, 150, towns), rng.uniform(-38, -33, towns)])
    town = rng.integers(0, towns, count)
    lon, lat = (centre[town] + rng.normal(0, 0.03, (count, 2))).T
    # every tenth sign hangs on the pole of the one before it
    shared = np.flatnonzero(np.arange(count) % 10 == 9)
    lon[shared], lat[shared] = lon[shared - 1], lat[shared - 1]
    classes = np.array([f"regulatory--maximum-speed-limit-{v}--g1" for v in (40, 50, 60)])
    classes = np.concatenate([classes, [f"warning--made-up-{k}--g1" for k in range(120)]])
    drives = np.array([f"drive-{k:03d}" for k in range(60)])
    variance = rng.uniform(0.1, 2.0, (2, count))
    real = pa.float64()
    table = pa.table(
        {
            "id": pa.array([f"s{k:06d}" for k in range(count)]),
            "class": pa.array(classes[rng.integers(0, len(classes), count)].tolist()),
            "lat_rad": pa.array(np.radians(lat), real),
            "lon_rad": pa.array(np.radians(lon), real),
            "height_m": pa.array(rng.uniform(0, 600, count), real),
            "cov_ee_m2": pa.array(variance[0], real),
            "cov_en_m2": pa.array(0.3 * np.sqrt(variance[0] * variance[1]), real),
            "cov_eu_m2": pa.array(np.zeros(count), real),
            "cov_nn_m2": pa.array(variance[1], real),
            "cov_nu_m2": pa.array(np.zeros(count), real),
            "cov_uu_m2": pa.array(np.full(count, 4.0), real),
            "confidence": pa.array(rng.uniform(0.2, 1.0, count), real),
            "n_views": pa.array(rng.integers(1, 60, count)),
            "first_seen_ns": pa.array(np.arange(count) * 1_000_000_000),
            "last_seen_ns": pa.array(np.arange(count) * 1_000_000_000 + 2_000_000_000),
            "height_above_road_m": pa.array(np.full(count, 2.2), real),
            "facing_rad": pa.array(rng.uniform(0, 6.28, count), real),
            "size_m": pa.array(np.full(count, 0.7), real),
            "side": pa.array(["left"] * count),
            "status": pa.array(["ok"] * count),
            "drives": pa.array([[d] for d in drives[rng.integers(0, 60, count)].tolist()]),
            "detection_rows": pa.array([[]] * count, pa.list_(pa.int64())),
        }
    )
    pq.write_table(table, out / names.SIGNS_RAW)
    return out
