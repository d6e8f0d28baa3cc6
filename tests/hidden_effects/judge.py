"""What a gap finder's answer to a hidden case is worth.

The answer is the content of ``gap.json``. Nothing is taken from it on trust: how much of the
held-out disagreement is closed, and whether a wrong name could be told from the right one at
all, is computed from the drawn drive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.hidden_effects.answers import (
    formula_is_strange,
    misfits,
    noise_claims,
    refused,
    strange_misfits,
    strangers,
)
from tests.hidden_effects.camera import CAMERA_SCALES
from tests.hidden_effects.cases import Drawn
from tests.hidden_effects.formula_text import (
    formula_is_right,
    terms_told_beside,
    told_beside_a_name,
)
from tests.hidden_effects.hide import RECEIVERS_OWN
from tests.hidden_effects.judge_outside import (
    FLAGGED,
    SAME_NATS,
    SAME_SHARE,
    equivalent,
    outside_outcome,
)
from tests.hidden_effects.outside import Outside
from tests.hidden_effects.own_filter import closed_share, own_sd, shortfall
from tests.hidden_effects.sizes import SCALES, STOCHASTIC, DrawnEffect
from tests.hidden_effects.told import terms_of

NOISE_NAMES = frozenset({"gnss_correlated_noise"})
DIRTY_NAMES = NOISE_NAMES | {"gnss_outliers", "gnss_noise_scale"}
"""Naming the noise that is really there is no false alarm."""
LEVELS_OF = {
    "gnss_noise_scale": ("position_h", "velocity_h"),
    "accel_bias_walk": ("accel_bias_walk",),
    "gyro_bias_walk": ("gyro_bias_walk",),
}
"""Factors on noise levels that grow with a hidden noise."""
KNOWN_SHARE = 0.5
"""A parameter is determined where the drive alone gives its sd below this share of its value."""
INTERVAL = 1.96


@dataclass
class Verdict:
    """One finished case.

    ``outcome`` in a word; ``wrong`` names given with confidence that are not there; ``why`` a
    sentence on every miss; ``covered`` of ``counted`` values lie within their 95 % interval;
    ``closed`` share of the held-out disagreement that the found values take away by the drawn
    drive, ``closed_told`` by the answer itself. ``receiver`` the recording whose errors the fixes
    have; ``misfits`` what is said to be missing without a name where nothing is, or where it is;
    ``claims`` the noise that is said to be more; ``refused``, ``refused_p``, ``refused_nats`` the
    strongest inertial or installed candidate that was not named.
    """

    id: str
    kind: str
    level: str
    evidence: float
    outcome: str = ""
    named: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    why: str = ""
    top_right: bool = False
    covered: int = 0
    counted: int = 0
    pulls: list[float] = field(default_factory=list)
    closed: float | None = None
    closed_told: float | None = None
    flagged: bool = False
    formula_right: bool = False
    seconds: float = 0.0
    cpu_s: float = 0.0
    receiver: str = ""
    misfits: list[str] = field(default_factory=list)
    claims: list[str] = field(default_factory=list)
    refused: str = ""
    refused_p: float | None = None
    refused_nats: float | None = None


def judge(drawn: Drawn, answer: Mapping[str, Any]) -> Verdict:
    """Compare an answer with the truth."""
    case = drawn.case
    findings: Sequence[Mapping[str, Any]] = answer["findings"]
    verdict = Verdict(
        id=case.id,
        kind=case.kind,
        level=case.level,
        evidence=min(case.evidence.values(), default=0.0),
        named=[str(f["effect"]) for f in findings],
        seconds=case.seconds,
    )
    before, after = float(answer["gap_before"]), float(answer["gap_after"])
    if before > 0.0:
        verdict.closed_told = 1.0 - after / before
    replay = drawn.setting.replay
    verdict.receiver = case.receiver
    verdict.refused, verdict.refused_p, verdict.refused_nats = refused(answer)
    verdict.claims = [f"{c['level']} times {float(c['factor']):.2f}" for c in noise_claims(answer)]
    truth = {name for name in case.effects if name in SCALES or name in CAMERA_SCALES}
    real_noise = DIRTY_NAMES if case.level == "dirty" else NOISE_NAMES
    shown = [f for f in findings if f["effect"] not in real_noise or f["effect"] in truth]
    shown = strangers(shown, replay, truth)
    verdict.wrong = [
        str(f["effect"])
        for f in shown
        if f["effect"] not in truth and not truth & set(f.get("confusable_with", ()))
    ]
    verdict.flagged = formula_is_strange(answer, replay)
    odd = strange_misfits(answer, None if case.kind == "outside" else replay)
    verdict.misfits = [f"{m['channel']} {m['kind']}: {m.get('where', '')}" for m in odd]
    if isinstance(drawn.formula, Outside):
        _unlisted(verdict, drawn, drawn.formula, answer, shown)
    elif case.kind in ("formula", "removed"):
        _outside(verdict, drawn, answer, shown)
    elif not truth:
        verdict.outcome = "false alarm" if shown or verdict.flagged else "silent"
        if verdict.outcome == "false alarm":
            verdict.why = _describe(shown, answer)
    else:
        _inside(verdict, drawn, answer, shown, truth)
    return verdict


def judge_refusal(drawn: Drawn, text: str) -> Verdict:
    """A run that stopped and said why: right where it names the clock that errs, otherwise no
    answer, and on a drive where nothing is wrong a false alarm."""
    case = drawn.case
    verdict = Verdict(case.id, case.kind, case.level, min(case.evidence.values(), default=0.0))
    verdict.seconds, verdict.receiver = case.seconds, case.receiver
    outside = isinstance(drawn.formula, Outside) and "clock" in drawn.formula.channel
    verdict.flagged = outside and "clock" in text
    verdict.outcome = "flagged" if verdict.flagged else "refused"
    if case.kind == "null":
        verdict.outcome = "false alarm"
    verdict.why = f"{case.truth}; stopped: {text}"
    return verdict


def _unlisted(
    verdict: Verdict,
    drawn: Drawn,
    outside: Outside,
    answer: Mapping[str, Any],
    shown: Sequence[Mapping[str, Any]],
) -> None:
    """Judge an answer where the truth is an error of no library."""
    verdict.closed = None
    seen = drawn.extras().flex is None
    if seen and (shown or answer.get("unexplained") is not None):
        verdict.closed = equivalent(drawn, answer, _found(shown))
    verdict.outcome, verdict.wrong = outside_outcome(outside, answer, shown, verdict.closed)
    verdict.flagged = verdict.outcome in FLAGGED
    verdict.formula_right = verdict.outcome == "formula right"
    if verdict.outcome not in ("formula right", "misfit right", "noise right"):
        said = _describe(shown, answer)
        verdict.why = f"{drawn.case.truth}; {said}"
        if verdict.closed is not None:
            verdict.why += f"; takes away {100.0 * verdict.closed:.0f} % of both days"


def _found(shown: Sequence[Mapping[str, Any]]) -> dict[str, DrawnEffect]:
    """Values of the named effects that this package can draw."""
    return {
        str(f["effect"]): _values(f)
        for f in shown
        if f["effect"] in SCALES and f["effect"] not in STOCHASTIC
    }


def _inside(
    verdict: Verdict,
    drawn: Drawn,
    answer: Mapping[str, Any],
    shown: Sequence[Mapping[str, Any]],
    truth: set[str],
) -> None:
    names = [str(f["effect"]) for f in shown]
    pairs = {
        t: str(f["effect"])
        for f in shown
        for t in truth & set(f.get("confusable_with", ()))
        if f["effect"] not in truth
    }
    if truth <= STOCHASTIC and not names:
        verdict.outcome = "as noise" if _noise_shows(truth, answer) else "missed"
    elif set(names) == truth:
        verdict.outcome = "named"
    elif {*names} - set(pairs.values()) | set(pairs) == truth:
        verdict.outcome = "pair"
    elif not names:
        verdict.outcome = "missed"
    elif truth <= set(names):
        verdict.outcome = "named with more"
    elif truth & set(names):
        verdict.outcome = "partly"
    else:
        verdict.outcome = "wrong"
    verdict.top_right = bool(names) and names[0] in truth
    if names and names[0] in pairs.values():
        verdict.top_right = True
    if verdict.outcome not in ("named", "pair"):
        verdict.why = _describe(shown, answer)
    if truth & (STOCHASTIC | set(CAMERA_SCALES)):
        return
    if verdict.wrong:
        short = shortfall(drawn, names)
        verdict.why += f"; {', '.join(names)} fall {short:.1f} nats short of the truth"
        if short < SAME_NATS:
            verdict.why += ", which nobody could tell"
    _coverage(verdict, drawn, shown)
    found = {str(f["effect"]): _values(f) for f in shown if f["effect"] in SCALES}
    verdict.closed = closed_share(drawn, found)


def _noise_shows(truth: set[str], answer: Mapping[str, Any]) -> bool:
    """Whether the noise block has grown where the noise was hidden."""
    noise = {str(k): float(v) for k, v in answer.get("noise", {}).items()}
    return all(noise.get(key, 1.0) > 1.0 for name in truth for key in LEVELS_OF.get(name, ()))


def _outside(
    verdict: Verdict,
    drawn: Drawn,
    answer: Mapping[str, Any],
    shown: Sequence[Mapping[str, Any]],
) -> None:
    case = drawn.case
    truth = set(case.effects)
    if verdict.flagged:
        verdict.formula_right = case.kind == "formula" and (
            formula_is_right(case.formula_kind, answer["unexplained"])
            or _is_equivalent(drawn, answer, shown)
        )
        verdict.outcome = "formula right" if verdict.formula_right else "flagged"
    elif shown and case.kind == "formula" and told_beside_a_name(case.formula_kind, shown):
        verdict.outcome = "formula beside a name"
    elif shown:
        verdict.outcome = "mis-named"
    elif case.effects and case.effects.keys() <= LEVELS_OF.keys() and _noise_shows(truth, answer):
        # a level of noise stays in the model without the effect of that name
        verdict.outcome = "as noise"
    else:
        verdict.outcome = "missed"
    if case.kind == "removed" and not verdict.flagged and terms_told_beside(case.effects, shown):
        verdict.outcome = "formula beside a name"
        verdict.wrong = []
    elif case.kind == "removed":
        # what was taken out of the library may come back under a name that is the same thing
        verdict.wrong = [] if verdict.flagged else verdict.wrong
        if verdict.wrong and not set(case.effects) & STOCHASTIC:
            short = shortfall(drawn, [str(f["effect"]) for f in shown])
            verdict.why = f"fall {short:.1f} nats short of the truth; "
            if short < SAME_NATS:
                verdict.outcome = "alike"
                verdict.wrong = []
    elif verdict.flagged:
        verdict.wrong = []
    if not verdict.formula_right:
        verdict.why += _describe(shown, answer)


def _is_equivalent(
    drawn: Drawn, answer: Mapping[str, Any], shown: Sequence[Mapping[str, Any]]
) -> bool:
    """Whether another formula is the hidden one for every use of it."""
    share = equivalent(drawn, answer, _found(shown)) if terms_of(answer["unexplained"]) else None
    return share is not None and share >= SAME_SHARE


def _describe(shown: Sequence[Mapping[str, Any]], answer: Mapping[str, Any]) -> str:
    parts = []
    for f in shown:
        numbers = ", ".join(
            f"{p} {v['value']:.3g}±{v['sd'] or np.inf:.1g}" for p, v in f["parameters"].items()
        )
        parts.append(f"{f['effect']} ({numbers}) {f['evidence_nats']:.0f} nats")
    odd = answer.get("unexplained")
    if odd is not None:
        parts.append(f"unexplained {odd['channel']}: {odd['formula']}")
    parts += [f"misfit {m['channel']} {m['kind']}: {m.get('where', '')}" for m in misfits(answer)]
    parts += [f"noise {c['level']} times {float(c['factor']):.2f}" for c in noise_claims(answer)]
    return "said: " + ("; ".join(parts) if parts else "nothing")


def _values(finding: Mapping[str, Any]) -> DrawnEffect:
    """Parameter values of a finding, those with one parameter under this package's name."""
    effect = str(finding["effect"])
    values = {str(p): float(v["value"]) for p, v in finding["parameters"].items()}
    names = SCALES[effect].parameters
    if effect == "earth_rotation":
        return {"on": 1.0}
    if len(names) == 1 and len(values) == 1:
        return {names[0]: next(iter(values.values()))}
    return {p: v for p, v in values.items() if p in names}


def _coverage(verdict: Verdict, drawn: Drawn, shown: Sequence[Mapping[str, Any]]) -> None:
    """Count the values that their interval holds, among those that the drive determines."""
    true = {name: v for name, v in drawn.case.effects.items() if name in SCALES}
    sds = own_sd(drawn, list(true))
    for finding in shown:
        effect = str(finding["effect"])
        if effect not in true or effect == "earth_rotation":
            continue
        if effect in RECEIVERS_OWN and drawn.setting.replay is not None:
            # what the recorded receiver has of it itself is part of what is told
            continue
        size = max(abs(v) for v in true[effect].values())
        told = list(finding["parameters"].items())
        for name, value in told:
            mine = SCALES[effect].parameters[0] if len(told) == 1 else str(name)
            if sds.get((effect, mine), np.inf) > KNOWN_SHARE * size or value["sd"] is None:
                continue
            pull = (float(value["value"]) - true[effect].get(mine, 0.0)) / float(value["sd"])
            verdict.counted += 1
            verdict.covered += abs(pull) <= INTERVAL
            verdict.pulls.append(round(pull, 3))
