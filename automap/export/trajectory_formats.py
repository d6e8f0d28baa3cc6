"""The trajectory as other tools read it: CSV, RTKLIB .pos, TUM and KITTI poses, GPX.

TUM: GPS seconds, position in metres east, north, up of the first pose, quaternion x y z w of
the vehicle's forward-left-up axes (the axes of ROS and of evo). KITTI: rows of [R | t] from
the vehicle's right-down-forward axes to those of the first pose.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from io import StringIO
from typing import Any

import numpy as np

from automap.earth import ecef_axes, local_ned
from automap.export.beliefs import belief_text
from automap.export.icons import sign_words
from automap.export.kml_cells import xml_text
from automap.export.sign_columns import SignColumns
from automap.frames import matrix_to_quat, rpy_to_matrix
from automap.records import FloatArray, Trajectory
from automap.timebase import gps_to_iso

GPX_STEP_S = 1.0
_ROWS = 1 << 15
"""Written at once: some ten megabytes of text."""
_NED_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_FRD_TO_FLU = np.diag([1.0, -1.0, -1.0])
# columns: right, down, forward in body axes forward, right, down
_CAMERA_AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def stretches(trajectory: Trajectory) -> Iterator[tuple[Trajectory, Trajectory | None]]:
    """A long trajectory in parts, each with what was before it: the text of all rows at once is
    larger than the trajectory."""
    for a in range(0, max(len(trajectory), 1), _ROWS):
        yield trajectory.at(slice(a, a + _ROWS)), trajectory if a else None


def trajectory_csv(trajectory: Trajectory, before: Trajectory | None = None) -> str:
    """All columns of the trajectory table, with their units in the names; the names stand above
    unless rows went ``before``."""
    import pandas as pd

    from automap.io.trajectory_table import to_columns

    decimals = {"gps_s": 6, "lat_deg": 10, "lon_deg": 10}
    table = pd.DataFrame(to_columns(trajectory))
    table = table.round({name: decimals.get(str(name), 5) for name in table if name != "t_ns"})
    return str(table.to_csv(index=False, header=before is None, lineterminator="\n"))


def rtklib_pos(trajectory: Trajectory, before: Trajectory | None = None) -> str:
    """RTKLIB solution file in GPS time with ellipsoidal heights, velocities and sigmas, without its
    header where rows went ``before``."""
    header = (
        "% program   : automap\n"
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,"
        "ns=# of satellites)\n"
        "%  GPST                      latitude(deg) longitude(deg)  height(m)   Q  ns"
        "   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio"
        "    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu"
        "    sdvun\n"
    )
    t = trajectory
    stamps = _gpst(t.gps_s)
    text = StringIO()
    text.write(header if before is None else "")
    lat, lon = np.degrees(t.lat_rad), np.degrees(t.lon_rad)
    for i, stamp in enumerate(stamps):
        sp, sv, v = t.sd_pos_ned[i], t.sd_vel_ned[i], t.vel_ned[i]
        text.write(
            f"{stamp} {lat[i]:14.9f} {lon[i]:14.9f} {t.height_m[i]:10.4f}   5   0"
            f" {sp[0]:8.4f} {sp[1]:8.4f} {sp[2]:8.4f}   0.0000   0.0000   0.0000   0.00    0.0"
            f" {v[0]:10.5f} {v[1]:10.5f} {-v[2]:10.5f}"
            f" {sv[0]:9.5f} {sv[1]:8.5f} {sv[2]:8.5f}  0.00000  0.00000  0.00000\n"
        )
    return text.getvalue()


def tum_poses(trajectory: Trajectory, before: Trajectory | None = None) -> str:
    """TUM pose file: one ``t x y z qx qy qz qw`` a row; the first pose is that of the rows that
    went ``before``, where some did."""
    position, attitude = _local(trajectory, before)
    world = _NED_TO_ENU @ attitude @ _FRD_TO_FLU
    quat = matrix_to_quat(world)
    table = np.column_stack([trajectory.gps_s, position @ _NED_TO_ENU.T, quat[:, 1:], quat[:, :1]])
    return _rows(table, ["%.6f"] + ["%.5f"] * 3 + ["%.9f"] * 4)


def kitti_poses(trajectory: Trajectory, before: Trajectory | None = None) -> str:
    """KITTI pose file: twelve numbers a row, the 3x4 matrix relative to the first pose, which is
    that of the rows that went ``before``, where some did."""
    position, attitude = _local(trajectory, before)
    axes = attitude @ _CAMERA_AXES
    first = (rpy_to_matrix((before or trajectory).rpy[:1]) @ _CAMERA_AXES)[0].T
    rotation = first @ axes
    moved = position @ first.T
    table = np.concatenate([rotation, moved[:, :, None]], axis=2).reshape(len(position), 12)
    return _rows(table, ["%.9e"] * 12)


def gpx_track(
    trajectory: Trajectory | None,
    name: str,
    step_s: float = GPX_STEP_S,
    signs: SignColumns | None = None,
    lineage: Mapping[str, Any] | None = None,
    geoid_m: FloatArray | None = None,
    others: Mapping[str, Trajectory] | None = None,
) -> str:
    """GPX 1.1 track, where there is one, in the order of time, at about one point in ``step_s`` (0:
    all), and those of ``others`` by their names; ``signs`` become waypoints, ``lineage`` the
    description of the file.

    Programs take a height of GPX for one above the sea: it stands there with that of the geoid,
    ``geoid_m`` [n] above the ellipsoid, and where that is unknown no height does. Points without a
    time or a place are left out.
    """
    track = "" if trajectory is None else _track(trajectory, xml_text(name), step_s, geoid_m)
    for other, drive in (others or {}).items():
        track += _track(drive, xml_text(other), step_s, None)
    about = "; ".join(f"{key}: {_flat(value)}" for key, value in (lineage or {}).items())
    title = xml_text(name)
    description = f"<desc>{xml_text(about)}</desc>" if about else ""
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="AutoMap" xmlns="http://www.topografix.com/GPX/1/1">\n'
        f"<metadata><name>{title}</name>{description}</metadata>\n"
        f"{''.join(_waypoints(signs))}"
        f"{track}</gpx>\n"
    )


def _track(trajectory: Trajectory, title: str, step_s: float, geoid_m: FloatArray | None) -> str:
    known = np.isfinite(trajectory.gps_s + trajectory.lat_rad + trajectory.lon_rad)
    order = np.flatnonzero(known)[np.argsort(trajectory.gps_s[known], kind="stable")]
    gps_s = trajectory.gps_s[order]
    if step_s > 0.0 and len(gps_s):
        keep = np.unique(np.searchsorted(gps_s, np.arange(gps_s[0], gps_s[-1] + 1e-9, step_s)))
        order = order[np.append(keep[keep < len(gps_s) - 1], len(gps_s) - 1)]
    keep, gps_s = order, trajectory.gps_s
    lat, lon = np.degrees(trajectory.lat_rad[keep]), np.degrees(trajectory.lon_rad[keep])
    geoid = np.full(len(gps_s), np.nan) if geoid_m is None else geoid_m
    points = "\n".join(
        f'<trkpt lat="{a:.9f}" lon="{b:.9f}">{_elevation(h - n)}'
        f"<time>{gps_to_iso(float(s))}</time>{_geoid(h - n, n)}</trkpt>"
        for a, b, h, s, n in zip(
            lat, lon, trajectory.height_m[keep], gps_s[keep], geoid[keep], strict=True
        )
    )
    return f"<trk><name>{title}</name><trkseg>\n{points}\n</trkseg></trk>\n"


def _waypoints(signs: SignColumns | None) -> Iterator[str]:
    if signs is None:
        return
    values = signs.values
    for row in np.flatnonzero(signs.located).tolist():
        confidence, radius = values["confidence"][row], values["ce95_m"][row]
        height = float(values["height_msl_m"][row])
        words = [sign_words(values["class"][row])]
        words += [f"confidence {belief_text(confidence)}"] if np.isfinite(confidence) else []
        words += [f"95 % within {radius:.1f} m"] if np.isfinite(radius) else []
        yield (
            f'<wpt lat="{signs.lat_deg[row]:.7f}" lon="{signs.lon_deg[row]:.7f}">'
            f"{_elevation(height)}{_geoid(height, float(signs.height_m[row]) - height)}"
            f"<name>{xml_text(values['id'][row])}</name>"
            f"<desc>{xml_text(', '.join(words))}</desc>"
            f"<type>{xml_text(values['class'][row])}</type></wpt>\n"
        )


def _elevation(height: float) -> str:
    return f"<ele>{height:.3f}</ele>" if np.isfinite(height) else ""


def _geoid(height: float, geoid: float) -> str:
    """The geoid's height beside one above the sea."""
    return f"<geoidheight>{geoid:.3f}</geoidheight>" if np.isfinite(height) else ""


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {item}" for key, item in value.items())
    return ", ".join(str(item) for item in value) if isinstance(value, list) else str(value)


def _local(
    trajectory: Trajectory, before: Trajectory | None = None
) -> tuple[FloatArray, FloatArray]:
    """Positions [n, 3] NED of the first and attitudes [n, 3, 3] body to that NED frame."""
    t, start = trajectory, before or trajectory
    ref = (float(start.lat_rad[0]), float(start.lon_rad[0]), float(start.height_m[0]))
    position = local_ned(t.lat_rad, t.lon_rad, t.height_m, ref).reshape(-1, 3)
    # north turns on the way: through the Earth's axes to those of the first pose
    axes, first = ecef_axes(t.lat_rad, t.lon_rad), ecef_axes(start.lat_rad[:1], start.lon_rad[:1])
    return position, first[0].T @ axes @ rpy_to_matrix(t.rpy)


def _gpst(gps_s: FloatArray) -> list[str]:
    """GPS time as RTKLIB writes it, to the millisecond."""
    stamps = np.datetime64("1980-01-06", "ms") + np.rint(gps_s * 1e3).astype("timedelta64[ms]")
    return [str(s).replace("-", "/").replace("T", " ") for s in stamps]


def _rows(table: FloatArray, formats: list[str]) -> str:
    text = StringIO()
    np.savetxt(text, table, fmt=formats)
    return text.getvalue()
