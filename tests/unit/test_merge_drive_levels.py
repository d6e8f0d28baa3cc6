"""Levels of each drive's errors: squares and how many the signs tell."""

from __future__ import annotations

import numpy as np
import pytest

from automap.mapping.cells import cell_of
from automap.mapping.drive_levels import drive_squares, error_levels
from automap.mapping.path_errors import Equations, Network
from automap.mapping.sightings import DriveSigns, stack_sightings
from tests.unit.test_merge_correlation import drive

DRAWS = 400


def test_squares_are_as_many_as_the_freedom_says() -> None:
    """In the mean over draws of the errors as stated, by group."""
    rng = np.random.default_rng(7)
    paths, each, signs = 3, 9, 6
    n = paths * each
    time_s = np.concatenate([np.sort(rng.uniform(0.0, 120.0, each)) for _ in range(paths)])
    step = np.diff(time_s, prepend=np.inf)
    alike = np.append(np.where(step < 0.0, 0.0, np.exp(-np.abs(step) / 40.0)), np.zeros(paths))
    path = np.repeat(np.arange(paths), each)
    node = np.column_stack([np.arange(n), n + path])
    sd = rng.uniform(0.3, 2.0, (n, 2, 2))
    root = rng.normal(size=(n, 2, 2))
    own = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(2)
    sign = np.concatenate([rng.permutation(np.arange(each) % signs) for _ in range(paths)])
    information = np.linalg.inv(own)
    group = np.concatenate([path, paths + np.arange(paths)])
    squares, freedom = np.zeros((DRAWS, 9)), np.zeros(9)
    order = None
    for draw in range(DRAWS):
        wander = np.zeros((n, 2))
        for k in range(n):
            fresh = rng.normal(size=2) * np.sqrt(1.0 - alike[k] ** 2)
            wander[k] = alike[k] * wander[k - 1] + fresh
        error = np.concatenate([wander, rng.normal(size=(paths, 2))])
        noise = np.einsum("nij,nj->ni", np.linalg.cholesky(own), rng.normal(size=(n, 2)))
        measured = (sd * error[node]).sum(axis=1) + noise + 5.0 * sign[:, None]
        equations = Equations(Network(alike, node, sign, sd, measured, information), order)
        order = equations.order
        found = equations.solve()
        weight = np.ones(n)
        squares[draw], freedom = equations.components(found, weight, group, 6 + path, 9)
    assert squares.mean(axis=0) == pytest.approx(freedom, rel=0.15)
    # of errors and places nothing else is told than there are measurements
    assert freedom.sum() == pytest.approx(2.0 * n - 2.0 * signs)
    assert (freedom > 0.2).all()


def _street(factor: float, seed: int) -> list[DriveSigns]:
    """Eight drives past the same 24 signs, the last of which errs by ``factor`` times what it
    states of its own."""
    rng = np.random.default_rng(seed)
    place = np.column_stack([20.0 * np.arange(24), np.zeros(24), np.full(24, 2.0)])
    cov = np.tile(np.diag([0.3**2, 0.3**2, 0.2**2]), (24, 1, 1))
    time_s = 2.0 * np.arange(24)
    drives = []
    for number in range(8):
        shared = 0.5 * rng.normal(size=3)
        own = rng.normal(size=(24, 3)) * [0.3, 0.3, 0.2] * (factor if number == 7 else 1.0)
        stated = cov + 0.5**2 * np.eye(3)
        sd = np.full(3, 0.5)
        drives.append(drive(number, place + shared + own, stated, sd, time_s))
    return drives


def _factors(drives: list[DriveSigns]) -> np.ndarray:
    sightings = stack_sightings(drives)
    sign = np.tile(np.arange(24), len(drives))
    cells = np.unique(cell_of(sightings.lat, sightings.lon)).tolist()
    told = [drive_squares(sightings, sign, cell) for cell in cells]
    return error_levels(told, len(drives))[1]


def test_a_drive_that_errs_by_more_is_known_by_itself() -> None:
    honest, off, sure = (_factors(_street(factor, 3))[:, 2] for factor in (1.0, 2.0, 0.4))
    # three of its standard errors, and rounding
    assert abs(np.log(honest)).max() < 0.36
    assert off[7] > 1.4 > off[:7].max()
    assert sure[7] < 0.7 < sure[:7].min()


def test_levels_of_drives_do_not_depend_on_their_order() -> None:
    drives = _street(2.0, 4)
    order = [3, 7, 0, 5, 1, 6, 2, 4]
    np.testing.assert_allclose(
        _factors([drives[k] for k in order]), _factors(drives)[order], rtol=1e-12
    )


def test_a_drive_of_one_sign_keeps_the_common_levels() -> None:
    drives = _street(1.0, 5)
    sightings = stack_sightings(drives[:1])
    cells = np.unique(cell_of(sightings.lat, sightings.lon)).tolist()
    told = [drive_squares(sightings, np.arange(24), cell) for cell in cells]
    levels, factors = error_levels(told, 2)
    assert levels.tolist() == [1.0, 1.0, 1.0]
    assert (factors == 1.0).all()


def test_a_cell_in_which_no_sign_stands_tells_nothing() -> None:
    sightings = stack_sightings(_street(1.0, 5)[:1])
    elsewhere = int(cell_of(np.array([0.9]), np.array([2.0]))[0])
    drives, squares = drive_squares(sightings, np.arange(24), elsewhere)
    assert (len(drives), squares.shape) == (0, (0, 3, 2))
