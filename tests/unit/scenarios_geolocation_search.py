"""Cameras, links, stamps and existence, on a drive where no two numbers are alike."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from automap.records import NO_TIME, Detections
from tests.unit.figure_levels import levelled
from tests.unit.geolocation_drive import CLASSES, CORRECTIONS, NOISE, PRIOR, rich_drive
from tests.unit.scenarios import scenario
from tests.unit.scenarios_geolocation import _landmarks, _settled

ORIGIN = (-0.6161, 2.6023, 571.0)


def _some(found: Detections, rows: Any) -> Detections:
    arrays = {n: v[rows] for n, v in vars(found).items() if isinstance(v, np.ndarray)}
    return replace(found, **arrays)


def _two(pairs: np.ndarray) -> dict[str, np.ndarray]:
    return {"first": pairs[0], "second": pairs[1]}


@scenario
def geolocation_epipolar() -> Any:
    """Pairs of boxes, their planes, and the camera's turn and offset by them."""
    from automap.geolocation import epipolar, limits

    drive, rng = rich_drive(), np.random.default_rng(1)
    shuffled = _some(drive.detections[1], rng.permutation(len(drive.detections[1])))
    found: dict[str, Any] = {}
    for record in (drive.detections[0], shuffled):
        camera = replace(
            drive.cameras[record.camera], mount_sd=0.03, time_offset_sd=0.09, time_offset_s=0.02
        )
        geometry = epipolar.pair_geometry(drive.path, record, camera, ORIGIN)
        fast = geometry.paced(0.003)
        x = np.array([0.006, -0.004, 0.009, 0.031])
        prior = np.array([0.02, 0.03, 0.01, 0.05])
        found[record.camera] = {
            "pairs": (_two(geometry.pairs), len(geometry), geometry.n_boxes),
            "thinned": _two(geometry.thinned(30).pairs),
            "residuals": [g.residuals(at) for g in (geometry, fast) for at in (x, 0.0 * x)],
            "rays": fast.rays(x),
            "descend": [epipolar.descend(0.3 * x, g, prior, 0.01) for g in (geometry, fast)],
            "first": epipolar.first_correction(drive.path, record, camera, ORIGIN, 2.5e-3),
        }
    few = _some(drive.detections[0], np.arange(3))
    found["few"] = epipolar.first_correction(drive.path, few, camera, ORIGIN, 1e-3) is None
    t_ns = np.sort(rng.integers(0, 6 * 10**9, 24)).astype(np.int64)
    t_ns[5] = t_ns[4]
    names = np.array([CLASSES[k % 2] for k in range(24)], object)
    track = np.where(np.arange(24) % 5 == 0, -1, np.arange(24) % 3)
    heights = 0.4 * limits.PAIR_LOG_GROWTH * rng.normal(size=24)
    found["candidates"] = [
        _two(epipolar.candidate_pairs(t_ns[:n], names[:n], heights[:n], track[:n])) for n in (24, 0)
    ]
    return levelled(found)


