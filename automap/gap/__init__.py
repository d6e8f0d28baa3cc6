"""Gap finding: where simulation and measurement disagree, and the named effect that is missing.

``find_gaps`` is the entry. Reading order: ``drive`` and ``model`` (what goes in), ``fit`` (a
model on a drive), ``columns`` and ``kernels`` (how candidates would show), ``whitening``,
``evidence`` and ``screening`` (which one does), ``noise``, ``scoring``, ``trial`` (a candidate
fitted), ``naming``, ``formula`` and ``dictionary`` (outside the library), ``search`` (one after
another), ``heldout`` (the gap), ``result``.
"""

from automap.gap.drive import GapDrive
from automap.gap.finder import find_gaps
from automap.gap.model import GapModel, base_model
from automap.gap.result import Finding, GapResult, ParameterValue, Unexplained

__all__ = [
    "Finding",
    "GapDrive",
    "GapModel",
    "GapResult",
    "ParameterValue",
    "Unexplained",
    "base_model",
    "find_gaps",
]
