"""Stage geolocate: where the detected signs stand."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import InputError
from automap.io import names
from automap.io.trust import check_inside
from pipeline.run.geolocate_output import report_result, write_nothing, write_observations_of
from pipeline.run.stage import Stage, StageContext

if TYPE_CHECKING:
    import pyarrow as pa

    from automap.effects.path_signals import PathSignals
    from automap.geolocation.rules import GeolocationRules
    from automap.io.drive import Drive
    from automap.io.manifest import VehicleSection
    from automap.records import (
        Camera,
        Detections,
        IntArray,
        PictureTurns,
        SignPoints,
        Trajectory,
    )
    from pipeline.settings.geolocate import GeolocateSettings


def run(context: StageContext) -> None:
    """Write signs_raw.parquet and observations.parquet; empty ones where there is nothing."""
    from automap.io.observations_table import read_detection_rows
    from automap.io.searched_table import read_searched
    from automap.io.signs_table import write_signs

    if context.drive.bearings_file is not None:
        _locate_bearings(context, context.drive.bearings_file)
        return
    for text in context.drive.camera_warnings():
        context.warn(text)
    detections_file = context.out / names.DETECTIONS
    if not detections_file.is_file():
        context.warn("There are no detections, so the map has no signs.")
        write_signs(context.work / names.SIGNS_RAW, [])
        context.result = "no detections"
        return
    table, parts = read_detection_rows(detections_file)
    searched = context.out / names.SEARCHED
    looked = read_searched(searched) if searched.is_file() else {}
    parts = [(replace(record, looked=looked.get(record.camera)), rows) for record, rows in parts]
    turns = _turns(context)
    cameras, parts = _as_turned(context.drive.cameras(), parts, turns)
    parts = _in_trajectory_time(context, parts)
    trajectory = _trajectory(context)
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
        write_nothing(context, table)
        return
    known = _as_pictured(trajectory, known, cameras, turns)
    _locate(context, trajectory, table, known, _dated(cameras, context.out / names.FUSION))


def _dated(cameras: dict[str, Camera], fused: Path) -> dict[str, Camera]:
    """The cameras with their stamps as unsure against the path as against its clock and, where
    nobody knows how old the fixes are that date it, as that; ``fused`` tells it."""
    age_sd = json.loads(fused.read_text()).get("age_sd_s", 0.0) if fused.is_file() else 0.0
    return {
        name: replace(camera, time_offset_sd=math.hypot(camera.time_offset_sd, age_sd))
        for name, camera in cameras.items()
    }


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


def _turns(context: StageContext) -> dict[str, PictureTurns]:
    """What the bends of the videos contradict, by camera."""
    from automap.io.camera_turns import read_camera_turns

    file = context.out / names.CAMERA_TURNS
    turns = read_camera_turns(file) if file.is_file() else {}
    return {name: one for name, one in turns.items() if not one.as_stated}


def _as_turned(
    cameras: Mapping[str, Camera],
    parts: list[tuple[Detections, IntArray]],
    turns: Mapping[str, PictureTurns],
) -> tuple[dict[str, Camera], list[tuple[Detections, IntArray]]]:
    """Boxes with stamps as the bends say, and cameras whose offset is as unsure as that."""
    return {
        n: replace(c, time_offset_sd=turns[n].offset_sd_s) if n in turns else c
        for n, c in cameras.items()
    }, [
        (replace(r, t_ns=turns[r.camera].corrected(r.t_ns)) if r.camera in turns else r, rows)
        for r, rows in parts
    ]


def _as_pictured(
    trajectory: Trajectory,
    parts: list[tuple[Detections, IntArray]],
    cameras: Mapping[str, Camera],
    turns: Mapping[str, PictureTurns],
) -> list[tuple[Detections, IntArray]]:
    """Boxes as they are in the picture that the bends show."""
    from automap.geolocation.camera_hypotheses import in_picture

    return [
        (in_picture(trajectory, r, cameras[r.camera], turns[r.camera].pictures), rows)
        if r.camera in turns
        else (r, rows)
        for r, rows in parts
    ]


def rules_from(
    settings: GeolocateSettings, drive: str, vehicle: VehicleSection | None = None
) -> GeolocationRules:
    """The library's rules from the stage's settings and what the manifest says of the vehicle."""
    from automap.geolocation.landmark import SizePrior
    from automap.geolocation.rules import GeolocationRules
    from automap.geolocation.views import MeasurementNoise

    rules = GeolocationRules(
        noise=MeasurementNoise(
            pixel_sd=settings.pixel_sd,
            box_fraction=settings.box_fraction,
            margin_sd_px=settings.box_margin_sd_px,
        ),
        size=SizePrior(size_m=settings.sign_size_m, log_sd=settings.sign_size_log_sd),
        max_silence_s=settings.max_silence_s,
        focal_sd=settings.focal_sd,
        camera_margin_sd_px=settings.box_margin_sd_px,
        estimate_camera=settings.estimate_camera,
        estimate_noise=settings.estimate_noise,
        adjust_trajectory=settings.adjust_trajectory,
        min_existence=settings.min_existence,
        max_single_view_m=settings.max_single_view_m,
        drive=drive,
    )
    if vehicle is None or vehicle.imu_above_road_m is None:
        return rules
    return replace(
        rules,
        imu_above_road_m=vehicle.imu_above_road_m,
        imu_above_road_sd_m=vehicle.imu_above_road_sigma_m,
    )


def _locate(
    context: StageContext,
    trajectory: Trajectory,
    table: pa.Table,
    parts: list[tuple[Detections, IntArray]],
    stated: Mapping[str, Camera],
) -> None:
    import numpy as np

    from automap.geolocation import limits
    from automap.geolocation.locate import locate_signs
    from automap.io.signs_table import write_signs
    from automap.io.trajectory_table import write_trajectory
    from pipeline.settings.user_effects import activate
    from pipeline.shared.freed import give_freed_back

    give_freed_back()
    settings = context.settings.geolocate
    activate(context.settings.effects)
    path = path_quantities(context.out, trajectory)
    cameras, records = as_known(stated, [r for r, _ in parts], settings.fixed, path)
    result = locate_signs(
        trajectory,
        records,
        cameras,
        rules_from(settings, context.drive.name, context.drive.vehicle),
        lambda fraction: context.progress(fraction, "linking detections"),
        _control_signs(context.drive),
    )
    rows = np.concatenate([rows for _, rows in parts])
    signs = [
        replace(sign, detection_rows=np.sort(rows[sign.detection_rows])) for sign in result.signs
    ]
    write_signs(context.work / names.SIGNS_RAW, signs)
    if signs and context.drive.vehicle.imu_above_road_m is None:
        context.warn(
            "Nobody says how high the IMU is above the road; the signs' heights above it assume "
            f"{limits.IMU_ABOVE_ROAD_M:.1f} m, give or take {limits.IMU_ABOVE_ROAD_SD_M:.1f} m. "
            "Measure it and write imu_above_road_m under [vehicle] in "
            f"{context.drive.manifest_file}."
        )
    if result.adjusted is not None:
        write_trajectory(context.work / names.TRAJECTORY_ADJUSTED, result.adjusted.pieces())
    write_observations_of(context.work / names.OBSERVATIONS, table, parts, result)
    for text in result.warnings:
        context.warn(text)
    report_result(context, result)


def as_known(
    stated: Mapping[str, Camera],
    records: list[Detections],
    known: Mapping[str, Mapping[str, Mapping[str, float]]],
    path: PathSignals | None,
) -> tuple[dict[str, Camera], list[Detections]]:
    """Cameras as they are where their errors are known, and boxes without those errors that
    change from box to box."""
    from automap.effects.camera import as_stated, true_camera

    cameras = {n: true_camera(c, known[n]) if n in known else c for n, c in stated.items()}
    return cameras, [
        as_stated(r, cameras[r.camera], known[r.camera], path) if r.camera in known else r
        for r in records
    ]


def path_quantities(out: Path, trajectory: Trajectory) -> PathSignals | None:
    """The quantities of the drive where users' effects of a camera need them."""
    from automap.effects.camera_user import depends_on_the_drive
    from automap.effects.path_signals import path_signals
    from automap.io.tables import read_imu

    if not depends_on_the_drive():
        return None
    file = out / names.IMU
    return path_signals(trajectory, read_imu(file) if file.is_file() else None)


