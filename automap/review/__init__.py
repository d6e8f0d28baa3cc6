"""What people decide about the signs of a map.

``verdicts`` folds the actions of a review into the state of each sign, ``reviewed`` applies that to
the signs of a drive or of a merged map, ``posts`` hangs those that were moved or added on posts,
and ``chosen_views`` locates a sign from the views that a person chose.
"""
