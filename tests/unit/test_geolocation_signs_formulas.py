"""How boxes become signs of the map: likelihoods, stretches of frames, what is said of a sign."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import ORIGIN, camera, drive_path

from automap.earth import from_local_ned, tangent_rotation
from automap.frames import rotation_vector_to_matrix
from automap.gates import gate
from automap.geolocation import assembly, due_frames, facing, limits
from automap.geolocation.assembly import _status, class_beliefs
from automap.geolocation.landmark import (
    elapsed_s,
    place,
    position_jacobian,
    relative_views,
    seen_from,
    view_sd,
)
from automap.geolocation.path_relation import make_path
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.stamp_scatter import Residuals, deviance, told, tracked_or_linked
from automap.mapping import limits as mapping
from automap.mapping.backs import backs
from automap.mapping.sureness import class_probabilities
from automap.records import FloatArray

FREEDOM = 4.0


def never(a: int, b: int) -> bool:
    return False


def test_a_signs_likelihood_is_students_with_full_matrices() -> None:
    """Each box's errors with a dense covariance; the fit solved with dense weights."""
    rng = np.random.default_rng(1)
    n, m = 5, 4
    value, by_fit = rng.normal(size=(n, 3)), rng.normal(size=(n, 3, m))
    by_stamp, own, prior = rng.normal(size=(n, 3)), rng.uniform(0.3, 2.0, 3), rng.uniform(0.1, 2, m)
    C = np.array([np.diag(own) + 0.88**2 * np.outer(d, d) for d in 0.7 * by_stamp])
    W = np.linalg.inv(C)
    r = value
    for _ in range(2):
        weight = (FREEDOM + 3.0) / (FREEDOM + np.einsum("ni,nij,nj->n", r, W, r))
        N = sum(w * B.T @ V @ B for w, B, V in zip(weight, by_fit, W, strict=True))
        pull = sum(w * B.T @ V @ z for w, B, V, z in zip(weight, by_fit, W, value, strict=True))
        x = np.linalg.inv(N + np.diag(prior)) @ pull
        r = value - by_fit @ x
    square = np.einsum("ni,nij,nj->n", r, W, r)
    whole = np.diag(prior) + sum(B.T @ V @ B for B, V in zip(by_fit, W, strict=True))
    total = np.sum((FREEDOM + 3.0) * np.log1p(square / FREEDOM) + np.linalg.slogdet(C)[1])
    total += x @ (prior * x) + np.linalg.slogdet(whole)[1]
    signs = [Residuals(value, by_stamp, by_fit, prior)] * 2
    assert deviance(signs, own, 0.7) == pytest.approx(2.0 * total)


def test_stamps_are_told_to_err_beyond_a_uniform_ones_sigma() -> None:
    stamps = [np.array([0, 0, 100, 300, 200]) * 10**6, np.array([5, 5]) * 10**6]
    for factor in (0.999, 1.001):
        found = told(factor * 0.1 / np.sqrt(12.0), stamps)
        assert bool(found) == (factor > 1.0)
    assert told(1e9, []) == []


def test_boxes_of_single_signs_are_the_detectors_tracks_where_most_have_one() -> None:
    class Many(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.track)

    often = limits.SCATTER_VIEWS
    track = np.array([3] * often + [5] * (often - 1) + [3] * often + [-1] * 9)
    views: Any = Many(
        track=track, camera=np.array([0] * (2 * often - 1) + [1] * (often + 9)),
        t_ns=np.arange(300), centre=np.arange(300.0)[:, None] * [1.0, 0.0, 0.0],
    )  # fmt: skip
    marks: Any = [
        SimpleNamespace(rows=np.arange(often), ok=True),
        SimpleNamespace(rows=np.arange(often), ok=False),
        SimpleNamespace(rows=np.arange(2), ok=True),
    ]
    found = tracked_or_linked(views, marks)
    assert [rows.tolist() for rows in found] == [
        list(range(often)), list(range(2 * often - 1, 3 * often - 1))
    ]  # fmt: skip
    views.track = np.where(np.arange(len(track)) < often, 3, -1)
    assert [rows.tolist() for rows in tracked_or_linked(views, marks)] == [list(range(often))]
    # of many signs an even part
    many: Any = [SimpleNamespace(rows=np.arange(k, k + often), ok=True) for k in range(150)]
    some = [int(rows[0]) for rows in tracked_or_linked(views, many)]
    assert some == list(range(0, 150, 3))


