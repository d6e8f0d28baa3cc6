"""What a gap finder's answer to a hidden case is worth.

The answer is the content of ``gap.json``. Nothing is taken from it on trust: how much of the
held-out disagreement is closed, and whether a wrong name could be told from the right one at
all, is computed from the drawn drive.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.hidden_effects.camera import CAMERA_SCALES
from tests.hidden_effects.cases import Drawn
from tests.hidden_effects.evidence import Scene, Whitened, shifts_of, whiten
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.setting import Setting, walks
from tests.hidden_effects.sizes import SCALES, STOCHASTIC, DrawnEffect

NOISE_NAMES = frozenset({"gnss_correlated_noise"})
DIRTY_NAMES = NOISE_NAMES | {"gnss_outliers", "gnss_noise_scale"}
"""Naming the noise that is really there is no false alarm."""
LEVELS_OF = {
    "gnss_noise_scale": ("position_h", "velocity_h"),
    "accel_bias_walk": ("accel_bias_walk",),
    "gyro_bias_walk": ("gyro_bias_walk",),
}
"""Factors on noise levels that grow with a hidden noise."""
SAME_NATS = 5.0
"""A name that falls short of the truth by less cannot be told from it on that drive."""
KNOWN_SHARE = 0.5
"""A parameter is determined where the drive alone gives its sd below this share of its value."""
INTERVAL = 1.96


@dataclass
class Verdict:
    """One finished case.

    ``outcome`` in a word; ``wrong`` names given with confidence that are not there; ``why`` a
    sentence on every miss; ``covered`` of ``counted`` values lie within their 95 % interval;
    ``closed`` share of the held-out disagreement that the found values take away by the drawn
    drive, ``closed_told`` by the answer itself.
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
    truth = {name for name in case.effects if name in SCALES or name in CAMERA_SCALES}
    real_noise = DIRTY_NAMES if case.level == "dirty" else NOISE_NAMES
    shown = [f for f in findings if f["effect"] not in real_noise or f["effect"] in truth]
    verdict.wrong = [
        str(f["effect"])
        for f in shown
        if f["effect"] not in truth and not truth & set(f.get("confusable_with", ()))
    ]
    verdict.flagged = answer.get("unexplained") is not None
    if case.kind in ("formula", "removed"):
        _outside(verdict, drawn, answer, shown)
    elif not truth:
        verdict.outcome = "false alarm" if shown or verdict.flagged else "silent"
        if verdict.outcome == "false alarm":
            verdict.why = _describe(shown, answer)
    else:
        _inside(verdict, drawn, answer, shown, truth)
    return verdict


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
        verdict.formula_right = case.kind == "formula" and formula_is_right(
            case.formula_kind, answer["unexplained"]
        )
        verdict.outcome = "formula right" if verdict.formula_right else "flagged"
    elif shown and case.kind == "formula" and _beside(case.formula_kind, shown):
        verdict.outcome = "formula beside a name"
    elif shown:
        verdict.outcome = "mis-named"
    elif case.effects and case.effects.keys() <= LEVELS_OF.keys() and _noise_shows(truth, answer):
        # a level of noise stays in the model without the effect of that name
        verdict.outcome = "as noise"
    else:
        verdict.outcome = "missed"
    if case.kind == "removed" and not verdict.flagged and _told_beside(case.effects, shown):
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