@scenario
def geolocation_hypotheses() -> Any:
    """Cameras and boxes as they would be, how they are judged, and what is said of them."""
    from automap.effects.lens import focal_length
    from automap.geolocation import camera_doubt
    from automap.geolocation import camera_hypotheses as of
    from automap.geolocation.camera_explanation import Trial
    from automap.geolocation.epipolar import pair_geometry
    from automap.geolocation.rules import GeolocationRules

    drive = rich_drive()
    record, camera = drive.detections[0], drive.cameras["front"]
    plain = of.Hypothesis("", _some(record, np.arange(9, 24)), camera)
    families = (of._pictures, of._mountings, of._calibrations)
    geometry = pair_geometry(drive.path, record, camera, ORIGIN)
    more = 1111.0 / focal_length(camera)
    matrix = camera.matrix * [[more], [more], [1.0]]
    stated = replace(plain, camera=replace(camera, matrix=matrix))
    judge = of._Judge(drive.path, ORIGIN, stated, np.zeros(len(record), bool))
    none = [np.full(len(one), "", object) for one in drive.detections]
    trial = Trial(drive.detections, drive.cameras, GeolocationRules(), none)
    assumed = trial.assuming("left", replace(plain, camera=drive.cameras["front"]), drive.path)
    x = np.array([0.003, -0.002, 0.005, 0.02])
    statuses = ["ok"] * 6 + ["far", "single_view", "weak_geometry", "far", "doubtful"]
    signs = [_sign(k, status) for k, status in enumerate(statuses)]
    notes = np.array(
        ["", "misfit", "no_pose", "", "no_place", "back", "", "unconfirmed"] * 6, object
    )
    used = notes == ""
    return levelled(
        {
            "tried": [
                (one.what, one.found.box, one.camera.mount_rpy, one.camera.matrix)
                for family in families
                for one in family(plain)
            ],
            "late": vars(of._shifted(plain, 1.37)),
            "fast": vars(of._paced(plain, -0.021)),
            "best": of._best_in_time(0.25, 0.004, lambda v, scale: (v - 0.0123) ** 2 + scale * v),
            "loss": [of.mean_loss(geometry, at, s) for at in (x, 40.0 * x) for s in (0.01, 0.1)],
            "scale": judge.scale(plain, 0.01),
            "judged": judge.loss(of.Hypothesis("", record, camera)),
            "few": replace(judge, out=np.arange(len(record)) > 2).loss(
                of.Hypothesis("", record, camera)
            ),
            "unknown": camera_doubt.as_unknown(camera),
            "beyond": [
                camera_doubt.beyond_stated(replace(CORRECTIONS["front"], **change), camera, 0.004)
                for change in (
                    {"turn": np.array([0.0, k * 0.01, 0.0]), "time_s": t, "focal_log": f}
                    for k, t, f in (
                        (0, 0.001, 0.001),
                        (3, 0.0, 0.0),
                        (0, -0.2, 0.0),
                        (0, 0.0, 0.06),
                    )
                )
            ],
            "misfit": [
                camera_doubt.misfit(u, notes, s)
                for u, s in (
                    (used, signs),
                    (used, signs[:6]),
                    (used | True, signs),
                    (used | True, signs[:8]),
                )
            ],
            "doubtful": camera_doubt.doubtful(signs[3], 7.5),
            "assumed": (
                assumed.cameras["left"].matrix,
                assumed.cameras["left"].focal_sd,
                assumed.cameras["left"].distortion_sd,
            ),
            "rows": [trial.rows(name)[[0, -1]] for name in ("front", "left")],
        }
    )


def _sign(number: int, status: str) -> Any:
    from automap.records import Sign

    root = np.random.default_rng(number).normal(size=(3, 3))
    return Sign(
        id=f"s{number}",
        class_name=CLASSES[number % 4],
        lat_rad=-0.61,
        lon_rad=2.6,
        height_m=4.0,
        cov_enu=root @ root.T,
        confidence=0.7,
        n_views=5,
        first_seen_ns=NO_TIME,
        last_seen_ns=NO_TIME,
        height_above_road_m=2.0,
        facing_rad=1.0,
        facing_sd_rad=0.1,
        size_m=0.7,
        side="left",
        status=status,
    )


@scenario
def geolocation_existence() -> Any:
    """Frames that were looked at, what should have been seen in them, and what moves along."""
    from automap.geolocation import due_frames, existence
    from automap.geolocation.carriers import carried_views, moves_along

    drive = rich_drive()
    views = drive.views()
    rng = np.random.default_rng(8)
    marks = _landmarks(views)
    # some were seen once or twice
    marks = [
        *marks[4:16],
        *(
            _few(views, mark.rows[k : k + n])
            for mark, k, n in zip(
                marks[:9], (2, 3, 4, 5, 6, 1, 2, 7, 3), (1, 2, 1, 3, 1, 1, 2, 1, 1), strict=True
            )
        ),
    ]
    searched = {
        d.camera: due_frames.searched_frames(d, drive.cameras[d.camera]) for d in drive.detections
    }
    holes = _some(drive.detections[1], np.r_[0:40, 70:110:3])
    usual = due_frames.usual_heights(views, marks)
    patterns = due_frames.patterns_of(views, marks, drive.path, drive.detections, drive.cameras)
    mark = marks[2]
    times = (drive.path.t_ns[::40] + 3_000_000).astype(np.int64)
    late = round(drive.cameras["front"].time_offset_s * 1e9)
    region = np.tile([200.0, 150.0, 900.0, 600.0], (len(times), 1))
    carried = replace(
        views,
        centre=views.centre + np.array([3.0, 2.0, 0.0]) * (views.t_ns[:, None] * 1e-9 - 1e3),
    )
    tracked = [np.flatnonzero((views.track == k) & (views.camera == 0)) for k in (1, 4, 10, 11)]
    lorry = replace(views, measured=views.measured.copy())
    lorry.measured[tracked[0]] = views.measured[tracked[0][4]] + rng.normal(
        0.0, 0.003, (len(tracked[0]), 3)
    )
    return levelled(
        {
            "searched": [
                {name: each for name, each in vars(s).items() if name != "camera"}
                for s in (
                    *searched.values(),
                    due_frames.searched_frames(holes, drive.cameras[holes.camera]),
                )
            ],
            "usual": usual,
            "due": [
                due_frames.due_frames(views, m, drive.path, searched["front"], 0.02)
                for m in marks[:12:3]
            ],
            "heights": [
                due_frames.apparent_heights(
                    views,
                    replace(mark, parameters=np.array([*mark.parameters[:3], np.log(0.8)])),
                    drive.path,
                    due_frames.Searched(drive.cameras["front"], times, times + late, part),
                    slice(None),
                )
                for part in (np.tile([0.0, 0.0, 1279.0, 719.0], (len(times), 1)), region)
            ],
            "exist": existence.existence_odds(patterns, [p.score for p in patterns]),
            "base": [
                existence.expected_log_odds(rng.normal(m, 2.0, n), np.ones(n), (2.0, 2.0))
                for m, n in ((-1.0, 7), (1.5, 12))
            ],
            "patterns": [vars(p) for p in patterns],
            "carried": [carried_views(v, PRIOR) for v in (views, carried, lorry)],
            "moves": [moves_along(v, r, PRIOR) for v in (views, lorry) for r in tracked],
        }
    )


