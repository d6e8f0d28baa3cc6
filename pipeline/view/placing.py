"""Where a sign stands by the views that a reviewer chose, in one drive or in several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.errors import AutoMapError
from automap.records import (
    NO_TIME,
    Camera,
    Detections,
    FloatArray,
    PlacedSign,
    SeenIn,
    Sign,
    Trajectory,
)
from pipeline.view.drives import MapDrive

_CLICK_PX = 1.0
"""Half the side of the box that stands for a click."""


@dataclass(frozen=True)
class Part:
    """What of a sign one drive sees: ``rows`` of its boxes, and frames clicked in."""

    drive: MapDrive
    rows: tuple[int, ...] = ()
    clicks: tuple[SeenIn, ...] = ()


def placed(parts: Sequence[Part], class_name: str, gps_time: bool) -> PlacedSign:
    """The sign's place of all parts; ``gps_time`` whether the map's stamps are GPS time.

    ValueError says in a sentence why there is none.
    """
    found = [_as_placed(_located(part, class_name), part, gps_time) for part in parts]
    if not found:
        raise ValueError("it has no views whose recording is at hand")
    result = found[0]
    for other in found[1:]:
        result = joined(result, other, related=False)
    return result


def joined(a: PlacedSign, b: PlacedSign, related: bool = True) -> PlacedSign:
    """One sign of two places by their inverse covariances.

    Where they are ``related``, as those of one drive are, how closely is not known: half of each
    information is consistent whatever it is (covariance intersection, Julier and Uhlmann, American
    Control Conference, 1997).
    """
    share = 0.5 if related else 1.0
    info = [share * np.linalg.inv(_level(p)) for p in (a, b)]
    cov = np.linalg.inv(info[0] + info[1])
    offset = np.array(
        [
            (b.lon_deg - a.lon_deg) * np.cos(np.radians(a.lat_deg)),
            b.lat_deg - a.lat_deg,
        ]
    )
    step = cov @ info[1] @ offset
    larger = a if a.n_views >= b.n_views else b
    known = [t for t in (a.first_seen_ns, b.first_seen_ns) if t != NO_TIME]
    height, var_u = _mean((a.height_m, a.cov_m2[3]), (b.height_m, b.cov_m2[3]))
    return PlacedSign(
        lon_deg=a.lon_deg + float(step[0] / np.cos(np.radians(a.lat_deg))),
        lat_deg=a.lat_deg + float(step[1]),
        cov_m2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]), var_u),
        height_m=height,
        height_above_road_m=larger.height_above_road_m,
        sd_above_road_m=larger.sd_above_road_m,
        facing_deg=larger.facing_deg,
        facing_sd_deg=larger.facing_sd_deg,
        size_m=larger.size_m,
        side=larger.side,
        n_views=a.n_views + b.n_views,
        first_seen_ns=min(known, default=NO_TIME),
        last_seen_ns=max(a.last_seen_ns, b.last_seen_ns),
    )


def _level(place: PlacedSign) -> FloatArray:
    ee, en, nn, _ = place.cov_m2
    return np.array([[ee, en], [en, nn]])


def _mean(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Mean of two values by their variances, and the larger share's variance."""
    known = [p for p in (a, b) if np.isfinite(p).all() and p[1] > 0]
    if len(known) < 2:
        return known[0] if known else (float("nan"), float("nan"))
    weight = np.array([1.0 / p[1] for p in known])
    value = float(weight @ [p[0] for p in known] / weight.sum())
    return value, min(p[1] for p in known)


def _located(part: Part, class_name: str) -> Sign:
    from automap.geolocation.rules import GeolocationRules
    from automap.review.chosen_views import locate_chosen

    name = part.drive.name
    drive, trajectory = part.drive.load().drive, part.drive.trajectory
    if drive is None or trajectory is None:
        raise ValueError(f"the recording or the path of {name} is not at hand")
    cameras = drive.cameras()
    detections, clicked = _chosen(part, class_name, cameras, trajectory)
    vehicle = drive.manifest.vehicle
    rules = GeolocationRules(drive=name)
    if vehicle.imu_above_road_m is not None:
        rules = GeolocationRules(
            imu_above_road_m=vehicle.imu_above_road_m,
            imu_above_road_sd_m=vehicle.imu_above_road_sigma_m,
            drive=name,
        )
    try:
        return locate_chosen(
            *(trajectory, detections, cameras, _corrections(part.drive, cameras)),
            *(rules, clicked),
        )
    except AutoMapError as error:
        raise ValueError(str(error)) from error