def scene(rng: np.random.Generator, n: int = 6) -> Any:
    """Cameras on a line that look at a place 30 m ahead, and what they measure of it."""
    C = np.array([rotation_vector_to_matrix(v) for v in 0.1 * rng.normal(size=(n, 3))])
    centre = np.column_stack([3.0 * np.arange(n), rng.normal(size=n), 0.1 * rng.normal(size=n)])
    point = np.array([40.0, 5.0, -2.0])
    q = np.einsum("nij,nj->ni", C, point - centre)
    measured = np.column_stack([q[:, 1:] / q[:, :1], np.log(0.8 / q[:, 0])])
    views = SimpleNamespace(
        C_cam_ref=C, centre=centre, measured=measured, sd=np.tile([0.01, 0.02, 0.03], (n, 1)),
        t_ns=np.arange(n) * 10**8,
    )  # fmt: skip
    return views, point


def test_a_place_seen_from_a_view_is_that_place() -> None:
    views, point = scene(np.random.default_rng(2))
    for anchor in (0, 4):
        x = seen_from(views, anchor, point, np.log(0.8))
        assert x is not None
        assert x[:2] == pytest.approx(views.measured[anchor, :2])
        assert x[3] - x[2] == pytest.approx(views.measured[anchor, 2])
        assert place(views, anchor, x) == pytest.approx(point)
        J = np.column_stack(
            [
                (place(views, anchor, x + e) - place(views, anchor, x - e)) / 2e-6
                for e in 1e-6 * np.eye(4)
            ]
        )
        mark: Any = SimpleNamespace(parameters=x, anchor=anchor)
        np.testing.assert_allclose(position_jacobian(views, mark), J, atol=1e-6)
        M, b = relative_views(views, np.arange(6), anchor)
        q = views.C_cam_ref[anchor] @ (point - views.centre[anchor])
        for k in range(6):
            own = views.C_cam_ref[k] @ (point - views.centre[k])
            assert M[k] @ q + b[k] == pytest.approx(own)
    behind = views.centre[0] - views.C_cam_ref[0].T @ [limits.MIN_FORWARD_M, 0.0, 0.0]
    assert seen_from(views, 0, behind, 0.0) is None


def test_views_from_one_place_count_as_one_in_whatever_order_they_come() -> None:
    views, _ = scene(np.random.default_rng(3), 8)
    step = limits.SAME_PLACE_M
    along = step * np.array([0.0, 0.1, 0.2, 1.4, 1.5, 9.2, 20.7, 20.8])
    views.centre = np.column_stack([along, np.zeros(8), np.zeros(8)])
    count = np.array([3, 3, 3, 2, 2, 1, 2, 2])
    for order in (np.arange(8), np.random.default_rng(4).permutation(8)):
        wanted = views.sd[order] * np.sqrt(count[order])[:, None]
        np.testing.assert_allclose(view_sd(views, order), wanted)
    # a slow drift of the speed's error: in proportion at first, and no more than for some seconds
    views.t_ns = np.array([0, 1, -1, 100, 10**6, -(10**6), 3, 4]) * 10**8
    seconds = elapsed_s(views, np.arange(6), 0)
    assert seconds[1] == pytest.approx(0.1, rel=1e-3)
    assert seconds[1] == -seconds[2]
    assert seconds[4] == pytest.approx(limits.VELOCITY_ERROR_S)
    assert seconds[5] == -seconds[4]


