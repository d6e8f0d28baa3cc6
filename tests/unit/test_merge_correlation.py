"""Sightings whose errors east and north go together: merged places against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from merge_scene import ORIGIN, levels_told, to_enu, to_geodetic

from automap.geolocation.limits import NODE_S
from automap.mapping.adjustment import Adjusted, adjust, offsets_of
from automap.mapping.association import associate
from automap.mapping.candidates import (
    D_E,
    D_N,
    D_U,
    EVIDENCE,
    PLACES,
    V_EE,
    V_EN,
    V_NN,
    V_U,
)
from automap.mapping.drive_levels import error_levels
from automap.mapping.limits import COMMON_SD_M, MOST
from automap.mapping.offset_kernels import smooth, vote
from automap.mapping.sightings import DrivePath, DriveSigns, Sightings, stack_sightings

TAU_S = 60.0
START_S = 1.4e9


def drive(
    number: int,
    enu: np.ndarray,
    cov: np.ndarray,
    path_sd: np.ndarray | None = None,
    time_s: np.ndarray | None = None,
) -> DriveSigns:
    """Signs of one class seen at places [n, 3] with covariances [n, 3, 3], ``time_s`` [n] into
    the drive; with ``path_sd`` [3] a trajectory whose error they share."""
    n = len(enu)
    start = START_S + 86400.0 * number
    time = start + (np.zeros(n) if time_s is None else time_s)
    lat, lon, height = to_geodetic(enu)
    path = None
    if path_sd is not None:
        at = start + np.arange(0.0, 300.0, 1.0)
        still = np.ones(len(at))
        path = DrivePath(
            at, ORIGIN[0] * still, ORIGIN[1] * still, 0.0 * still, np.tile(path_sd, (len(at), 1))
        )
    return DriveSigns(
        name=f"drive-{number}",
        start_gps_s=start,
        ids=tuple(f"s{k}" for k in range(n)),
        class_name=np.full(n, "regulatory--stop--g1", object),
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        cov_enu=cov,
        confidence=np.full(n, 0.9),
        n_views=np.full(n, 9, np.int64),
        first_gps_s=time - 2.0,
        last_gps_s=time,
        height_above_road_m=np.full(n, 2.0),
        sd_above_road_m=np.full(n, 0.1),
        facing_rad=np.zeros(n),
        facing_sd_rad=np.full(n, 0.1),
        size_m=np.full(n, 0.7),
        side=np.full(n, "left", object),
        status=np.full(n, "ok", object),
        path=path,
    )


def ellipse(along_m: float, across_m: float, bearing_deg: float, up_m: float = 0.2) -> np.ndarray:
    """Covariance [3, 3] ENU of an error that is long towards a bearing."""
    b = np.radians(bearing_deg)
    along, across = np.array([np.sin(b), np.cos(b)]), np.array([np.cos(b), -np.sin(b)])
    cov = np.diag([0.0, 0.0, up_m**2])
    cov[:2, :2] = along_m**2 * np.outer(along, along) + across_m**2 * np.outer(across, across)
    return cov


def place_of(result: Adjusted) -> np.ndarray:
    return to_enu(result.lat, result.lon, result.height)


def test_two_tilted_ellipses_meet_where_both_allow() -> None:
    """Weights are inverse covariances, the cross terms with their signs."""
    seen = np.array([[0.0, 0.0, 2.0], [0.6, 0.2, 2.4]])
    cov = np.stack([ellipse(0.9, 0.2, 30.0, 0.2), ellipse(0.8, 0.15, 70.0, 0.3)])
    drives = [drive(k, seen[k : k + 1], cov[k : k + 1]) for k in range(2)]
    result = adjust(stack_sightings(drives), np.zeros(2, np.int64))
    total = cov + 0.02**2 * np.eye(3)
    weight = np.linalg.inv(total)
    merged = np.linalg.inv(weight.sum(axis=0))
    place = merged @ np.einsum("nij,nj->i", weight, seen)
    assert place_of(result)[0] == pytest.approx(place, abs=1e-4)
    assert abs(place[0] - 0.3) > 0.1, "the plain mean is no answer"
    assert result.cov_enu[0] == pytest.approx(merged + COMMON_SD_M**2 * np.eye(3), abs=1e-6)
    assert abs(merged[0, 1]) > 0.01


def street() -> tuple[Sightings, np.ndarray]:
    """Three drives over four signs along a street to the north-east, every error its own tilt;
    what a drive's signs share is not alike on the axes. The sign of every sighting."""
    rng = np.random.default_rng(4)
    true = np.column_stack([[0.0, 20.0, 40.0, 60.0], [0.0, 25.0, 40.0, 70.0], [2.0, 3.0, 2.5, 2.0]])
    drives, sign = [], []
    for number, path_sd in enumerate(([0.5, 0.8, 1.1], [0.7, 0.4, 0.9], [0.3, 0.6, 0.5])):
        rows = np.array([0, 1, 2, 3] if number != 1 else [0, 2, 3])
        own = np.stack(
            [ellipse(rng.uniform(0.3, 0.9), 0.15, rng.uniform(10.0, 80.0)) for _ in rows]
        )
        offset = np.array(path_sd) * rng.normal(0.0, 0.5, 3)
        enu = true[rows] + offset + rng.normal(0.0, 0.08, (len(rows), 3))
        time = 20.0 + 30.0 * rows * rng.uniform(0.7, 1.2)
        total = own + np.diag(np.square(path_sd))
        drives.append(drive(number, enu, total, np.array(path_sd), time))
        sign.append(rows)
    return stack_sightings(drives), np.concatenate(sign)


