"""What is made of the nodes: states at every sample and between, the vehicle's own attitude."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from automap.errors import StageError
from automap.frames import matrix_to_quat, quat_to_matrix
from automap.fusion import limits
from automap.fusion.kernel_runs import run_dense
from automap.fusion.layout import HAS_POS_H, HAS_POS_V, HAS_VEL_H, HAS_VEL_V
from automap.fusion.model import build_state_model
from automap.fusion.mounting import estimate_mounting
from automap.fusion.nodes import Shift
from automap.fusion.options import FusionOptions
from automap.fusion.output import vehicle_tilt
from automap.fusion.problem import make_problem
from automap.fusion.resample import shift_states, states_at
from automap.fusion.sections import filter_and_smooth
from tests.unit.dense_filter import State
from tests.unit.fusion_drive import Sensor, record
from tests.unit.fusion_motion import city_drive, make_motion
from tests.unit.fusion_problem import make_nodes, nominal_of, true_start
from tests.unit.fusion_receiver import GPS0, Receiver, receive

NORTH = (66.0, -179.9985, 50.0)


def _apart(states: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Differences [n, 9] in m, m/s, rad of states [n, 10] from others."""
    none = np.zeros((1, 0))
    rows = []
    for a, b in zip(states, others, strict=True):
        one, other = (
            State(s[None, :3], s[None, 3:6], quat_to_matrix(s[None, 6:10]), none) for s in (a, b)
        )
        rows.append(one.minus(other)[0])
    return np.array(rows)


def test_states_at_the_samples_meet_every_node_and_share_out_what_is_left() -> None:
    """Across the date line in the far north; half way to a node half of the mismatch is there."""
    motion = city_drive(20.0, 2, start_speed=9.0, origin_deg=NORTH)
    options = FusionOptions(effects=("accel_bias", "gyro_bias"), accel_noise=0.1, gyro_noise=0.01)
    sensor = Sensor(gyro_noise=0.01, accel_noise=0.1)
    problem = make_problem(
        record(motion, sensor, 3, rate=50.0), build_state_model(options), options
    )
    fixes = receive(motion, Receiver(), 4)
    values = np.column_stack(
        [fixes.lat_rad, fixes.lon_rad, fixes.height_m, fixes.vel_ned, np.zeros(len(fixes))]
    )[:-1]
    every = np.arange(len(values)) * 10
    assert problem.t[every] == pytest.approx(fixes.gps_s[:-1] - GPS0, abs=1e-6)
    flags = np.full(len(every), HAS_POS_H | HAS_POS_V | HAS_VEL_H | HAS_VEL_V)
    var = np.tile(np.square([0.3] * 3 + [0.07] * 3 + [1.0] * 9), (len(every), 1))
    nodes = make_nodes(problem.t[every], flags, values, var)
    _, smooth = filter_and_smooth(problem, nodes, true_start(motion), Shift())
    meet, _ = run_dense(problem, nodes, smooth.nominal, smooth.params, blend=True)
    run_on, _ = run_dense(problem, nodes, smooth.nominal, smooth.params, blend=False)
    at_nodes = _apart(meet[every[1:]], smooth.nominal[1:])
    assert np.abs(at_nodes[:, :3]).max() < 1e-6
    assert np.abs(at_nodes[:, 3:]).max() < 1e-8
    miss = _apart(smooth.nominal[1:], run_on[every[1:]])
    half_way = _apart(meet[every[1:] - 5], run_on[every[1:] - 5])
    for column in range(9):
        size = np.abs(miss[:, column]).max()
        assert size > (1e-3 if column < 6 else 1e-5), column
        assert half_way[:, column] == pytest.approx(0.5 * miss[:, column], abs=0.01 * size), column
    lon = np.mod(smooth.nominal[:, 1], 2.0 * np.pi)
    assert lon.min() < np.pi < lon.max(), "the drive does not cross the date line"


def test_states_between_samples_lie_on_the_path() -> None:
    motion = make_motion([(0.0, 14.0)], [(2.0, 6.0, 100.0)], 10.0, origin_deg=NORTH, slope=0.08)
    t = np.arange(0.0, 10.01, 0.2)
    want = np.arange(0.5, 9.5, 0.0371)
    found = states_at(t, nominal_of(motion.at(t)), want)
    miss = _apart(found, nominal_of(motion.at(want)))
    assert np.abs(miss[:, :3]).max() < 2e-3
    assert np.abs(miss[:, 3:6]).max() < 0.05
    assert np.abs(miss[:, 6:]).max() < 2e-3
    later = shift_states(t, nominal_of(motion.at(t)), np.full(len(t), 0.05))
    inside = t < 9.9
    miss = _apart(later[inside], nominal_of(motion.at(t[inside] + 0.05)))
    assert np.abs(miss[:, :3]).max() < 2e-3


