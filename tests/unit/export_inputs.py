"""Small made-up runs for the tests of export and report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from automap.io import names
from automap.io.signs_table import write_signs
from automap.io.tables import write_columns, write_fixes
from automap.io.trajectory_table import write_trajectory
from automap.records import ClockModel, Fixes, Sign, Trajectory

GPS_S = 1_457_486_418.0
CLOCK = ClockModel(4_000_000_000_000, GPS_S, 1e-6, 0.002, 1e-7, "arrival", 0.07)
HOSTILE = "</script><img src=x onerror=alert(1)>&\"'$[id]\x07 signé"


def sign(number: int = 1, **changes: object) -> Sign:
    """One plausible sign; any field can be changed."""
    first = CLOCK.ref_ns + number * 7_000_000_000
    fields: dict[str, object] = {
        "id": f"s{number:04d}",
        "class_name": ("stop", "give-way", "speed-limit-50")[number % 3],
        "lat_rad": np.radians(48.97 + 2e-4 * number),
        "lon_rad": np.radians(8.47 + 3e-4 * np.sin(number)),
        "height_m": 158.0 + number % 5,
        "cov_enu": np.array([[1.3, 0.4, 0.0], [0.4, 0.6, 0.0], [0.0, 0.0, 4.0]]),
        "confidence": 0.93,
        "n_views": 9,
        "first_seen_ns": first,
        "last_seen_ns": first + 1_500_000_000,
        "height_above_road_m": 2.2,
        "facing_rad": -0.5,
        "facing_sd_rad": 0.05,
        "size_m": 0.75,
        "side": "right",
        "status": "ok" if number % 4 else "weak_geometry",
        "drives": ("demo",),
    }
    return Sign(**{**fields, **changes})  # type: ignore[arg-type]


def trajectory(seconds: float = 120.0, rate_hz: float = 50.0, clock: bool = True) -> Trajectory:
    """A winding drive at 12 m/s with uncertainty that grows and shrinks."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    heading = 0.6 * np.sin(t / 15.0)
    north, east = 12.0 * np.cos(heading), 12.0 * np.sin(heading)
    lat = np.radians(48.97) + np.cumsum(north) / rate_hz / 6.37e6
    lon = np.radians(8.47) + np.cumsum(east) / rate_hz / (6.38e6 * np.cos(lat))
    t_ns = CLOCK.ref_ns + np.rint(t * 1e9).astype(np.int64)
    sigma = 0.8 + 0.5 * np.sin(t / 9.0)
    zero = np.zeros_like(t)
    return Trajectory(
        t_ns=t_ns,
        gps_s=CLOCK.gps_s(t_ns) if clock else np.full(len(t), np.nan),
        lat_rad=lat,
        lon_rad=lon,
        height_m=158.0 + 2.0 * np.sin(t / 40.0),
        vel_ned=np.column_stack([north, east, zero]),
        rpy=np.column_stack([0.02 * np.sin(t), 0.01 * np.cos(t), heading]),
        sd_pos_ned=np.column_stack([sigma, 0.9 * sigma, 1.8 * sigma]),
        sd_vel_ned=np.column_stack([0.05 + zero, 0.05 + zero, 0.03 + zero]),
        sd_rpy=np.radians(np.column_stack([0.1 + zero, 0.1 + zero, 0.4 + 5 * np.exp(-t)])),
    )


def fixes(path: Trajectory, geoid_sep_m: float = 48.0) -> Fixes:
    """One fix a second along a trajectory, with a hole of ten seconds."""
    rows = np.arange(0, len(path), 50)
    seconds = (path.t_ns[rows] - path.t_ns[0]) * 1e-9
    rows = rows[(seconds < 40) | (seconds > 50)]
    n = len(rows)
    noise = np.random.default_rng(3).normal(0.0, 1.2 / 6.37e6, (n, 2))
    return Fixes(
        gps_s=CLOCK.gps_s(path.t_ns[rows]),
        lat_rad=path.lat_rad[rows] + noise[:, 0],
        lon_rad=path.lon_rad[rows] + noise[:, 1],
        height_m=path.height_m[rows],
        vel_ned=path.vel_ned[rows],
        sd_pos_ned=np.full((n, 3), 1.2),
        sd_vel_ned=np.full((n, 3), 0.1),
        fix_type=np.full(n, 3, np.int64),
        n_sats=np.full(n, 9, np.int64),
        hdop=np.full(n, 0.9),
        geoid_sep_m=np.full(n, geoid_sep_m),
        offset=np.arange(n, dtype=np.int64) * 100,
        arrival_ns=path.t_ns[rows] + 80_000_000,
    )


