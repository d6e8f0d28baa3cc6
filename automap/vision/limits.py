"""The numbers that decide what is found in pictures, and why each is what it is.

What a user may want to change is in the rules of search, tracking and choice of frames. "Chosen"
says of a number that neither a derivation nor a measurement gives it, and what it weighs. The
networks' own figures are those that they were trained with (``docs/detector.md``).
"""

from __future__ import annotations

# dark pictures (chosen together on the images to tune on, darkened and with noise)

WHITE_PERCENTILE = 95.0
"""The light of a picture is what a twentieth of it exceeds: lamps do not count."""
DARK_GREYS, NOISY_SHARE = 140.0, 0.04
"""Pictures whose light is below, in grey levels, and whose noise is more than that part of it, are
raised: the networks find as much in dark ones without noise as in bright ones."""
WANTED_GREYS, MOST_GAIN = 180.0, 4.0
"""Light after raising, in grey levels, and the greatest gain: more raises noise only."""
SMOOTH_PX = 0.9
"""Sigma of the smoothing before: takes noise between neighbours, leaves faces of 10 px."""
NOISE_BAND_PX = 192
"""Rows in the middle of a picture that tell its noise: neither sky nor bonnet."""

# boxes of the network

MOST_ZOOM = 2.0
"""Small pictures are enlarged at most so much: more has no detail, and costs its square."""
REDUCED_BY = (4.0, 8.0, 16.0)
"""Copies in which large signs are looked for, each smaller than the first search by so much: drawn
stop signs of all sizes are found at a score of 0.9 between some 20 and 180 px as searched, so that
each size is well within the range of one copy."""
LEAST_REDUCED_PX = 36.0
"""The longest side of a sign in a reduced copy: what is smaller has less than 144 px in the first
search, well within its range. With less (20, 28) one more false box came up in the 50 images to
tune on."""
SUPPORT_OVERLAP = 0.5
"""IoU from which boxes of two copies are looks at one sign: what counts as found in the figures."""
SUPPORT, ALONE, LEAST_SUPPORT_PX = 0.5, 0.25, 20.0
"""The log-odds that a second copy tells over those of the probability ``ALONE`` count for half:
both copies come of the same picture. From 20 px the network finds drawn signs at a score of 0.9.
Of 80 drawn stop signs of 64 to 700 px in the images to tune on, 64 are found without it, 69 with
it; where all of it counts 70, and one more box that shows no sign has over 0.9 on 600 images."""
PART = 0.2
"""A box of less than this part of the area of a larger one around it does not take its place: two
or four signs in one frame, and a sign with its plate, are larger parts. It is a letter taken for a
sign, or another sign in front."""
LEAST_COPY_PX = 64.0
"""The longest side of a copy: less shows no sign and what is around it."""
SURE = 1e-4
"""Probabilities are taken for no surer than this, to either side, when they are joined."""
JOINT_WEIGHTS = (0.0, 1.0, 0.5)
"""Bias and weights of the log-odds of detector and classifier of a model that states none; those of
the one that comes along were fitted. Chosen: the detector decides."""
UNKNOWN_DOUBT = 0.25
"""What is over even odds in the log-odds of a box counts for so much less where the face is none of
the classes: wheels, lamps and shop boards are seldom taken for one sign. Between what is the most
likely on the two halves of the street images, of which every such box was looked at: 0.20 and 0.30
(``tests/benchmarks/look_alikes.py --fit``)."""
FINE_FROM = 1.5
"""From so many times the width that pictures are enlarged to, they are searched in a copy of that
width, and their own pixels only in part. Less would save little."""
FAR_ROWS, FINE_HINT, FINE_MARGIN_PX, FINE_CELL_PX = (0.35, 0.65), 0.15, 24.0, 32
"""Rows of the picture, parts of its height, that are searched pixel by pixel: 0.93 of the labelled
signs of less than 26 px on 250 street images stand there. A level camera with a view 60 deg high
sees what is 5 m above it in them from 29 m on. Outside, the heat in the copy from which a place is
searched again, px around it, and the cells that windows are made of. Where those images were
searched in a copy of half their size first, as many signs of all sizes were found as pixel by pixel
(AP 0.962), for 0.34 of the pixels; of 0.12, 0.15 and 0.2, 0.2 loses one."""
LARGEST_FINE_PX = 48.0
"""What is larger shows in the copy as well."""
MIDDLE_SHARE = 0.19
"""Of a box's sides, how far from its middle cells tell its edges. So far they were trained to:
where a bell of a sigma of 0.13 sides is above 0.35."""
LEAST_HEAT = 0.1
"""Of the peak's, below which a cell tells nothing of a box."""

# faces

