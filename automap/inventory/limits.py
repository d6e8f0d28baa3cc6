"""The numbers that decide a comparison with an inventory, and why each is what it is."""

from __future__ import annotations

import math

STALE = 0.05
"""Of an inventory's signs, those that are gone, that stand elsewhere by now, and that are of
another class, before the data: chosen, as registers that are looked after are right in 19 of 20."""
STALE_WEIGHT = 20.0
"""Listed signs that the share of gone ones, and that of another class, weigh as, before the data.
Chosen: as many as one of which is stale."""
NEW_SHARE = 0.1
"""Of a map's signs those that no inventory has, before that is estimated: counts as one sign, for
some lists lack nearly all. Chosen."""
DOUBT_FACTOR_LOG_SD = 0.15
"""Of the logarithm of the factor on a map's doubts that signs are there, before a list tells.
Chosen: a belief of a half, 6.9 below the surest in logarithmic odds, is good to a factor of e in
its odds; some tens of doubted signs outweigh it, and a list that lacks most signs does not."""
SURE = 0.9
"""Of the statements of a kind that are for work, the part that is expected to be right, and how
probable it is of each missing sign that it is gone. What is asked of each kind: nine of ten."""
LIKELIER_THAN_NOT = 0.5
"""What is less likely is not for work, however sure the others of its kind are."""
MOST_DRIVES = 9
"""Further drives that an unconfirmed sign is said to need, at most: that many say "many"."""
HIGHEST_RATE = 0.99
"""Of finding a sign in view: no drive is without any risk of a lorry in between."""
MOST_SURE = 0.999
"""A map's belief in a sign and its class is taken for no more, as by a merge."""
CLASS_AT_HOME, CLASS_ELSEWHERE = (-3.7, 2.9), (-4.15, 2.85)
"""Log odds that a sign is not of the class a list says, shift and slope by the logarithm of what
its views give to the best other class over what they give to that one, fitted by
``tests/benchmarks/listed_classes.py``: of a known country on the half to fit, with the classifier
before this one; of none on three draws of all drawings, of which each half alone gives the same to
0.05. Steeper ones (3.9), of that classifier, told with 0.7 what was right in one of four."""
OTHER_LOOK = 0.1
"""How much it counts that the views look like faces of another shape or colour, which may be none
that the classifier names. Little: some faces are drawn within others, a red circle on a white
square. With the classifier before, the most likely of 0, 0.03, 0.06, 0.1, 0.15, 0.2 and 0.3 on the
same half. Now 0.03 is without a country, by 0.0019 of a loss of 0.0142, and on the half to check
0.1, by 0.0042; at home none is better by more than its standard error: kept."""
FAINT_SHARE = 0.01
"""Added to both: the most likely of 0.001, 0.003, 0.01, 0.03 and 0.1 on the same half; at home 0.03
is by 0.0003 now, within its standard error."""
TOLD_BY_CHANCE = 1e-3
"""What a list contradicts is told where chance alone would do so once in a thousand lists."""
LEAST_TURNS = 3
"""Fewer entries that contradict are no habit of a list: two may stand on one odd post. Chosen."""
HALF_APPROACH_ROWS = 4
"""Places on the path, some 8 m apart, from which a sign must have been in view to count among those
that a drive looked at. On a straight road it is so from 6 or 7 of them (60 to 7 m): half an
approach, where the last frames, the largest, are missing, or a bend cut it short."""
GLIMPSE_PRIOR = (1.0, 1.0)
"""Likewise of signs in view from fewer places: nothing is known, every rate is as likely."""
DETECTION_PRIOR = (8.0, 1.5)
"""Beta parameters of how often a drive sees a sign in view, before the data: as in a merge."""
USUAL_SD_M, USUAL_PAIRS = 2.0, 0.5
"""Error of an inventory's position per axis, before the data: chosen, about what aerial
pictures are digitised to. It counts as half a sign, so that the first signs outweigh it."""
CIRCLE_95 = 2.45
"""Of a normal error in a plane 95 % lie within so many sigmas per axis."""
LEAST_SD_M = 0.15
"""What a post and a face on it, or the two ends of a face, differ by."""
SAME_POST_M, SAME_WAY = CIRCLE_95 * math.sqrt(2.0) * LEAST_SD_M, math.cos(math.radians(45.0))
"""Entries so near one another, of 19 of 20 posts, are of one post: what both are off against it;
and the cosine between faces that are for the same road."""
LARGEST_SD_M = 6.0
"""Where signs stand some ten metres apart, worse positions cannot be told from moved ones."""
ROUNDS = 40
"""Of the expectation maximisation; the sd settles to a centimetre in some twenty."""
