"""Users' effects of a camera: turns and time offsets that go with quantities of the drive.

They act as the boresight and the time offset do, times a signal: after these, about the camera's
axes, and added to the stamps.
"""

from __future__ import annotations

import numpy as np

from automap.effects.camera_kernels import TIME, TURN
from automap.effects.measured import Values
from automap.effects.signals import Signals
from automap.effects.user import OF_CAMERA, signal_of, user_effects
from automap.records import FloatArray

_COLUMNS = (TURN, TURN + 1, TURN + 2, TIME)


def _terms() -> list[tuple[str, str, int]]:
    """Effect, parameter and place among ``OF_CAMERA`` of all users' effects of a camera."""
    return [
        (effect.name, term.parameter, OF_CAMERA.index(term.on))
        for effect in user_effects()
        for term in effect.formulas
        if term.on in OF_CAMERA
    ]


def depends_on_the_drive(values: Values | None = None) -> bool:
    """Whether users' effects of a camera are among ``values``, or exist at all."""
    return any(values is None or effect in values for effect, _, _ in _terms())


def drift(values: Values, signals: Signals) -> tuple[FloatArray, FloatArray]:
    """Turn [n, 3] in rad (roll, pitch, yaw) and time offset [n] in s that go with the drive."""
    out = np.zeros((len(signals.time), 4))
    for effect, parameter, place in _terms():
        value = values.get(effect, {}).get(parameter, 0.0)
        if value != 0.0:
            out[:, place] += value * signal_of(effect, parameter, signals)
    return out[:, :3], out[:, 3]


def user_columns(signals: Signals, columns: FloatArray) -> FloatArray:
    """Derivatives [n, 3, u] by the parameters of users' effects, from the kernels' columns."""
    added = [
        columns[:, :, _COLUMNS[place]] * signal_of(effect, parameter, signals)[:, None]
        for effect, parameter, place in _terms()
    ]
    return np.stack(added, axis=2) if added else np.zeros((len(columns), 3, 0))
