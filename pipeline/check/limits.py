"""The numbers from which ``automap check`` says something, and why.

"Chosen" says of a number that no derivation gives it, and what it weighs.
"""

from __future__ import annotations

LONG_ARM_M = 5.0
"""Longer lever arms do not fit on a car: centimetres, millimetres or a wrong number."""
LOW_ARM_M = 0.5
"""An antenna further below the IMU has the sign of a roof's turned; so has a camera where nobody
says how high the IMU is above the road."""
FASTEST_M_S = 70.0
"""Between two fixes no car is faster (250 km/h)."""
FIX_GAP_S, FIX_GAP_STEPS = 5.0, 5.0
"""A time without fixes that is told, s and in usual steps."""
SET_SPEED_M_S, SET_WAY_S, SET_PART = 3.0, 1.0, 0.5
"""A vehicle that drove on while its clock was set: slower than this it may have parked; velocities
are over the way of a second, which is known to half of itself at that speed."""
SET_JITTER_S = 0.05
"""Of stamps beside a set clock: what a busy phone's readings are late by."""
LOST_SHARE = 0.2
"""Of the epochs without a fix. Chosen: a start in a garage and some bridges lose less."""
LATE_PROBABILITY = 2.7e-3
"""A delay, a turn or a scale is said to be one that chance makes so rarely: three sigmas."""
SCALE_SD = 0.01
"""Relative error of a receiver's speed over a drive: by Doppler a thousandth, by slopes and
smoothing up to a hundredth."""
LATE_TOLD_S, LATE_S = 0.1, 1.0
"""Delays of velocities that are told, and that are warned of: braking at 3 m/s^2 the first errs by
what a receiver's velocity errs by anyway, and recorded receivers' are late by up to 0.7 s."""
SPARSE_HZ, FEW_READINGS = 1.0, 10
"""With fewer readings a second, or fewer at all, there is nothing to integrate: a car turns a
corner between two of them, and the fixes come as often."""
SLOW_HZ = 20.0
"""Turns and springs (some 2 Hz) need ten readings a period."""
LONG_GAP_S = 1.0
"""Without readings for so long a position is a metre off at an acceleration of 2 m/s^2."""
LEFT_OUT_SHARE = 0.02
"""Of the readings that a reader leaves out. Chosen: every recording has a little."""
USUAL_OUTPUT_DELAY_S = 0.1
"""A receiver's epochs arrive later by about this, where nobody states it."""
SHORT_OVERLAP = 0.5
"""Of the shorter recording's span. Chosen: less is a file of another part of the drive."""
SAME_START_S = 3.0
"""A start is the file's creation time if it is this near: that has whole seconds, and is written
when the file is opened or closed."""
OFF_CENTRE = 0.2
"""Part of the picture by which a principal point may be off its middle: lenses are centred to some
hundredths, and a matrix of another resolution is off by more."""
OFF_CENTRE_DOUBTED = 0.08
"""The same that is worth a word: a matrix of 3:2 pictures is off by 0.09 in 16:9 ones, one of 4:3
by 0.17; of the recorded drives' cameras none is by more than 0.04."""
VIEW_DEG = (20.0, 150.0)
"""Horizontal views of cameras that look at a road through a lens with a pinhole model."""
STRAIGHT_DEG = 105.0
"""Wider lenses bend straight lines: those made not to end at some 100 deg across (14 mm on full
frame, 104 deg), and pictures that were straightened are cut to less."""
WIDEST_DEG = 170.0
"""No lens with a pinhole model sees more: its picture would be 23 focal lengths wide."""
ASPECT = 0.1
"""Relative difference of the two focal lengths; pixels are square."""
SLOW_WHEELS_HZ = 0.9
"""Adapters that ask for the speed alone manage one a second and more."""
COARSE_STEP = 0.05
"""A step of wheel speed, m/s, that is as large as wheels' own noise."""
LAGGING_RECEIVER_S = 0.3
"""Wheel speed that is earlier than the receiver's by more, s, shows the lag of the receiver's."""
WRONG_AXES, DOUBTED_AXES = 1e-6, 0.01
"""Axes with less probability are wrong, and are doubted. Chosen: refusing right ones loses a drive,
so odds of a million are asked, and with a mistake in one manifest of a hundred to begin with."""
TILTED_RAD = 0.20943951023931953
"""Gravity this far off the down axis, 12 deg, is a sensor mounted askew: roads and cars lean by
some degrees."""
WEAK_CORRELATION = 0.2
"""Speed changes and turns that the IMU feels less of where they should be are worth a word. Chosen:
hills take off a half of what recorded drives show, a wrong axis all of it."""
GYRO_SCALE_OFF = 0.25
"""A gyro's scale further off, beyond its own sigma, is no error of a gyro but of a unit. Chosen:
the receiver's low-pass takes a tenth off quick turns, a late phone's a quarter."""
GYRO_SCALE_PROBABILITY = 1e-6
"""That sigma counts so often as chance exceeds it so rarely."""
NEAR_UNIT = 1.3
"""A factor within this of a unit's is the unit's."""
BORDER_DEG = 1.0
"""A place so near a country's box is in it: the borders are drawn at 1:110 million, to some
0.3 deg, and leave out small islands."""
AHEAD_S = 2 * 86400.0
"""A log cannot be of a time after it was written, but for time zones and a recorder's clock."""
COPIED_S = 30 * 86400.0
"""A log is copied from its recorder within a month: one of 1024 weeks before is of another era."""