FACE_MARGIN = 0.09
"""Of the box's size, on every side of it: what is around a face tells its shape, but more of it
and the light that a face is seen by is no longer its own. Set on the part to tune on."""
FOREIGN = 0.03
"""Prior weight of a class that does not belong to the country: thirty times the evidence."""
TRAINED_ODDS, ODDS_AT_HOME, ODDS_ELSEWHERE = 2.7, 6.7, 1.0
"""Classes to faces of no class: in the training, 0.71 to 0.21 that are drawn and
0.05 of what lies between classes; where the country's set is known, as found on the German street
images to tune on (67 to 10); and in the rest of the world, whose signs are taken to be as often
none of the classes."""

# the class of a track

CLEAR_PX = 32.0
"""From this height a face shows all that a classifier can read; a smaller one counts by its area,
the most likely among the powers 0.5, 1 and 2."""
FAINTEST, OTHERS = 0.02, 50.0
"""What a view does not list has that probability together, at least, and is so many classes: none
is forbidden by one view."""
LEAST_SHARE = 0.001
"""Less of what a track's views give to a class is not written down: a tenth of what decides
anything (``inventory_limits.FAINT_SHARE``)."""
VIEW_CORRELATION = 0.25
"""Of the views of a pass, which count as four at most: the most likely of 0.1, 0.25, 0.5 and 1 on
the half to fit of held tracks and drawn passes (``tests/benchmarks/sign_probability.py --fit``)."""
POWERS_AT_HOME, POWERS_ELSEWHERE = (0.70, 0.64), (0.52, 0.54)
"""Of the odds of class and group, where the country's set is known and where it is not: the most
likely on the half to fit of 1600 passes of Australian faces, and, with the next two, on 5332 passes
of faces of all countries."""
SHIFT_ELSEWHERE, LAPSE_ELSEWHERE = -0.57, 0.02
"""Where no set is known: added to the logarithm of the odds of the class, for more faces are of
none than the network was trained on; and how often all views of a face agree in a shape and colour
that it has not, however clear they are (J. B. Copas, J. R. Statist. Soc. B 50, 1988). Without these
a power that is right of what is sure is too careful of what is not."""
POWERS_UNTOLD = (0.25, 0.37)
"""Of detectors whose probabilities were calibrated by nobody here. Chosen: as careful as any
were found to need."""
SUREST = 1e-7
"""Nothing pooled is taken for surer than this: it is what the numbers of a view are rounded to."""
NAMED = 2.0 / 3.0
"""A class is named that is so probable: a wrong name costs as much as two that are missing."""
SCORE_LIMITS = (0.05, 0.95)
"""A detector that gives a name alone has its score for a probability, within these."""

# tracks

NEAREST_M = 0.5
"""A sign nearer to the image plane has passed."""
CLOSER = 0.6
"""Of the distance that is left to a sign, how much a guessed motion may take at once."""
REJOIN_S = 0.5
"""A thing that moves by itself is met again where it was (``SUPPORT_OVERLAP``) for so long. Chosen:
a lorry ahead moves by a part of its width, and photographs by the way are taken further apart."""
LEAST_SCORE = 1e-3
"""A box without a score still says a little of its class."""

# motion of the camera

LONGEST_STEP_M = 20.0
"""A step between two frames beyond this is a hole in the data, not motion."""
PATH_STEP_SD_M, PATH_STEP_SHARE = 0.05, 0.04
"""Error of a step by the trajectory, m and part of its length: attitude is good from frame to
frame, mounting and time offset tilt the way ahead (0.04 are 2.3 deg)."""
PATH_TURN_SD, PATH_TURN_RATE_SD, PATH_TURN_S = 0.0015, 0.004, 3.0
"""The same of its turn, rad and rad/s, up to so many seconds. Chosen: a pixel or two, and what late
stamps make of bends."""
TOWN_SPEED, SPEED_LOG_SD = 12.0, 0.6
"""Speed taken where nothing is known, m/s: 43 km/h, to a factor of 1.8."""
SPEED_SHARES, MOVE_SD_M = (0.2, 0.1, 0.05), 0.1
"""Error of a guessed step ahead, to the right and down, parts of it, and m besides: what changes
from frame to frame; the guess itself is a scale that stays (``SPEED_LOG_SD``)."""
TURN_RATE_SD = 0.3
"""Turn of a car of which nothing is known, rad/s: a corner taken at town speed."""
STILL_PX, STILL_TURN_SD, STILL_MOVE_SD_M = 0.17, 0.002, 0.05
"""Flow of a reduced picture, px, up to which the camera stands, and how sure that then is, rad and
m. Chosen: more takes creeping for standing, less takes the jitter of points for motion."""
FLOW_POINTS, FEWEST_POINTS = 80, 12
"""Points that are followed, and how many must be left for three angles and as many outliers."""
FLOW_WORST_PX = 1.0
"""Points that come back further from their start, followed forth and back, were lost."""
FLOW_HALF_WEIGHT = 2.0
"""Sigmas at which a point counts half. Chosen nearer than ``robust.CAUCHY``: cars and shadows move,
and there are points enough."""
FLOW_NOISE_PX = 0.5
"""Of a point's flow, whatever the residuals say."""
LEAST_RADIUS, WORST_FLOW, LEAST_TURN_SD = 0.03, 0.03, 0.003
"""Normalised coordinates: points nearer to the centre have no direction across; flow that fits a
turn no better is none; and what a turn by flow is good to, rad, beside twice its own sigma."""
FLOW_HEIGHT = 0.75
"""Of the picture, from its top, where points are followed: the bonnet moves along, and so do its
reflections."""

