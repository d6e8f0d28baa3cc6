"""A city mapped by many drives: time and memory of ``automap merge``, and what comes out.

    python tests/benchmarks/merge_million.py [DRIVES] [SIGHTINGS_PER_DRIVE] [FOLDER]

Writes output folders as runs do (signs, trajectory, times), merges them with the command line
and compares the map with the city: signs found, duplicates, neighbours kept apart, errors over
stated errors. A twentieth of the signs has a neighbour 1.5 m away.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automap.earth import metres_per_radian
from automap.io.atomic import write_json
from automap.io.signs_table import COVARIANCE_COLUMNS
from automap.io.tables import write_columns
from automap.records import FloatArray, IntArray
from automap.signs.vocabulary import load_vocabulary

BLOCK_M = 150.0
SIGNS_PER_BLOCK = 4
ORIGIN = (np.radians(-35.28), np.radians(149.13), 580.0)
SHARED_SD = np.array([0.6, 0.6, 1.0])
TAU_S = 60.0
ALONG_SD, ACROSS_SD, UP_SD = 0.4, 0.2, 0.15
SPEED = 12.0
SEEN, CLUTTER, WRONG = 0.9, 0.03, 0.03
TWINS, TWIN_M = 0.05, 1.5


class City:
    """A grid of streets with signs for both directions of every block."""

    def __init__(self, rng: np.random.Generator, side: int) -> None:
        self.side = side
        self.starts, self.steps = self._blocks()
        n = len(self.starts) * SIGNS_PER_BLOCK
        block = np.repeat(np.arange(len(self.starts)), SIGNS_PER_BLOCK)
        along = rng.uniform(15.0, BLOCK_M - 5.0, n)
        # signs of one block keep 4 m apart, but for the twins
        order = np.lexsort((along, block))
        along = along[order].reshape(-1, SIGNS_PER_BLOCK)
        for k in range(1, SIGNS_PER_BLOCK):
            along[:, k] = np.maximum(along[:, k], along[:, k - 1] + 4.0)
        twin = rng.random(len(along)) < TWINS * SIGNS_PER_BLOCK
        along[twin, 1] = along[twin, 0] + TWIN_M
        self.along = along.ravel()
        self.block = block
        direction = self.steps[block] / BLOCK_M
        left = np.column_stack([-direction[:, 1], direction[:, 0]])
        beside = np.where(rng.random(n) < 0.85, 4.5, -4.5)
        beside = beside.reshape(-1, SIGNS_PER_BLOCK)
        beside[twin, 1] = beside[twin, 0]
        plan = self.starts[block] + direction * self.along[:, None] + left * beside.ravel()[:, None]
        self.position = np.column_stack([plan, rng.uniform(2.0, 3.0, n)])
        self.facing = np.mod(np.arctan2(direction[:, 0], direction[:, 1]) + np.pi, 2 * np.pi)
        self.names = sorted(load_vocabulary().classes)
        self.code = rng.integers(0, len(self.names), n)

    def _blocks(self) -> tuple[FloatArray, FloatArray]:
        nodes = np.stack(np.meshgrid(np.arange(self.side), np.arange(self.side)), axis=-1)
        nodes = nodes.reshape(-1, 2)
        starts, steps = [], []
        for step in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            end = nodes + step
            inside = ((end >= 0) & (end < self.side)).all(axis=1)
            starts.append(nodes[inside])
            steps.append(np.tile(step, (int(inside.sum()), 1)))
        return np.vstack(starts) * BLOCK_M, np.vstack(steps) * BLOCK_M

    def route(self, rng: np.random.Generator, blocks: int) -> IntArray:
        """A walk over ``blocks`` different blocks that mostly goes straight on."""
        key = {
            (int(a), int(b), int(c), int(d)): k
            for k, (a, b, c, d) in enumerate(
                np.hstack([self.starts / BLOCK_M, self.steps / BLOCK_M]).round().astype(int)
            )
        }
        node = rng.integers(0, self.side, 2)
        step = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)][rng.integers(4)])
        taken: list[int] = []
        while len(taken) < blocks:
            options = [step, np.array([-step[1], step[0]]), np.array([step[1], -step[0]]), -step]
            first = rng.choice(3, p=[0.6, 0.2, 0.2])
            order = [first, *(k for k in (0, 1, 2, 3) if k != first)]
            for choice in order:
                end = node + options[choice]
                if (end >= 0).all() and (end < self.side).all():
                    step = options[choice]
                    break
            taken.append(key[int(node[0]), int(node[1]), int(step[0]), int(step[1])])
            node = node + step
        return np.array(taken, np.int64)


def wander(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Shared errors [k, 3] of a trajectory at increasing times."""
    from scipy.signal import lfilter

    grid = np.arange(time_s[0] - 1.0, time_s[-1] + 2.0)
    keep = np.exp(-1.0 / TAU_S)
    white = rng.standard_normal((len(grid), 3)) * np.sqrt(1 - keep**2)
    white[0] = rng.standard_normal(3)
    value = lfilter([1.0], [1.0, -keep], white, axis=0)
    return np.column_stack([np.interp(time_s, grid, value[:, k]) for k in range(3)]) * SHARED_SD


