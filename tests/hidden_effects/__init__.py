"""Drives with hidden errors, made apart from the library: own earth, integrator and formulas.

Nothing in this package imports the library's simulator, effects or fusion. What it shares with
them is the contract alone: file formats, names of effects, signs and units.
"""
