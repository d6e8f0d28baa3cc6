"""The passes of a fusion run, from readings and fixes to a smoothed trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import IO

import numpy as np

from automap.frames import (
    matrix_to_quat,
    quat_to_matrix,
)
from automap.fusion import limits
from automap.fusion.alignment import first_position_sd
from automap.fusion.aside import ROWS
from automap.fusion.delay_states import WHEELS_STATE
from automap.fusion.dense_pieces import MARGIN_S, dense_pieces
from automap.fusion.kernel_runs import Start
from automap.fusion.layout import HAS_POS_H, HAS_POS_V
from automap.fusion.measurements.position import by_carrier
from automap.fusion.mounting import Mounting, estimate_mounting
from automap.fusion.nodes import FixModel, Shift
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Basis, Pass, Session, basis_of, run_passes, without_readings
from automap.fusion.preparation import prepare
from automap.fusion.problem import stored
from automap.fusion.result import FusionResult, Prior, WheelResult, assemble, collect
from automap.fusion.screening import screen_fixes
from automap.fusion.wheels import Wheels
from automap.fusion.worse_stretches import WINDOWS, find_again, find_worse, fixes_in
from automap.records import (
    ClockModel,
    Fixes,
    FloatArray,
    ImuData,
    WheelSpeed,
)

_NO_NHC = ("imu_mounting", "nhc_lever_arm", "vehicle_pitch")
"""What nothing shows before the constraint acts in the vehicle's axes."""
_AGAIN = 2
"""Times at most that stretches of larger errors are found anew by a path that knows of them: one
finds most of each, the next what the path followed until then, and each costs passes over all."""


def fuse_imu_gnss(
    imu: ImuData,
    fixes: Fixes,
    clock: ClockModel,
    options: FusionOptions,
    delay: Prior,
    lever_arm: FloatArray | None = None,
    lever_arm_sd: float = limits.STATED_ARM_SD_M,
    roll_sd: float = limits.KNOWN_ROLL_SD,
    delay_is_clock: bool = False,
    odometer: WheelSpeed | None = None,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
    scratch: IO[bytes] | None = None,
) -> FusionResult:
    """Fuse inertial readings and fixes of one drive.

    ``imu`` in vehicle axes or, with ``axes_known`` False, in the sensor's own: then the
    mounting is estimated. ``delay`` is the prior of how much later than the fixes' clock the
    IMU stamps run: imu_time_offset minus any unknown output delay of the receiver. With
    ``delay_is_clock`` that delay is an error of the clock model and corrects ``gps_s``;
    otherwise the stamps are instants of a right clock at which late samples were noted, and
    each row of the output is the vehicle's state at its stamp's instant. ``lever_arm`` [3] IMU
    to antenna in body axes, None if unknown (it is then estimated). ``roll_sd`` rad how
    exactly axes that are known are so about the forward one, which no motion tells. ``odometer``
    the speed of the wheels, stamped by the host clock without the IMU's own delay. In holes between
    readings of more than three seconds the output has a row a second, by made-up readings
    (``over_holes``); it begins where readings tell the heading. Into the file
    ``scratch`` goes what of a long drive is as large as its readings; it stays open while stretches
    of the result are asked for.

    Raises:
        InputError: fewer than two usable fixes within the IMU's span, or hardly any samples.
    """
    session, known = prepare(
        *(imu, fixes, clock, options, delay),
        *(lever_arm, lever_arm_sd, roll_sd, delay_is_clock, odometer),
    )
    axes_known, base_ns = imu.axes_known, int(session.imu.t_ns[0])
    del imu
    options, warnings = session.options, known.warnings
    mounting = Mounting(np.eye(3), np.zeros(3), np.zeros(3))
    start: Start | None = None
    shift: Shift | None = None
    margin = np.inf
    known_means, known_sds = known.in_vehicle
    if not axes_known:
        progress(0.05, "fusing in sensor axes to find the mounting")
        free = replace(options, effects=tuple(e for e in options.effects if e not in _NO_NHC))
        loose = replace(session, options=free)
        last, found = run_passes(loose, None, constrained=False, basis=_basis_of(loose, scratch))
        margin = found.margin
        mounting = _mounting_of(last)
        session, start = _turn(session, last, mounting)
        shift = last.shift
        # what gravity and turns left open stays open, also in the vehicle's roll
        known_sds = {**known_sds, "imu_mounting_roll": float(mounting.sd[0])}
        del loose, last, found
    session = replace(
        session, means={**session.means, **known_means}, sds={**session.sds, **known_sds}
    )
    # of a long drive the readings are as large again as what is made of them
    basis, session = _basis_of(session, scratch), without_readings(session)
    progress(0.3, "fusing")
    last, found = run_passes(
        session,
        start,
        constrained=True,
        progress=lambda text: progress(0.5, text),
        found=shift,
        basis=basis,
    )
    screened = known.screened
    worse, window_s = None, WINDOWS * options.multipath_tau_s
    # a carrier-phase solution is as good as it says, from one moment to the next
    if options.adapt and not by_carrier(fixes):
        worse = find_worse(last, window_s, len(fixes))
    again = 0
    while worse is not None:
        screened = screen_fixes(fixes_in(known.stated, worse, options), options.wander_tau_s)
        session = replace(session, fixes=screened.fixes)
        start, shift = _unsure(found.start, screened.fixes), last.shift
        del last
        progress(0.6, "fusing, with errors as large as they are by stretches")
        last, found = run_passes(session, start, constrained=True, found=shift, basis=basis)
        if not worse.slow:
            break
        now = worse if again == _AGAIN else find_again(last, window_s, worse)
        if now.spans == worse.spans:
            # where they are is settled: what lasts for minutes is as ever there. Levels begin
            # where they are, for a path that drifts looks like positions that do
            session = replace(session, options=replace(session.options, factors=last.factors))
            now = replace(worse, slow=False)
        again, worse = again + 1, now
    if worse is not None:
        warnings.append(worse.text())
    if screened.n_outliers:
        warnings.append(
            f"{screened.n_outliers} fixes lie up to {screened.largest_m:.0f} m off the path that "
            "the others and the velocities show; they were trusted less"
        )
    margin = min(margin, found.margin)
    if last.tuned is not None and not last.tuned.better:
        warnings.append(
            "tuning found no better noise levels: on the half of the drive that they were not "
            f"found on they explain the measurements by {-last.tuned.gain:.0f} nats worse; the "
            "levels of a plain run stay"
        )
    progress(0.8, "writing the trajectory at IMU rate")
    outcome = collect(last, base_ns, screened.outliers)
    del last, found, basis
    result = assemble(
        session,
        outcome,
        clock,
        mounting,
        margin,
        warnings,
        axes_known,
        delay_is_clock,
        known.arm_sd,
        known.age_sd,
        worse,
    )
    return replace(result, wheels=_wheels_of(known.wheels, result, delay_is_clock))


