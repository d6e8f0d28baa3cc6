"""What a drive cannot tell stays in the path's sigma: lasting biases, arms that nobody stated."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from automap.fusion import limits
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.measurements.position import unseen_changes, unseen_errors
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.lever_arm import turn_rate
from automap.records import FloatArray
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive

OPTIONS = FusionOptions()
STATED = np.array([[1.0, 2.0, 3.0], [4.0, 4.0, 4.0]])
LEVER = np.array([0.9, -0.6, -1.4])
METRES = Receiver(lever=tuple(LEVER))
CENTIMETRES = Receiver(wander=(0.006,) * 3, white=(0.012,) * 3, lever=tuple(LEVER))


def _factors(**given: float) -> dict[str, float]:
    return dict.fromkeys(ALL_LEVELS, 1.0) | given


@pytest.mark.parametrize("factor", [0.0, 0.1, 0.5, 1.0])
def test_where_a_drive_shows_less_than_was_stated_the_rest_is_unseen(factor: float) -> None:
    """White, quick, slow and unseen parts together are never less than all shares of it."""
    levels = ("wander", "wander_v", "multipath", "position_h", "position_v")
    unseen = unseen_errors(STATED, OPTIONS, _factors(**dict.fromkeys(levels, factor)))
    shares = (OPTIONS.wander_share, OPTIONS.multipath_share, OPTIONS.white_share)
    seen = STATED * factor * np.linalg.norm(shares)
    whole = STATED * np.linalg.norm((*shares, OPTIONS.bias_share))
    assert whole == pytest.approx(STATED, rel=0.005)
    assert np.hypot(unseen, seen) == pytest.approx(whole)
    if factor < 1.0:
        assert (unseen > OPTIONS.bias_share * STATED).all()


@pytest.mark.parametrize("share", [0.0, 0.2, 0.9])
def test_a_receiver_has_the_lasting_part_that_is_stated_of_it(share: float) -> None:
    """What the other shares leave of a statement lasts where that is said: not of a receiver of
    which nothing does."""
    unseen = unseen_errors(STATED, replace(OPTIONS, bias_share=share), _factors())
    assert unseen == pytest.approx(share * STATED, abs=1e-6)


def test_what_is_unseen_grows_with_what_is_seen() -> None:
    """Errors of minutes and of hours have one cause: three times the one, three times the other."""
    grown = unseen_errors(STATED, OPTIONS, _factors(wander=3.0, wander_v=5.0))
    assert grown == pytest.approx(OPTIONS.bias_share * STATED * [3.0, 3.0, 5.0])
    # noise that is gone from one fix to the next is no sign of a bias
    noisy = unseen_errors(STATED, OPTIONS, _factors(position_h=5.0, position_v=5.0, multipath=4.0))
    assert noisy == pytest.approx(unseen_errors(STATED, OPTIONS, _factors()))


def test_noise_beyond_the_statement_takes_nothing_from_what_is_unseen() -> None:
    """Noise that hides what lasts for minutes does not make a bias smaller."""
    quick = _factors(position_h=6.0, position_v=6.0, multipath=4.0)
    hidden = unseen_errors(STATED, OPTIONS, quick | {"wander": 0.1, "wander_v": 0.1})
    assert (hidden > 0.9 * STATED).all()


def test_levels_of_the_height_are_its_own() -> None:
    down = unseen_errors(STATED, OPTIONS, _factors(wander_v=4.0))
    plain = unseen_errors(STATED, OPTIONS, _factors())
    assert down[:, :2] == pytest.approx(plain[:, :2])
    assert (down[:, 2] > 3.0 * plain[:, 2]).all()


def test_heights_err_with_the_ranges_that_positions_show() -> None:
    """Four times those of minutes and of hours; what motion does not show of them lasts."""
    unseen = unseen_errors(STATED, OPTIONS, _factors(wander=4.0, wander_v=0.2))
    assert unseen[:, :2] == pytest.approx(OPTIONS.bias_share * STATED[:, :2] * 4.0)
    seen = 0.2 * OPTIONS.wander_share * STATED[:, 2]
    lasting = math.hypot(OPTIONS.wander_share, OPTIONS.bias_share)
    assert np.hypot(unseen[:, 2], seen) == pytest.approx(4.0 * lasting * STATED[:, 2])


def test_what_is_unseen_changes_as_slow_errors_do_but_for_its_constant_part() -> None:
    shown = _factors(wander=0.3, wander_v=0.3)
    unseen = unseen_errors(STATED, OPTIONS, shown)
    long = unseen_changes(STATED, 1e6, OPTIONS, shown)
    assert np.hypot(long / math.sqrt(2.0), OPTIONS.bias_share * STATED) == pytest.approx(unseen)
    one = unseen_changes(STATED, OPTIONS.wander_tau_s, OPTIONS, shown)
    assert one == pytest.approx(long * math.sqrt(1.0 - math.exp(-1.0)))
    assert unseen_changes(STATED, 1e6, OPTIONS, _factors()) == pytest.approx(0.0, abs=1e-6)
    # three times the errors of minutes, and of hours with them
    grown = unseen_changes(STATED, 1e6, OPTIONS, _factors(wander=3.0, wander_v=3.0))
    assert grown == pytest.approx(0.0, abs=1e-6)


def test_heights_that_go_off_evenly_are_in_the_sigma_of_the_pitch() -> None:
    """No innovation tells them from a road that falls: four metres of receivers of three were four
    sigmas of the pitch."""
    motion = city_drive(70.0, 4)
    imu, fixes = record(motion, Sensor(), 2), receive(motion, Receiver(wander=(0.0,) * 3), 3)
    fixes = replace(fixes, sd_pos_ned=np.full((len(fixes), 3), 3.0))
    off = replace(fixes, height_m=fixes.height_m + np.linspace(0.0, 4.0, len(fixes)))
    path = fuse_imu_gnss(
        imu, off, CLOCK, OPTIONS, Prior(0.0, 0.1), lever_arm=np.zeros(3)
    ).trajectory
    true = motion.at((path.t_ns - BASE_NS) * 1e-9)
    error = float(np.median(path.rpy[:, 1] + np.arcsin(true.c_n_b[:, 2, 0])))
    way = float(np.hypot(*true.vel[:, :2].T).mean()) * 70.0
    assert error == pytest.approx(4.0 / way, rel=0.3)
    assert 0.5 * error < np.median(path.sd_rpy[:, 1]) < 1.5 * error


def _fused(receiver: Receiver, arm: FloatArray | None) -> FusionResult:
    motion = city_drive(70.0, 4)
    imu, fixes = record(motion, Sensor(), 2), receive(motion, receiver, 3)
    return fuse_imu_gnss(imu, fixes, CLOCK, OPTIONS, Prior(0.0, 0.1), lever_arm=arm)


def _arm(result: FusionResult) -> tuple[FloatArray, FloatArray]:
    rows = [result.parameters.names.index(f"gnss_lever_arm_{a}") for a in "xyz"]
    return result.parameters.values[-1, rows], result.parameters.sd[-1, rows]


@pytest.mark.slow
def test_fixes_of_metres_tell_no_arm_and_the_path_is_less_sure_for_it() -> None:
    unknown, stated = _fused(METRES, None), _fused(METRES, LEVER)
    assert not any("gnss_lever_arm" in name for name in unknown.parameters.names)
    assert _arm(stated)[0] == pytest.approx(LEVER, abs=0.1)
    sd = unknown.trajectory.sd_pos_ned
    bias = unseen_errors(np.array([METRES.wander]), OPTIONS, unknown.noise_factors)
    assert (sd > np.hypot(bias, limits.UNKNOWN_ARM_SD_M)).all()
    # at the antenna a bend is faster or slower by the turn rate times the arm
    path = unknown.trajectory
    swung = limits.UNKNOWN_ARM_SD_M * np.abs(turn_rate(path)[:, 2])
    assert swung.max() > 0.05
    assert (path.sd_vel_ned[:, :2].max(axis=1) > 0.9 * swung).all()
    assert (
        stated.trajectory.sd_pos_ned
        > 0.95 * unseen_errors(np.array([METRES.wander]), OPTIONS, stated.noise_factors)
    ).all()


def test_fixes_of_centimetres_tell_the_arm() -> None:
    value, sd = _arm(_fused(CENTIMETRES, None))
    assert (np.abs(value - LEVER)[:2] < 4.0 * sd[:2]).all()
    assert sd[:2].max() < 0.1
