"""An IMU whose azimuth was mistaken at first is none that changed; one that lies otherwise is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from automap.records import FloatArray
from automap.sync.axes_evidence import AxesEvidence, Followed, axes_evidence
from automap.sync.mount_change import mount_change
from automap.sync.mount_pieces import MountPiece, forward_azimuth, mount_pieces
from tests.unit.fusion_drive import CLOCK, Sensor, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import Receiver, receive


@cache
def pieces() -> tuple[list[MountPiece], FloatArray]:
    motion = city_drive(330.0, 4)
    imu = record(motion, Sensor(), 4, rate=20.0)
    fixes = receive(motion, Receiver(rate=2.0), 4)
    whole = axes_evidence(imu, fixes, CLOCK)
    return mount_pieces(imu, fixes, CLOCK, whole), whole.up


def turned(piece: MountPiece, angle: float) -> MountPiece:
    """A piece whose accelerations lie otherwise about the vertical."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def by(seen: Followed | None) -> Followed | None:
        return None if seen is None else replace(seen, xy=turn @ seen.xy)

    seen = piece.seen
    return replace(piece, seen=replace(seen, surge=by(seen.surge), lateral=by(seen.lateral)))


def test_a_first_piece_that_was_mistaken_is_no_change() -> None:
    drive, up = pieces()
    assert mount_change(drive, up, known=False) is None
    mistaken = [turned(drive[0], np.pi / 4), *drive[1:]]
    assert mount_change(mistaken, up, known=False) is None


def test_other_axes_from_the_second_minute_on_are_one() -> None:
    drive, up = pieces()
    other = [turned(piece, np.pi / 2) for piece in drive[:2]] + drive[2:]
    change = mount_change(other, up, known=False)
    assert change is not None
    assert change.kind == "axes"


def test_noise_of_velocities_on_a_straight_road_tells_no_azimuth() -> None:
    """Of 25 samples chance explains three tenths at one of the lags that are tried; it said that
    the sensor lies backwards, to a degree, where the road had no bend."""
    up = np.array([0.0, 0.0, -1.0])

    def azimuth(share: float) -> tuple[float, float] | None:
        xx = np.diag([280.0, 0.1, 0.01])
        lateral = Followed(25.5, 115, 0.04, np.array([0.0, -0.12, 0.0]), xx, 0.5, share, 1.4)
        return forward_azimuth(AxesEvidence(up, lateral=lateral), up)

    assert azimuth(0.3) is None
    assert azimuth(0.9) is not None
