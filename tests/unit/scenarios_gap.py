"""Evidence, noise and scores of the gap finder, part by part."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.fusion.layout import CH_NHC, CH_POS, CH_VEL
from automap.records import FloatArray
from tests.unit.figure_levels import levelled
from tests.unit.scenarios import _or_error, scenario


def _joint() -> Any:
    """Two drives of white rows in several channels, with holes, that four columns explain."""
    from automap.gap.linear import Linear
    from automap.gap.rows import Rows
    from tests.unit.gap_linear import columns_named

    layout = columns_named("e0.p", "e1.p", "e1.q", "e2.p", "e3.p")
    rows = []
    for seed, n in ((1, 700), (2, 450)):
        rng = np.random.default_rng(seed)
        phi = 0.3 * rng.standard_normal((n, 5)) * rng.uniform(0.3, 1.0, (n, 1))
        phi[:, 1] += 0.5 * phi[:, 0]
        channel = rng.choice([CH_POS, CH_POS + 1, CH_VEL, CH_VEL + 2, CH_NHC], n)
        truth = np.array([0.8, 0.6, -0.7, 0.0, 0.5])
        noise = rng.standard_t(4.0, n) * np.where(np.arange(n) % 180 < 60, 2.0, 1.0)
        w = phi @ truth + noise
        # the vehicle's constraint tells the opposite of one
        w -= np.where(channel == CH_NHC, 2.0 * phi[:, 4] * 0.5 + 2.5 * phi[:, 4], 0.0)
        t = np.cumsum(rng.uniform(0.02, 0.3, n)) + np.where(np.arange(n) > n // 2, 25.0, 0.0)
        rows.append(Rows(w, phi, t, channel))
    score = sum((r.phi.T @ r.w for r in rows), np.zeros(5))
    info = sum((r.phi.T @ r.phi for r in rows), np.zeros((5, 5)))
    sds = np.array([0.5, 0.3, 0.8, 0.4, 0.6])
    return Linear(tuple(layout), tuple(rows), None, score, info, sds, np.zeros(5))


def _columns(frame: Any) -> dict[str, Any]:
    return {name: getattr(frame, name) for name in ("t", "drive", "channel")}


@scenario
def gap_parts() -> Any:
    """What evidence is made of: ratios, stretches, folds and what the channels say."""
    from automap.gap import evidence as of
    from automap.gap.linear import Given, conditional
    from automap.gap.stretches import stretches

    linear, rng = _joint(), np.random.default_rng(3)
    parts = ((1,), (1, 2), (3,), (4,), (2, 4))
    found: dict[str, Any] = {}
    for name, given in {"none": Given(), "one": Given((0,), (0.7,))}.items():
        known = conditional(linear, given)
        rows = of._stacked(known, (1, 4))
        estimate = np.array([0.4, -0.3])
        along = rows.phi @ estimate
        at = rows.frame.channel == CH_VEL
        some = rows.side((at, rows.frame.some(at)))
        starts = rows.frame.starts[8.0]
        told = [of.evidence(known, part, least) for part in parts for least in (1.0, 2.5)]
        found[name] = {
            "evidence": told,
            "corrected": [each.corrected(r) for each in told[:4] for r in (0.5, 1.0, 3.0)],
            "plain": [of.plain_nats(known, part) for part in parts],
            "singles": of.singles(known, np.array([1, 2, 3, 4])),
            "inflation": [of.inflation(known, np.array(c)) for c in ([1, 2, 3, 4], [3], [2, 4])],
            "shown": [of.shown_by(known, part) for part in parts],
            "apart": [of.apart(known, one, other) for one in parts[:3] for other in parts[2:]],
            "rows": {"phi": rows.phi, "w": rows.w, **_columns(rows.frame)},
            "some": {"phi": some.phi, "w": some.w, **_columns(some.frame)},
            "contradicted": [
                of._contradicted(
                    of._stacked(known, part), linear.sides, value * np.ones(len(part)), r
                )
                for part in parts
                for value in (0.1, 0.9)
                for r in (1.0, 9.0)
            ],
            "ratio": of._ratio(rows, estimate),
            "starts": starts,
            "scatter": [
                of._scatter(along * rows.w, along**2, stretches(rows.frame.t, rows.frame.drive, s))
                for s in (3.0, 8.0, 60.0)
            ],
            "predicted": of._predicted(rows.phi, rows.w, along**2, starts, np.diag([4.0, 9.0])),
        }
    root = rng.normal(size=(3, 3))
    one = rng.normal(size=3), root @ root.T, np.array([0.5, 1.0, 2.0])
    found["bayes"] = float(of.bayes_factors(*(each[None] for each in one))[0])
    found["nats"] = of.single_nats(
        np.array([[0.5, 30.0], [4.0, 9.0]]), np.array([3.0, 200.0]), np.array([0.5, 0.1])
    )
    return levelled(found)


def _cut(drive: Any, seconds: float) -> Any:
    """The first seconds of a drive."""

    def first(record: Any, n: int, of: int) -> Any:
        arrays = {k: v for k, v in vars(record).items() if isinstance(v, np.ndarray)}
        return replace(record, **{k: v[:n] for k, v in arrays.items() if len(v) == of})

    imu, fixes = drive.imu, drive.fixes
    share = seconds / ((imu.t_ns[-1] - imu.t_ns[0]) * 1e-9)
    return replace(
        drive,
        imu=first(imu, int(share * len(imu.t_ns)), len(imu.t_ns)),
        fixes=first(fixes, int(share * len(fixes)), len(fixes)),
    )


@scenario
def gap_levels() -> Any:
    """Levels of noise of two short drives, their estimates as one, and how likely they are."""
    from automap.fusion.levels import ALL_LEVELS
    from automap.gap import base_model, noise, scoring
    from automap.gap.drive import open_drive
    from automap.gap.fit import fit_drive
    from automap.gap.joint import combine
    from tests.unit.test_gap import simulated

    model = base_model()
    model = replace(model, factors={k: 1.3 * v for k, v in model.factors.items()})
    wrong = {"accel_scale": {"x": 0.02, "y": -0.01, "z": 0.015}}
    drives = [
        open_drive(_cut(simulated(e, seed, size), s), model.options)
        for e, seed, size, s in ((wrong, 3, 1.0, 26.0), ({}, 5, 1.6, 34.0))
    ]
    fits = [fit_drive(d, model) for d in drives]
    factors = {
        k: model.factors[k] * f
        for k, f in zip(ALL_LEVELS, np.linspace(0.6, 1.9, len(ALL_LEVELS)), strict=True)
    }
    held = scoring.fit_held_out(drives[:1], model, {"accel_scale": {"x": 0.02}}, fits[:1])
    states = noise.fitted_about(model, {"accel_scale": 1.5, "gyro_scale": 1.0}, fits)
    said: list[str] = []
    fitted = noise.open_fits(drives[:1], model, said.append)
    whitener = scoring.whitener_of(fits[1])
    prior = np.array([0.5, 2.0, 1.0, 0.3, 0.4, 0.6])
    slopes = noise.noise_slopes(fits, factors)
    return levelled(
        {
            "score": [noise.noise_score(fits, f) for f in (factors, model.factors)],
            "slopes": [slopes.score, slopes.slope, slopes.info],
            "climbed": [
                noise.fit_noise(fits, ("accel", "nhc_y"), factors),
                noise.fit_noise(fits[:1]),
            ],
            "time": noise._time_constant(
                "wander_tau", fits, noise.rooms_of(fits), -1e9, dict(factors)
            ),
            "limits": [noise._limits(level) for level in ALL_LEVELS],
            "relative": noise._relative(fits, factors),
            "opened": (said, fitted.model.factors, fitted.estimate),
            "joint": [states.joint(), combine(states.fits, [1.5, -0.4], prior)],
            "none": combine(fits, [1.5, -0.4], np.zeros(0)),
            "values": states.values(),
            "whitener": whitener,
            "gain": scoring.gain_over(fits[:1], held, whitener),
            "each": scoring._each_score(fits[0], whitener),
            "likelier": [scoring.likelier(fits[:1], held), scoring.likelier(fits, states.fits)],
            "epochs": scoring.epochs(fits),
            "remaining": scoring.remaining_gap(fits),
            "channels": scoring.channel_gaps(fits, states.fits, {CH_VEL: "accel_scale"}),
            "joined": [scoring._joined(fits, c) for c in (CH_POS, CH_VEL + 1, CH_NHC)],
        }
    )


@scenario
def gap_rests() -> Any:
    """Noise at rest by the squares of steps, and how sure so few are."""
    from automap.gap import noise
    from automap.gap.rest import squared_steps, surely
    from tests.unit.test_gap_noise import at_rest

    spans = [(5.3, 31.0), (60.0, 94.6)]
    axes = np.array([1.0, 3.0, 2.0])
    imu = at_rest(axes, 0.4 * axes[::-1], spans).opened.drive.imu
    t: FloatArray = (imu.t_ns - imu.t_ns[0]) * 1e-9
    steps = [squared_steps(t, imu.accel, span) for span in (*spans, (200.0, 210.0))]
    drives = [at_rest(axes, 0.4 * axes[::-1], spans[k:]) for k in (0, 1)]
    return levelled(
        {
            "steps": steps,
            "factors": [noise.rest_factors(some) for some in (drives, drives[1:])],
            "surely": [surely(n) for n in (5, 90)],
            "none": _or_error(noise.rest_factors, []),
        }
    )