def _chosen(
    part: Part, class_name: str, cameras: dict[str, Camera], trajectory: Trajectory
) -> tuple[list[Detections], Any]:
    """The views as detections, a record a camera, and which of them are clicks [n]."""
    boxes = part.drive.boxes
    rows: dict[str, list[tuple[int, int, FloatArray, str, float, bool]]] = {}
    for row in part.rows:
        assert boxes is not None
        rows.setdefault(boxes.camera[row], []).append(
            (int(boxes.frame[row]), int(boxes.t_ns[row]), boxes.box[row], boxes.class_name[row],
             float(boxes.score[row]), False)
        )  # fmt: skip
    for click in part.clicks:
        t_ns = part.drive.stamp_of(click.camera, click.frame)
        if t_ns is None:
            raise ValueError(f"the camera {click.camera} has no frame {click.frame}")
        x, y = click.x_px, click.y_px
        box = np.array([x - _CLICK_PX, y - _CLICK_PX, x + _CLICK_PX, y + _CLICK_PX])
        rows.setdefault(click.camera, []).append((click.frame, t_ns, box, class_name, 1.0, True))
    detections: list[Detections] = []
    clicked: list[bool] = []
    for camera, own in rows.items():
        if camera not in cameras:
            raise ValueError(f"the size of the pictures of {camera} is not known")
        frames, stamps, places, names, score, bare = zip(*own, strict=True)
        clicked += bare
        detections.append(
            Detections(
                frame=np.array(frames, np.int64),
                t_ns=np.array(stamps, np.int64),
                class_name=np.array(names, object),
                box=np.array(places, np.float64),
                score=np.array(score, np.float64),
                track=np.full(len(own), 1, np.int64),
                camera=camera,
            )
        )
    return detections, np.array(clicked, bool)


def _corrections(shown: MapDrive, cameras: dict[str, Camera]) -> dict[str, Any]:
    """What the run found out about the cameras, as its record says."""
    from automap.effects.lens import focal_length
    from automap.geolocation.boresight import prior_covariance
    from automap.geolocation.landmark_kernels import MARGIN, RADIAL
    from automap.geolocation.rules import GeolocationRules
    from automap.geolocation.views import CameraCorrection

    assert shown.out is not None
    found = {}
    for name, camera in cameras.items():
        told: Any = shown.metrics.get(f"camera_{name}")
        try:
            focal = focal_length(camera)
            covariance = prior_covariance(camera, GeolocationRules())
            sd = [*np.radians(told["boresight_rpy_sd_deg"]), told["time_offset_sd_s"]]
            sd += [told["focal_scale_sd"]]
            covariance[:5, :5] = np.diag(np.array(sd, np.float64) ** 2)
            covariance[MARGIN, MARGIN] = (told["box_margin_sd_px"] / focal) ** 2
            # runs of before took k1 as stated
            covariance[RADIAL, RADIAL] = told.get("k1_sd", camera.distortion_sd) ** 2
            found[name] = CameraCorrection(
                turn=np.radians(told["boresight_rpy_deg"]),
                time_s=float(told["time_offset_s"]),
                covariance=covariance,
                focal_log=float(np.log(told["focal_scale"])),
                margin=float(told["box_margin_px"]) / focal,
                radial=float(told.get("k1_added", 0.0)),
            )
        except (KeyError, TypeError, ValueError):
            continue
    return found


def _as_placed(sign: Sign, part: Part, gps_time: bool) -> PlacedSign:
    cov = sign.cov_enu
    first, last = sign.first_seen_ns, sign.last_seen_ns
    if gps_time:
        clock = part.drive.clock
        if clock is None:
            first = last = NO_TIME
        else:
            gps_s = clock.gps_s(np.array([first, last], np.int64))
            first, last = (round(float(seconds) * 1e9) for seconds in gps_s)
    return PlacedSign(
        lon_deg=float(np.degrees(sign.lon_rad)),
        lat_deg=float(np.degrees(sign.lat_rad)),
        cov_m2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1]), float(cov[2, 2])),
        height_m=sign.height_m,
        height_above_road_m=sign.height_above_road_m,
        sd_above_road_m=sign.sd_above_road_m,
        facing_deg=float(np.degrees(sign.facing_rad)) % 360.0,
        facing_sd_deg=float(np.degrees(sign.facing_sd_rad)),
        # a click has no size: that of the prior is none of the sign's
        size_m=sign.size_m if part.rows else float("nan"),
        side=sign.side,
        n_views=sign.n_views,
        first_seen_ns=first,
        last_seen_ns=last,
    )