@pytest.mark.parametrize("offset_s", [0.0, 0.03])
def test_frames_that_should_show_a_sign_are_those_a_walk_along_the_frames_finds(
    offset_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sign boxed in some of sixty frames, due where it is as tall as signs are when found."""
    rng = np.random.default_rng(5)
    tall, step = rng.random(60), np.int64(10**8)
    boxed, late = np.array([20, 21, 26, 40]), np.int64(round(offset_s * 1e9))
    searched = due_frames.Searched(
        camera(time_offset_s=offset_s), np.arange(60), np.arange(60) * step + late,
        np.zeros((60, 4)),
    )  # fmt: skip
    views: Any = SimpleNamespace(
        camera=np.zeros(4, np.int64), centre=np.zeros((4, 3)),
        t_ns=boxed * step + late, origin=ORIGIN, score=np.array([0.5, 0.6, 0.7, 0.8]),
    )  # fmt: skip
    mark: Any = SimpleNamespace(anchor=2, rows=np.arange(4), position=np.zeros(3), size_m=1.0)
    asked: list[int] = []

    def heights(views: Any, mark: Any, path: Any, searched: Any, near: slice) -> FloatArray:
        t_ns = searched.t_ns[near]
        asked.extend(np.rint(t_ns / step).astype(int).tolist())
        return np.array([501.0 if tall[round(t / step)] < 0.6 else 499.0 for t in t_ns])

    monkeypatch.setattr(due_frames, "apparent_heights", heights)
    monkeypatch.setattr(limits, "AFTER_S", 1.0)
    found = due_frames.pattern_of(
        *(views, mark, boxed, SimpleNamespace(t_ns=np.arange(70) * step), searched),
        *(0.5, 0.1 * np.arange(70)),
    )
    assert asked == list(range(10, 50))
    due = {k for k in asked if tall[k] < 0.6}
    order = sorted(due | set(boxed.tolist()))
    assert (found.t_s - offset_s) * 10.0 == pytest.approx(order)
    assert found.seen.tolist() == [k in boxed for k in order]
    assert found.due.tolist() == [k in due for k in order]
    assert found.score.tolist() == [0.5, 0.6, 0.7, 0.8]


def test_a_class_is_believed_by_its_tracks_as_by_the_drives_of_a_map() -> None:
    """However many boxes a track has; one that reads another class tells against it, and cameras
    number their tracks alike."""

    def believed(track: list[int], camera: list[int], name: str, p: list[float]) -> FloatArray:
        told = np.array(p)
        views: Any = SimpleNamespace(
            track=np.array(track), camera=np.array(camera), class_probability=told,
            class_name=np.array(list(name), object), group_probability=0.5 + 0.5 * told,
        )  # fmt: skip
        return np.array(class_beliefs(views, np.arange(len(p)), "a"))

    zero, one = np.zeros(3, np.int64), np.zeros(1, np.int64)
    three = believed([4, 4, 7, 4], [0, 0, 0, 1], "aaba", [0.8, 0.8, 0.5, 0.7])
    by_drives = class_probabilities(np.array([0, 1, 0]), np.array([0.8, 0.5, 0.7]), zero, one)
    assert three[0] == pytest.approx(by_drives[0])
    assert three[1] >= three[0]
    assert believed([4, 4], [0, 0], "aa", [0.8, 0.8])[0] == pytest.approx(0.8)
    assert believed([4, 5], [0, 0], "aa", [0.8, 0.8])[0] > 0.85
    assert believed([-1, -1], [0, 0], "aa", [0.7, 0.9])[0] == pytest.approx(0.8)
    assert np.isnan(believed([1, 2], [0, 0], "ab", [np.nan, np.nan])).all()


def sighting(depth: float = 20.0, sd: float = 0.1) -> Any:
    return SimpleNamespace(landmark=SimpleNamespace(depth_m=depth, depth_log_sd=sd))


@pytest.mark.parametrize(
    ("seen", "size", "height", "n", "wanted"),
    [
        ([sighting()], 0.7, 2.0, 3, "ok"),
        ([sighting()], 0.7, 2.0, 1, "single_view"),
        ([sighting()], 0.149, 2.0, 1, "implausible"),
        ([sighting()], 6.01, 2.0, 3, "implausible"),
        ([sighting()], 0.15, -2.0, 3, "ok"),
        ([sighting()], 6.0, 15.0, 3, "ok"),
        ([sighting()], 0.7, 15.1, 3, "implausible"),
        ([sighting()], 0.7, -2.1, 3, "implausible"),
        ([sighting(61.0, 0.9), sighting(60.0)], 0.7, 2.0, 4, "ok"),
        ([sighting(61.0, 0.9), sighting(60.1)], 0.7, 2.0, 4, "far"),
        ([sighting(sd=0.26), sighting(sd=0.25)], 0.7, 2.0, 4, "ok"),
        ([sighting(sd=0.26), sighting(sd=0.3)], 0.7, 2.0, 4, "weak_geometry"),
    ],
)
def test_what_is_said_first_of_a_sign(
    seen: list[Any], size: float, height: float, n: int, wanted: str
) -> None:
    assert _status(seen, size, height, n) == wanted


def test_a_sign_of_the_map_has_place_and_covariance_where_it_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Kilometres from the origin, where north is another one; sizes by their variances."""
    rng = np.random.default_rng(7)
    path = make_path(drive_path(4.0), ORIGIN)
    root = rng.normal(size=(3, 3))
    position, covariance = np.array([900.0, 60_000.0, -250.0]), root @ root.T
    placed = position, covariance, np.array([0.5, 0.5, 0.2])
    sd, log_size = np.array([0.1, 0.3]), np.log([0.7, 0.9])
    seen: Any = [
        SimpleNamespace(
            landmark=SimpleNamespace(
                rows=np.array(rows), depth_m=20.0, depth_log_sd=0.1,
                covariance=np.diag([1.0, 1.0, 1.0, sd[k] ** 2]),
                parameters=np.array([0, 0, 0, log_size[k]]),
            ),
            covariance=np.diag([1.0, 1.0, 4.0 + 9.0 * k]), path_sd=np.array([9.0, 9.0, 1.5]),
            class_score={"a": 1.0, "b": 1.5 * k},
        )
        for k, rows in enumerate(([4, 1], [2]))
    ]  # fmt: skip
    t_ns = path.t_ns[np.array([0, 5, 30, 0, 9])]
    views: Any = SimpleNamespace(
        origin=ORIGIN, t_ns=t_ns, score=np.full(5, 0.4), row=np.array([9, 8, 7, 6, 5]),
        class_name=np.array(["a"] * 5, object), class_probability=np.full(5, np.nan),
        track=np.arange(5), camera=np.zeros(5, np.int64),
        group_probability=np.full(5, np.nan), centre=np.arange(5.0)[:, None] * [10.0, 0.0, 0.0],
    )  # fmt: skip
    facing: Any = SimpleNamespace(rad=0.3, sd_rad=0.2)
    # heights are said of the path, and far from it anything goes
    monkeypatch.setattr(limits, "HEIGHT_LIMITS_M", (-1e4, 1e4))
    rules = GeolocationRules(imu_above_road_m=1.2, imu_above_road_sd_m=0.4, drive="d")
    found = assembly.assemble_sign(views, seen, placed, path, facing, 7, rules, 0.8)
    lat, lon, height = (float(v) for v in from_local_ned(position, ORIGIN))
    assert (found.lat_rad, found.lon_rad, found.height_m) == (lat, lon, height)
    # axes at the sign by differences of places
    axes = np.zeros((3, 3))
    for k, e in enumerate(np.eye(3)):
        moved = np.array([float(v) for v in from_local_ned(position + e, ORIGIN)])
        change = moved - [lat, lon, height]
        axes[:, k] = change[1] * 6.386e6 * np.cos(lat), change[0] * 6.357e6, change[2]
    np.testing.assert_allclose(found.cov_enu, axes @ covariance @ axes.T, atol=0.03)
    by_size = [found.by_size_e_m, found.by_size_n_m, found.by_size_u_m]
    np.testing.assert_allclose(by_size, axes @ [0.5, 0.5, 0.2], atol=0.01)
    C = tangent_rotation(np.array([lat]), np.array([lon]), ORIGIN)[0].T
    turn = np.arctan2(C[1, 0], C[0, 0])
    assert abs(turn) > 1e-3
    assert found.facing_rad == pytest.approx((0.3 + turn) % (2.0 * np.pi), abs=1e-4)
    w = sd**-2.0
    assert found.size_m == pytest.approx(np.exp(np.sum(w * log_size) / w.sum()))
    # of the best pass less what the path's own error lifts both by
    assert found.sd_above_road_m == pytest.approx(np.hypot(np.sqrt(4.0 - 1.5**2), 0.4))
    assert found.class_name == "a"
    assert found.confidence == pytest.approx(0.8 * (1.0 - (1.0 - 0.4 * limits.VIEW_EVIDENCE) ** 3))
    assert found.detection_rows.tolist() == [5, 7, 8]
    assert (found.first_seen_ns, found.last_seen_ns) == (t_ns[1], t_ns[2])
    assert (found.n_views, found.drives, found.id, found.existence) == (3, ("d",), "s0007", 0.8)
    above = found.height_above_road_m - 1.2
    nearest = path.position[np.argmin(np.linalg.norm(path.position[:, :2] - position[:2], axis=1))]
    assert above == pytest.approx(nearest[2] - position[2], abs=0.5)
    monkeypatch.setattr(limits, "HEIGHT_LIMITS_M", (1e4, 2e4))
    for some, sure in ((seen, 0.8), (seen[1:], 0.8 * limits.IMPLAUSIBLE_CONFIDENCE)):
        off = assembly.assemble_sign(views, some, placed, path, facing, 7, rules, 0.8)
        right = 1.0 - (1.0 - 0.4 * limits.VIEW_EVIDENCE) ** off.n_views
        assert (off.status, off.existence) == ("implausible", pytest.approx(sure))
        assert off.confidence == pytest.approx(0.8 * limits.IMPLAUSIBLE_CONFIDENCE * right)


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_a_back_is_near_its_front_by_both_sigmas_and_a_plates_thickness(factor: float) -> None:
    slack, sd = mapping.THICKNESS_M, 0.3
    distance = factor * np.sqrt(gate(mapping.BACK_PROBABILITY, 2) * (2.0 * sd**2 + slack**2))
    assert distance < mapping.BACK_REACH_M
    away = np.arccos(mapping.AWAY_COSINE)

    def behind(
        where: float, turn: float, sd: float = sd, beside: Callable[[int, int], bool] = never
    ) -> bool:
        names = ["sign--back", "regulatory--stop--g1"]
        place = np.array([[where, 0.0], [0.0, 0.0]])
        covariance = np.tile(sd**2 * np.eye(2), (2, 1, 1))
        return bool(backs(names, place, covariance, np.array([turn, 0.0]), beside)[0] == 1)

    assert behind(-distance, 1.001 * away) == (factor < 1.0)
    assert not behind(0.0, 0.999 * away)
    assert behind(0.0, np.pi)
    assert not behind(0.0, np.pi, beside=lambda a, b: {a, b} == {0, 1})
    far = 1.001 * mapping.BACK_REACH_M
    for where, wanted in ((far, False), (-far, False), (0.998 * far, True)):
        assert behind(where, np.pi, 1e3) is wanted


def test_a_boxs_size_is_the_mean_of_width_and_height_by_their_logarithms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Wide and tall boxes of 10 to 90 px, of a focal length of 1000 px: those of one octave err
    alike, and by a margin in pixels the more, the smaller they are."""
    width = np.array([80.0, 20.0, 30.0, 12.0, 60.0])
    height = np.array([90.0, 40.0, 10.0, 11.0, 50.0])
    views: Any = SimpleNamespace(
        log_aspect=np.log(width / height),
        measured=np.column_stack([np.zeros((5, 2)), np.log(height / 1000.0)]),
        class_name=np.array(["a"] * 5, object),
        margin_sd=np.full(5, 0.002),
        attitude_sd=np.zeros((5, 3)),
    )
    weight = np.array([1.0, 0.25, 1.0, 1.0, 1.0])
    seen: Any = SimpleNamespace(
        landmark=SimpleNamespace(rows=np.arange(5), weight=weight), facing=np.array([1.0, 0.0])
    )
    monkeypatch.setattr(facing, "view_sd", lambda *_: np.full((5, 3), 0.03))
    monkeypatch.setattr(facing, "crowd", lambda *_: np.ones(5))
    monkeypatch.setattr(facing, "_against_traffic", lambda *_: (np.zeros(1), np.ones(1)))
    monkeypatch.setattr(
        facing, "expected_aspect", lambda v, rows, grid, shape: np.zeros((5, len(grid)))
    )
    found = facing._observed(views, [seen], Any)  # type: ignore[arg-type]
    size = np.sqrt(width * height)
    octave = np.floor(np.log2(size / 1000.0))
    assert (
        np.diff(found.octave[np.argsort(octave, kind="stable")]).tolist()
        == np.diff(np.sort(octave)).tolist()
    )
    assert len(set(octave)) == len(found.octaves) > 2
    alike = np.hypot(2.0 / size, limits.FACE_ALIKE)
    for k, one in enumerate(found.octaves):
        np.testing.assert_allclose(
            found.columns[:, 1 + k], np.where(found.octave == one, alike, 0.0)
        )
    # both sides err alike in pixels, a narrow box's width by more of itself
    narrow = np.maximum(height / width, 1.0)
    np.testing.assert_allclose(found.sd, 0.03 * np.sqrt(1.0 + narrow**2) / np.sqrt(weight))