def dense_covariance(sightings: Sightings, tau_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Covariance [3 n, 3 n] of what the drives' signs share and of all errors, ENU by row: between
    nodes what wanders goes straight."""
    n = len(sightings)
    node = np.unique(np.floor(sightings.time_s / NODE_S)[:, None] + [0.0, 1.0])
    share = np.maximum(1.0 - np.abs(sightings.time_s[:, None] / NODE_S - node), 0.0)
    alike = share @ np.exp(-NODE_S * np.abs(node[:, None] - node) / tau_s) @ share.T
    alike /= np.sqrt(np.outer(np.diag(alike), np.diag(alike)))
    shared, own = np.zeros((3 * n, 3 * n)), np.zeros((3 * n, 3 * n))
    for i in range(n):
        ee, en, nn = sightings.own[i]
        own[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = [
            [ee, en, 0.0],
            [en, nn, 0.0],
            [0.0, 0.0, sightings.own_u[i]],
        ]
        for j in range(n):
            if sightings.drive[i] == sightings.drive[j]:
                both = alike[i, j] * sightings.shared_sd[i] * sightings.shared_sd[j]
                shared[3 * i : 3 * i + 3, 3 * j : 3 * j + 3] = np.diag(both)
    return shared, shared + own


def design(sign: np.ndarray) -> np.ndarray:
    """Which sign [m] each sighting [n] is of, for the three axes: [3 n, 3 m]."""
    return np.kron(np.eye(int(sign.max()) + 1)[sign], np.eye(3))


@pytest.mark.parametrize("levels", [(1.0, 1.0, 1.0), (1.5, 1.0, 0.8), (1.1, 0.7, 0.9)])
def test_a_street_is_the_generalised_least_squares_of_all_at_once(
    levels: tuple[float, float, float],
) -> None:
    """Places, covariances, and the drives' offsets with theirs."""
    sightings, sign = street()
    result = adjust(sightings, sign, np.array(levels))
    wander, total = dense_covariance(sightings, TAU_S)
    own = levels[2] ** 2 * (total - wander)
    wanders, lasts = 0.5 * levels[0] ** 2, 0.5 * levels[1] ** 2
    # of heights both together are no less than stated
    level = np.sqrt(np.tile([lasts, lasts, max(lasts, 1.0 - wanders)], len(sightings)))
    shared = wanders * wander + level[:, None] * level * dense_covariance(sightings, 1e12)[0]
    total = shared + own
    z = to_enu(sightings.lat, sightings.lon, sightings.height).ravel()
    a, weight = design(sign), np.linalg.inv(total)
    normal = np.linalg.inv(a.T @ weight @ a)
    place = normal @ a.T @ weight @ z
    assert place_of(result) == pytest.approx(place.reshape(-1, 3), abs=2e-3)
    for k in range(int(sign.max()) + 1):
        at = slice(3 * k, 3 * k + 3)
        expected = normal[at, at] + COMMON_SD_M**2 * np.eye(3)
        assert result.cov_enu[k] == pytest.approx(expected, abs=1e-4)
    # the shared part given all measurements, the places' own error in it
    gain = shared @ weight
    offset = gain @ (z - a @ place)
    assert result.offset == pytest.approx(offset.reshape(-1, 3), abs=2e-3)
    left = shared - gain @ shared + gain @ a @ normal @ a.T @ gain.T
    for number in range(3):
        rows = np.flatnonzero(sightings.drive == number)
        for axis in range(3):
            at = 3 * rows + axis
            assert result.drive_offset[number, axis] == pytest.approx(offset[at].mean(), abs=2e-3)
            sd = np.sqrt(left[np.ix_(at, at)].mean())
            assert result.drive_sd[number, axis] == pytest.approx(sd, rel=2e-3)


def test_a_sighting_too_far_off_along_its_short_axis_counts_less() -> None:
    """Two metres along the ellipses' long axis are no surprise, across it they are."""
    cov = np.tile(ellipse(1.2, 0.15, 45.0), (4, 1, 1))
    way = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    moved = []
    for direction in (way, way * [1.0, -1.0, 1.0]):
        seen = np.zeros((4, 3))
        seen[3] = 2.0 * direction
        drives = [drive(k, seen[k : k + 1], cov[k : k + 1]) for k in range(4)]
        sightings = stack_sightings(drives)
        moved.append(float(place_of(adjust(sightings, np.zeros(4, np.int64)))[0] @ direction))
    assert moved[0] == pytest.approx(0.5, abs=0.01)
    assert moved[1] < 0.1


def test_levels_are_as_large_as_errors_are() -> None:
    """Where drives state half of their own errors, tilted ones, the level of these is twice."""
    rng = np.random.default_rng(2)
    n = 15
    true = np.column_stack([np.arange(n) * 9.0, np.arange(n) * 12.0, np.full(n, 2.0)])
    cov = np.tile(ellipse(0.6, 0.1, 36.9), (n, 1, 1))
    error = rng.multivariate_normal(np.zeros(3), cov[0], (4, n))
    found = []
    for factor in (1.0, 2.0):
        drives = [
            drive(number, true + factor * error[number], cov, np.full(3, 1e-3), np.arange(n))
            for number in range(4)
        ]
        found.append(levels_told(stack_sightings(drives), np.tile(np.arange(n), 4))[0][2])
    assert found[0] == pytest.approx(1.0, rel=0.15)
    # what was stated beforehand holds it back a little
    assert 1.8 < found[1] / found[0] < 2.02


def grouped(drives: list[DriveSigns], again: bool = True) -> np.ndarray:
    sightings = stack_sightings(drives)
    found = associate(sightings)
    return associate(sightings, found, offsets_of(sightings, found)) if again else found


def test_places_differ_along_the_long_axis_of_their_errors_and_not_across_it() -> None:
    for bearing in (45.0, -45.0):
        cov = ellipse(1.5, 0.2, bearing)[None]
        b = np.radians(bearing)
        along = np.array([[np.sin(b), np.cos(b), 0.0]])
        across = np.array([[np.cos(b), -np.sin(b), 0.0]])
        first = drive(0, np.zeros((1, 3)), cov)
        assert grouped([first, drive(1, 2.5 * along, cov)]).tolist() == [0, 0]
        assert grouped([first, drive(1, 2.5 * across, cov)]).tolist() == [0, 1]


@pytest.mark.parametrize("bearings", [(30.0, 75.0), (60.0, 15.0)])
def test_a_third_sighting_is_sought_where_two_tilted_errors_cross(
    bearings: tuple[float, float],
) -> None:
    """Two sightings along rays from the south-west: their sign stands 3 m before either."""
    crossing = np.array([4.0, 4.0, 0.0])
    drives = []
    for number, bearing in enumerate(bearings):
        b = np.radians(bearing)
        seen = crossing - 3.0 * np.array([np.sin(b), np.cos(b), 0.0])
        drives.append(drive(number, seen[None], ellipse(2.5, 0.15, bearing)[None]))
    sharp = (0.1**2 * np.eye(3))[None]
    # at first each drive meets the map of those before it
    third = drive(2, crossing[None], sharp)
    assert grouped([*drives, third], again=False).tolist() == [0, 0, 0]
    beside = drive(2, crossing[None] + [[1.2, -1.2, 0.0]], sharp)
    assert grouped([*drives, beside], again=False).tolist() == [0, 0, 1]


def candidates(places: np.ndarray, covs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One candidate for every sighting: its place relative to the map sign's."""
    n = len(places)
    index = np.full((n, MOST), -1, np.int64)
    index[:, 0] = np.arange(n)
    values = np.zeros((n, MOST, PLACES))
    values[:, 0, [D_E, D_N, D_U]] = places
    values[:, 0, V_EE], values[:, 0, V_EN] = covs[:, 0, 0], covs[:, 0, 1]
    values[:, 0, V_NN], values[:, 0, V_U] = covs[:, 1, 1], covs[:, 2, 2]
    values[:, 0, EVIDENCE] = 30.0
    return index, values


def test_each_stretch_of_a_drive_has_the_offset_that_most_of_its_sightings_agree_with() -> None:
    rng = np.random.default_rng(7)
    n, sd = 10, np.array([2.0, 3.0, 1.5])
    covs = np.stack([ellipse(0.9, 0.2, bearing, 0.3) for bearing in rng.uniform(10.0, 80.0, n)])
    true = np.repeat([[1.5, -2.0, 0.7], [-1.0, 0.5, 0.0]], 5, axis=0)
    places = true + 0.2 * rng.standard_normal((n, 3))
    strays = [1, 7]
    places[strays] = [4.0, 4.0, 0.5]
    time = np.concatenate([80.0 + 7.0 * np.arange(5), 200.0 + 6.0 * np.arange(5)])
    index, values = candidates(places, covs)
    # as of one class: a stray may be a sign that the map does not hold yet
    values[:, 0, EVIDENCE] = 2.0
    offset, variance = np.zeros((2, n, 3))
    vote(time, np.tile(sd, (n, 1)), index, values, offset, variance)
    for rows in (slice(0, 5), slice(5, 10)):
        assert (offset[rows] == offset[rows][0]).all()
        proposed = [k for k in range(n)[rows] if k not in strays]
        assert (places[proposed] == offset[rows][0]).all(axis=1).any()
        # it wanders from the middle on
        assert variance[rows][2] == pytest.approx(0.0, abs=1e-9)
        assert (variance[rows][0] > variance[rows][1]).all()


def test_offsets_along_a_drive_are_the_conditional_mean_of_the_process() -> None:
    """Kalman and Rauch-Tung-Striebel against the covariances of all instants at once."""
    rng = np.random.default_rng(8)
    n = 9
    time = np.cumsum(rng.uniform(1.0, 40.0, n))
    shared = np.column_stack([rng.uniform(0.5, 1.5, n) for _ in range(3)])
    covs = np.stack([np.diag(rng.uniform(0.05, 0.6, 3)) for _ in range(n)])
    places = 0.3 * rng.standard_normal((n, 3))
    _, values = candidates(places, covs)
    chosen = np.zeros(n, np.int64)
    chosen[[2, 6]] = -1
    values[4, 0, V_U] = np.nan
    offset, variance = np.zeros((n, 3)), np.zeros((n, 3))
    smooth(time, shared, chosen, values, offset, variance)
    for axis, column in enumerate((V_EE, V_NN, V_U)):
        sd = np.sqrt(2.0 * shared[:, axis] ** 2 + 1e-4)
        prior = np.outer(sd, sd) * np.exp(-np.abs(time[:, None] - time) / TAU_S)
        rows = np.flatnonzero((chosen >= 0) & np.isfinite(values[:, 0, column]))
        noisy = prior[np.ix_(rows, rows)] + np.diag(values[rows, 0, column])
        gain = np.linalg.solve(noisy, prior[rows]).T
        assert offset[:, axis] == pytest.approx(gain @ places[rows, axis], abs=1e-9)
        left = np.diag(prior - gain @ prior[rows])
        assert variance[:, axis] == pytest.approx(left, abs=1e-9)


def test_a_size_that_all_drives_took_a_sign_for_is_not_averaged_away() -> None:
    # ten signs seen from afar, whose sizes move them 5 m to the east in every drive, and ten near
    # ones; drives scatter by a third of what they state
    rng = np.random.default_rng(5)
    places = np.column_stack([rng.uniform(-150, 150, (20, 2)), np.full(20, 2.0)])
    places[:, 0] = np.linspace(-500, 500, 20)
    far = np.arange(20) % 2 == 1
    effect = np.where(far, 5.0, 0.05)
    cov = np.array([ellipse(6.0 if f else 0.6, 0.6, 90.0) for f in far])
    wrong = np.column_stack([effect * rng.standard_normal(20), np.zeros((20, 2))])

    def once(number: int, along: np.ndarray = effect, moved: np.ndarray = wrong) -> DriveSigns:
        scatter = rng.normal(0.0, 0.2, (20, 3))
        told = drive(number, places + moved + scatter, cov)
        nothing = np.zeros(20)
        return replace(told, by_size_e_m=along, by_size_n_m=nothing, by_size_u_m=nothing)

    def merged(drives: list[DriveSigns]) -> tuple[Adjusted, np.ndarray]:
        sightings, same = stack_sightings(drives), np.tile(np.arange(20), len(drives))
        levels, _ = levels_told(sightings, same)
        return adjust(sightings, same, levels), levels

    found, levels = merged([once(k) for k in range(4)])
    sd = np.sqrt(found.cov_enu[:, 0, 0])
    assert levels[2] < 0.6
    assert np.all((sd[far] > 5.0) & (sd[far] < 5.7))
    assert sd[~far].max() < 0.25
    # one drive that sees all from near settles it
    near = once(4, np.full(20, 0.05), 0.01 * wrong)
    near = replace(near, cov_enu=np.tile(cov[0], (20, 1, 1)))
    sd = np.sqrt(merged([*(once(k) for k in range(3)), near])[0].cov_enu[:, 0, 0])
    assert sd.max() < 0.7


def test_a_few_drives_more_move_no_levels_of_the_others() -> None:
    rng = np.random.default_rng(3)
    freedom = rng.uniform(5.0, 40.0, (300, 3))
    squares = np.stack([freedom * rng.lognormal(0.0, 0.5, (300, 3)), freedom], axis=-1)
    before = error_levels([(np.arange(297), squares[:297])], 300)
    after = error_levels([(np.arange(300), squares)], 300)
    assert np.array_equal(before[0], after[0])
    assert np.array_equal(before[1][:297], after[1][:297])
