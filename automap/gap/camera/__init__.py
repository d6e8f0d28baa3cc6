"""Errors of a camera by the search's own comparison: the boxes of tracked signs as rows.

Reading order: ``views`` (boxes, and how a camera with errors sees them), ``fit`` (a camera fitted
to them), ``linear`` (that fit as the rows that all candidates have), ``search``.
"""
