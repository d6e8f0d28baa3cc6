"""What a drive's signs tell together: faces, sizes, frames that lack a box, errors of the path;
against dense Gaussian algebra and signs drawn at random."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from geolocation_scene import ORIGIN, camera, drive_path
from scipy.stats import multivariate_normal, norm

from automap.earth import local_ned
from automap.geolocation import facing, limits
from automap.geolocation.box_noise import scatter
from automap.geolocation.class_sizes import _predicted, measured_size
from automap.geolocation.due_frames import Pattern, of_looks, searched_frames
from automap.geolocation.existence import _found_rate, pattern_nats, thing_nats
from automap.geolocation.facing import (
    _GRID,
    _OCTAVES,
    Faces,
    _believe,
    _common,
    _prior,
    _Seen,
    _summary,
)
from automap.geolocation.landmark import SizePrior
from automap.geolocation.sightings import Sighting
from automap.geolocation.trajectory_adjustment import Adjustment, shift_sighting, shifted
from automap.mapping.limits import PATH_CORRELATION_S
from automap.mapping.path_errors import path_nodes
from automap.records import Detections, FloatArray, Looked
from automap.robust import cauchy_weight


def face_of(
    rng: np.random.Generator, turned: float, n: int = 7, sd: float = 0.03, off: float = 0.0
) -> _Seen:
    """A round face ``turned`` rad against a road to the north, passed at some distance: boxes of
    two octaves of size, their log aspects off by ``off`` and by what an octave has in common."""
    view = np.linspace(0.1, 0.7, n)
    octave = np.where(np.arange(n) < n // 2, 2, 4)
    octaves = np.unique(octave)
    columns = np.column_stack([np.ones(n)] + [np.where(octave == k, 0.02, 0.0) for k in octaves])
    own = np.array([sd * (1.0 + 0.5 * (k % 2)) for k in range(n)])
    common = rng.standard_normal(len(octaves))
    measured = np.log(np.cos(turned - view)) + off + columns[:, 1:] @ common
    return _Seen(
        grid=0.3 + _GRID,
        centres=np.array([0.0, 0.2]),
        beside=np.array([0.9, 0.6]),
        measured=measured + own * rng.standard_normal(n),
        expected=np.log(np.maximum(np.cos(0.3 + _GRID - view[:, None]), 0.02)),
        sd=own,
        crowd=np.ones(n),
        columns=columns,
        least=np.full(n, -np.inf),
        octave=octave,
        octaves=octaves,
        sure=True,
        yaw_sd=0.01,
    )


FACES = Faces(0.25, 0.1, np.linspace(-0.04, 0.04, _OCTAVES), 0.05, 1.3, 1.2)


def test_faces_look_against_the_road_or_anywhere_with_the_shares_that_are_stated() -> None:
    one = face_of(np.random.default_rng(1), 0.1)
    core, elsewhere = _prior(one, FACES)
    step = np.radians(1.0)
    wanted = (
        0.9
        * 0.5
        * np.array([[0.9], [0.6]])
        * norm(0.0, 0.25).pdf(one.grid - one.centres[:, None])
        * step
    )
    np.testing.assert_allclose(core, wanted, rtol=1e-9, atol=1e-15)
    assert elsewhere == pytest.approx(np.full(len(_GRID), 0.1 / len(_GRID)))
    # round the circle it is one direction
    turned, _ = _prior(replace(one, centres=one.centres + 2.0 * np.pi), FACES)
    np.testing.assert_allclose(turned, core, atol=1e-15)


@pytest.mark.parametrize("sure", [True, False])
def test_the_belief_over_normals_is_bayes_rule_with_all_errors_of_the_boxes(sure: bool) -> None:
    """What the boxes share stands in a dense covariance here; weights in as many rounds."""
    rng = np.random.default_rng(2)
    one = replace(face_of(rng, 0.35), sure=sure)
    one.measured[3] += 0.3
    found = _believe(one, FACES)
    n = len(one.sd)
    core, elsewhere = _prior(one, FACES)
    aspect = np.hypot(0.05, 0.0 if sure else limits.PLATE_ASPECT_SD)
    shared = np.diag([aspect, *[FACES.alike] * len(one.octaves)]) ** 2
    off = one.measured[:, None] - one.expected - FACES.log_aspect[one.octave][:, None]
    weight = np.ones(n)
    for _ in range(3):
        own = np.diag((1.2 * one.sd) ** 2 / weight)
        S = own + one.columns @ shared @ one.columns.T
        log = multivariate_normal(np.zeros(n), S).logpdf(off.T)
        normal = (core.sum(axis=0) + elsewhere) * np.exp(log - log.max())
        size = normal.sum()
        normal /= size
        gain = shared @ one.columns.T @ np.linalg.inv(S)
        each = gain @ off
        cov = shared - gain @ one.columns @ shared
        best = int(np.argmax(normal))
        residual = (off[:, best] - one.columns @ each[:, best]) / (1.2 * one.sd)
        weight = cauchy_weight(residual**2)
    np.testing.assert_allclose(found.normal, normal, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.core, core * np.exp(log - log.max()) / size, atol=1e-12)
    mean = each @ normal
    assert found.shared == pytest.approx(mean)
    spread = np.diag(cov) + (each - mean[:, None]) ** 2 @ normal
    assert found.shared_variance == pytest.approx(spread)
    assert found.residual == pytest.approx(residual)
    # a direction, and of each shared error as much as its variance fell by
    took = 1.0 - np.diag(cov) / np.diag(shared)
    assert found.absorbed == pytest.approx(1.0 + took.sum())
    # half of the belief lies to either side of it, and 95 % within the sigmas that tell as much,
    # with the trajectory's own error of heading
    told = _summary(one, found)
    step = np.radians(1.0)
    off = one.grid - told.rad
    assert normal[off < -step].sum() < 0.5 < normal[off < step].sum()
    own = np.sqrt(told.sd_rad**2 - 0.01**2)
    assert normal[np.abs(off) <= 1.96 * own + step].sum() >= 0.95
    rms = np.sqrt(normal @ off**2)
    assert own >= rms * (1.0 - 1e-9)
    assert own == pytest.approx(rms, rel=0.1)


def test_what_faces_have_in_common_is_what_is_expected_of_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One round: sums over signs, normals and roads, one by one, with the priors as signs besides.

    One face's shape is not known: it says nothing of aspects.
    """
    rng = np.random.default_rng(3)
    turns = np.radians([-12.0, 20.0, 5.0, 60.0, -3.0])
    seen = [face_of(rng, 0.1 + t, 12, 0.06, 0.08) for t in turns]
    seen[1] = replace(seen[1], sure=False)
    seen[3] = replace(seen[3], beside=np.array([0.1, 0.3]))
    one_size = np.column_stack([np.ones(12), np.full(12, 0.02)])
    seen[2] = replace(seen[2], octaves=np.array([2]), columns=one_size, octave=np.full(12, 2))
    monkeypatch.setattr(facing, "_ROUNDS", 1)
    found = _common(seen)
    start = Faces()
    believed = [_believe(one, start) for one in seen]
    square = about = 0.0
    for one, belief in zip(seen, believed, strict=True):
        for c, centre in enumerate(one.centres):
            for g, normal in enumerate(one.grid):
                square += belief.core[c, g] * (normal - centre) ** 2
                about += belief.core[c, g]
    freedom = limits.FACES_FREEDOM
    turned = (freedom * limits.TURNED_SD**2 + square) / (freedom + about)
    assert found.turned_sd == pytest.approx(np.sqrt(turned))
    # those far from the road tell little of how many beside it face elsewhere
    near = [0.9, 0.9, 0.9, 0.3, 0.9]
    odd = sum(n * (1.0 - b.core.sum()) for n, b in zip(near, believed, strict=True))
    share = (freedom * limits.FACE_ELSEWHERE + odd) / (freedom + sum(near))
    assert found.elsewhere == pytest.approx(share)
    sure = [k for k in range(5) if k != 1]
    aspects = [believed[k].shared[0] ** 2 + believed[k].shared_variance[0] for k in sure]
    spread = (freedom * limits.FACE_ASPECT_SD**2 + sum(aspects)) / (freedom + 4.0)
    assert found.aspect_sd == pytest.approx(np.sqrt(spread))
    small = sum(believed[k].shared[0] + 0.02 * believed[k].shared[1] for k in sure)
    large = sum(believed[k].shared[0] + 0.02 * believed[k].shared[2] for k in sure if k != 2)
    wanted = np.zeros(_OCTAVES)
    wanted[[2, 4]] = small / (freedom + 4.0), large / (freedom + 3.0)
    assert found.log_aspect == pytest.approx(wanted)
    alike = [v for b in believed for v in b.shared[1:] ** 2 + b.shared_variance[1:]]
    assert found.alike == pytest.approx(
        max(1.0, np.sqrt((freedom + sum(alike)) / (freedom + len(alike))))
    )
    took = sum(b.absorbed for b in believed) / 5.0
    assert found.scale == pytest.approx(
        scatter([b.residual for b in believed], [one.crowd for one in seen], took)
    )
    assert found.scale > 1.05
    # none tell nothing
    none = _common([])
    assert (none.turned_sd, none.elsewhere) == (limits.TURNED_SD, limits.FACE_ELSEWHERE)