def write_run(out: Path, signs: int = 12, name: str = "demo", seconds: float = 120.0) -> Path:
    """A whole OUT folder as the stages before export leave it."""
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(1)
    path = trajectory(seconds)
    write_trajectory(out / names.TRAJECTORY, path)
    write_signs(out / names.SIGNS_RAW, [sign(i) for i in range(1, signs + 1)])
    write_fixes(out / names.FIXES, fixes(path))
    seen = path.t_ns[100:-100:10]
    n = len(seen)
    write_columns(
        out / names.OBSERVATIONS,
        {
            "t_ns": seen,
            "frame": np.arange(n),
            "class": np.array(["stop"] * n, object),
            "sign_id": np.array([None, "s0001"] * (n // 2) + [None] * (n % 2), object),
            "residual_px": rng.normal(0, 1, n),
            "used": rng.random(n) > 0.2,
        },
    )
    content = {
        "ref_ns": CLOCK.ref_ns,
        "ref_gps_s": CLOCK.ref_gps_s,
        "drift": CLOCK.drift,
        "sd_offset_s": CLOCK.sd_offset_s,
        "sd_drift": CLOCK.sd_drift,
        "method": "arrival",
        "output_delay_s": 0.07,
    }
    (out / names.SYNC).write_text(json.dumps(content))
    arrival = path.t_ns[::10]
    delay = 0.07 + rng.exponential(0.01, len(arrival))
    write_columns(
        out / names.SYNC_DELAYS,
        {"t_ns": arrival, "delay_s": delay, "envelope_s": np.full(len(arrival), 0.07)},
    )
    _write_fusion(out, path, rng)
    (out / names.FUSION).write_text(json.dumps(FUSION))
    record = {
        "schema": "automap.run/1",
        "automap": "0.1.0",
        "drive": {"name": name, "path": f"/drives/{name}"},
        "settings": {"geolocate": {"pixel_sd": 1.5}},
        "stages": {"fuse": {"status": "done", "seconds": 1.25, "reason": "never ran"}},
        "verdict": {
            "state": "doubtful",
            "reasons": [{"code": "innovations", "text": "the sigmas of <east> are too small"}],
        },
        "warnings": ["The lever arm is not measured; it is taken as zero."],
        "metrics": {"mounting_rpy_deg": [0.1, 0.2, 0.3]},
    }
    (out / names.RUN).write_text(json.dumps(record))
    return out


FUSION = {
    "method": "inertial",
    "imu_delay_s": 0.125,
    "imu_delay_sd_s": 0.004,
    "delay_is_clock": False,
    "mounting_rpy_deg": [179.0, 6.8, 185.0],
    "mounting_rpy_sd_deg": [2.7, 0.1, 0.2],
    "align_margin_nats": 300.0,
    "noise_factors": {"gyro": 4.0, "position_h": 0.5, "accel": 1.0},
    "fixes_used": 120,
    "refused_share": 0.0,
    "standstill": [[0.5, 3.0], [4.0, 5.0]],
    "channels": {
        "position_n": {"count": 60, "normalised_rms": 1.04, "accepted_share": 1.0},
        "position_e": {"count": 60, "normalised_rms": 2.4, "accepted_share": 1.0},
        "nhc_y": {"count": 60, "normalised_rms": 0.1, "accepted_share": 1.0},
    },
}
"""What the fuse stage says of a sensor upside down."""


def _write_fusion(out: Path, path: Trajectory, rng: np.random.Generator) -> None:
    epochs = np.repeat(path.t_ns[::50], 6)
    channels = ["position_n", "position_e", "position_d", "velocity_n", "velocity_e", "velocity_d"]
    ratio = rng.normal(0, 1, len(epochs))
    write_columns(
        out / names.INNOVATIONS,
        {
            "t_ns": epochs,
            "channel": np.array(channels * (len(epochs) // 6), object),
            "innovation": 1.4 * ratio,
            "sd": np.full(len(epochs), 1.4),
            "nis": ratio**2,
            "accepted": np.abs(ratio) < 2.5,
        },
    )
    nodes = path.t_ns[::50]
    columns: dict[str, np.ndarray] = {"t_ns": nodes}
    for effect in ("accel_bias", "gyro_bias"):
        for axis in "xyz":
            columns[f"{effect}_{axis}"] = np.cumsum(rng.normal(0, 1e-4, len(nodes)))
            columns[f"sd_{effect}_{axis}"] = np.linspace(0.02, 0.005, len(nodes))
    write_columns(out / names.IMU_ERRORS, columns)
