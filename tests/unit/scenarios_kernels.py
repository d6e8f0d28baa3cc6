"""Kernels of the fusion one by one, with inputs in which every term is as large as the others."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.unit.figure_calls import after
from tests.unit.scenarios import scenario


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def _turned(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A quaternion [4] and its matrix [3, 3]."""
    from automap.frames import quat_to_matrix

    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    return q, quat_to_matrix(q[None])[0]


def _spd(rng: np.random.Generator, n: int) -> np.ndarray:
    root = rng.normal(size=(n, n))
    return np.asarray(root @ root.T + 0.5 * np.eye(n))


@scenario
def kernels_mechanisation() -> Any:
    """Turns, and single steps on a small Earth that turns fast."""
    from automap.fusion.mechanisation import (
        _half_turn,
        earth_terms,
        quat_to_dcm,
        rotate_left,
        rotate_right,
        strapdown_step,
    )

    rng = _rng(1)
    found: dict[str, Any] = {}
    for k in range(3):
        q, c = _turned(rng)
        place = np.array([0.5 - 0.7 * k, 0.3, 900.0])
        found[f"place {k}"] = [
            after(earth_terms, place, on, np.full(9, np.nan)) for on in (False, True)
        ]
        found[f"matrix {k}"] = after(quat_to_dcm, q, np.zeros((3, 3)))
        x, y, z = (0.9, 4e-3, 1e-3)[k] * np.array([0.7, -1.1, 0.4])
        found[f"turn {k}"] = [
            after(_half_turn, (3.0, 9e-5, 2e-4)[k]),
            after(rotate_left, q, x, y, z),
            after(rotate_right, 1.3 * q, x, y, z),
        ]
        rates = rng.uniform(-1.5, 1.5, (2, 6)) * np.array([1.0, 1.0, 1.0, 9.0, 9.0, 9.0])
        earth = np.array([700.0, 1500.0, 9.7, 60.0, 0.64, 0.77, 0.31, -0.42, 0.69])
        found[f"step {k}"] = after(
            strapdown_step,
            np.array([0.72, 0.4, 81.0]),
            rng.uniform(-70.0, 70.0, 3),
            q,
            c,
            *rates,
            0.4,
            earth,
            np.zeros(3),
        )
    # on the Earth's own gradient of gravity alone: falling from far up
    found["fall"] = after(
        strapdown_step,
        np.array([0.72, 0.4, 4e6]),
        np.array([0.1, 0.2, 0.3]),
        *_turned(rng),
        np.zeros(6),
        np.zeros(6),
        0.2,
        np.array([6.3e6, 6.4e6, 9.7, 60.0, 0.64, 0.77, 0.0, 0.0, 0.69]),
        np.zeros(3),
    )
    return found


def _started(phi: Any, noise: Any) -> None:
    """An interval as it begins, without noise."""
    from automap.fusion.kernels.transition import start_interval
    from tests.unit.figure_calls import plain

    plain(start_interval)(phi)
    noise[:] = 0.0


@scenario
def kernels_transition() -> Any:
    """Rows, noise, covariance and error estimate over an interval."""
    from automap.fusion.kernels.transition import (
        N_NOISE,
        add_noise,
        add_transition,
        carry_mean,
        end_interval,
        expand_noise,
        outlasting,
        propagate_covariance,
        reach,
    )

    rng = _rng(2)
    n = 14
    phi = rng.normal(size=(9, n))
    part = phi.copy()
    part[:, 12:] = 0.0
    part[:8, 11] = 0.0
    terms = np.array([[0, 0, 0, 0], [0, 2, 4, 1], [1, 1, 0, 2], [1, 2, 8, 3], [0, 1, 7, 4]])
    _, c = _turned(rng)
    reading, force = rng.normal(size=8), rng.normal(size=3)
    tau = np.where(np.arange(n) % 3 == 1, 0.0, 0.7 + 0.1 * np.arange(n))
    kept = np.where(np.arange(n) % 4 == 1, -1, np.arange(n) % 3)
    keep = np.array([0.6, 1.3, 0.8])
    walk = rng.uniform(0.2, 2.0, n)
    decay = np.where(tau > 0.0, rng.uniform(0.3, 0.9, n), 1.0)
    xi = rng.normal(size=n - 9)
    return {
        "start": after(_started, phi, np.full(N_NOISE, 2.0)),
        "reach": [after(reach, each) for each in (phi, part, np.zeros((9, n)))],
        "rows": after(add_transition, phi, terms, c, reading, force, 0.6),
        "noise": [
            after(add_noise, rng.normal(size=N_NOISE), rng.normal(size=3), 0.7, 0.9, 1.3)
            for _ in range(3)
        ],
        "whole": after(expand_noise, rng.normal(size=N_NOISE), np.full((9, 9), np.nan)),
        "left": after(outlasting, 0.4, tau, kept, keep, np.full(n, 3.0)),
        "end": after(
            end_interval,
            *(phi, 0.4, tau, walk, np.full(n, 3.0), np.full(n, 3.0), xi, kept, keep),
        ),
        "covariance": [
            after(
                propagate_covariance,
                *(_spd(rng, n), each, _spd(rng, 9), decay, walk, np.zeros((9, n))),
            )
            for each in (phi, part)
        ],
        "mean": after(carry_mean, rng.normal(size=n), phi, decay, xi, 2.0 * xi[::-1], np.zeros(n)),
    }


