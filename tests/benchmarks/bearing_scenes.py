"""Objects from bearings in streets that are not Regent Street: which costs serve best.

    python tests/benchmarks/bearing_scenes.py [--parts N] [--data DIR]

Traffic lights of Dublin where they really stand and cameras where Street View really stood, with
simulated sightings: one metre of camera position, two degrees of bearing, depths in tenths of
metres that are 0.3 off in the logarithm and short in common, objects missed more often from afar,
false sightings. The default costs were chosen here; the street with real sightings
(``tests/recordings/test_regent_street.py``) stays for checking.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.evaluation.sign_matching import match
from automap.geolocation.bearings import BearingRules, locate_from_bearings
from automap.records import Bearings, FloatArray, SignPoints

ORIGIN = (float(np.radians(53.344)), float(np.radians(-6.25)), 0.0)
SPACING_M = 6.0
REACH_M = 30.0
_SEEN_FROM_M = [0.0, 3.0, 6.0, 16.0, 20.0, 28.0, 36.0, 40.0, 41.0]
_SEEN = [0.0, 0.3, 0.6, 0.6, 0.35, 0.2, 0.08, 0.03, 0.0]
_FALSE_PER_CAMERA = 0.8
COSTS = ((9.0, 9.0), (7.0, 6.0), (6.0, 6.0), (5.0, 6.0), (7.0, 4.0), (6.0, 8.0))


def places(path: Path, columns: tuple[int, int], skip: int = 0) -> FloatArray:
    """North and east [n, 2], m, of a table whose ``columns`` are latitude and longitude, deg."""
    lines = path.read_text(encoding="utf-8").splitlines()[skip:]
    cells = [line.replace(",", " ").split() for line in lines if line.strip()]
    degrees = np.array([[float(row[k]) for k in columns] for row in cells])
    zero = np.zeros(len(degrees))
    return local_ned(*np.radians(degrees.T), zero, ORIGIN)[:, :2]


def thinned(cameras: FloatArray, objects: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Cameras near objects, no two of them nearer than ``SPACING_M``."""
    near = np.hypot(*np.moveaxis(cameras[:, None] - objects[None], 2, 0)).min(axis=1) < REACH_M
    kept: list[FloatArray] = []
    for camera in rng.permutation(cameras[near]):
        if all(np.hypot(*(camera - other)) > SPACING_M for other in kept):
            kept.append(camera)
    return np.array(kept)


def sightings(objects: FloatArray, cameras: FloatArray, rng: np.random.Generator) -> Bearings:
    """What a detector with a depth estimate would report of the objects."""
    centre, bearing, depth = [], [], []
    for camera in cameras:
        offset = objects - camera - rng.normal(0.0, 1.0, 2)
        distance = np.hypot(*offset.T)
        seen = rng.random(len(objects)) < np.interp(distance, _SEEN_FROM_M, _SEEN)
        turn = np.degrees(np.arctan2(offset[seen, 1], offset[seen, 0]))
        turn += rng.normal(0.0, 2.0, len(turn))
        far = np.maximum((distance[seen] - 2.5) / 1.1, 1.5) * np.exp(rng.normal(0, 0.3, len(turn)))
        n_false = int(rng.poisson(_FALSE_PER_CAMERA))
        bearing += [*turn, *rng.uniform(0.0, 360.0, n_false)]
        depth += [*far, *np.exp(rng.normal(2.1, 0.5, n_false))]
        centre += [camera] * (len(turn) + n_false)
    n = len(bearing)
    lat, lon, _ = from_local_ned(np.column_stack([np.array(centre), np.zeros(n)]), ORIGIN)
    return Bearings(
        lat_rad=np.asarray(lat),
        lon_rad=np.asarray(lon),
        bearing_rad=np.radians(np.round(bearing) % 360.0),
        depth_m=np.round(depth, 1),
        class_name=np.full(n, "", np.object_),
        sd_rad=np.full(n, np.nan),
    )


def points(lat_rad: FloatArray, lon_rad: FloatArray) -> SignPoints:
    n = len(lat_rad)
    nothing = np.full(n, "", np.object_)
    return SignPoints(lat_rad, lon_rad, nothing, np.full((n, 2, 2), np.nan), np.zeros(n))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=3, help="of the town, a scene each")
    parser.add_argument("--data", default=os.environ.get("AUTOMAP_SHARED_DATA", "../shared/data"))
    arguments = parser.parse_args()
    folder = Path(arguments.data) / "object_geolocation" / "regent-street" / "DublinTL"
    lights = places(folder / "DublinTL_2015.csv", (1, 0), skip=1)
    everywhere = places(folder / "gsvs_2015.csv", (0, 1))
    total = dict.fromkeys(COSTS, np.zeros(4))
    for seed, rows in enumerate(np.array_split(np.argsort(lights[:, 0]), arguments.parts), 11):
        rng = np.random.default_rng(seed)
        objects = lights[rows]
        seen = sightings(objects, thinned(everywhere, objects, rng), rng)
        lat, lon, _ = from_local_ned(np.column_stack([objects, np.zeros(len(objects))]), ORIGIN)
        truth = points(np.asarray(lat), np.asarray(lon))
        for alone, price in COSTS:
            rules = BearingRules(alone_cost=alone, object_cost=price)
            signs, _ = locate_from_bearings(seen, rules)
            found = points(
                np.array([s.lat_rad for s in signs]), np.array([s.lon_rad for s in signs])
            )
            hits = [len(match(found, truth, gate)) for gate in (2.0, 6.0)]
            total[alone, price] = total[alone, price] + [len(found), len(truth), *hits]
    for (alone, price), (n_found, n_truth, near, far) in total.items():
        print(
            f"alone {alone:g} object {price:g}: "
            f"2 m recall {near / n_truth:.2f} precision {near / n_found:.2f}, "
            f"6 m recall {far / n_truth:.2f} precision {far / n_found:.2f}"
        )


if __name__ == "__main__":
    main()
