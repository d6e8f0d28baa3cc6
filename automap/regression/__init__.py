"""Figures of a drive that are kept, and how far a later run moved from them.

A figure moves by so many of its own stated sigmas. The same recording through the same code
gives the same figures to rounding, so the question is not whether a change could be chance but
whether it matters: a shift of a tenth of a sigma raises the expected squared error by a
hundredth and drowns in what the result says of itself. That is what is allowed.
"""