def mark(log_size: float, variance: float, ok: bool = True) -> Any:
    covariance = np.zeros((4, 4))
    covariance[3, 3] = 0.4 * variance
    return SimpleNamespace(
        ok=ok,
        covariance=covariance,
        pass_covariance=1.5 * covariance,
        parameters=np.array([0.0, 0.0, 2.0, log_size]),
    )


def test_a_measured_size_is_what_the_prior_was_joined_with() -> None:
    prior = SizePrior(0.7, 0.4)
    own, noise = np.array([-0.9, -0.1, 0.4]), np.array([0.03, 0.05, 0.15]) ** 2
    after = 1.0 / (1.0 / noise + 0.4**-2)
    joined = after * (own / noise + np.log(0.7) * 0.4**-2)
    marks = [mark(m, v) for m, v in zip(joined, after, strict=True)]
    marks += [mark(0.0, 0.1**2, ok=False), mark(0.0, 0.39**2)]
    size, variance = np.array([measured_size(one, prior) for one in marks]).T
    assert size[:3] == pytest.approx(own)
    assert variance[:3] == pytest.approx(noise)
    assert np.isnan(size[3:]).all()
    assert np.isnan(variance[3:]).all()
    edge = (1.0 - limits.LEAST_SIZE_GAIN) * 0.4**2
    told = [measured_size(mark(0.0, k * edge), prior)[0] for k in (0.99, 1.01)]
    assert np.isfinite(told).tolist() == [True, False]