def seen_signs(
    rng: np.random.Generator, city: City, number: int, sightings: int
) -> tuple[dict[str, object], IntArray, IntArray, float]:
    """A drive's table of signs, the true sign of every row (-1 clutter), its route and start."""
    blocks = int(np.ceil(sightings / (SIGNS_PER_BLOCK * SEEN * (1.0 + CLUTTER))))
    route = city.route(rng, blocks)
    start = 1.45e9 + 86400.0 * number
    _, first = np.unique(route, return_index=True)
    times, signs = [], []
    for place in np.sort(first):
        own = np.arange(SIGNS_PER_BLOCK) + SIGNS_PER_BLOCK * route[place]
        signs.append(own)
        times.append(start + (place * BLOCK_M + city.along[own] - 8.0) / SPEED)
    sign, time_s = np.concatenate(signs), np.concatenate(times)
    seen = rng.random(len(sign)) < SEEN
    sign, time_s = sign[seen], time_s[seen]
    false = rng.random(len(sign)) < CLUTTER
    n = len(sign) + int(false.sum())
    truth = np.concatenate([sign, np.full(int(false.sum()), -1)])
    source = np.concatenate([sign, sign[false]])
    when = np.concatenate([time_s, time_s[false] + 0.2])
    place = city.position[source].copy()
    heading = city.facing[source] + np.pi
    ahead = np.column_stack([np.sin(heading), np.cos(heading)])
    right = np.column_stack([ahead[:, 1], -ahead[:, 0]])
    stray = rng.uniform(-1.0, 1.0, (n, 2)) * (25.0, 8.0) * (truth < 0)[:, None]
    place[:, :2] += stray[:, :1] * ahead + stray[:, 1:] * right
    order = np.argsort(when)
    shared = np.empty((n, 3))
    shared[order] = wander(rng, when[order])
    error = shared.copy()
    error[:, :2] += ALONG_SD * ahead * rng.standard_normal((n, 1))
    error[:, :2] += ACROSS_SD * right * rng.standard_normal((n, 1))
    error[:, 2] += UP_SD * rng.standard_normal(n)
    enu = place + error
    north, east = (float(v) for v in metres_per_radian(ORIGIN[0], ORIGIN[2]))
    cov = np.zeros((n, 3, 3))
    cov[:, :2, :2] = ALONG_SD**2 * ahead[:, :, None] * ahead[:, None, :]
    cov[:, :2, :2] += ACROSS_SD**2 * right[:, :, None] * right[:, None, :]
    cov[:, 2, 2] = UP_SD**2
    cov += np.diag(SHARED_SD**2)
    code = city.code[source].copy()
    wrong = (rng.random(n) < WRONG) | (truth < 0)
    code[wrong] = rng.integers(0, len(city.names), int(wrong.sum()))
    stamps = np.rint(when * 1e9).astype(np.int64)
    columns: dict[str, object] = {
        "id": [f"s{k + 1:04d}" for k in range(n)],
        "class": [city.names[k] for k in code],
        "lat_rad": ORIGIN[0] + enu[:, 1] / north,
        "lon_rad": ORIGIN[1] + enu[:, 0] / east,
        "height_m": ORIGIN[2] + enu[:, 2],
    }
    columns |= {name: cov[:, i, j] for name, i, j in COVARIANCE_COLUMNS}
    columns |= {
        "confidence": np.where(truth >= 0, 0.95, 0.8),
        "n_views": np.full(n, 12),
        "first_seen_ns": stamps - 2_000_000_000,
        "last_seen_ns": stamps,
        "height_above_road_m": place[:, 2],
        "facing_rad": np.mod(city.facing[source] + 0.15 * rng.standard_normal(n), 2 * np.pi),
        "size_m": np.full(n, 0.6),
        "side": ["left"] * n,
        "status": ["ok"] * n,
        "drives": [[f"drive-{number:04d}"]] * n,
        "detection_rows": pa.array([[k] for k in range(n)], pa.list_(pa.int64())),
    }
    return columns, truth, route, start