# whether a video turns as its path does

BEND_S, MOST_BENDS, LEAST_BEND_RAD, TURN_STEP_S = 10.0, 5, 0.35, 0.095
"""Length of the stretches in which pictures are followed, s, how many, the least that the path
turns there, rad, and how far two pictures are apart, s. A corner at town speed takes four seconds,
of which frames that are off by ``MOST_LATE_S`` still hold the most; 20 deg are ten times what 10 s
of turns by flow are off by (``LEAST_TURN_SD``, at random); ten pictures a second follow a turn of
0.5 rad/s within the window of the flow."""
MOST_LATE_S, LATE_STEP_S = 3.0, 0.05
"""How far frames from their stamps are looked for, and in which steps: nearer than turns change."""
LEAST_AHEAD, FEWEST_STEPS = 0.5, 20
"""Cosine to the way ahead below which a camera looks aside: what is near passes it and looks like a
turn. Two seconds of followed pictures are the least that shows where a bend begins and ends."""
ALIKE_TURNS, UNLIKE_TURNS, FEWEST_BENDS = 0.8, 0.5, 2
"""Correlation of turns from which pictures and path show the same bend, and below which they show
different ones; and how many bends have to: one may be of a lorry that crosses. Chosen: in drawn
videos it is 0.999, in noise the best of all offsets 0.3; half of all turns explained is 0.7."""
STEPS_ALIKE, LEAST_LATE_SD_S = 5.0, 0.03
"""So many steps err alike (half a second of what is seen), and what the offset of one bend is good
to at best: the exposure of a frame and half the way between two of them."""
FOLLOWED_S = 0.1, 0.14, 0.2, 0.28, 0.4, 0.57, 0.8, 1.13, 1.6
"""Times in which gimbals and steadied pictures may follow their vehicle, s, up to the 1.6 after
which the least that is left in ``MOST_LATE_S`` is a seventh."""
LATE_PROBABILITY = 1e-4
"""So rarely is a right video called late or quick."""

# frames

STILL_GREYS, STILL_SHARE = 4.0, 0.002
"""A picture stands still in which no more than this share changed by more than so many grey levels.
Chosen: at night little of a picture changes even in motion."""
REPEATED_GREYS = 3.0
"""Grey levels in a thumbnail by which a frame that is shown again differs at most: coding it again
changes means of 25 pixels by up to 2. Noise of a sensor alone is less there, so that a covered lens
counts as well; of what a lamp lights some part changes more."""
DRIVEN_SPEED, REPEATED_M, UNSEEN_M = 2.0, 1.0, 20.0
"""A vehicle drives that goes faster than this, m/s: at rest the paths of bad receivers wander with
up to 1 m/s. A picture that is the same after ``REPEATED_M`` is not of where the vehicle is: half of
a step to the next frame. It is told from ``UNSEEN_M`` on: nearly all signs are seen from further
away, and a frame that is shown twice is no news (25 pictures a second told as 30)."""
CUT_PX = 1.5
"""A box so near to an edge that is not the picture's is of a sign cut off."""
AROUND_PX, MOVED_SHARE = 48.0, 0.04
"""What a network wants to see around a sign, px, and how far one moves to the next frame, part of
the picture's width: the window about it that is searched."""
WHOLE_S = 0.105
"""Where every frame is searched, at most so long from one that is searched whole to the next, s: a
tenth, and what stamps are off; those between are searched around what these two show. At 70 km/h
that is the 2 m from which the views of an approach are taken."""
HINT = 0.5
"""A box of this part of the least score is no detection, but a reason to look closer."""
BETTER_VIEW, CUT_WORTH = 1.1, 0.3
"""How much better a view must be to take another's place as the picture of a track, and what one
that is cut off by the picture's edge is worth. Chosen."""