@scenario
def kernels_axis() -> Any:
    """Smoother and whitener of one axis, with fixes that lack a part and some that are off."""
    from automap.fusion.kernels.axis import _sandwich, predict, smooth_axis, start, step
    from automap.fusion.kernels.whiten import whiten_axis

    rng = _rng(3)
    n = 14
    t = np.cumsum(rng.uniform(0.3, 1.7, n))
    z = np.column_stack([np.cumsum(rng.normal(1.0, 2.0, n)), rng.normal(1.0, 2.0, n)])
    z[5] += 60.0
    used = rng.uniform(size=(n, 2)) > 0.25
    used[:2, 0] = False
    var, lasting = rng.uniform(0.5, 2.0, (n, 2)), rng.uniform(0.4, 1.5, (n, 2))
    rest = (used, var, lasting, 0.8, (2.3, 3.9))
    columns = np.stack([z, rng.normal(size=(n, 2)), rng.normal(2.0, 3.0, (n, 2))], axis=2)
    p, f = _spd(rng, 4), np.zeros((4, 4))
    f[np.arange(4), np.arange(4)] = 1.0, 0.9, 0.8, 0.6
    return {
        "start": after(start, np.zeros((4, 4))),
        "step": after(step, p, 0.7, (2.3, 3.9)),
        "predict": after(predict, p, f, 0.7, 0.8, np.zeros((4, 4))),
        "sandwich": after(_sandwich, p + np.triu(p), p, np.arange(4.0), f, np.zeros(4)),
        "smoothed": [after(smooth_axis, t, z, *rest, g, np.zeros((n, 4))) for g in (4.0, 1e9)],
        "score": after(smooth_axis, t, z, *rest, 4.0, np.zeros((0, 4))),
        "white": [
            after(whiten_axis, t, columns, *rest, g, np.zeros((n, 2, 3))) for g in (4.0, 9e9)
        ],
    }


@scenario
def kernels_state() -> Any:
    """States against each other, moved, and between samples, over the date line too."""
    from automap.fusion.kernels.resample import interpolate_states
    from automap.fusion.kernels.state import apply_correction, inject, load_state, subtract

    rng = _rng(4)
    found: dict[str, Any] = {}
    rows = np.zeros((5, 10))
    for k in range(5):
        rows[k, :6] = 0.3 + 0.2 * k, 3.1 - 0.3 * k, 900.0 + 1e5 * k, *rng.normal(0.0, 9.0, 3)
        rows[k, 6:] = _turned(rng)[0]
    rows[3, 1], rows[4, 1] = 3.1, -3.1
    near = rows[1] + np.array([2e-6, -3e-6, 4.0, 0.5, -0.6, 0.7, 0.0, 0.0, 0.0, 0.0])
    near[6:] = -near[6:]
    pairs = ((0, 1), (1, 2), (3, 4), (4, 3))
    for k, (a, b) in enumerate(pairs):
        pos, vel, q = rows[a, :3], rows[a, 3:6], rows[a, 6:]
        found[f"apart {k}"] = after(subtract, pos, vel, q, rows[b], np.zeros(11))
        error = rng.normal(size=12) * np.repeat([1e5, 3.0, 0.4, 1.0], 3)
        xi = rng.normal(size=3)
        found[f"moved {k}"] = after(inject, pos, vel, 1.02 * q, np.zeros((3, 3)), xi, error)
    found["near"] = after(subtract, near[:3], near[3:6], near[6:], rows[1], np.zeros(9))
    found["loaded"] = after(
        load_state, rows[2], rng.normal(size=3), *(np.zeros(n) for n in (3, 3, 4)),
        np.zeros((3, 3)), np.zeros(3),
    )  # fmt: skip
    errors = rng.normal(size=(5, 12)) * np.repeat([1e4, 3.0, 0.4, 1.0], 3)
    found["corrected"] = after(apply_correction, rows, rng.normal(size=(5, 3)), errors)
    t = np.array([0.0, 30.0, 80.0, 120.0, 121.0])
    rows[:, 3:6] *= np.array([30.0, -20.0, 40.0])
    want = np.array([-2.0, 0.0, 7.0, 30.0, 41.0, 77.0, 90.0, 120.3, 120.8, 121.0, 124.0])
    for states in (rows, rows[:2], rows * np.where(np.arange(10) == 1, -1.0, 1.0)):
        found[f"between {len(found)}"] = after(
            interpolate_states, t[: len(states)], states, want, np.zeros((len(want), 10))
        )
    return found


