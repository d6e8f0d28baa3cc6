"""From sensors to signs: simulated drives through the whole pipeline, against their truth.

    python tests/benchmarks/drive_to_map.py [--drives N] [--first SEED] [--seconds S] [-o DIR]

A route, signs, the camera's turn (up to 5 deg) and time offset (up to 0.3 s), biases and scale
errors are drawn at random, `automap simulate` writes the drive, a quarter of the boxes is taken
out, a tenth gets a wrong class and a tenth as many boxes stand where nothing is; then
`automap run`, and its signs and its camera are set against the truth. The trajectory has the errors
that fusion leaves, where `geolocation_simulated.py` draws larger ones and knows the bound.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from automap.evaluation.sign_matching import match, summarise_signs
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.gates import sigmas
from automap.io.sign_points import read_sign_points

MISSED, WRONG, CLUTTER = 0.25, 0.1, 0.1
TURNED_DEG = 10.0
SIGNS_SCENARIO = Path(__file__).resolve().parents[2] / "configs" / "scenarios" / "signs.toml"
STATED_MOUNT = np.radians([0.0, 1.0, 0.0])


def toml(value: Any) -> str:
    """A value of a scenario as TOML writes it within a line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(v)}" for key, v in value.items()) + " }"
    return f"[{', '.join(map(toml, value))}]" if isinstance(value, list) else json.dumps(value)


def draw_scenario(rng: np.random.Generator, seconds: float) -> dict[str, Any]:
    """A drive of about ``seconds`` through streets with a sign every forty metres or so."""
    legs: list[dict[str, float]] = []
    length = heading = driven = 0.0
    while driven < seconds:
        straight, speed = rng.uniform(120.0, 400.0), rng.uniform(9.0, 17.0)
        turn, radius = rng.choice([-1.0, 1.0]) * rng.uniform(50.0, 100.0), rng.uniform(15.0, 40.0)
        turn = -turn if abs(heading + turn) > 150.0 else turn
        bend = abs(np.radians(turn)) * radius
        legs.append({"length_m": straight, "speed_m_s": speed})
        legs.append({"turn_deg": turn, "radius_m": radius, "speed_m_s": rng.uniform(6.0, 9.0)})
        heading, length = heading + turn, length + straight + bend
        driven += straight / speed + bend / 7.5 + 4.0
    names = sorted({sign["sign"] for sign in tomllib.loads(SIGNS_SCENARIO.read_text())["signs"]})
    signs = []
    at = 60.0
    while at < length - 100.0:
        signs.append(
            {
                "at_m": at,
                "sign": str(rng.choice(names)),
                "offset_m": rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 6.5),
                "height_m": rng.uniform(1.9, 3.8),
            }
        )
        at += rng.uniform(15.0, 60.0)
    # of its own generator: the rest is the same however faces are turned
    turns = np.random.default_rng(len(signs)).normal(0.0, TURNED_DEG, len(signs))
    for sign, turn in zip(signs, np.clip(turns, -60.0, 60.0), strict=True):
        sign["turned_deg"] = turn
    turned = np.radians(rng.uniform([-3.0, -5.0, -5.0], [3.0, 5.0, 5.0]))
    scenario = {
        "schema": "automap.scenario/1",
        "name": "drive-to-map",
        "seed": int(rng.integers(1 << 30)),
        "signs": signs,
        "start": {
            "utc": "2026-03-14T09:20:00Z",
            **{"lat_deg": -35.28, "lon_deg": 149.13, "height_m": 580.0, "heading_deg": 62.0},
        },
        "gnss": {"lever_arm_m": [0.4, 0.1, -1.2]},
        "camera": {
            "box_sd_px": 1.0,
            "lever_arm_sigma_m": 0.02,
            "mount_rpy_deg": np.degrees(STATED_MOUNT),
            "mount_rpy_sigma_deg": 3.0,
            "time_offset_sigma_s": 0.15,
        },
        "errors": {
            "camera_boresight": dict(zip(("roll", "pitch", "yaw"), turned, strict=True)),
            "camera_time_offset": {"s": rng.uniform(-0.3, 0.3)},
            "accel_bias": dict(zip("xyz", rng.normal(0.0, 0.08, 3), strict=True)),
            "gyro_bias": dict(zip("xyz", rng.normal(0.0, 0.003, 3), strict=True)),
            "accel_scale": dict(zip("xyz", rng.normal(0.0, 0.002, 3), strict=True)),
            "gyro_scale": dict(zip("xyz", rng.normal(0.0, 0.002, 3), strict=True)),
        },
        "route": {
            "stops": [
                {"at_m": at, "hold_s": rng.uniform(3.0, 20.0)}
                for at in np.sort(rng.uniform(300.0, length - 200.0, 8))
            ],
            "legs": legs,
        },
    }
    plain: dict[str, Any] = json.loads(json.dumps(scenario, default=lambda value: value.tolist()))
    return plain


