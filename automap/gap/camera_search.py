"""Which effect of the camera is missing, from the boxes of tracked signs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE
from automap.gap.advice import advice
from automap.gap.camera_evidence import (
    FREE_FACTOR,
    columns_of,
    covariance,
    gain,
    marginal,
    parameters,
    prior_sds,
)
from automap.gap.camera_fit import CameraFit, box_noise, estimate_noise, fit_camera
from automap.gap.camera_scores import evidence, null_maxima
from automap.gap.camera_views import Boxes, keys
from automap.gap.chance import p_value
from automap.gap.result import Finding
from automap.records import FloatArray

MIN_NATS = 7.0
MAX_P = 1e-3
TRY_NATS = 3.0
TRY_SHARE = 0.1
CLOSE_NATS = 3.0
CLOSE_SHARE = 0.03
NULL_DRAWS = 4000
MIN_SIGNS = 6
MAX_ROUNDS = 6
SHUTTER_SLACK_S, LONGEST_SHUTTER_S = 0.005, 0.12

Log = Callable[[str], None]


@dataclass(frozen=True)
class CameraGap:
    """What was found about one camera.

    ``findings`` with gaps in nats a box on held-out signs; ``values`` effect -> parameter ->
    value; ``held_out`` the fits of the held-out signs before and after, ``gap_before`` and
    ``gap_after`` of all findings together; numbers of signs and boxes that were fitted and
    held out.
    """

    camera: str
    findings: tuple[Finding, ...]
    values: Mapping[str, Mapping[str, float]]
    gap_before: float
    gap_after: float
    signs: int
    boxes: int
    held_out: tuple[CameraFit, CameraFit] | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Trial:
    effect: str
    fit: CameraFit
    nats: float
    p: float


def find_camera_gap(
    camera: str,
    boxes: Boxes,
    held: Boxes | None,
    exclude: Collection[str] = (),
    log: Log = lambda text: None,
) -> CameraGap:
    """Name what the stated camera lacks, one effect after another while held-out signs agree.

    Without ``held`` the last third of the signs is held out.
    """
    if held is None:
        cut = 2 * boxes.n_signs // 3
        boxes, held = boxes.of_signs(0, cut), boxes.of_signs(cut, boxes.n_signs)
    if boxes.n_signs < MIN_SIGNS or held.n_signs < 2:
        text = (
            f"camera {camera}: only {boxes.n_signs + held.n_signs} signs were tracked over "
            "several frames; too few to look for errors of the camera"
        )
        nothing: tuple[Finding, ...] = ()
        n = boxes.n_signs + held.n_signs
        total = len(boxes.sign) + len(held.sign)
        return CameraGap(camera, nothing, {}, 0.0, 0.0, n, total, None, (text,))
    allowed = [e for e in dict(keys()) if e not in exclude]
    log(f"camera {camera}: fitting the noise of the boxes")
    first = box_noise(boxes, np.full(2, 1.5), np.full(2, 0.03))
    free = fit_camera(boxes, first, prior_sds(boxes, allowed, FREE_FACTOR))
    sd = estimate_noise(free)
    free = fit_camera(boxes, sd, prior_sds(boxes, allowed, FREE_FACTOR), free.common, free.local)
    sd = estimate_noise(free)
    held_sd = estimate_noise(
        fit_camera(
            held,
            box_noise(held, np.full(2, 1.5), np.full(2, 0.03)),
            prior_sds(held, allowed, FREE_FACTOR),
        )
    )
    now = fit_camera(boxes, sd, prior_sds(boxes, ()))
    held_fits = [fit_camera(held, held_sd, prior_sds(held, ()))]
    accepted: list[str] = []
    found: list[tuple[_Trial, tuple[str, ...]]] = []
    refused: set[str] = set()
    warnings: list[str] = []
    for _ in range(MAX_ROUNDS):
        left = [e for e in allowed if e not in accepted and e not in refused]
        if not left:
            break
        log(f"camera {camera}: screening")
        trials = _trials(now, sd, accepted, left)
        if not trials or trials[0].nats < MIN_NATS or trials[0].p > MAX_P:
            break
        best = trials[0]
        after = _with_values(held, held_sd, best.fit, [*accepted, best.effect])
        if not after.cost < held_fits[-1].cost:
            refused.add(best.effect)
            warnings.append(
                f"camera {camera}: {best.effect} would explain {best.nats:.0f} nats of the fitted "
                "signs, but the held-out signs do not confirm it; it is not named"
            )
            continue
        close = max(CLOSE_NATS, CLOSE_SHARE * best.nats)
        confusable = tuple(t.effect for t in trials[1:] if best.nats - t.nats < close)
        accepted.append(best.effect)
        found.append((best, confusable))
        held_fits.append(after)
        now = best.fit
    now, accepted = _eliminate(now, sd, accepted)
    found = [
        (t, tuple(dict.fromkeys([*r, *_stand_ins(now, sd, t.effect, accepted, allowed)])))
        for t, r in found
        if t.effect in accepted
    ]
    held_fits[1:] = [
        _with_values(held, held_sd, now, accepted[: k + 1]) for k in range(len(accepted))
    ]
    n = max(len(held.sign), 1)
    gaps = [(f.cost - held_fits[-1].cost) / n for f in held_fits]
    rest = _remaining(held_fits[-1])
    cov = covariance(now, accepted)
    findings = []
    for number, (trial, confusable) in enumerate(found):
        findings.append(
            Finding(
                trial.effect,
                parameters(now, trial.effect, accepted, cov),
                trial.nats,
                trial.p,
                rest + gaps[number],
                rest + gaps[number + 1],
                confusable,
                advice(trial.effect, confusable),
            )
        )
    values = {
        e: {p: v.value for p, v in parameters(now, e, accepted, cov).items()} for e in accepted
    }
    return CameraGap(
        camera,
        tuple(findings),
        values,
        rest + gaps[0],
        rest,
        boxes.n_signs + held.n_signs,
        len(boxes.sign) + len(held.sign),
        (held_fits[0], held_fits[-1]),
        tuple(warnings),
    )


def _eliminate(
    now: CameraFit, sd: FloatArray, accepted: Sequence[str]
) -> tuple[CameraFit, list[str]]:
    """Drop effects that others, accepted later, have made unnecessary."""
    kept = list(accepted)
    for effect in accepted if len(accepted) > 1 else ():
        others = [e for e in kept if e != effect]
        start = now.common.copy()
        start[columns_of(effect)] = 0.0
        fewer = prior_sds(now.boxes, others, FREE_FACTOR)
        fit = fit_camera(now.boxes, sd, fewer, start, now.local)
        every = fewer + prior_sds(now.boxes, (effect,), FREE_FACTOR)
        if gain(fit, now, effect, others, every) < MIN_NATS:
            now, kept = fit, others
    return now, kept


def _stand_ins(
    now: CameraFit, sd: FloatArray, effect: str, accepted: Sequence[str], allowed: Sequence[str]
) -> Iterator[str]:
    """Effects that would do as well in the place of one: when it was accepted, others that go
    with it were still missing, and the comparison another."""
    others = [e for e in accepted if e != effect]
    start = now.common.copy()
    start[columns_of(effect)] = 0.0
    fewer = fit_camera(now.boxes, sd, prior_sds(now.boxes, others, FREE_FACTOR), start, now.local)

    def nats(name: str) -> float:
        prior = prior_sds(now.boxes, [*others, name], FREE_FACTOR)
        fit = fit_camera(now.boxes, sd, prior, fewer.common, fewer.local)
        return gain(fewer, fit, name, others, prior) if _possible(fit, name) else -np.inf

    own = nats(effect)
    close = max(CLOSE_NATS, CLOSE_SHARE * own)
    yield from (e for e in allowed if e not in accepted and own - nats(e) < close)


def _trials(
    now: CameraFit, sd: FloatArray, accepted: Sequence[str], left: Sequence[str]
) -> list[_Trial]:
    """Fits of the candidates that stand out, best first."""
    scores = marginal(now, accepted)
    groups = []
    ranked = []
    for effect in left:
        rows = columns_of(effect)
        prior = np.array([p.prior_sd for p in CATALOGUE[effect].parameters])
        groups.append((rows, prior))
        ranked.append((effect, evidence(scores, rows, prior)))
    maxima = null_maxima(scores, groups, NULL_DRAWS)
    least = max(TRY_NATS, TRY_SHARE * max(e.nats for _, e in ranked))
    out = []
    for effect, seen in ranked:
        if seen.nats < least:
            continue
        factor = min(max(1.0, seen.scale), FREE_FACTOR)
        prior = prior_sds(now.boxes, accepted, FREE_FACTOR) + prior_sds(
            now.boxes, (effect,), factor
        )
        fit = fit_camera(now.boxes, sd, prior, now.common, now.local)
        if not _possible(fit, effect):
            continue
        nats = gain(now, fit, effect, accepted, prior)
        out.append(_Trial(effect, fit, nats, p_value(nats, maxima)))
    return sorted(out, key=lambda t: -t.nats)


def _possible(fit: CameraFit, effect: str) -> bool:
    """Whether a fitted value can be: rows are read from the top, within a frame's time. On a
    straight road a shutter beyond that is a lever arm in disguise."""
    if effect != "rolling_shutter":
        return True
    value = float(fit.common[columns_of(effect)[0]])
    return -SHUTTER_SLACK_S < value < LONGEST_SHUTTER_S


def _with_values(held: Boxes, sd: FloatArray, fit: CameraFit, effects: Sequence[str]) -> CameraFit:
    """Held-out signs with the effects at the values of a fit."""
    start = np.zeros(held.n_common)
    for effect in effects:
        start[columns_of(effect)] = fit.common[columns_of(effect)]
    return fit_camera(held, sd, prior_sds(held, ()), start)


def _remaining(fit: CameraFit) -> float:
    """Nats a box between the residuals' size and one."""
    total = 0.0
    for column in fit.residual.T:
        v = float(np.mean(np.clip(column, -4.0, 4.0) ** 2))
        total += 0.5 * (v - 1.0 - np.log(max(v, 1e-6)))
    return total
