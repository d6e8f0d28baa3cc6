"""Gap finding: where simulation and measurement disagree, and the named effect that is missing.

``find_gaps`` is the entry, ``search.Search.run`` the search that ``docs/gap.md`` draws. Reading
order: ``drive`` (what goes in), ``motion``, ``fit`` (a model on a drive), ``noise`` (a set of
effects with its noise), ``candidates``, ``dictionary`` and ``slow`` (what may be missing),
``kernels``, ``whitening`` and ``linear`` (how it would show), ``evidence``, ``selection`` (which
set), ``screening`` and ``search``, ``scoring`` and ``confirm`` (other data), ``misfit``,
``stochastic`` and ``receivers`` (what is left), ``chance``, ``naming``, ``result``, ``finder``; all
that decides is in ``limits``. ``camera`` and ``laboratory`` search other recordings.
"""

from automap.gap.drive import GapDrive
from automap.gap.finder import GapResult, find_gaps
from automap.gap.fit import GapModel, base_model
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
