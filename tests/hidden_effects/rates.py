"""Rates of a set of verdicts, with their intervals, and every miss."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy.stats import beta, kstest

from tests.hidden_effects.hide import ENOUGH_NATS
from tests.hidden_effects.judge import Verdict
from tests.hidden_effects.judge_outside import SAME_NATS
from tests.hidden_effects.sizes import STOCHASTIC


def clopper_pearson(hits: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a share, C. Clopper and E. Pearson, Biometrika 26 (1934)."""
    if trials == 0:
        return 0.0, 1.0
    tail = 0.5 * (1.0 - level)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, trials - hits + 1))
    high = 1.0 if hits == trials else float(beta.ppf(1.0 - tail, hits + 1, trials - hits))
    return low, high


def effect_of(verdict: Verdict) -> str:
    """The hidden effect of a case of one."""
    return verdict.id.split("-")[1] if verdict.kind in ("effect", "removed") else ""


def _line(name: str, hits: int, trials: int, goal: str) -> str:
    if trials == 0:
        return f"{name:<58} no case yet   goal {goal}"
    low, high = clopper_pearson(hits, trials)
    share = f"{hits}/{trials} = {100 * hits / trials:.1f} %"
    return f"{name:<58} {share:<18} [{100 * low:.1f}, {100 * high:.1f}]   goal {goal}"


def _real_lines(
    name: str, verdicts: Sequence[Verdict], test: Callable[[Verdict], bool]
) -> list[str]:
    """The share among cases with a real receiver's errors."""
    real = [v for v in verdicts if v.receiver]
    return [_line(name, sum(map(test, real)), len(real), "-")]


def _refused_lines(nulls: Sequence[Verdict]) -> list[str]:
    """How the p-values of the strongest refused candidates on null drives are spread: evenly from
    0 to 1 where they are what they say."""
    p = np.array([v.refused_p for v in nulls if v.refused_p is not None])
    if len(p) == 0:
        return ["strongest refused inertial candidate of null drives: not stated"]
    shares = ", ".join(f"{np.mean(p <= q):.3f} below {q}" for q in (0.01, 0.05, 0.1, 0.5))
    nats = [v.refused_nats for v in nulls if v.refused_nats is not None]
    strongest = f", {max(nats):.1f} nats at most" if nats else ""
    test = kstest(p, "uniform").pvalue
    return [
        f"strongest refused inertial candidate of {len(p)} null drives: {shares}{strongest}; "
        f"uniform with a p-value of {test:.2g} (Kolmogorov-Smirnov)"
    ]


