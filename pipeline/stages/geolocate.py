"""Stage geolocate: where the detected signs stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import InputError
from automap.io import names
from pipeline.stage import Stage, StageContext

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pyarrow as pa

    from automap.geolocation.locate import GeolocationResult
    from automap.geolocation.rules import GeolocationRules
    from automap.io.drive import Drive
    from automap.records import Camera, Detections, IntArray, Trajectory
    from pipeline.settings.geolocate import GeolocateSettings

_LISTED = 3


def run(context: StageContext) -> None:
    """Write signs_raw.parquet and observations.parquet; empty ones where there is nothing."""
    from automap.io.observations_table import read_detection_rows
    from automap.io.signs_table import write_signs

    if context.drive.bearings_file is not None:
        _locate_bearings(context, context.drive.bearings_file)
        return
    detections_file = context.out / names.DETECTIONS
    if not detections_file.is_file():
        context.warn("There are no detections, so the map has no signs.")
        write_signs(context.work / names.SIGNS_RAW, [])
        context.result = "no detections"
        return
    table, parts = read_detection_rows(detections_file)
    parts = _in_trajectory_time(context, parts)
    trajectory = _trajectory(context)
    cameras = context.drive.cameras()
    known = [part for part in parts if part[0].camera in cameras]
    for record, rows in parts:
        if record.camera not in cameras:
            context.warn(
                f"{len(rows)} detections of the camera {record.camera} were left out: the "
                "manifest has no such camera; add a section [video."
                f"{record.camera}] with its camera_matrix."
            )
    if trajectory is None or len(trajectory) < 2:
        if len(table):
            context.warn("Without a trajectory the detections cannot be placed on the map.")
        known = []
    if not known or trajectory is None:
        _write_nothing(context, table)
        return
    _locate(context, trajectory, table, known)


def _locate_bearings(context: StageContext, path: Path) -> None:
    """Signs of a drive that brings finished sightings in place of detections."""
    import numpy as np

    from automap.geolocation.bearings import BearingRules, locate_from_bearings
    from automap.io.bearings_csv import read_bearings
    from automap.io.signs_table import write_signs
    from automap.io.tables import write_columns

    bearings, sentences = read_bearings(path)
    for text in sentences:
        context.warn(text)
    if (context.out / names.DETECTIONS).is_file() and context.drive.videos:
        context.warn(f"{path} is used for the map; the detections in the video are not.")
    bearing_rules = BearingRules(single=context.settings.geolocate.single_sightings)
    signs, index = locate_from_bearings(bearings, bearing_rules, drive=context.drive.name)
    write_signs(context.work / names.SIGNS_RAW, signs)
    ids = np.array([sign.id for sign in signs] + [""], np.object_)
    columns = {
        "lat_deg": np.degrees(bearings.lat_rad),
        "lon_deg": np.degrees(bearings.lon_rad),
        "bearing_deg": np.degrees(bearings.bearing_rad),
        "depth_m": bearings.depth_m,
        "class": bearings.class_name.astype(str),
        "sign_id": ids[index].astype(str),
        "used": index >= 0,
    }
    write_columns(context.work / names.OBSERVATIONS, columns)
    unused = int((index < 0).sum())
    if unused:
        context.warn(f"{unused} of {len(bearings)} sightings meet no other and have no object.")
    alone = sum(sign.status == "single_view" for sign in signs)
    if alone:
        context.warn(f"{alone} of {len(signs)} objects rest on one sighting and its depth alone.")
    context.metric("detections", len(bearings))
    context.metric("detections_used", len(bearings) - unused)
    context.result = f"{len(signs)} signs from {len(bearings)} sightings"


def _trajectory(context: StageContext) -> Trajectory | None:
    from automap.io.trajectory_table import read_trajectory

    path = context.out / names.TRAJECTORY
    return read_trajectory(path) if path.is_file() else None


def _in_trajectory_time(
    context: StageContext, parts: list[tuple[Detections, IntArray]]
) -> list[tuple[Detections, IntArray]]:
    """The detections with stamps of the trajectory's clock; a camera whose clock nothing ties
    to it is left out, and said."""
    from automap.io.clock_json import read_clocks
    from automap.sync.stamps import in_trajectory_time

    path = context.out / names.SYNC
    if not path.is_file() or not (context.out / names.TRAJECTORY).is_file():
        return parts
    clocks = read_clocks(path)
    converted = []
    for record, rows in parts:
        video = context.drive.videos.get(record.camera)
        if video is None:
            converted.append((record, rows))
            continue
        try:
            t_ns = in_trajectory_time(record.t_ns, video.section.time, clocks)
        except InputError as error:
            context.warn(
                f"{context.drive.manifest_file}: [video.{record.camera}]: the {len(rows)} "
                f"detections of this camera cannot be placed: {error}."
            )
            continue
        converted.append((replace(record, t_ns=t_ns), rows))
    return converted


def rules_from(settings: GeolocateSettings, drive: str) -> GeolocationRules:
    """The library's rules from the stage's settings."""
    from automap.geolocation.assembly import AssemblyRules
    from automap.geolocation.boresight import CameraPriors
    from automap.geolocation.landmark import SizePrior
    from automap.geolocation.rules import GeolocationRules
    from automap.geolocation.tracking import TrackingRules
    from automap.geolocation.views import MeasurementNoise

    return GeolocationRules(
        noise=MeasurementNoise(pixel_sd=settings.pixel_sd, box_fraction=settings.box_fraction),
        size=SizePrior(size_m=settings.sign_size_m, log_sd=settings.sign_size_log_sd),
        tracking=TrackingRules(max_silence_s=settings.max_silence_s),
        assembly=AssemblyRules(imu_above_road_m=settings.imu_above_road_m, drive=drive),
        camera=CameraPriors(focal_sd=settings.focal_sd, lever_arm_sd_m=settings.lever_arm_sd_m),
        estimate_camera=settings.estimate_camera,
        min_existence=settings.min_existence,
        max_single_view_m=settings.max_single_view_m,
    )


def _locate(
    context: StageContext,
    trajectory: Trajectory,
    table: pa.Table,
    parts: list[tuple[Detections, IntArray]],
) -> None:
    import numpy as np

    from automap.geolocation.locate import locate_signs
    from automap.io.signs_table import write_signs

    settings = context.settings.geolocate
    cameras, records = _as_known(context.drive.cameras(), [r for r, _ in parts], settings.fixed)
    result = locate_signs(
        trajectory,
        records,
        cameras,
        rules_from(settings, context.drive.name),
        lambda fraction: context.progress(fraction, "linking detections"),
    )
    rows = np.concatenate([rows for _, rows in parts])
    signs = [
        replace(sign, detection_rows=np.sort(rows[sign.detection_rows])) for sign in result.signs
    ]
    write_signs(context.work / names.SIGNS_RAW, signs)
    _write_observations(context.work / names.OBSERVATIONS, table, parts, result)
    for text in result.warnings:
        context.warn(text)
    _report(context, result)


def _as_known(
    stated: Mapping[str, Camera],
    records: list[Detections],
    known: Mapping[str, Mapping[str, Mapping[str, float]]],
) -> tuple[dict[str, Camera], list[Detections]]:
    """Cameras as they are where their errors are known, and boxes at the instants of their rows."""
    from automap.effects.camera import row_delay_s, true_camera

    cameras = {n: true_camera(c, known[n]) if n in known else c for n, c in stated.items()}
    out = []
    for record in records:
        if "rolling_shutter" in known.get(record.camera, {}):
            rows = 0.5 * (record.box[:, 1] + record.box[:, 3])
            late = row_delay_s(rows, cameras[record.camera].height, known[record.camera])
            record = replace(record, t_ns=record.t_ns + (late * 1e9).astype(record.t_ns.dtype))
        out.append(record)
    return cameras, out


def _write_observations(
    path: Path,
    table: pa.Table,
    parts: list[tuple[Detections, IntArray]],
    result: GeolocationResult,
) -> None:
    import numpy as np

    from automap.io.observations_table import write_observations

    rows = np.concatenate([own for _, own in parts])

    def spread(values: npt.NDArray[Any], missing: Any) -> npt.NDArray[Any]:
        column: np.ndarray[Any, Any] = np.full(len(table), missing, values.dtype)
        column[rows] = values
        return column

    fate = result.observations
    t_ns = table["t_ns"].to_numpy().copy()
    for record, own in parts:
        t_ns[own] = record.t_ns
    results = {
        "t_ns": t_ns,
        "track": spread(fate.track, -1),
        "sign_id": spread(fate.sign_id, ""),
        "residual_x_px": spread(fate.residual_px[:, 0], np.nan),
        "residual_y_px": spread(fate.residual_px[:, 1], np.nan),
        "range_m": spread(fate.range_m, np.nan),
        "used": spread(fate.used, False),
        "note": spread(fate.note, "no_camera"),
    }
    write_observations(path, table, results)


def _write_nothing(context: StageContext, table: pa.Table) -> None:
    """No signs; every detection is still listed, unused."""
    import numpy as np

    from automap.io.observations_table import write_observations
    from automap.io.signs_table import write_signs

    n = len(table)
    unknown = np.full(n, np.nan)
    columns = {
        "track": np.full(n, -1, np.int64),
        "sign_id": np.full(n, "", np.object_),
        "residual_x_px": unknown,
        "residual_y_px": unknown,
        "range_m": unknown,
        "used": np.zeros(n, np.bool_),
        "note": np.full(n, "no_pose", np.object_),
    }
    write_observations(context.work / names.OBSERVATIONS, table, columns)
    write_signs(context.work / names.SIGNS_RAW, [])
    context.metric("detections", n)
    context.metric("detections_used", 0)
    context.result = f"0 signs from {n} detections"


def _report(context: StageContext, result: GeolocationResult) -> None:
    import numpy as np

    signs, fate = result.signs, result.observations
    context.metric("detections", len(fate.used))
    context.metric("detections_used", int(fate.used.sum()))
    statuses = sorted({s.status for s in signs})
    context.metric("sign_status", {k: sum(s.status == k for s in signs) for k in statuses})
    for name, found in result.corrections.items():
        sd = np.sqrt(np.diag(found.covariance))
        context.metric(
            f"camera_{name}",
            {
                "boresight_rpy_deg": np.degrees(found.turn).tolist(),
                "boresight_rpy_sd_deg": np.degrees(sd[:3]).tolist(),
                "time_offset_s": found.time_s,
                "time_offset_sd_s": float(sd[3]),
                "focal_scale": float(np.exp(found.focal_log)),
                "focal_scale_sd": float(sd[4]),
            },
        )
    context.result = f"{len(signs)} signs from {len(fate.used)} detections"
    if signs:
        sd = np.sqrt([0.5 * (s.cov_enu[0, 0] + s.cov_enu[1, 1]) for s in signs])
        context.result += f", median sd {float(np.median(sd)):.1f} m"
        residual = fate.residual_px[fate.used]
        if len(residual):
            context.metric("residual_rms_px", float(np.sqrt(np.mean(residual**2))))
    flagged = [s for s in signs if s.status != "ok"]
    if flagged:
        some = ", ".join(f"{s.id} {s.status}" for s in flagged[:_LISTED])
        more = f" and {len(flagged) - _LISTED} more" if len(flagged) > _LISTED else ""
        context.warn(f"{len(flagged)} of {len(signs)} signs are placed uncertainly: {some}{more}.")


def _inputs(drive: Drive) -> list[Path]:
    return [] if drive.bearings_file is None else [drive.bearings_file]


STAGE = Stage(
    name="geolocate",
    version=3,
    run=run,
    inputs=_inputs,
    needs=(names.TRAJECTORY, names.DETECTIONS, names.SYNC),
    # the adjusted trajectory is written by a geolocation that moves the vehicle as well
    outputs=(names.SIGNS_RAW, names.OBSERVATIONS, names.TRAJECTORY_ADJUSTED),
    settings=("geolocate",),
    manifest=("name", "video"),
)