def spoil(path: Path, rng: np.random.Generator) -> None:
    """Boxes missed, called another class, and put where nothing is, in a detections file."""
    boxes = pd.read_csv(path)
    boxes = boxes[rng.random(len(boxes)) > MISSED].copy()
    wrong = rng.random(len(boxes)) < WRONG
    boxes.loc[wrong, "class"] = rng.choice(sorted(boxes["class"].unique()), wrong.sum())
    stray = boxes.sample(int(CLUTTER * len(boxes)), random_state=rng)
    size = rng.uniform(12.0, 60.0, len(stray))
    stray["x_min"] = rng.uniform(5.0, 1200.0, len(stray))
    stray["y_min"] = rng.uniform(5.0, 600.0, len(stray))
    stray["x_max"], stray["y_max"] = stray["x_min"] + size, stray["y_min"] + size
    both = pd.concat([boxes, stray]).sort_values("frame", kind="stable")
    both.to_csv(path, index=False)


def automap(*arguments: object) -> None:
    """Run the command; its message when it fails."""
    command = [str(Path(sys.executable).with_name("automap")), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}: {done.stderr}")


def asset_figures(found: Path, true: Path) -> dict[str, float]:
    """Errors of facing and height above the road of the signs matched within 3 m, and how many lie
    in their 95 % intervals."""
    tables = [json.loads(path.read_text())["features"] for path in (found, true)]
    pairs = match(read_sign_points(found), read_sign_points(true), 3.0)
    off: dict[str, list[tuple[float, float]]] = {"facing_deg": [], "height_above_road_m": []}
    for i, j in zip(pairs.estimate.tolist(), pairs.truth.tolist(), strict=True):
        one, other = tables[0][i]["properties"], tables[1][j]["properties"]
        for name, sd in (
            ("facing_deg", "facing_sd_deg"),
            ("height_above_road_m", "sd_above_road_m"),
        ):
            error = one[name] - other[name]
            error = (error + 180.0) % 360.0 - 180.0 if name == "facing_deg" else error
            off[name].append((abs(error), one[sd]))
    result = {}
    for name, values in off.items():
        error, sd = np.array(values).T
        result[f"{name} median"] = float(np.median(error))
        result[f"{name} inside"] = float(np.mean(error < sigmas(0.05) * sd))
    return result


def figures(seed: int, seconds: float, folder: Path) -> dict[str, float]:
    """One drive, made, run and compared."""
    rng = np.random.default_rng(7000 + seed)
    scenario = draw_scenario(rng, seconds)
    lines = [f"{key} = {toml(value)}" for key, value in scenario.items()]
    (folder / "scenario.toml").write_text("\n".join(lines) + "\n")
    drive, out = folder / "drive", folder / "out"
    automap("simulate", folder / "scenario.toml", "-o", drive)
    spoil(drive / "video" / "front_detections.csv", rng)
    automap("run", drive, "-o", out)
    truth = read_sign_points(drive / "truth" / "signs.geojson")
    summary = summarise_signs(read_sign_points(out / "signs.geojson"), truth)
    camera = json.loads((out / "run.json").read_text())["metrics"]["camera_front"]
    turned = scenario["errors"]["camera_boresight"]
    true_turn = np.array([turned[name] for name in ("roll", "pitch", "yaw")])
    found = rpy_to_matrix(np.radians(camera["boresight_rpy_deg"]))
    off = np.degrees(matrix_to_rpy(rpy_to_matrix(true_turn).T @ found))
    return {
        "signs": float(len(truth)),
        "precision_3m": summary["gates"]["3"]["precision"],
        "recall_3m": summary["gates"]["3"]["recall"],
        "median_error_m": summary["median_error_m"],
        **asset_figures(out / "signs.geojson", drive / "truth" / "signs.geojson"),
        "coverage95": summary["coverage95"],
        "roll_error_deg": float(off[0]),
        "pitch_error_deg": float(off[1]),
        "yaw_error_deg": float(off[2]),
        "roll_sd_deg": camera["boresight_rpy_sd_deg"][0],
        "yaw_sd_deg": camera["boresight_rpy_sd_deg"][2],
        "time_error_s": camera["time_offset_s"] - scenario["errors"]["camera_time_offset"]["s"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--drives", type=int, default=4)
    parser.add_argument("--first", type=int, default=0, help="seed of the first drive")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("-o", "--out", type=Path, help="keep the drives and runs here")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(arguments.first, arguments.first + arguments.drives):
            folder = (arguments.out or Path(scratch)) / f"seed-{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            rows.append(figures(seed, arguments.seconds, folder))
            print(" ".join(f"{key} {value:.4g}" for key, value in rows[-1].items()), flush=True)
    weight = np.array([row["signs"] for row in rows])
    for key in rows[0]:
        values = np.array([row[key] for row in rows])
        if "error_deg" in key or "error_s" in key:
            print(f"all: rms {key} {np.sqrt(np.mean(values**2)):.4f}")
        elif "_sd_" not in key and key != "signs":
            print(f"all: {key} {np.average(values, weights=weight):.3f}")


if __name__ == "__main__":
    main()
