"""The numbers that decide what the gap finder says, and why each is what it is."""

from __future__ import annotations

import math

# odds

LEAST_ODDS = math.log(1e3)
"""An effect is named where a thousand to one speaks for it, prior included: one search in a
thousand may name what is not there."""
OUTSIDE_LIBRARY = 0.1
"""Prior probability that a missing effect is none of the library's. Chosen: the library has what
data sheets and the literature name; one in ten leaves room for what they do not."""
ANISOTROPY = 0.2
"""Share by which what is much the same on all axes differs between them: capacitors of a filter
are good to a fifth. Of a drift that is fitted as one level of three axes it is taken likewise."""
CLOSE_NATS = math.log(20.0)
"""Rivals with odds of less than twenty to one between them are not told apart."""
CLOSE = 0.03
"""Share of the evidence within which rivals are not told apart either: what a linear model and a
fitted noise leave unsure of many nats."""
CHALLENGE = 0.1
"""Share of the evidence within which a rival is fitted too: a screening's evidence of a strong
effect is off by what is not linear, rarely by more than a tenth. By as much a formula must be ahead
of a name to be told in its place, or more clearly so than one time in a thousand by chance."""
PRIOR_SCALES = (1.0, 5.0)
"""An effect may be five times its usual size, at odds of one to two for either."""
LEAST_OWN = 0.01
"""Share of its information that a parameter must have beside those in the model: linear models of
effects that are hardly told apart are off by a percent or so themselves."""
APART = 1.645
"""Sigmas of the difference of two models' scores, stretch by stretch, from which on they are told
apart (Vuong 1989): the better is then the worse one time in twenty."""

SHOWS, ALIKE = 3.0, 0.8
"""An effect of its usual size shows on a drive where it stands out by three sigmas. Two cannot be
told apart where four fifths of what one shows are the other's, and the rest shows no more."""

# candidates

FORMULA_SIZES = {
    **dict(gyro=5e-4, accel=0.05, position=0.5, height=0.5, velocity=0.05, nhc=0.05),
    **dict(imu=0.02, imu_time=0.02, antenna=0.5),
}
"""Usual root mean square of what a formula adds, rad/s, m/s^2, m, m, m/s, m/s. Chosen as large as
what consumer sensors err by and a drive notices: 5 mg, 1.7 degrees a minute, the noise of fixes. Of
how unit and antenna sit and keep time the most that it adds, rad, s, m: a mount gives by a degree,
a clock jumps by a few samples and an antenna slides by a hand or two, however long that stays."""
SAME_SIGNAL = 0.999
"""A quantity that correlates so with a sum of catalogue effects' is those effects: a one-sided
rate is a scale and an asymmetry."""
REFERENCE_TAU_S = 0.1
"""Delays and lags are told apart by what so long a one does beyond first order."""
FREE_DELAY_S = 0.02
"""A clock offset that is estimated with a larger sd is free: it is the same as late fixes."""

# stretches

BLOCKS_S = (8.0, 32.0)
"""Lengths of the stretches over which scores are compared with what they should scatter by: half
a minute holds a bend and what follows it, and a receiver's errors of seconds."""
SHRINK_BLOCKS = 12.0
"""So many stretches count for a scatter as it should be: the ratio of a few says little (its
relative sd is sqrt(2 / n))."""
DRIFT_BLOCKS = 8
"""Of a drive, or of what it has of speeds, turns and the like, in which a named value or a level of
noise is looked at for itself: a value that a drive knows to twelve sigmas is known to four in each.
Steps between them are seen to a sixteenth of the drive."""
FOLDS = 6
"""Stretches of equal information of which each is predicted from the others. With fewer the others
know much less than all, with more a stretch holds no whole bend."""

# search

MAX_FINDINGS = 8
"""Bounds the time of a search; triples are rare."""
MAX_ROUNDS, CLOSING_ROUNDS = 12, 5
"""Rounds of selecting and fitting at most, and the last of them, in which candidates are only
exchanged and dropped; bounds the time."""
TRIALS = 2
"""A candidate that was fitted and not needed is tried once more, beside others; then no more."""
SHORTLIST = 16
"""Candidates whose rows are looked at one by one, by their scores; bounds the time."""
RIVALS = 5
"""Rivals of a candidate that are carried on with what stands out beside them; bounds the time."""
WEAK_SHARE = 0.25
"""What has less than this share of the strongest's evidence waits until that one is fitted: the
screening is linear, and what a large effect leaves beyond that looks like small ones."""
STEADY = 0.1
"""Factor on the drift of biases under which courses of time are proposed: what drift can follow in
a drive, it has swallowed. A tenth follows nothing; what is proposed is judged with all of it."""
NULL_DRAWS = 4000
"""A p-value of 1e-3 is then known to half of itself."""
SUSPECTED = 0.01
"""Chance below which something is told to be missing though nothing is named: one search in a
hundred says so of nothing. Eight stretches of half a minute can say it, seven cannot."""

