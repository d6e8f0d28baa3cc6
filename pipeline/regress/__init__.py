"""``automap regress``: drives with known results as tests of the code."""
