"""``automap simulate``: a drive made from a scenario, or from a run (its twin)."""