def _few(views: Any, rows: Any) -> Any:
    from automap.geolocation.landmark import fit_landmark

    return fit_landmark(views, rows, PRIOR)


@scenario
def geolocation_stamps() -> Any:
    """How far stamps err by the scatter of boxes, its likelihood, and whose boxes are asked."""
    from automap.geolocation import stamp_scatter as of

    drive, rng = rich_drive(), np.random.default_rng(6)
    late = [
        replace(d, t_ns=d.t_ns + np.rint(rng.normal(0.0, 4e7, len(d))).astype(np.int64))
        for d in drive.detections
    ]
    off = replace(drive, detections=late)
    views = off.views()

    marks = _landmarks(views, (1, 5, 8, 9))
    signs = [of.residuals_of(views, m, PRIOR) for m in marks]
    own = np.array([0.9, 1.4, 0.6])
    some = replace(views, track=np.where(views.track % 2 == 0, views.track, -1))
    groups = of.tracked_or_linked(views, [])
    return levelled(
        {
            "signs": signs,
            "deviance": [of.deviance(signs, own, sd) for sd in (0.0, 0.01, 0.05)],
            "scatter": of.stamp_scatter(views, groups[:6], PRIOR),
            "groups": (groups, of.tracked_or_linked(some, _landmarks(views, range(6)))),
            "told": [
                of.told(sd, [np.arange(0, 10**9, 10**8), np.array([5])]) for sd in (0.028, 0.03)
            ],
        }
    )


@scenario
def geolocation_links() -> Any:
    """Boxes linked over the frames, tracks cleaned and joined, and what that is decided by."""
    from automap.geolocation import splitting, tracking

    drive, rng = rich_drive(), np.random.default_rng(9)
    views = drive.views()
    loose = replace(views, track=np.full(len(views), -1))
    few = np.sort(rng.choice(len(views), 110, replace=False))
    tracks = tracking.link_views(views, PRIOR, 6.0)
    mixed = [np.unique(np.r_[a, b[:2]]) for a, b in pairwise(tracks[2:10])]
    stray = replace(views, measured=views.measured.copy())
    stray.measured[[60, 131, 202, 203]] += [0.11, -0.08, 0.2]
    marks, misfits = splitting.clean_tracks(stray, mixed, PRIOR, 6.0)
    long = [rows for rows in tracks if len(rows) > 7]
    pieces = [part for rows in long for part in (rows[:3], rows[3:])]
    active = [tracking._Track(list(rows), _few(views, rows), int(rows[0])) for rows in pieces]
    for track in active:
        for row in track.rows:
            track.add(views, row)
    frame = np.flatnonzero(views.frame == views.frame[long[2][4]])
    steps: list[float] = []
    return levelled(
        {
            "linked": tracks,
            "untold": tracking.link_views(loose, PRIOR, 6.0, few, steps.append),
            "steps": np.array(steps),
            "cleaned": [m.rows for m in marks],
            "misfits": misfits,
            "costs": tracking._link_costs(views, active, frame),
            "scores": [track.class_score for track in active],
        }
    )


