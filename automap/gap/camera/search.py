"""Which effect of the camera is missing, from the boxes of tracked signs.

The same comparison as for all other candidates: a fit made linear, the set of candidates with the
highest posterior odds, that set fitted as it is, until it stays; rivals decided by what is not
linear, on fitted and held-out signs, and what held-out signs speak against is not named.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE
from automap.gap import limits
from automap.gap.camera.fit import CameraFit, box_noise, estimate_noise, fit_camera
from automap.gap.camera.linear import covariance, log_evidence, selection_of
from automap.gap.camera.views import Boxes, keys
from automap.gap.chance import null_maxima, p_value
from automap.gap.limits import LONGEST_SHUTTER_S, MIN_SIGNS, SHUTTER_SLACK_S
from automap.gap.result import Finding, ParameterValue, advice
from automap.gap.selection import Chosen, Key
from automap.gap.stepwise import close_rivals, rivals, select
from automap.records import FloatArray

FIRST_PX, FIRST_SHARE = 1.5, 0.03
"""Noise of boxes before it is known."""

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


def find_camera_gap(
    camera: str,
    boxes: Boxes,
    held: Boxes | None,
    exclude: Collection[str] = (),
    log: Log = lambda text: None,
) -> CameraGap:
    """Name what the stated camera lacks, as far as held-out signs agree.

    Without ``held`` the last third of the signs is held out.
    """
    if held is None:
        cut = 2 * boxes.n_signs // 3
        boxes, held = boxes.of_signs(0, cut), boxes.of_signs(cut, boxes.n_signs)
    signs, count = boxes.n_signs + held.n_signs, len(boxes.sign) + len(held.sign)
    if boxes.n_signs < MIN_SIGNS or held.n_signs < 2:
        text = (
            f"camera {camera}: only {signs} signs were tracked over "
            "several frames; too few to look for errors of the camera"
        )
        return CameraGap(camera, (), {}, 0.0, 0.0, signs, count, None, (text,))
    effects = [e for e in dict(keys()) if e not in exclude]
    search = _Search(boxes, held, effects, lambda text: log(f"camera {camera}: {text}"))
    search.run()
    findings, gaps, fits = search.findings()
    warnings = tuple(f"camera {camera}: {text}" for text in search.warnings)
    values = search.values()
    return CameraGap(
        *(camera, findings, values, gaps[0], gaps[-1], signs, count),
        *((fits[0], fits[-1]), warnings),
    )


class _Search:
    """A search on ``boxes`` with ``held`` others that judge; ``chosen`` is the set of candidates
    so far, ``now`` its fit and ``selection`` that fit made linear."""

    def __init__(self, boxes: Boxes, held: Boxes, effects: Collection[str], log: Log) -> None:
        self.boxes, self.held, self.effects, self.log = boxes, held, effects, log
        log("fitting the noise of the boxes")
        every = {key: limits.PRIOR_SCALES[-1] for key in keys() if key[0] in effects}
        self.sd = _noise(boxes, every)
        self.held_sd = _noise(held, every)
        self.barred: set[Key] = set()
        self.tried: dict[Key, int] = {}
        self.challenged: set[frozenset[str]] = set()
        self.close: dict[str, tuple[str, ...]] = {}
        self.warnings: list[str] = []
        self._take(Chosen())

    def run(self) -> None:
        """Rounds until the set stays."""
        for number in range(limits.MAX_ROUNDS):
            self.log(f"selecting beside {', '.join(self.chosen.names) or 'nothing'}")
            worn = {key for key, count in self.tried.items() if count >= limits.TRIALS}
            self.selection.refused = frozenset(self.barred | worn)
            closing = number >= limits.MAX_ROUNDS - limits.CLOSING_ROUNDS
            limit = len(self.chosen.names) if closing else limits.MAX_FINDINGS
            found = select(self.selection, self.chosen, limit)
            had = self.selection.keys(self.chosen)
            if self.selection.keys(found) != had:
                for key in self.selection.keys(found) - had:
                    self.tried[key] = self.tried.get(key, 0) + 1
                self._take(found)
                for name in [n for n in self.chosen.names if not self._possible(self.now, n)]:
                    self._give_up(name)
                continue
            rival = self._decided()
            if rival is not None:
                self._take(rival)
                continue
            against = self._spoken_against()
            if against is None:
                return
            self._give_up(against)

    def _take(self, chosen: Chosen) -> None:
        self.chosen = chosen
        self.now = self._fit(chosen)
        self.selection = selection_of(self.now, self.effects)

    def _give_up(self, name: str) -> None:
        parts = self.selection.candidates[name].parts
        self.barred |= {self.selection.key(name, part) for part in parts}
        self._take(self.chosen.without(name))

    def _fit(self, chosen: Chosen) -> CameraFit:
        """The chosen set as it is, not made linear."""
        order = keys()
        prior = {order[i]: scale for _, part, scale in chosen.parts for i in part}
        start = getattr(self, "now", None)
        return _fitted(self.boxes, self.sd, prior, start)

    def _held(self, fit: CameraFit, effects: Collection[str]) -> CameraFit:
        """Held-out signs with some effects at the values of a fit."""
        acting = np.array([e in effects for e, _ in keys()])
        start = np.zeros(self.held.n_common)
        start[: len(acting)] = np.where(acting, fit.common[: len(acting)], 0.0)
        return fit_camera(self.held, self.held_sd, np.zeros(len(start)), start)

    def _possible(self, fit: CameraFit, name: str) -> bool:
        """Whether a fitted value can be."""
        if name != "rolling_shutter":
            return True
        value = float(fit.common[keys().index((name, "s"))])
        return -SHUTTER_SLACK_S < value < LONGEST_SHUTTER_S

    def _decided(self) -> Chosen | None:
        """The choice with a rival in a candidate's place where fitted and held-out signs are
        likelier with it, None where no rival is; what cannot be told apart is noted."""
        self.close = {}
        for name in self.chosen.names:
            best, instead = 0.0, None
            barred = frozenset(self.barred)
            for rival in close_rivals(self.selection, self.chosen, name, barred):
                if rival.name in self.chosen.names:
                    continue
                self.log(f"checking whether {name} is {rival.name}")
                fit = self._fit(rival.chosen)
                if not self._possible(fit, rival.name):
                    continue
                ahead, sigmas = self._ahead(fit, rival.chosen)
                if abs(sigmas) < limits.APART:
                    self.close[name] = (*self.close.get(name, ()), rival.name)
                if ahead > best:
                    best, instead = ahead, rival.chosen
            if instead is not None and frozenset(instead.names) not in self.challenged:
                self.challenged |= {frozenset(self.chosen.names), frozenset(instead.names)}
                return instead
        return None

    def _ahead(self, fit: CameraFit, chosen: Chosen) -> tuple[float, float]:
        """Nats by which all signs are likelier under another set than under the one that is taken,
        and the sigmas of that by its scatter from sign to sign (Vuong 1989)."""
        parts, evidence = [], []
        for one, its in ((fit, chosen), (self.now, self.chosen)):
            held = self._held(one, its.names)
            parts.append(-np.concatenate([one.cost_by_sign(), held.cost_by_sign()]))
            evidence.append(log_evidence(one) + self.selection.log_prior(its) - held.cost)
        each = parts[0] - parts[1]
        spread = float(np.sqrt(len(each)) * np.std(each))
        sigmas = float(each.sum()) / spread if spread > 0.0 else 0.0
        return evidence[0] - evidence[1], sigmas

    def _spoken_against(self) -> str | None:
        """The candidate that held-out signs speak against most, if any."""
        names = self.chosen.names
        every = self._held(self.now, names).cost
        gains = {n: self._held(self.now, set(names) - {n}).cost - every for n in names}
        worst = min(gains, key=lambda n: gains[n], default=None)
        if worst is None or gains[worst] > -limits.HELD_OUT_SLACK:
            return None
        self.warnings.append(
            f"{worst} explains the fitted signs, but the held-out signs are {-gains[worst]:.0f} "
            "nats less likely with it; it is not named"
        )
        return worst

    def values(self) -> dict[str, dict[str, float]]:
        """Effect -> parameter -> value of what was found."""
        out: dict[str, dict[str, float]] = {}
        for (effect, parameter), value in zip(keys(), self.now.common.tolist(), strict=False):
            if effect in self.chosen.names:
                out.setdefault(effect, {})[parameter] = value
        return out

    def findings(self) -> tuple[tuple[Finding, ...], list[float], list[CameraFit]]:
        """What was found, the surest first; gaps in nats a box on held-out signs and their fits,
        of nothing, of the first, of the first two, and so on."""
        selection, chosen = self.selection, self.chosen
        known = selection.given(chosen)
        parts = [p for c in selection.candidates.values() for p in c.parts if known.shows(p)]
        maxima = null_maxima(known, parts, limits.NULL_DRAWS)
        odds = {n: selection.odds_of(chosen, n) for n in chosen.names}
        names = sorted(chosen.names, key=lambda n: -odds[n][0])
        fits = [self._held(self.now, names[:k]) for k in range(len(names) + 1)]
        rest, count = _remaining(fits[-1]), max(len(self.held.sign), 1)
        gaps = [rest + (fit.cost - fits[-1].cost) / count for fit in fits]
        full = _fitted(
            *(self.boxes, self.sd),
            {key: chosen.scale_of(key[0]) for key in keys() if key[0] in names},
            self.now,
        )
        cov = covariance(full)
        out = []
        for number, name in enumerate(names):
            total, moves = odds[name]
            room = max(limits.CLOSE_NATS, limits.CLOSE * total)
            near = [r.name for r in rivals(selection, chosen, name) if r.ahead > -room]
            close = tuple(dict.fromkeys([*near, *self.close.get(name, ())]))
            nats = sum(m.evidence.nats for m in moves)
            wider = float(np.sqrt(max(m.evidence.overdispersion for m in moves)))
            places = {p.name: keys().index((name, p.name)) for p in CATALOGUE[name].parameters}
            sds = {p: wider * float(np.sqrt(cov[i, i])) for p, i in places.items()}
            units = {p.name: p.unit for p in CATALOGUE[name].parameters}
            told = {
                p: ParameterValue(float(full.common[i]), sds[p], units[p])
                for p, i in places.items()
            }
            out.append(
                Finding(
                    *(name, told, nats, p_value(nats, maxima)),
                    *(gaps[number], gaps[number + 1], close, advice(name, close)),
                )
            )
        return tuple(out), gaps, fits


def _noise(boxes: Boxes, every: Mapping[tuple[str, str], float]) -> FloatArray:
    """One sigma [n, 3] of boxes, all errors that a camera may have taken out."""
    first = box_noise(boxes, np.full(2, FIRST_PX), np.full(2, FIRST_SHARE))
    free = _fitted(boxes, first, every)
    return estimate_noise(_fitted(boxes, estimate_noise(free), every, free))


def _fitted(
    boxes: Boxes,
    sd: FloatArray,
    prior: Mapping[tuple[str, str], float],
    start: CameraFit | None = None,
) -> CameraFit:
    """A fit in which the parameters of ``prior`` (factor on their prior sds) act, and no others."""
    effect_sd = np.zeros(boxes.n_common)
    for i, key in enumerate(keys()):
        usual = {p.name: p.prior_sd for p in CATALOGUE[key[0]].parameters}
        effect_sd[i] = prior.get(key, 0.0) * usual[key[1]]
    if start is None:
        return fit_camera(boxes, sd, effect_sd)
    common = start.common.copy()
    common[: len(keys())] *= effect_sd[: len(keys())] > 0.0
    return fit_camera(boxes, sd, effect_sd, common, start.local)


def _remaining(fit: CameraFit) -> float:
    """Nats a box between the residuals' size and one."""
    total = 0.0
    for column in fit.residual.T:
        v = float(np.mean(np.clip(column, -limits.CLIP, limits.CLIP) ** 2))
        total += 0.5 * (v - 1.0 - np.log(max(v, 1e-6)))
    return total
