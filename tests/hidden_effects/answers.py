"""What an answer says beside names: misfits, claims of noise, what it refused, a receiver's own."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from tests.hidden_effects.real_receiver import Replay
from tests.hidden_effects.told import FIX_AXES, terms_of

Answer = Mapping[str, Any]
SURE = 1e-3
"""The p-value below which the finder says that it names; a less sure misfit says nothing."""
INSTALLED = ("gnss_lever_arm", "gnss_datum_shift")
"""Of the receiver by name, but where its antenna and its datum are is no error of the receiver."""
EARLY_S = 0.03
"""Fixes ahead of their tags by a known time are told as stamps that are late by it, give or take
so much: the recordings' delays are known to a few hundredths."""


def rows(answer: Answer, key: str) -> list[Mapping[str, Any]]:
    """A list of records of the answer, empty where there is none."""
    found = answer.get(key) or ()
    return [found] if isinstance(found, Mapping) else list(found)


def misfits(answer: Answer) -> list[Mapping[str, Any]]:
    """What the answer says is missing without a name for it."""
    return [m for m in rows(answer, "misfits") if float(m.get("p_value", 0.0)) <= SURE]


def noise_claims(answer: Answer) -> list[Mapping[str, Any]]:
    """Levels of noise that the answer says are not as stated."""
    return [c for c in rows(answer, "noise_claims") if float(c.get("p_value", 0.0)) <= SURE]


def refused(answer: Answer) -> tuple[str, float | None, float | None]:
    """Name, p-value and nats of the strongest candidate that is no receiver's and was not named;
    nothing where the answer does not state it."""
    own = [r for r in rows(answer, "refused") if not of_receiver(str(r.get("effect", "")))]
    if not own:
        return "", None, None
    best = max(own, key=lambda r: float(r.get("evidence_nats", 0.0)))
    p, nats = best.get("p_value"), best.get("evidence_nats")
    name = str(best.get("effect", ""))
    return name, None if p is None else float(p), None if nats is None else float(nats)


def of_receiver(name: str) -> bool:
    """Whether a name is one of the receiver's own errors."""
    return name.startswith("gnss_") and name not in INSTALLED


def strangers(
    findings: Sequence[Mapping[str, Any]],
    replay: Replay | None,
    truth: Collection[str] = (),
) -> list[Mapping[str, Any]]:
    """The findings that a recorded receiver has not brought along, and those that are what is
    hidden (``truth``) or cannot be told from it; all of them without a recording."""
    if replay is None:
        return list(findings)
    return [
        f
        for f in findings
        if {str(f["effect"]), *f.get("confusable_with", ())} & set(truth)
        or not (of_receiver(str(f["effect"])) or _is_early(f, replay))
    ]


def _is_early(finding: Mapping[str, Any], replay: Replay) -> bool:
    """Whether a finding is that the recorded receiver's positions run ahead of their tags."""
    if finding["effect"] != "imu_time_offset":
        return False
    told = next(iter(finding["parameters"].values()))
    early = -replay.series().position_s
    return early > 0.0 and abs(float(told["value"]) - early) < EARLY_S + 3.0 * float(told["sd"])


def formula_is_strange(answer: Answer, replay: Replay | None) -> bool:
    """Whether the answer's formula, if any, says more than that a recorded receiver errs."""
    unexplained = answer.get("unexplained")
    if unexplained is None:
        return False
    places = [t.channel for t in terms_of(unexplained)] or [str(unexplained["channel"])]
    return replay is None or not all(place in FIX_AXES for place in places)


def strange_misfits(answer: Answer, replay: Replay | None) -> list[Mapping[str, Any]]:
    """Misfits that are no recorded receiver's: its errors show in positions and velocities."""
    return [m for m in misfits(answer) if replay is None or str(m["channel"]).startswith("nhc")]