def test_states_before_and_after_the_samples_go_on_as_they_were() -> None:
    motion = make_motion([(0.0, 14.0)], [], 6.0, origin_deg=NORTH, heading_deg=70.0, slope=0.0)
    t = np.arange(1.0, 4.01, 0.2)
    want = np.array([0.4, 0.8, 4.3, 4.9])
    miss = _apart(states_at(t, nominal_of(motion.at(t)), want), nominal_of(motion.at(want)))
    assert np.abs(miss[:, :3]).max() < 0.01


def test_the_vehicles_tilt_is_that_of_sensor_and_mounting_together() -> None:
    """Against the difference quotient of the vehicle's attitude by both."""
    rng = np.random.default_rng(3)
    turn = Rotation.from_rotvec([0.3, -0.2, 1.1]).as_matrix()
    c_n_s = Rotation.from_rotvec([[0.1, 0.4, -2.0], [1.0, 0.2, 0.3]]).as_matrix()
    nominal = np.zeros((2, 10))
    nominal[:, 6:10] = matrix_to_quat(c_n_s)
    root = 0.01 * rng.standard_normal((2, 13, 13))
    cov = root @ np.swapaxes(root, 1, 2)
    found = vehicle_tilt(nominal, cov[:, :12, :12], turn)
    for k in range(2):

        def vehicle(dx: np.ndarray, c: np.ndarray = c_n_s[k]) -> np.ndarray:
            sensor = Rotation.from_rotvec(dx[6:9]).as_matrix() @ c
            # the mounting's error turns the vehicle's axes against the sensor's
            return sensor @ (Rotation.from_rotvec(dx[9:12]).as_matrix() @ turn).T

        J = np.zeros((3, 12))
        for j in range(12):
            step = 1e-6 * np.eye(12)[j]
            J[:, j] = Rotation.from_matrix(vehicle(step) @ vehicle(-step).T).as_rotvec() / 2e-6
        assert found[k] == pytest.approx(J @ cov[k, :12, :12] @ J.T, rel=1e-4, abs=1e-9)


def test_the_axis_of_turning_corrects_a_mounting_that_gravity_got_wrong() -> None:
    """Bends to both sides; an accelerometer's bias has tilted all attitudes by 0.05 rad of roll."""
    turns = [(10.0, 8.0, 180.0), (30.0, 8.0, -180.0), (50.0, 8.0, 180.0), (70.0, 8.0, -180.0)]
    motion = make_motion([(0.0, 10.0)], turns, 90.0, slope=0.0)
    t = np.arange(0.0, 90.0, 0.1)
    true = motion.at(t)
    c_v_s = Rotation.from_rotvec([0.2, -0.1, 0.9]).as_matrix()
    exact = estimate_mounting(t, true.vel, true.c_n_b @ c_v_s, true.gyro @ c_v_s, np.zeros(len(t)))
    assert np.abs(_turn(exact.matrix, c_v_s)).max() < 0.01
    for wrong in (0.05, -0.05):
        rolled = Rotation.from_rotvec([wrong, 0.0, 0.0]).as_matrix()
        attitude = true.c_n_b @ rolled @ c_v_s
        found = estimate_mounting(t, true.vel, attitude, true.gyro @ c_v_s, np.zeros(len(t)))
        off = _turn(found.matrix, c_v_s)[0]
        by_gravity_alone = _turn(rolled @ c_v_s, c_v_s)[0]
        assert abs(off) < 0.85 * abs(by_gravity_alone)
        assert off * by_gravity_alone > 0.0
        assert abs(off) < 3.0 * found.sd[0]


def test_a_drive_without_a_turn_has_the_mounting_that_gravity_tells() -> None:
    """Nothing is learnt from turns that are not there, which is not the same as no number."""
    motion = make_motion([(0.0, 10.0)], [], 60.0, slope=0.0)
    t = np.arange(0.0, 60.0, 0.1)
    true = motion.at(t)
    c_v_s = Rotation.from_rotvec([0.2, -0.1, 0.9]).as_matrix()
    found = estimate_mounting(t, true.vel, true.c_n_b @ c_v_s, true.gyro @ c_v_s, np.zeros(len(t)))
    assert np.abs(_turn(found.matrix, c_v_s)).max() < 0.01
    assert found.sd[0] == pytest.approx(limits.ROAD_ROLL_SD)


