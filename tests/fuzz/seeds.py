"""Whole small files for the readers to begin with, made here; none is of a recording."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from automap.io.nmea_writer import sentence
from tests.unit.receiver_messages import GPS, pvt

ROOT = Path(__file__).resolve().parents[2]


def _table(head: str, row: str, count: int = 12) -> bytes:
    """A CSV whose ``{i}`` is the row and ``{t}`` its time in ns."""
    rows = [row.format(i=i, t=10**12 + i * 10**7) for i in range(count)]
    return "\n".join([head, *rows, ""]).encode()


def _json(value: object) -> bytes:
    return json.dumps(value).encode()


def _zip(**tables: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in tables.items():
            # without a time of its own an entry takes the clock's, and no seed repeats
            entry = zipfile.ZipInfo(f"{name}.csv", (2024, 1, 1, 0, 0, 0))
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _parquet() -> bytes:
    out = io.BytesIO()
    names = [f"g{axis}_rad_s" for axis in "xyz"] + [f"a{axis}_m_s2" for axis in "xyz"]
    columns = {name: np.linspace(0, 1, 40) for name in names}
    pq.write_table(pa.table({"t_ns": np.arange(40) * 10**7, **columns}), out)
    return out.getvalue()


def _nmea() -> bytes:
    bodies = (
        "GNGGA,1200{i:02}.00,4807.0380,N,01131.0000,E,1,08,0.9,545.4,M,46.9,M,,",
        "GNRMC,1200{i:02}.00,A,4807.0380,N,01131.0000,E,022.4,084.4,230394,,,A",
    )
    return b"".join(sentence(body.format(i=i)) for i in range(6) for body in bodies)


def _gpmf() -> bytes:
    def item(key: bytes, kind: bytes, size: int, data: bytes) -> bytes:
        head = key + kind + struct.pack(">BH", size, len(data) // size)
        return head + data + bytes(-len(data) % 4)

    rows = struct.pack(">30h", *range(30))
    stream = item(b"STMP", b"J", 8, struct.pack(">Q", 10**6)) + item(b"STNM", b"c", 1, b"Accel")
    stream += item(b"SCAL", b"s", 2, struct.pack(">h", 418)) + item(b"ACCL", b"s", 6, rows)
    return item(b"DEVC", b"\0", 1, item(b"STRM", b"\0", 1, stream))


def _jpeg() -> bytes:
    from PIL import Image

    out, exif = io.BytesIO(), Image.Exif()
    exif.get_ifd(0x8769)[36867] = "2024:01:01 10:00:00"
    exif.get_ifd(0x8825).update({1: "N", 2: (48.0, 7.0, 2.5), 3: "E", 4: (11.0, 31.0, 0.5)})
    Image.new("RGB", (16, 12)).save(out, "JPEG", exif=exif)
    return out.getvalue()


_PHONE = _table("time,seconds_elapsed,z,y,x", "17{t},0.{i:02},0.1,0.2,9.8")
_POS = "2024/01/01 10:00:{i:02}.000 48.1 11.5 500.0 1 9 0.01 0.01 0.02 0 0 0 0.0 2.0"
_CLOCK = {"ref_ns": 1, "ref_gps_s": 1e9, "drift": 0.0, "sd_offset_s": 0.1, "sd_drift": 1e-6}
_ACTION = {"id": "a0", "time": "2026-01-01T00:00:00Z", "seen_class": "stop", "note": "n"}
_ACTION_AT = {"kind": "accept", "sign": "s1", "lon_deg": 8.1, "lat_deg": 49.0, "sd_m": 1.0}
_POINT = {"type": "Point", "coordinates": [8.47, 48.97]}
_SIGN = {"type": "Feature", "id": "s", "geometry": _POINT, "properties": {"class": "stop"}}
_STATE = "t_ns,gps_s,lat_deg,lon_deg,height_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg"
_BIAS = "scale = [1, 1, 1]\nbias = [0.1, 0, 0]\n"


def seeds() -> dict[str, bytes]:
    """A file for each harness and more, by names that ``broken_readers.reader_of`` knows."""
    sensor = sorted((ROOT / "configs/sensors").glob("*.toml"))[0]
    return {
        "bearings_csv": _table("lat_deg,lon_deg,bearing_deg,class", "48.{i},11.5,{i},stop"),
        "detections_csv": _table(
            "frame,class,x_min,y_min,x_max,y_max,score", "{i},stop,8{i},10,9{i},20,0.9"
        ),
        "detector_toml": b'schema = "automap.detector/1"\nmodel = "m.onnx"\nclasses = ["stop"]\n',
        "drive_toml": b'schema = "automap.drive/1"\n[imu]\nfile = "imu.csv"\naxes = "FLU"\n',
        "exif_jpg": _jpeg(),
        "foreign_bearings": _table("lat,lon,bearing,depth", "51.5,-0.{i},15.0,5.6"),
        "foreign_points": _table("lon,lat", "-6.{i},53.3"),
        "frames_csv": _table("frame,t_ns", "{i},{t}"),
        "gopro_channels": _gpmf(),
        "imu_calibration": (
            f'schema = "automap.imu-calibration/1"\n[accel]\n{_BIAS}[gyro]\n{_BIAS}'.encode()
        ),
        "imu_csv": _table("t_ns,gx,gy,gz,ax,ay,az", "{t},0.1,0.{i},0.2,0.1,0.2,9.8", 60),
        "imu_log_named": _table("t_ns,gx,gy,gz,ax,ay,az", "{t},0.1,0.{i},0.2,0.1,0.2,9.8", 60),
        "imu_parquet": _parquet(),
        "odometer_csv": _table("t_ns,speed_m_s", "{t},10.{i}"),
        "phone_csv": _PHONE,
        "phone_zip": _zip(Gyroscope=_PHONE, TotalAcceleration=_PHONE),
        "receiver_toml": (
            b'schema = "automap.receiver/1"\nname = "x"\n[errors]\nwander_share = 0.9\n'
            b"wander_tau_s = 80.0\n"
        ),
        "review_json": _json({"schema": "automap.review/1", "actions": [_ACTION | _ACTION_AT]}),
        "run_json": _json(
            {"schema": "automap.run/1", "stages": {"ingest": {"status": "done", "outputs": {}}}}
        ),
        "camera_turns_json": _json(
            {
                "front": {
                    **{"bends": 3, "at_ns": 4000000000000, "offset_s": -0.7, "offset_sd_s": 0.03},
                    **{"rate": 0.01, "pictures": ["mirrored"], "unlike": 0, "allowed": False},
                }
            }
        ),
        "rx_nmea": _nmea(),
        "rx_ubx": b"".join(pvt(GPS + i) for i in range(8)),
        "rx_mixed": b"".join(pvt(GPS + i) for i in range(3)) + _nmea(),
        "rx_pos": _table("%  GPST latitude(deg) longitude(deg) height(m) Q ns", _POS),
        "rx_table": _table(
            "timestamp,latitude,longitude,altitude", "17000000{i:02},48.{i},11.5,500"
        ),
        "sensor_toml": sensor.read_bytes(),
        "settings_model_toml": b'[fuse]\neffects = ["gyro_bias"]\n',
        "signs_geojson": _json({"type": "FeatureCollection", "features": [_SIGN, _SIGN]}),
        "sync_json": _json(
            {**_CLOCK, "method": "x", "output_delay_s": None, "time_base": "boot_ns"}
        ),
        "trajectory_csv": _table(_STATE, "{t},1e9,48.{i},11.5,500,1,0,0,0,1,90"),
        "truth_trajectory": _table(_STATE, "{t},1e9,48.{i},11.5,500,1,0,0,0,1,90"),
    }