def report(verdicts: Sequence[Verdict]) -> list[str]:
    """Lines with all rates, then every miss."""

    def of(kind: str) -> list[Verdict]:
        return [v for v in verdicts if v.kind == kind]

    def count(items: Iterable[Verdict], test: Callable[[Verdict], bool]) -> int:
        return sum(1 for v in items if test(v))

    effects = [v for v in of("effect") if effect_of(v) not in STOCHASTIC]
    noises = [v for v in of("effect") if effect_of(v) in STOCHASTIC]
    strong = [v for v in effects if v.evidence >= ENOUGH_NATS]
    weak = [v for v in effects if v.evidence < ENOUGH_NATS]
    triples, formulas, removed = (of(k) for k in ("triple", "formula", "removed"))
    cameras = [v for v in of("camera") if v.evidence >= ENOUGH_NATS]
    nulls = of("null") + [v for v in of("camera") if v.evidence == 0.0]
    clean = [v for v in nulls if v.level != "dirty" and not v.receiver]
    # what a drive does not show cannot be told: a receiver that has no heights' rates, for one
    outside = [v for v in of("outside") if v.evidence >= SAME_NATS]
    known = effects + triples
    named = [v for v in known if v.closed is not None and v.top_right]
    covered, counted = sum(v.covered for v in known), sum(v.counted for v in known)
    lines = [
        _line(
            f"named first, evidence of {ENOUGH_NATS:.0f} nats or more",
            count(strong, lambda v: v.top_right),
            len(strong),
            ">= 97 %",
        ),
        *_real_lines("  of these with a real receiver's errors", strong, lambda v: v.top_right),
        _line(
            "  of these under a name said to be confusable",
            count(strong, lambda v: v.outcome == "pair"),
            len(strong),
            "-",
        ),
        _line("named first, less evidence", count(weak, lambda v: v.top_right), len(weak), "-"),
        _line(
            "wrong name with confidence, single effects and triples",
            count(effects + noises + cameras + triples, lambda v: bool(v.wrong)),
            len(effects + noises + cameras + triples),
            "<= 0.5 %",
        ),
        _line(
            "hidden noise named or fitted as noise",
            count(noises, lambda v: v.outcome in ("named", "as noise")),
            len(noises),
            "-",
        ),
        _line(
            "camera effects named first",
            count(cameras, lambda v: v.top_right),
            len(cameras),
            ">= 95 %",
        ),
        _line(
            "false alarms on null drives",
            count(nulls, lambda v: v.outcome == "false alarm"),
            len(nulls),
            "<= 1 %",
        ),
        *_real_lines(
            "  of these with a real receiver's errors",
            nulls,
            lambda v: v.outcome == "false alarm",
        ),
        _line(
            "  misfits without a name on null drives",
            count(nulls, lambda v: bool(v.misfits)),
            len(nulls),
            "<= 1 %",
        ),
        _line(
            "  noise said to be more on null drives that are not dirty",
            count(clean, lambda v: bool(v.claims)),
            len(clean),
            "-",
        ),
        _line(
            "triples exactly right",
            count(triples, lambda v: v.outcome in ("named", "pair")),
            len(triples),
            ">= 90 %",
        ),
        *_real_lines(
            "  of these with a real receiver's errors",
            triples,
            lambda v: v.outcome in ("named", "pair"),
        ),
        _line("true value inside its 95 % interval", covered, counted, "92 to 98 %"),
        _line(
            "outside the library: said to be missing where it is",
            count(outside, lambda v: v.flagged),
            len(outside),
            ">= 95 %",
        ),
        _line(
            "  nothing said",
            count(outside, lambda v: v.outcome == "silent"),
            len(outside),
            "none",
        ),
        _line(
            "  elsewhere, or as noise only",
            count(outside, lambda v: v.outcome in ("elsewhere", "as noise")),
            len(outside),
            "-",
        ),
        _line(
            "  a name that is not it, alone and sure",
            count(outside, lambda v: bool(v.wrong)),
            len(outside),
            "<= 0.5 %",
        ),
        _line(
            "formulas: flagged",
            count(formulas, lambda v: v.flagged),
            len(formulas),
            ">= 90 %",
        ),
        _line(
            "  formula right or equivalent",
            count(formulas, lambda v: v.formula_right),
            len(formulas),
            ">= 80 %",
        ),
        _line(
            "  silently under a wrong name",
            count(formulas, lambda v: v.outcome == "mis-named"),
            len(formulas),
            "<= 2 %",
        ),
        _line(
            "effect taken out of the library: flagged",
            count(removed, lambda v: v.flagged),
            len(removed),
            "-",
        ),
        _line(
            "  fitted as a level of noise, or beside a name",
            count(removed, lambda v: v.outcome in ("as noise", "formula beside a name")),
            len(removed),
            "-",
        ),
        _line(
            "  silently under a wrong name",
            count(removed, lambda v: v.outcome == "mis-named"),
            len(removed),
            "<= 2 %",
        ),
    ]
    if named:
        own = float(np.median([v.closed for v in named if v.closed is not None]))
        told = [v.closed_told for v in named if v.closed_told is not None]
        lines.append(
            f"held-out gap closed, median: {100 * own:.2f} % by the drawn drive, "
            f"{100 * float(np.median(told)):.2f} % by the answer   goal >= 95 %"
        )
    pulls = np.array([p for v in known for p in v.pulls])
    if len(pulls):
        lines.append(
            f"error over sd: rms {np.sqrt(np.mean(pulls**2)):.2f}, median of the size "
            f"{np.median(np.abs(pulls)):.2f} (0.67 is right)"
        )
    lines += _refused_lines([v for v in nulls if v.refused_p is not None])
    if verdicts:
        outcomes = Counter(v.outcome for v in outside)
        if outcomes:
            ways = ", ".join(f"{n} {outcome}" for outcome, n in outcomes.most_common())
            lines.append(f"outside the library, outcomes: {ways}")
        speed = [v.cpu_s / (v.seconds / 600.0) for v in verdicts]
        lines.append(
            f"CPU time for ten minutes of drive: median {np.median(speed):.0f} s, "
            f"worst {np.max(speed):.0f} s   goal <= 90 s"
        )
    lines += ["", "every miss:"]
    for v in sorted(verdicts, key=lambda v: v.id):
        if v.why and v.outcome not in ("formula right", "alike"):
            level = f"{v.level} with {v.receiver}" if v.receiver else v.level
            scene = f"{level}, {v.seconds:.0f} s, {v.evidence:.0f} nats"
            lines.append(f"  {v.id} ({scene}) {v.outcome}: {v.why}")
    return lines