def _beside(kind: str, shown: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the right formula is told as what a name cannot be told from."""
    confusable = (str(r) for f in shown for r in f.get("confusable_with", ()) if "+=" in str(r))
    return any(
        formula_is_right(kind, {"channel": r.partition(" ")[0], "formula": r}) for r in confusable
    )


def _told_beside(
    effects: Mapping[str, Mapping[str, float]], shown: Sequence[Mapping[str, Any]]
) -> bool:
    """Whether what a name cannot be told from is a formula of the hidden effect's terms alone."""
    true = {term for effect in effects for term in _terms_of(effect, effects[effect])}
    for finding in shown:
        for rival in map(str, finding.get("confusable_with", ())):
            terms = {(c, q) for c, q in re.findall(r"(\w+) \+= k\d* \* ([^;]+)", rival)}
            if terms and terms <= true:
                return True
    return False


def _terms_of(effect: str, values: Mapping[str, float]) -> set[tuple[str, str]]:
    """What an effect of the sensors adds, as (axis, quantity)."""
    sensor, _, kind = effect.partition("_")
    quantity = {"accel": "force", "gyro": "rate"}.get(sensor, "")
    out = set()
    for p in values:
        where = f"{sensor}_{p[0]}"
        if kind in ("misalignment", "g_sensitivity") and len(p) == 2:
            out.add((where, f"{'force' if kind == 'g_sensitivity' else quantity}_{p[1]}"))
        elif kind == "scale_asymmetry":
            same = (f"abs({quantity}_{p})", f"max({quantity}_{p}, 0)", f"min({quantity}_{p}, 0)")
            out |= {(where, text) for text in same}
        elif kind == "quadratic":
            out.add((where, f"{quantity}_{p}^2"))
        elif kind == "temperature":
            out.add((where, "temperature"))
    return out


def _describe(shown: Sequence[Mapping[str, Any]], answer: Mapping[str, Any]) -> str:
    parts = []
    for f in shown:
        numbers = ", ".join(
            f"{p} {v['value']:.3g}±{v['sd']:.1g}" for p, v in f["parameters"].items()
        )
        parts.append(f"{f['effect']} ({numbers}) {f['evidence_nats']:.0f} nats")
    odd = answer.get("unexplained")
    if odd is not None:
        parts.append(f"unexplained {odd['channel']}: {odd['formula']}")
    return "said: " + ("; ".join(parts) if parts else "nothing")


_TERMS = {
    "force_x": r"f_?x|force_?x|accel_?x|a_?x|acceler|braking",
    "force_y": r"f_?y|force_?y|accel_?y|lateral|a_?y",
    "rate_z": r"omega_?z|w_?z|rate_?z|gyro_?z|yaw.?rate|ω_?z",
    "rate": r"omega|rate|gyro|ω",
    "speed": r"speed|(?<![a-z])v(?![a-z])",
    "heading": r"heading|yaw|psi|course",
    "time": r"(?<![a-z])t(?![a-z])|time|warm|ramp|step",
    "sign": r"sign|tanh|sgn|hyster",
    "half": r"max|abs|\||positive|negative|half|one.?sided",
    "sine": r"sin",
    "square": r"\^\s*2|\*\*\s*2|²|squar|abs|\|",
    "cube": r"\^\s*3|\*\*\s*3|³|cub",
    "step": r"step|>|heaviside",
}
_RIGHT: dict[str, tuple[str, tuple[str, ...]]] = {
    "heading_sine": ("accel_x", ("heading", "sine")),
    "rate_squared": ("gyro_x", ("rate", "square")),
    "force_times_rate": ("accel_z", ("force_x", "rate_z")),
    "speed_cubed": ("accel_x", ("speed", "cube")),
    "warm_up": ("gyro_z", ("time",)),
    "one_sided": ("accel_y", ("force_x", "half")),
    "speed_times_lateral": ("accel_x", ("speed", "force_y")),
    "step": ("accel_y", ("step",)),
    "position_speed_squared": ("position", ("speed", "square")),
    "hysteresis": ("accel_z", ("sign",)),
}


def formula_is_right(kind: str, told: Mapping[str, Any]) -> bool:
    """Whether a reported formula has the channel and the factors of the hidden one."""
    channel, terms = _RIGHT[kind]
    text = str(told["formula"]).lower()
    place = f"{told['channel']} {text}".lower()
    right_place = channel in place or channel.replace("_", " ") in place
    return right_place and all(re.search(_TERMS[term], text) for term in terms)


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
        size = max(abs(v) for v in true[effect].values())
        told = list(finding["parameters"].items())
        for name, value in told:
            mine = SCALES[effect].parameters[0] if len(told) == 1 else str(name)
            if sds.get((effect, mine), np.inf) > KNOWN_SHARE * size:
                continue
            pull = (float(value["value"]) - true[effect].get(mine, 0.0)) / float(value["sd"])
            verdict.counted += 1
            verdict.covered += abs(pull) <= INTERVAL
            verdict.pulls.append(round(pull, 3))


def _whitened(
    drawn: Drawn, scene: Scene, setting: Setting, cases: Sequence[Mapping[str, DrawnEffect]]
) -> Whitened:
    shifts = shifts_of(scene, cases, setting.warm_up)
    hidden = list(drawn.case.effects)
    return whiten(scene, shifts, setting.imu, setting.gnss, *walks(setting), without=hidden)


def _unit_cases(names: Sequence[str]) -> tuple[list[tuple[str, str]], list[dict[str, DrawnEffect]]]:
    keys = [(name, p) for name in names for p in SCALES[name].parameters]
    return keys, [{name: {p: SCALES[name].small}} for name, p in keys]


def own_sd(drawn: Drawn, names: Sequence[str]) -> dict[tuple[str, str], float]:
    """Standard deviation of each parameter that an optimal estimator would reach, all unknown."""
    keys, cases = _unit_cases(names)
    white = _whitened(drawn, drawn.scene, drawn.setting, list(cases))
    info = white.gram()
    # a parameter that shows nowhere else has an sd without bound
    cov = np.linalg.inv(info + 1e-9 * np.eye(len(info)))
    small = np.array([SCALES[name].small for name, _ in keys])
    return {key: float(s) for key, s in zip(keys, np.sqrt(np.diag(cov)) * small, strict=True)}


def shortfall(drawn: Drawn, names: Sequence[str]) -> float:
    """Nats by which the best values of the named effects fail to explain what is hidden."""
    usable = [name for name in names if name in SCALES and name not in STOCHASTIC]
    true = {name: v for name, v in drawn.case.effects.items() if name in SCALES}
    _, cases = _unit_cases(usable)
    nu = _whitened(drawn, drawn.scene, drawn.setting, [true, *cases]).nu
    target: Array = nu[:, 0]
    if not usable:
        return 0.5 * float(target @ target)
    fit, *_ = np.linalg.lstsq(nu[:, 1:], target, rcond=None)
    rest = target - nu[:, 1:] @ fit
    return 0.5 * float(rest @ rest)


def closed_share(drawn: Drawn, found: Mapping[str, DrawnEffect]) -> float:
    """Share of the held-out disagreement, in nats, that the found values take away."""
    true = {name: v for name, v in drawn.case.effects.items() if name in SCALES}
    nu = _whitened(drawn, drawn.held_out, drawn.again, [true, dict(found)]).nu
    rest = nu[:, 0] - nu[:, 1]
    return 1.0 - float(rest @ rest) / max(float(nu[:, 0] @ nu[:, 0]), 1e-12)
