"""What drawn drives themselves say of an answer, by the optimal filter that knows their noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tests.hidden_effects.cases import Drawn
from tests.hidden_effects.evidence import Scene, Whitened, shifts_of, whiten
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.setting import Setting, walks
from tests.hidden_effects.sizes import SCALES, STOCHASTIC, DrawnEffect


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
