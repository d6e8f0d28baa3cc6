"""Average the weights of two trainings of one classifier, of which one goes on from the other.

python -m pipeline.train.average --first A.pt --second B.pt --work DIR [--share 0.5]

What was learnt last weighs on what was known before; between the two networks lie such as keep
both (Wortsman et al. 2022, *Robust fine-tuning of zero-shot models*). The moments of the
normalisation are averaged too, which holds only where the two are near to each other.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import torch


def averaged(first: dict[str, Any], second: dict[str, Any], share: float) -> dict[str, Any]:
    """A checkpoint with ``share`` of the second's running mean and the rest of the first's.

    Raises ValueError where the two do not tell the same kinds of faces.
    """
    if first["labels"] != second["labels"]:
        raise ValueError("the two networks tell other kinds of faces")
    mean = {
        name: torch.lerp(first["mean"][name], value, share) if value.is_floating_point() else value
        for name, value in second["mean"].items()
    }
    return {"net": mean, "mean": mean, "labels": second["labels"], "step": second["step"]}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=Path, required=True)
    parser.add_argument("--second", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--share", type=float, default=0.5)
    options = parser.parse_args()
    states = [torch.load(p, weights_only=True) for p in (options.first, options.second)]
    torch.save(averaged(*states, options.share), options.work / "classifier.pt")


if __name__ == "__main__":
    main()
