"""The numba loops of the filter.

Nodes are the instants at which something is measured (and some without measurement, so that
no stretch is too long). Between nodes only the nominal state and the nine navigation rows of
the transition matrix are carried; the covariance moves from node to node. The smoother is
the modified Bryson-Frazier form (Bierman 1973): it inverts no covariance, so constant
parameters without process noise do it no harm, and it needs one pass over the scalars that
the forward filter recorded.

Reading order: ``fusion.arrays`` (what goes in and out), ``readings`` (corrected samples),
``transition`` and ``integrate`` (between nodes), ``fusion.measurements`` and ``update`` (at nodes),
``forward``, ``smoother``, ``dense``.
"""

from automap.fusion.arrays import ForwardStore, Legs, ModelArrays, NodeArrays, Samples
from automap.fusion.kernels.dense import run_dense
from automap.fusion.kernels.forward import run_forward
from automap.fusion.kernels.integrate import walk_path
from automap.fusion.kernels.on_springs import speed_downwards
from automap.fusion.kernels.smoother import run_smoother
from automap.fusion.kernels.state import apply_correction

__all__ = [
    "ForwardStore",
    "Legs",
    "ModelArrays",
    "NodeArrays",
    "Samples",
    "apply_correction",
    "run_dense",
    "run_forward",
    "run_smoother",
    "speed_downwards",
    "walk_path",
]