def _unsure(start: Start, fixes: FixModel) -> Start:
    """A start no surer than its first fix, which may lie in a worse stretch."""
    first = int(np.flatnonzero((fixes.flags & HAS_POS_H) > 0)[0])
    sd = start.sd.copy()
    sd[:2] = np.maximum(sd[:2], first_position_sd(fixes, first)[:2])
    if fixes.flags[first] & HAS_POS_V:
        sd[2] = max(sd[2], first_position_sd(fixes, first)[2])
    return Start(start.nominal, sd)


def _wheels_of(
    wheels: Wheels | None, result: FusionResult, delay_is_clock: bool
) -> WheelResult | None:
    if wheels is None or wheels.odometer is None:
        return None if wheels is None else WheelResult(wheels)
    names, values, sd = result.parameters.names, result.parameters.values, result.parameters.sd
    scale, late = (
        Prior(float(values[-1, i]), float(sd[-1, i])) if i >= 0 else Prior(0.0, 0.0)
        for i in (
            names.index(name) if name in names else -1
            for name in ("odometer_scale_relative", WHEELS_STATE)
        )
    )
    if delay_is_clock:
        # IMU and wheels share the clock that is off against the fixes
        late = replace(late, mean=late.mean - result.delay.mean)
    return WheelResult(wheels, replace(scale, mean=1.0 + scale.mean), late)


def _basis_of(session: Session, scratch: IO[bytes] | None) -> Basis:
    """The basis of a session's passes; a long drive's samples in the file ``scratch``."""
    basis = basis_of(session)
    if scratch is None or len(basis.problem.t) <= ROWS:
        return basis
    return replace(basis, problem=stored(basis.problem, scratch))


def _mounting_of(last: Pass) -> Mounting:
    """Mounting from a run in sensor axes."""
    problem = last.problem
    # time, velocity, attitude and rate at the samples between the nodes
    rows, n = np.empty((len(problem.t), 11)), 0
    for piece in dense_pieces(problem, last.nodes, last.smooth, True, MARGIN_S, with_rates=True):
        own = slice(piece.rows.start - piece.around.start, piece.rows.stop - piece.around.start)
        good = piece.good[own]
        t, states = problem.t[piece.rows][good], piece.dense[own][good, 3:10]
        rows[n : n + len(t)] = np.column_stack([t, states, piece.rates[own][good, :3]])
        n += len(t)
    rows = rows[:n]
    step = max(int(0.1 / max(float(np.median(np.diff(rows[:, 0]))), 1e-4)), 1)
    t, vel, quat, rate = (rows[::step, a:b].copy() for a, b in ((0, 1), (1, 4), (4, 8), (8, 11)))
    along = np.gradient(np.linalg.norm(vel, axis=1), t[:, 0])
    return estimate_mounting(t[:, 0], vel, quat_to_matrix(quat), rate, along)


def _turn(session: Session, last: Pass, mounting: Mounting) -> tuple[Session, Start]:
    """Turn readings, priors and the start from sensor into vehicle axes."""
    c = mounting.matrix
    imu = replace(
        session.imu, gyro=session.imu.gyro @ c.T, accel=session.imu.accel @ c.T, axes_known=True
    )
    means = dict(session.means)
    if "gyro_bias_x" in means:
        turned = c @ np.array([means[f"gyro_bias_{a}"] for a in "xyz"])
        means |= {f"gyro_bias_{a}": float(v) for a, v in zip("xyz", turned, strict=True)}
    nominal = last.smooth.nominal[0].copy()
    nominal[6:10] = matrix_to_quat(quat_to_matrix(nominal[6:10]) @ c.T)
    place, speed = np.full(3, limits.TURNED_START_SD_M), np.full(3, limits.TURNED_START_SPEED_SD)
    if not (session.fixes.flags & HAS_POS_V).any():
        place[2] = limits.UNKNOWN_HEIGHT_SD_M
    tilt = limits.START_TILT_SD
    sd = np.concatenate([place, speed, [tilt, tilt, limits.TURNED_HEADING_SD]])
    return replace(session, imu=imu, means=means), Start(nominal, sd)