def _samples(rng: np.random.Generator, n: int, extra: int) -> Any:
    from automap.fusion.arrays import Samples

    t = np.cumsum(rng.uniform(0.006, 0.015, n))
    t[n // 2 :] += 0.17
    raw = rng.uniform(-0.9, 0.9, (n, 6)) * np.repeat([1.0, 9.0], 3)
    return Samples(
        t,
        raw,
        rng.normal(size=(n, extra)),
        rng.normal(size=(n, 6)) * np.repeat([0.2, 5.0], 3),
        rng.uniform(0.1, 0.5, (n, 2)),
    )


TERMS = np.array(
    [
        *([0, 0, 0, 0], [0, 2, 3, 1], [1, 1, 0, 2], [1, 0, 5, 3]),
        *([0, 1, 7, 4], [1, 2, 8, 5], [1, 1, 1, 6]),
    ]
)


def _model(n: int, gap_s: float) -> Any:
    from automap.effects.term_sums import Terms
    from automap.fusion.arrays import ModelArrays

    none = Terms(np.zeros((0, 4), np.int64), np.zeros(0))
    return ModelArrays(
        TERMS,
        none,
        none,
        none,
        np.linspace(0.5, 1.5, n),
        np.linspace(2.0, 1.0, n),
        np.full(n, -1),
        np.array([0.3, 0.4]),
        gap_s,
        np.array([4.0, 6.0, 8.0, 50.0, 9.0]),
        True,
    )


def _integrated(samples: Any, model: Any, *rest: Any) -> Any:
    """A state carried on as ``integrate`` does it, with the noise of its steps."""
    from automap.fusion.kernels.integrate import integrate, sum_noise
    from tests.unit.figure_calls import plain

    *before, noise, rate, now, mid = rest
    room = np.full((99, 3), np.nan), np.full(99, np.nan), np.zeros(99, np.int64)
    i, done = plain(integrate)(samples, model, *before, rate, now, mid, 7, *room)
    assert not np.isfinite(room[1][:7]).any()
    plain(sum_noise)(samples, model, *(each[7:done] for each in room), noise)
    return i


@scenario
def kernels_readings() -> Any:
    """Readings put right, at samples and between them, and integrated over a gap."""
    from automap.fusion.kernels.dense import _spread, run_dense
    from automap.fusion.kernels.integrate import reading_at
    from automap.fusion.kernels.readings import (
        acceleration,
        correct,
        correction_of,
        raw_at,
        shift_of,
        take_noise_out,
    )

    rng = _rng(5)
    samples = _samples(rng, 12, 2)
    bare = samples._replace(extra=np.zeros((12, 0)))
    theta = rng.uniform(-0.3, 0.3, len(TERMS))
    matrix, shift = rng.normal(size=(6, 6)), rng.normal(size=6)
    _, c = _turned(rng)
    span = samples.t[4] - samples.t[3]
    times = samples.t[3] + span * np.array([-0.4, 0.3, 1.6])
    found: dict[str, Any] = {
        "raw": [after(raw_at, samples, 3, t, np.zeros(6)) for t in times],
        "inverse": after(correction_of, TERMS, theta, samples.extra[2], matrix, shift),
        "shift": after(shift_of, TERMS, theta, samples.extra[3], matrix, shift),
        "correct": after(correct, samples.raw[2], matrix, shift, np.zeros(6)),
        "calm": [after(take_noise_out, samples, 3, t, 6, np.ones(6)) for t in times],
        "force": [
            after(acceleration, samples, 3, t, 9.7, c, np.array([0.3, -0.8, -9.1]), np.zeros(3))
            for t in times
        ],
    }
    place = np.array([700.0, 1500.0, 9.7, 60.0, 0.64, 0.77, 0.31, -0.42, 0.69])
    pos = np.array([0.72, 0.4, 81.0])
    n = 9 + len(TERMS)
    for name, model, used, terms in (
        ("short", _model(n, 0.1), samples, TERMS),
        ("wide", _model(n, 1.0), samples, TERMS),
        ("bare", _model(n, 0.1)._replace(terms=TERMS[:4]), bare, TERMS[:4]),
    ):
        xi = theta[: len(terms)]
        width = 6 + used.extra.shape[1]
        phi, noise = rng.normal(size=(9, 9 + len(terms))), rng.normal(size=29)
        for k, (i, first, last) in enumerate(((2, 2.3, 8.7), (0, 0.0, 3.0), (8, 8.2, 13.5))):
            steps = np.concatenate([used.t, used.t[-1] + np.arange(1.0, 4.0) * 0.05])
            t0, t1 = np.interp([first, last], np.arange(len(steps)), steps)
            found[f"{name} {k}"] = after(
                _integrated,
                *(used, model, i, t0, t1, pos, rng.normal(0.0, 9.0, 3), *_turned(rng), xi),
                *(place, phi, noise, np.zeros(3), np.zeros(6), np.zeros(width)),
            )
        found[f"{name} at"] = after(
            reading_at, used, model, 4, float(used.t[4]) + 0.002, xi, np.zeros(3), np.zeros(width)
        )
        node_t = np.interp([1.4, 3.0, 3.0, 5.4, 9.7], np.arange(12), used.t)
        nominal = np.column_stack(
            [
                0.7 + 1e-6 * np.arange(5.0),
                0.4 - 2e-6 * np.arange(5.0),
                90.0 + np.arange(5.0),
                rng.normal(0.0, 9.0, (5, 3)),
                np.stack([_turned(rng)[0] for _ in range(5)]),
            ]
        )
        params = rng.uniform(-0.3, 0.3, (5, len(terms)))
        rates = np.full((12, 6), np.nan)
        runs = (
            (node_t, True, rates),
            (node_t, False, rates),
            (node_t, True, rates[:0]),
            (np.append(used.t[2], node_t[1:]), True, rates),
            (np.append(used.t[0] - 0.001, node_t[1:3]), False, rates),
            (np.append(node_t[2:4], used.t[-1] + 0.05), True, rates),
        )
        for k, (at, blend, told) in enumerate(runs):
            first = 5 - len(at) if k == 5 else 0
            part = slice(first, first + len(at))
            found[f"{name} dense {k}"] = after(
                run_dense,
                *(used, model, at, nominal[part], params[part], blend),
                *(np.full((12, 10), np.nan), told),
            )
    states = np.tile(np.concatenate([pos, [1.0, 2.0, 3.0], _turned(rng)[0]]), (12, 1))
    ends = float(samples.t[2]) - 0.003, float(samples.t[6]) + 0.004
    miss = np.array([70.0, -90.0, 8.0, 0.5, -0.6, 0.7, 0.3, -0.4, 0.5])
    found["spread"] = after(_spread, samples, 3, 6, *ends, miss, 700.0, 1500.0, states)
    return found


@scenario
def kernels_update() -> Any:
    """Blocks of one to three scalars, sound and surprising."""
    from automap.fusion.kernels.update import (
        _quadratic,
        block_gains,
        inflate,
        pack,
        unpack,
        update_block,
    )

    rng = _rng(6)
    n = 6
    p = _spd(rng, n)
    row = np.zeros(n * (n + 1) // 2)
    found: dict[str, Any] = {
        "pack": after(pack, p + np.tri(n), row),
        "unpack": after(unpack, np.arange(1.0, 22.0), np.zeros((n, n))),
    }
    for m in (1, 2, 3):
        h, z, var = rng.normal(size=(m, n)), rng.normal(0.0, 9.0, m), rng.uniform(0.5, 2.0, m)
        h[0, 2] = 0.0
        unit, dx, nu = rng.normal(size=(m, n)), rng.normal(size=n), rng.normal(size=m)
        found[f"gains {m}"] = after(
            block_gains, p, h, z, var, dx, unit, 0.0 * unit, np.zeros(m), np.ones(m)
        )
        found[f"update {m}"] = after(update_block, p, dx, unit, 0.3 * unit, nu)
        found[f"inflate {m}"] = [
            after(inflate, p, h, size * z, var, m, limit, most)
            for size, limit, most in (
                (1.0, 2.0, 1e3),
                (9.0, 2.5, 40.0),
                (2.0, 1e-3, 90.0),
                (0.01, 2.0, 1e3),
            )
        ]
        found[f"square {m}"] = after(_quadratic, _spd(rng, m), z, var, m, 1.7)
    found["flat"] = after(_quadratic, -np.eye(2), np.full(2, 1e-150), np.zeros(2), 2, 1.0)
    return found


def _store(rng: np.random.Generator, n: int) -> Any:
    """What a forward pass over five nodes might have left, one of which saw nothing."""
    from automap.fusion.arrays import ForwardStore

    scalars = np.array([2, 2, 5, 6, 9])
    k, s = len(scalars), int(scalars[-1])
    of = np.searchsorted(scalars, np.arange(s), side="right")
    channel = np.array([0, 1, 3, 4, 5, 6, 0, 1, 2])
    trans = rng.normal(size=(k, 9, n))
    trans[1, :, n - 2 :] = 0.0
    return ForwardStore(
        rng.normal(size=(k, 10)),
        rng.normal(size=(k, n - 9)),
        rng.normal(size=(k, n)),
        0.4 * trans,
        np.stack([_spd(rng, n)[np.triu_indices(n)] for _ in range(k)]),
        scalars,
        0.5 * rng.normal(size=(s, n)),
        0.2 * rng.normal(size=(s, n)),
        rng.normal(size=s),
        rng.uniform(0.5, 2.0, s),
        np.array([1.0, 1.0, 2.5, 2.5, 1.0, 1.0, 1e6, 1e6, 1.0]),
        np.column_stack([of, channel, np.ones(s, int)]),
        rng.uniform(0.0, 9.0, (k, 15)),
    )


@scenario
def kernels_smoother() -> Any:
    """Back over nodes, and what noise levels make of the likelihood."""
    from automap.fusion.kernels.level_slopes import _handed_on, _inertial, level_slopes
    from automap.fusion.kernels.smoother import (
        _smoothed_rows,
        _smoothed_variances,
        run_smoother,
        undo_interval,
        undo_scalars,
    )

    rng = _rng(7)
    n = 13
    store = _store(rng, n)
    lam, big = rng.normal(size=n), _spd(rng, n)
    decay = np.where(np.arange(n) > 9, rng.uniform(0.4, 0.9, n), 1.0)
    node_t = np.array([1.0, 1.4, 2.1, 2.5, 3.8])
    keep = rng.uniform(0.7, 1.3, (5, 3))
    kept = np.where(np.arange(n) % 4 == 1, -1, np.arange(n) % 3)
    tau = np.where(np.arange(n) % 3 == 1, 0.0, 0.7 + 0.1 * np.arange(n))
    walk = rng.uniform(0.2, 2.0, n)
    of_channel = np.arange(15) % 4 - 1
    of_state = np.arange(n) % 5 - 1
    of_time = np.where(np.arange(n) % 3 == 2, np.arange(n) % 2 + 4, -1)
    found: dict[str, Any] = {
        "interval": [after(undo_interval, lam, big, store.trans[k], decay) for k in (0, 1)],
        "rows": after(_smoothed_rows, big + np.tri(n), big, np.array([0, 4, 11]), np.zeros((3, 3))),
        "variances": after(_smoothed_variances, big + np.tri(n), big, np.zeros(n - 9)),
        "inertial": after(
            _inertial, lam, big, store.trans[2], np.array([0.3, 0.8]), 0.7, np.ones(6), np.ones(6)
        ),
        "handed": after(_handed_on, lam, big, store.trans[3], 6, 0.9, 1, np.zeros(6), np.zeros(6)),
    }
    for a, b in ((0, 0), (2, 5), (6, 9), (5, 6)):
        rows = (store.h[a:b], store.gain[a:b], store.nu[a:b], store.var[a:b])
        found[f"scalars {a} {b}"] = after(undo_scalars, lam, big, *rows, np.zeros(4), np.zeros(4))
    for every_s in (0.0, 1.2, 50.0):
        found[f"run {every_s}"] = after(
            run_smoother,
            *(node_t, keep, kept, tau, store, np.array([0, 4, 11]), every_s, lam, big),
            *(np.zeros((5, n)), np.zeros((5, 3, 3)), np.zeros((5, n - 9))),
        )
    found["without"] = after(
        run_smoother,
        *(node_t, keep, kept, tau, store, np.array([0, 4, 11]), 1.2, lam, big),
        *(np.zeros((5, n)), np.zeros((0, 3, 3)), np.zeros((5, n - 9))),
    )
    var = rng.uniform(0.5, 2.0, (5, 15))
    for same in (node_t, np.array([1.0, 1.0, 2.1, 2.5, 3.8])):
        found[f"levels {same[1]}"] = after(
            level_slopes,
            *(same, var, keep, kept, tau, walk, np.array([0.3, 0.8]), of_channel, of_state),
            *(of_time, store, 1e6, np.array([0.0, 1.0]), *np.zeros((2, 1, 6)), np.zeros(5, int)),
        )
    return found