@pytest.mark.parametrize("spread", [0.1, 0.25])
def test_many_sizes_of_a_class_tell_its_mean_and_spread(spread: float) -> None:
    rng = np.random.default_rng(4)
    prior, n = SizePrior(0.7, 0.6), 400
    variance = rng.uniform(0.02, 0.08, n) ** 2
    size = np.log(0.9) + rng.normal(0.0, spread, n) + np.sqrt(variance) * rng.standard_normal(n)
    found = _predicted(size, variance, prior)
    assert np.log(found.size_m) == pytest.approx(np.log(0.9), abs=0.03)
    # what is beyond its own error counts, and a small square is not beyond: some more than it is
    assert spread < found.log_sd < 1.25 * spread
    # a few that are far off change little
    size[:20] += 2.0
    assert np.log(_predicted(size, variance, prior).size_m) == pytest.approx(np.log(0.9), abs=0.04)


def test_one_size_of_a_class_is_joined_with_the_prior_by_their_variances() -> None:
    """A size that is just the prior's: the spread keeps to what is usual but for the one."""
    prior, noise = SizePrior(0.7, 0.3), 0.02**2
    found = _predicted(np.array([np.log(0.7)]), np.array([noise]), prior)
    freedom, usual = limits.CLASS_SPREAD_FREEDOM, limits.CLASS_SPREAD_LOG**2
    spread = usual
    for _ in range(5):
        sure = 0.3**-2 + 1.0 / (spread + noise)
        spread = freedom * usual / (freedom + 1.0)
    assert found.size_m == pytest.approx(0.7)
    assert found.log_sd == pytest.approx(np.sqrt(spread + 1.0 / sure))
    # a size that tells nothing leaves the prior, also its sigma
    nothing = _predicted(np.array([0.0]), np.array([1e6]), SizePrior(0.7, 0.1))
    assert (nothing.size_m, nothing.log_sd) == pytest.approx((0.7, 0.1), rel=1e-4)


def test_frames_without_a_box_are_found_between_those_with_one() -> None:
    """A detector that looks at every third frame of a camera of 30 Hz, boxes in some of them."""
    number = np.array([30, 33, 33, 36, 48, 51, 300])
    n = len(number)
    found = Detections(
        number, np.rint((10.0 + number / 30.0) * 1e9).astype(np.int64),
        np.full(n, "", object), np.zeros((n, 4)), np.ones(n), np.full(n, -1),
    )  # fmt: skip
    view = camera(time_offset_s=0.05)
    assumed = searched_frames(found, view)
    assert not assumed.known
    assert assumed.frame.tolist() == list(range(30, 301, 3))
    assert assumed.t_ns * 1e-9 == pytest.approx(10.05 + assumed.frame / 30.0, abs=1e-8)
    # what is known is not assumed, and nothing is said before the first box and after the last
    region = np.arange(16.0).reshape(4, 4)
    known = replace(found, looked=Looked(np.array([20, 30, 40, 310]), region))
    told = searched_frames(known, view)
    assert told.known
    assert told.frame.tolist() == [30, 40]
    assert told.region.tolist() == region[1:3].tolist()
    none = replace(found, **{k: getattr(found, k)[:0] for k in ("frame", "t_ns", "box")})
    assert len(searched_frames(none, view).frame) == 0


