"""Whole small files of formats that others write, and of what AutoMap reads back."""

from __future__ import annotations

import io
import json
import shutil
import struct
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from tests.fuzz.places import FLEET, MERGED, RESULTS, as_cells, fleet, merged, results

_LINE = [[8.46, 48.975], [8.47, 48.975], [8.48, 48.976]]
_CAMERA = b"""image_width: 640
image_height: 480
distortion_model: plumb_bob
camera_matrix:
  rows: 3
  cols: 3
  data: [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
distortion_coefficients:
  data: [0.1, -0.05, 0.001, 0.0, 0.0]
"""
_EUROC = b"""T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.1,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
intrinsics: [458.6, 457.3, 31.5, 23.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
"""
_OXTS = "48.9 8.4 112.0 0.02 -0.03 0.7 7 7 10 0 0.1 0 0 9.8 0 0 9.8 0 0 0 0 0 0 0.05 0.02 4 9 6 6 0"


def _get(path: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nConnection: close\r\n\r\n".encode()


def _post(path: str, body: object) -> bytes:
    data = json.dumps(body).encode()
    head = f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Type: application/json\r\n"
    return f"{head}Connection: close\r\nContent-Length: {len(data)}\r\n\r\n".encode() + data


_CLICK = {"drive": 0, "camera": "front", "frame": 3, "x": 300.0, "y": 200.0}
_REQUESTS = {
    "request_page": _get("/?token=TOKEN"),
    "request_sign": _get("/TOKEN/api/sign/0"),
    "request_review": _get("/TOKEN/api/review?known=0"),
    "request_drive": _get("/TOKEN/api/drive/0"),
    "request_frame": _get("/TOKEN/frame/0/3/front"),
    "request_boxes": _get("/TOKEN/api/boxes/0/3/front"),
    "request_file": _get("/TOKEN/out/signs.geojson"),
    "request_face": _get("/TOKEN/face/stop"),
    "request_accept": _post("/TOKEN/api/review", {"row": 0, "kind": "accept", "note": "n"}),
    "request_correct": _post(
        "/TOKEN/api/review",
        {"row": 1, "kind": "correct", "class_name": "stop", "facing_deg": 9.5, "height_m": 2.5},
    ),
    "request_move": _post(
        "/TOKEN/api/review", {"row": 1, "kind": "move", "lon_deg": 8.47, "lat_deg": 48.97}
    ),
    "request_add": _post(
        "/TOKEN/api/review",
        {"kind": "add", "class_name": "stop", "lon_deg": 8.47, "lat_deg": 48.97, "sd_m": 2.0},
    ),
    "request_merge": _post("/TOKEN/api/review", {"row": 0, "kind": "merge", "other": 1}),
    "request_split": _post("/TOKEN/api/review", {"row": 0, "kind": "split", "drives": ["demo"]}),
    "request_place": _post("/TOKEN/api/place", {"views": [_CLICK, {**_CLICK, "frame": 9}]}),
}


def _layers(folder: Path) -> dict[str, bytes]:
    import pyogrio.raw
    import shapely

    from tests.unit.test_roads import OSM, osm_pbf

    made = {"layer_osm": OSM.encode(), "layer_pbf": osm_pbf()}
    line = np.array([shapely.to_wkb(shapely.linestrings(_LINE))] * 2, object)
    names, driver = ["road_id", "from_m"], {"geojson": "GeoJSON", "gpkg": "GPKG"}
    for form, kind in driver.items():
        path = folder / f"layer.{form}"
        fields = [np.array(["A1", "A2"], object), np.array([1250.0, 10.0])]
        pyogrio.raw.write(
            path, geometry=line, field_data=fields, fields=names, driver=kind,
            geometry_type="LineString", crs="EPSG:4326",
        )  # fmt: skip
        made[f"layer_{form}"] = path.read_bytes()
    made["layer_csv"] = b"id,class,lat,lon,facing\n" + b"".join(
        b"K%d,stop,48.97%d,8.47%d,%d\n" % (k, k, k, 10 * k) for k in range(8)
    )
    made["layer_parquet"] = _geoparquet(folder / "layer.parquet")
    return made


def _geoparquet(path: Path) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq
    import shapely

    column = {"encoding": "WKB", "geometry_types": ["LineString"]}
    geo = {"version": "1.1.0", "primary_column": "geometry", "columns": {"geometry": column}}
    table = pa.table(
        {"road_id": ["A1", "A2"], "geometry": [shapely.to_wkb(shapely.linestrings(_LINE))] * 2}
    )
    pq.write_table(table.replace_schema_metadata({"geo": json.dumps(geo)}), path)
    return path.read_bytes()


def _bags(folder: Path) -> dict[str, bytes]:
    from tests.unit import import_bags

    kept = {name: getattr(import_bags, name) for name in ("IMU_NS", "FIX_NS", "IMAGE_NS")}
    try:
        # a bag of some 30 KB
        for name, count in (("IMU_NS", 60), ("FIX_NS", 8), ("IMAGE_NS", 2)):
            setattr(import_bags, name, kept[name][:count])
        plain = import_bags.write_bag(folder / "a.bag", ros2=False, ublox=True)
        own = import_bags.write_own_bag(folder / "b.bag")
        two = import_bags.write_bag(folder / "two", ros2=True)
    finally:
        for name, value in kept.items():
            setattr(import_bags, name, value)
    (mcap,) = two.rglob("*.mcap")
    return {
        "bag_ros1": plain.read_bytes(),
        "bag_own": own.read_bytes(),
        "bag_mcap": mcap.read_bytes(),
    }


def _videos(folder: Path) -> dict[str, bytes]:
    from tests.unit.test_inputs_video import _MILLISECONDS, _make

    data = _make(folder / "front.mp4", _MILLISECONDS).read_bytes()
    return {"video_mp4": data}


def _backgrounds(folder: Path) -> dict[str, bytes]:
    from tests.unit import backgrounds

    made = {
        "below_mbtiles": backgrounds.write_mbtiles(folder / "a.mbtiles", range(13, 15)),
        "below_pmtiles": backgrounds.write_pmtiles(folder / "a.pmtiles", range(13, 15)),
        "below_tiff": backgrounds.write_geotiff(folder / "a.tif", px=100),
        "below_gpkg": backgrounds.write_geopackage(folder / "a.gpkg", zooms=1),
    }
    return {name: path.read_bytes() for name, path in made.items()}


def _read_back(folder: Path) -> dict[str, bytes]:
    from pipeline.regress.baseline import write_baseline
    from tests.unit.test_regress_figures import record

    made: dict[str, bytes] = {}
    write_baseline(folder / "baseline", {"d0": record()})
    made["baseline_json"] = (folder / "baseline").read_bytes()
    out = results()
    for part, name in RESULTS.items():
        path = out / name
        if name.endswith(".parquet"):
            made[f"results_{part}_parquet"] = path.read_bytes()
            made[f"results_{part}_cells"] = as_cells(path)
        elif path.exists():
            made[f"results_{part}"] = path.read_bytes()
    for part, name in MERGED.items():
        path = merged() / name
        if name.endswith(".parquet"):
            made[f"merged_{part}_parquet"] = path.read_bytes()
            made[f"merged_{part}_cells"] = as_cells(path)
        else:
            made[f"merged_{part}"] = path.read_bytes()
    for part, name in FLEET.items():
        path = fleet() / name
        made[f"fleet_{part}"] = (
            path.read_bytes() if path.exists() else b'{"error": "no fix", "kind": "input"}'
        )
    return made


@cache
def more_seeds() -> dict[str, bytes]:
    """A file for each of these harnesses."""
    array = io.BytesIO()
    np.save(array, np.arange(40) * 0.1 + 9.0)
    tag = b"TIMETAG RTKLIB EX".ljust(60, b"\0") + struct.pack("<IId", 1000, 1_700_000_000, 0.25)
    tag += b"".join(struct.pack("<II", 5 + 10 * k, 60 * (k + 1)) for k in range(20))
    pos = "2024/01/01 10:00:{i:02}.000 48.1{i:02} 11.5 500.0 1 9 0.01 0.01 0.02 0 0 0 0.0 2.0"
    head = "%  GPST latitude(deg) longitude(deg) height(m) Q ns"
    folder = Path(tempfile.mkdtemp(prefix="seeds"))
    try:
        return {
            **_bags(folder),
            **_videos(folder),
            **_layers(folder),
            **_backgrounds(folder),
            **_read_back(folder),
            **_REQUESTS,
            "arrival_csv": b"offset,t_ns\n"
            + b"".join(b"%d,%d\n" % (9 * k, 10**9 + 10**8 * k) for k in range(20)),
            "fix_errors_csv": b"t_s,north_m,east_m,down_m,along_m_s\n"
            + b"".join(b"%d,0.%d,1,2,0.1\n" % (k, k) for k in range(9)),
            "finished_pos": "\n".join([head, *(pos.format(i=i) for i in range(12)), ""]).encode(),
            "time_tag": tag,
            "camera_yaml": _CAMERA,
            "comma_array": array.getvalue(),
            "kitti_row": _OXTS.encode(),
            "euroc_yaml": _EUROC,
            "digests_json": json.dumps({"/x/y": [[1, 2, 3, 4], "ab"]}).encode(),
        }
    finally:
        shutil.rmtree(folder, ignore_errors=True)