def write_drive(
    rng: np.random.Generator, city: City, number: int, sightings: int, out: Path
) -> IntArray:
    """One output folder; returns the true sign of every row, -1 for clutter."""
    columns, truth, route, start = seen_signs(rng, city, number, sightings)
    out.mkdir(parents=True)
    pq.write_table(pa.table(columns), out / "signs_raw.parquet")
    way = along_route(city, route, start, SPEED / 10.0)
    _write_trajectory(way, out / "trajectory.parquet")
    write_columns(out / "observations.parquet", {"t_ns": columns["last_seen_ns"]})
    write_json(
        out / "sync.json",
        {"ref_ns": 0, "ref_gps_s": 0.0, "drift": 0.0, "sd_offset_s": 0.0, "sd_drift": 0.0,
         "method": "made"},
    )  # fmt: skip
    record = {"schema": "automap.run/1", "drive": {"name": f"drive-{number:04d}"}}
    write_json(out / "run.json", record)
    return truth


def along_route(city: City, route: IntArray, start: float, step_m: float) -> FloatArray:
    """Time in s, latitude, longitude and heading in rad [k, 4] every so many metres."""
    at = np.arange(0.0, len(route) * BLOCK_M, step_m)
    block = np.minimum((at / BLOCK_M).astype(np.int64), len(route) - 1)
    part = (at - block * BLOCK_M) / BLOCK_M
    step = city.steps[route[block]]
    plan = city.starts[route[block]] + step * part[:, None]
    north, east = (float(v) for v in metres_per_radian(ORIGIN[0], ORIGIN[2]))
    place = ORIGIN[0] + plan[:, 1] / north, ORIGIN[1] + plan[:, 0] / east
    return np.column_stack([start + at / SPEED, *place, np.arctan2(step[:, 0], step[:, 1])])


def _write_trajectory(way: FloatArray, path: Path) -> None:
    time_s, lat, lon, yaw = way.T
    n, zero = len(way), np.zeros(len(way))
    columns = {name: zero for name in ("vn", "ve", "vd", "roll_deg", "pitch_deg")}
    columns |= {f"sd_{k}": zero for k in ("vn", "ve", "vd", "roll_deg", "pitch_deg", "yaw_deg")}
    columns |= {
        "t_ns": np.rint(time_s * 1e9).astype(np.int64),
        "gps_s": time_s,
        "lat_deg": np.degrees(lat),
        "lon_deg": np.degrees(lon),
        "height_m": np.full(n, ORIGIN[2]),
        "yaw_deg": np.degrees(yaw),
        "sd_n_m": np.full(n, SHARED_SD[1]),
        "sd_e_m": np.full(n, SHARED_SD[0]),
        "sd_d_m": np.full(n, SHARED_SD[2]),
    }
    write_columns(path, columns)