# rows

AR_ORDER, MAX_COEFFICIENT_SUM = 3, 0.9
"""What noise remembers of the rows before it, and how much of it at most: what lasts for longer is
a state's to say, and beyond nine tenths a channel would be told by its differences alone."""
HUBER = 2.0
"""Sigmas beyond which rows count less: of normal noise that takes a hundredth of what they say
(Huber 1981)."""
CLIP = 4.0
"""Sigmas at which a wild value is cut off: one fix in a thousand is not the size of all others."""
MIN_ROWS = 30
"""Of fewer no size is told: it would be off by an eighth and more (1 / sqrt(2 n))."""

# noise

LEVEL_RANGE = 256.0
"""Levels of noise are sought within such a factor of what is stated. Chosen: no data sheet is off
by more."""
REST_S, LEAST_RESTS = 1.0, 10
"""Means at rest are long enough for the noise that a filter sums up between fixes, too short for
drift; of fewer differences the deviation is not known to a third of itself."""
MAX_NODES = 4000
"""Noise is fitted on so many nodes at most, spread over the drives; bounds the time."""
WALK_FACTOR, SCALE_FACTOR = 2.5, 1.4
"""Factors from which on a bias' drift and a level of noise are told as not as stated. Chosen: twice
the variance for a level; drift is stated less surely."""
NOISE_NATS, OCCAM_NATS = 10.0, 3.0
"""Nats that a level must be worth beside what its freedom costs: twenty to one for being anything
between half and twice what data sheets say. Chosen."""
OUTLIER_NIS = 30.0
"""Squared sigmas from which on a fix is wild: of three normal coordinates one in a million."""
USUAL_SHARE, WILD_SHARE, WILD_P = 0.002, 0.005, 1e-4
"""Share of fixes that heavy tails alone throw so far, the share from which on more is told, and
the chance below which it is more. Chosen."""

# held-out data

FIT_SHARE = 2.0 / 3.0
"""Without a held-out drive the rest of each drive is held out: a third tells a value to twice the
sigma of all."""
MIN_PART_S = 8.0
"""Nothing shorter holds a bend."""
MAX_FIT_S, MAX_HELD_S = 1200.0, 900.0
"""No more of a drive is fitted or held out: noise and effects are settled by then."""
HELD_OUT_SLACK = 3.0
"""Nats by which held-out data may speak against what is sure: a right effect's value, known to one
sigma, costs half a nat a parameter, rarely more than three."""
WORSE_POSITIONS = 0.02
"""Share by which held-out positions may be predicted worse with a model than without: the
standard error of an rms of some thousand fixes."""
ONE_IN_A_THOUSAND = 3.09
"""Sigmas beyond which they must be worse stretch by stretch, too."""

# what is left

BANDS = 6
"""Bands of an octave and more between the slowest and the quickest that a channel shows."""
MISFIT_ROWS = 60
"""Of a channel, so that its halves still have a size."""
PLACE_ROWS = 15
"""Of a channel in a manoeuvre, below which no size of it is shown. Chosen."""
WORTH = 1.5
"""Factor on the variance below which a misfit is not told: sigmas are then off by less than a
quarter."""
STANDING_SPEED, TURN_RATE, ACCELERATION = 0.5, 0.08, 0.6
"""What is called standing, m/s, a turn, rad/s, and accelerating or braking, m/s^2. Chosen: they
sort what is shown."""

# time

BOX_S = 2.0
"""Biases are followed in boxes of this length: periods of 6 s and more show, below which a car on
its springs and bends sways itself."""
MOST_BOXES = 150
"""Of longer drives boxes are longer; bounds the time."""
LEAST_BOXES = 3
"""A period or a plateau of fewer boxes is not seen as one."""
PLATEAUS = 3
"""So many of the likeliest, of each axis, are carried on; bounds the time."""

# cameras

MIN_SIGNS = 6
"""As many as have errors to tell beside their own places."""
MIN_VIEWS, MAX_VIEWS = 4, 24
"""Of a sign; boxes of many neighbouring frames say the same again."""
MARGIN_SD_PX = 1.5
"""Boxes taller than their signs. Chosen."""
WINDOW_S = 60.0
"""Signs seen within such a time share an attitude error of the path. Chosen as receivers' errors
last."""
SHUTTER_SLACK_S, LONGEST_SHUTTER_S = 0.005, 0.12
"""Rows are read from the top, within a frame's time. On a straight road a shutter beyond that is a
lever arm in disguise."""

# desks

DESK_FOLDS = 4
"""Poses are held out a quarter at a time: of a dozen nine remain for six parameters."""
DESK_P = 1e-3
"""What is named, a thousand to one speaking for it, is as seldom by chance."""
DESK_HUBER = 2.5
"""Sigmas beyond which a pose counts less."""