def pattern(seen: str, step_s: float = 0.1) -> Pattern:
    """Frames one after another from a text such as "1.0": seen, seen but not due, due alone."""
    t_s = step_s * np.arange(len(seen))
    shown = np.array([c != "0" for c in seen])
    return Pattern(t_s, shown, np.array([c != "." for c in seen]), np.full(shown.sum(), 0.9))


def test_a_wait_is_one_look_that_shows_what_most_of_its_frames_show() -> None:
    moving = pattern("1.0011")
    for before, after in zip(vars(moving).values(), vars(of_looks(moving)).values(), strict=True):
        assert np.array_equal(before, after)
    waits = pattern("11" + "1" * 90 + "0" * 60 + "0" + "1" + "0" * 99 + "1")
    waits.t_s[2:152], waits.t_s[153:253] = 0.2, 15.3
    score = waits.score.copy()
    score[2:92] = np.linspace(0.5, 0.7, 90)
    told = of_looks(replace(waits, score=score))
    assert told.t_s.tolist() == pytest.approx([0.0, 0.1, 0.2, 15.2, 15.3, 25.3])
    assert told.seen.tolist() == [True, True, True, False, False, True]
    assert told.due.tolist() == [True] * 6
    assert told.score.tolist() == pytest.approx([0.9, 0.9, 0.6, 0.9])
    # one box of a wait is what it was: hundreds of frames do not show it
    odd = pattern("0" * 50 + "1" + "0" * 49)
    odd.t_s[:] = 3.0
    assert of_looks(odd) is odd


def test_the_share_of_frames_with_a_sign_is_counted_between_its_first_and_last_box() -> None:
    # 4 of 5 inner frames, and 1 of 2 where boxes that were not due say nothing
    both = [pattern("0011011100"), pattern("1..0111")]
    assert _found_rate(both[:1]) == pytest.approx(3.0 / 4.0)
    assert _found_rate(both) == pytest.approx(5.0 / 7.0)
    assert _found_rate([]) == 0.5


def test_a_signs_pattern_is_as_likely_as_drawn_ones_are_often() -> None:
    """Signs with rates of their own and something that comes and goes before them, drawn."""
    rng = np.random.default_rng(3)
    n, steps, rate = 200_000, 5, 0.8
    own = rng.beta(limits.RATE_SPREAD * rate, limits.RATE_SPREAD * (1.0 - rate), n)
    hidden = rng.random(n) < limits.HIDDEN
    drawn = np.zeros((n, steps), bool)
    for k in range(steps):
        anew = rng.random(n) > np.exp(-0.3 / limits.HIDDEN_S)
        hidden = np.where(anew & (k > 0), rng.random(n) < limits.HIDDEN, hidden)
        drawn[:, k] = rng.random(n) < np.where(hidden, limits.STRAY_FRAME, own)
    for text in ("11111", "11110", "01111", "10101", "11000"):
        often = np.mean((drawn == [c == "1" for c in text]).all(axis=1))
        told = np.exp(pattern_nats([pattern(text, 0.3)], rate)[0])
        assert told == pytest.approx(often, abs=4.0 * np.sqrt(often / n) + 1e-5), text


def test_what_is_seen_now_and_then_is_a_thing_and_what_a_lorry_hides_a_sign() -> None:
    def for_a_thing(text: str) -> float:
        return thing_nats(pattern(text).seen) - float(pattern_nats([pattern(text)], 0.95)[0])

    # one of thirty boxes of a thing in 33 frames: 1 / (2 * 528)
    assert thing_nats(pattern("1" + "0" * 31 + "1").seen) == pytest.approx(-np.log(2.0 * 528.0))
    now_and_then = "000000100100" + "0" * 21
    assert for_a_thing(now_and_then) > 8.0
    assert for_a_thing("1" * 12) < -2.0
    # as often, but all in a row before something hides it
    behind = "1" * 6 + "0" * 20
    assert for_a_thing(behind) < 0.0 < for_a_thing("1000" * 6 + "00")