@pytest.mark.parametrize("wrong", [0.03, -0.04])
@pytest.mark.parametrize("sides", [(1.0,), (1.0, -1.0)])
def test_roll_by_turns_and_by_gravity_are_joined_by_their_variances(
    wrong: float, sides: tuple[float, ...]
) -> None:
    """Level turns of known angle on one side or both, attitudes that are wrong by one roll."""
    dt, rate = 0.1, 0.3
    turning = np.concatenate([np.full(200, side * rate) for side in sides] + [np.zeros(200)])
    t = dt * np.arange(len(turning))
    heading = 0.4 + np.cumsum(turning) * dt
    level = Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    velocity = 12.0 * level[:, :, 0]
    body_rate = np.column_stack([np.zeros((len(t), 2)), turning])
    c_v_s = Rotation.from_rotvec([2.0, -0.4, 0.9]).as_matrix()
    rolled = Rotation.from_rotvec([wrong, 0.0, 0.0]).as_matrix()
    found = estimate_mounting(
        t, velocity, level @ rolled @ c_v_s, body_rate @ c_v_s, np.zeros(len(t))
    )
    # of a side 6 rad and a little less: seen along an axis that is off by the roll
    angle = 200 * dt * rate * np.cos(wrong)
    each = limits.LEAN_SD**2 + limits.GRADE_SD**2 * 0.5 * np.pi / angle
    by_turns, by_gravity = each / len(sides), limits.ROAD_ROLL_SD**2
    share = by_gravity / (by_gravity + by_turns)
    left = _turn(found.matrix, rolled @ c_v_s)
    assert left == pytest.approx([-wrong * share, 0.0, 0.0], abs=1e-6)
    assert found.sd[0] == pytest.approx(np.sqrt(by_turns * by_gravity / (by_turns + by_gravity)))
    np.testing.assert_allclose(
        Rotation.from_euler("ZYX", found.rpy[::-1]).as_matrix(), found.matrix
    )


def test_forward_is_where_the_vehicle_goes_but_for_what_is_told_apart() -> None:
    """Straight on with a sway to both sides; some rows backwards, some braking with its nose down,
    some slow and sideways."""
    n, dt, sway = 600, 0.1, 0.02
    t = dt * np.arange(n)
    c_v_s = Rotation.from_rotvec([0.3, -0.2, 1.9]).as_matrix()
    direction = np.column_stack([np.ones(n), sway * (-1.0) ** np.arange(n), np.zeros(n)])
    velocity = 12.0 * direction / np.linalg.norm(direction, axis=1)[:, None]
    attitude = np.broadcast_to(c_v_s, (n, 3, 3)).copy()
    along = np.zeros(n)
    plain = estimate_mounting(t, velocity, attitude, np.zeros((n, 3)), along)
    np.testing.assert_allclose(plain.matrix, c_v_s, atol=1e-9)
    blocks = n * dt / limits.FORWARD_BLOCK_S
    wanted = np.sin(np.arctan(sway)) / np.sqrt(2.0 * blocks) + limits.LEAST_FORWARD_SD
    assert plain.sd[1:] == pytest.approx([wanted] * 2, rel=1e-3)
    velocity[100:160] *= -1.0
    along[200:260] = -2.0 * limits.STRAIGHT_ACCELERATION
    attitude[200:260] = Rotation.from_euler("y", -0.1).as_matrix() @ c_v_s
    velocity[300:360] = [0.0, 0.5 * limits.MOUNTING_SPEED, 0.0]
    found = estimate_mounting(t, velocity, attitude, np.zeros((n, 3)), along)
    np.testing.assert_allclose(found.matrix[0], c_v_s[0], atol=1e-3)
    # where all of it is braking that is better than nothing
    braked = estimate_mounting(t, velocity, attitude, np.zeros((n, 3)), np.full(n, 9.0))
    assert np.abs(_turn(braked.matrix, c_v_s)).max() < 0.05
    few = int(0.9 * limits.MOUNTING_MOVING_S / dt)
    with pytest.raises(StageError, match="cannot be found"):
        estimate_mounting(t[:few], velocity[:few], attitude[:few], np.zeros((few, 3)), along[:few])
    more = int(1.1 * limits.MOUNTING_MOVING_S / dt)
    estimate_mounting(t[:more], velocity[:more], attitude[:more], np.zeros((more, 3)), along[:more])


def _turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(a @ b.T).as_rotvec()
