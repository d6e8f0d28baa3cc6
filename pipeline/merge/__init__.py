"""``automap merge``: one map of many drives."""