@scenario
def geolocation_hand() -> Any:
    """Signs of chosen views, what became of every box, and the sentences on it."""
    from automap.geolocation import result as of
    from automap.geolocation.rules import GeolocationRules
    from automap.review.chosen_views import _passes, locate_chosen

    drive = rich_drive()
    views, rules = drive.views(), GeolocationRules(noise=NOISE, size=PRIOR)

    def chosen(sign: int, boxes: slice, clicks: int) -> Any:
        some = [
            _some(d, np.flatnonzero(own == sign)[boxes])
            for d, own in zip(drive.detections, drive.owner, strict=True)
        ]
        clicked = np.arange(sum(map(len, some))) < clicks
        try:
            return locate_chosen(drive.path, some, drive.cameras, CORRECTIONS, rules, clicked)
        except ValueError as error:
            return str(error)

    seen = of.nothing_observed(np.full(sum(map(len, drive.owner)), "", object), views)
    before = seen.note.copy()
    for number, mark in enumerate(_settled(views, (1, 4, 7))):
        of.record_sign(seen, views, mark, number, f"s{number}", np.array([950.0, 810.0]))
    seen.note[200:230] = ["misfit", "too_far", "unconfirmed", "moving", "back", ""] * 5
    signs = [_sign(k, status) for k, status in enumerate(["ok", "single_view", "far"])]
    corrections = {
        "front": replace(CORRECTIONS["front"], time_minima=(-0.31, 0.27)),
        "left": replace(CORRECTIONS["front"], turn=np.array([0.1, -0.2, 0.3]), time_s=0.4),
    }
    gone = replace(seen, note=np.full(len(seen.note), "no_pose", object))
    gaps = replace(views, t_ns=views.t_ns + (np.arange(len(views)) // 90) * 40_000_000_000)
    return levelled(
        {
            "boxes": [chosen(k, np.s_[1:7], 0) for k in (2, 5)],
            "clicks": [chosen(k, np.s_[::3], 99) for k in (8, 9)],
            "some": chosen(10, np.s_[1::4], 2),
            "near": chosen(11, np.s_[3:4], 99),
            "mixed": chosen(7, np.s_[:1], 1),
            "passes": _passes(gaps),
            "before": before,
            "observed": seen,
            "told": [
                of.warnings_of(o, o.note != "fixed", signs, corrections, drive.cameras, 0.005)
                for o in (seen, gone)
            ],
        }
    )


@scenario
def geolocation_whole() -> Any:
    """The drive located with both cameras."""
    from automap.geolocation.locate import locate_signs
    from automap.geolocation.rules import GeolocationRules

    drive = rich_drive()
    rules = GeolocationRules(noise=NOISE, size=PRIOR, estimate_camera=False)
    found = locate_signs(drive.path, drive.detections, drive.cameras, rules)
    told = {n: v for n, v in vars(found).items() if n not in ("adjusted", "signs")}
    places = [(s.lat_rad, s.lon_rad, s.height_m, s.n_views, s.existence) for s in found.signs]
    return levelled({**told, "signs": np.array(places), "id": [s.support for s in found.signs]})


@scenario
def geolocation_late() -> Any:
    """One camera's frames, each off its stamp, with the camera and the noise estimated."""
    from automap.geolocation.locate import locate_signs
    from automap.geolocation.rules import GeolocationRules

    drive, rng = rich_drive(), np.random.default_rng(6)
    record, owner = drive.detections[0], drive.owner[0]
    moved = np.rint(rng.normal(0.0, 5e7, len(record))).astype(np.int64)
    late = replace(record, t_ns=record.t_ns + moved)
    some = _some(late, np.flatnonzero(np.isin(owner, (6, 7, 8, 9, 10, 11))))
    rules = GeolocationRules(noise=NOISE, size=PRIOR)
    found = locate_signs(drive.path, [some], drive.cameras, rules)
    correction = found.corrections["front"]
    return {
        "noise": found.noise,
        "places": [(s.lat_rad, s.lon_rad, s.height_m, s.confidence) for s in found.signs],
        "sd": [np.sqrt(np.diag(s.cov_enu)) for s in found.signs],
        "turn": correction.turn,
        "sigmas": np.sqrt(np.diag(correction.covariance)),
        "warnings": found.warnings,
    }
