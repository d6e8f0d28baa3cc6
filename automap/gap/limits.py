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
are good to a fifth."""
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
FORMULA_SIZES = {"gyro": 5e-4, "accel": 0.05, "position": 0.5, "height": 0.5, "velocity": 0.05}
"""Usual root mean square of what a formula adds, rad/s, m/s^2, m, m, m/s: ten times what a usual
sensor of each kind drifts or errs by in a minute, so that it could matter."""
LEAST_OWN = 0.01
"""Share of its information that a parameter must have beside those in the model: linear models of
effects that are hardly told apart are off by a percent or so themselves."""
APART = 1.645
"""Sigmas of the difference of two models' scores, stretch by stretch, from which on they are told
apart (Vuong 1989): the better is then the worse one time in twenty."""

# stretches

BLOCKS_S = (8.0, 32.0)
"""Lengths of the stretches over which scores are compared with what they should scatter by: half
a minute holds a bend and what follows it, and a receiver's errors of seconds."""
SHRINK_BLOCKS = 12.0
"""So many stretches count for a scatter as it should be: the ratio of a few says little (its
relative sd is sqrt(2 / n))."""
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

# time

BOX_S = 2.0
"""Biases are followed in boxes of this length: periods of 6 s and more show, below which a car on
its springs and bends sways itself."""
MOST_BOXES = 150
"""Of longer drives boxes are longer; bounds the time."""
