"""Gap finding: where simulation and measurement disagree, and the named effect that is missing.

``find_gaps`` is the entry. Reading order: ``drive`` and ``model`` (what goes in), ``fit`` (a model
on a drive), ``noise`` and ``fitted`` (a set with its noise), ``columns`` and ``kernels`` (how
candidates would show), ``dictionary``, ``slow`` and ``candidates`` (what may be missing),
``whitening`` and ``linear``, ``evidence``, ``selection`` (which set), ``search``, ``confirm`` and
``heldout`` (other data), ``misfit`` and ``stochastic`` (what is left), ``cost``, ``chance``,
``naming``, ``result``; all that decides is in ``limits``.
"""

from automap.gap.drive import GapDrive
from automap.gap.finder import GapResult, find_gaps
from automap.gap.model import GapModel, base_model
from automap.gap.result import Finding, ParameterValue, Unexplained

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