def _control_signs(drive: Drive) -> SignPoints | None:
    """The surveyed signs of a drive folder."""
    from automap.io.sign_points import read_sign_points

    path = _control_file(drive)
    return None if path is None else read_sign_points(path)


def _control_file(drive: Drive) -> Path | None:
    path = drive.path / names.CONTROL_SIGNS
    if not path.is_file():
        return None
    check_inside(path, drive.path, str(drive.path))
    return path


def _inputs(drive: Drive) -> list[Path]:
    return [path for path in (drive.bearings_file, _control_file(drive)) if path is not None]


STAGE = Stage(
    name="geolocate",
    # 15: contrast of the faces, how often they were seen, backs
    # 21: stamps and pictures as the bends of the videos say, existence by frames that are due,
    # a nose off its course
    # 26: of two mirror images of a face the likelier is stated; boxes too narrow to be found
    # 29: pieces of a track are joined as passes are, times are searched among many signs too
    # 35: what stays at its place in the picture is left out
    # 36: and what is followed for longer than signs are in sight
    # 37: a sign is sought from distances by its size alone
    # 42: stamps of a camera are unsure against a path that is dated by fixes of unknown age
    # 43: residuals and ranges of boxes are against signs where their views see them from
    # 44: passes of a drive are associated as drives of a map are
    # 45: k1 of lenses; a focal length that nobody states
    # 49: tracks are held against all of the path
    # 51: time offsets that explain the boxes alike are told by tracks along the path
    version=53,
    run=run,
    inputs=_inputs,
    needs=(
        *(names.TRAJECTORY, names.DETECTIONS, names.SEARCHED, names.CAMERA_TURNS),
        *(names.SYNC, names.IMU, names.FUSION),
    ),
    # the adjusted trajectory is written where signs seen again or surveyed ones move the vehicle
    outputs=(names.SIGNS_RAW, names.OBSERVATIONS, names.TRAJECTORY_ADJUSTED),
    settings=("effects", "geolocate"),
    setting_files=lambda settings: settings.effects.paths(),
    manifest=("name", "video", "vehicle"),
)