def test_between_nodes_the_error_goes_straight_and_is_as_large_as_stated() -> None:
    step, kept = limits.NODE_S, np.exp(-limits.NODE_S / PATH_CORRELATION_S)
    time = step * np.array([7.0, 7.3, 8.9, 12.5, 3.2, 3.7])
    alike, node, between = path_nodes(time, np.array([0, 4, 6]))
    # of the first path nodes 7, 8, 9, 12, 13, of the other 3, 4, and one each for all of them
    assert alike == pytest.approx([0.0, kept, kept, kept**3, kept, 0.0, kept, 0.0, 0.0])
    assert node[:, :2].tolist() == [[0, 1], [0, 1], [1, 2], [3, 4], [5, 6], [5, 6]]
    assert node[:, 2].tolist() == [7, 7, 7, 7, 8, 8]
    before, after, whole = between.T
    assert after[1:] / before[1:] == pytest.approx([3 / 7, 9.0, 1.0, 0.25, 7 / 3])
    assert (before[0], after[0], *whole) == (1.0,) + (0.0,) + (1.0,) * 6
    assert before**2 + after**2 + 2.0 * kept * before * after == pytest.approx(np.ones(6))


def test_an_adjustment_between_its_times_is_on_the_line_between_them() -> None:
    rng, times = np.random.default_rng(5), np.array([2.0, 4.1, 9.0, 12.5])
    error, sd = rng.normal(size=(4, 3)), rng.uniform(0.5, 2.0, (4, 3))
    for t in (-1.0, 2.0, 5.2, 12.5, 14.5):
        told, sd_there = Adjustment(times, error, sd).at(np.array([t]))
        assert told[0] == pytest.approx([np.interp(t, times, error[:, k]) for k in range(3)])
        assert sd_there[0] == pytest.approx([np.interp(t, times, sd[:, k]) for k in range(3)])


def test_the_adjusted_trajectory_is_the_old_one_less_its_error() -> None:
    path = drive_path(20.0, sd_m=2.0)
    time = path.t_ns * 1e-9
    nodes = np.linspace(time[0], time[-1], 5)
    slope = np.array([0.4, -0.3, 0.1])
    error = np.array([3.0, -2.0, 1.0]) + slope * (nodes - nodes[0])[:, None]
    sd = np.tile([0.5, 3.0, 1.0], (5, 1))
    after = shifted(path, Adjustment(nodes, error, sd), ORIGIN)
    before, moved = (local_ned(t.lat_rad, t.lon_rad, t.height_m, ORIGIN) for t in (path, after))
    wanted = np.array([3.0, -2.0, 1.0]) + slope * (time - time[0])[:, None]
    np.testing.assert_allclose(before - moved, wanted, atol=2e-4)
    np.testing.assert_allclose(
        path.vel_ned - after.vel_ned, np.tile(slope, (len(path), 1)), atol=1e-4
    )
    assert after.sd_pos_ned == pytest.approx(np.tile([0.5, 2.0, 1.0], (len(path), 1)))
    assert after.lon_rad == pytest.approx(path.lon_rad, abs=1e-5)
    # also where the date line is crossed
    turn = np.pi - path.lon_rad[1000]
    lon = (path.lon_rad + turn + np.pi) % (2.0 * np.pi) - np.pi
    east = (ORIGIN[0], ORIGIN[1] + turn, ORIGIN[2])
    over = shifted(replace(path, lon_rad=lon), Adjustment(nodes, error, sd), east)
    assert np.abs(over.lon_rad).max() <= np.pi
    np.testing.assert_allclose(np.sin(over.lon_rad - turn), np.sin(after.lon_rad), atol=1e-12)


@dataclass(frozen=True)
class Placed:
    position: FloatArray


def test_a_sighting_goes_with_the_trajectory() -> None:
    adjustment = Adjustment(
        np.array([0.0, 2.0]), np.array([[1.0, 0.0, -1.0], [3.0, 4.0, 1.0]]), np.full((2, 3), 0.7)
    )
    fields = dict.fromkeys(Sighting.__dataclass_fields__, None)
    given = fields | {
        "position": np.array([10.0, 20.0, -2.0]), "time_s": 1.5, "landmark": Placed(np.zeros(3)),
        "path_sd": np.array([0.5, 0.9, 0.7]),
    }  # fmt: skip
    after = shift_sighting(Sighting(**given), adjustment)  # type: ignore[arg-type]
    assert after.position == pytest.approx([10.0 - 2.5, 20.0 - 3.0, -2.0 - 0.5])
    assert after.landmark is given["landmark"], "its views are where they were"
    assert after.path_sd == pytest.approx([0.5, 0.7, 0.7])