def evaluate(city: City, table: pa.Table, seen_often: IntArray) -> dict[str, float]:
    """The map's signs against the city; ``seen_often`` [n] sightings of each true sign."""
    from scipy.optimize import linear_sum_assignment
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    north, east = (float(v) for v in metres_per_radian(ORIGIN[0], ORIGIN[2]))
    found = np.column_stack(
        [
            (table["lon_rad"].to_numpy() - ORIGIN[1]) * east,
            (table["lat_rad"].to_numpy() - ORIGIN[0]) * north,
        ]
    )
    facing = table["facing_rad"].to_numpy()
    there = np.flatnonzero(seen_often > 0)
    true, true_tree = city.position[there, :2], cKDTree(city.position[there, :2])
    pairs = [
        (i, int(j))
        for i, near in enumerate(true_tree.query_ball_point(found, 3.0))
        for j in near
        if np.cos(facing[i] - city.facing[there[j]]) > 0
    ]
    a, b = np.array(pairs).T
    graph = coo_matrix((np.ones(len(a)), (a, b + len(found))), shape=(len(found) + len(true),) * 2)
    _, group = connected_components(graph, directed=False)
    match = np.full(len(found), -1)
    order = np.argsort(group[a], kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(group[a][order])) + 1):
        left, right = np.unique(a[rows]), np.unique(b[rows])
        distance = np.linalg.norm(found[left][:, None] - true[right][None], axis=2)
        i, j = linear_sum_assignment(np.minimum(distance, 3.0))
        good = distance[i, j] < 3.0
        match[left[i[good]]] = right[j[good]]
    error = found[match >= 0] - true[match[match >= 0]]
    cov = np.array(
        [[table["cov_ee_m2"].to_numpy(), table["cov_en_m2"].to_numpy()],
         [table["cov_en_m2"].to_numpy(), table["cov_nn_m2"].to_numpy()]]
    ).transpose(2, 0, 1)[match >= 0]  # fmt: skip
    square = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[:, :, None])[:, :, 0])
    extra = np.flatnonzero(match < 0)
    near, _ = true_tree.query(found[extra])
    often = np.zeros(len(true), np.bool_)
    often[match[match >= 0]] = True
    enough = seen_often[there] >= 3
    gap = cKDTree(true).query(true, k=2)[0][:, 1]
    twins = gap < TWIN_M + 0.01
    close = cKDTree(found).query_pairs(2.0, output_type="ndarray")
    false_pairs = sum(1 for i, j in close.tolist() if match[i] < 0 or match[j] < 0)
    return {
        "true_signs_seen": len(true),
        "map_signs": len(found),
        "recall_seen_3_times": float(often[enough].mean()),
        "precision": float((match >= 0).mean()),
        "duplicates_within_2_m_share": float((near < 2.0).sum() / len(found)),
        "false_pairs_within_2_m_share": false_pairs / len(found),
        "twins_kept_apart": float(often[twins & enough].mean()) if twins.any() else 1.0,
        "median_error_m": float(np.median(np.hypot(*error.T))),
        "coverage95": float((square < 5.991).mean()),
    }


def main() -> None:
    drives = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    each = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    with tempfile.TemporaryDirectory(dir=sys.argv[3] if len(sys.argv) > 3 else None) as folder:
        rng = np.random.default_rng(1)
        blocks = drives * each / (20 * SIGNS_PER_BLOCK * SEEN)
        city = City(rng, max(3, round(np.sqrt(blocks / 4))))
        seen = np.zeros(len(city.position), np.int64)
        outs = []
        for number in range(drives):
            outs.append(Path(folder) / f"out-{number:04d}")
            truth = write_drive(rng, city, number, each, outs[-1])
            seen += np.bincount(truth[truth >= 0], minlength=len(seen))
        merged = Path(folder) / "map"
        start = "from pipeline.cli import main; main()"
        words = [sys.executable, "-c", start, "merge", *map(str, outs), "-o", str(merged)]
        started = time.monotonic()
        subprocess.run([*words, "--quiet"], check=True)
        wall = time.monotonic() - started
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        result: dict[str, float] = {
            "wall_s": wall,
            "processor_s": usage.ru_utime + usage.ru_stime,
            "peak_gb": usage.ru_maxrss / 1e6,
            "sightings": json.loads((merged / "merge.json").read_text())["sightings"],
        }
        result |= evaluate(city, pq.read_table(merged / "signs_raw.parquet"), seen)
        for name, value in result.items():
            print(f"{name:<32}{value:.4g}")


if __name__ == "__main__":
    main()
