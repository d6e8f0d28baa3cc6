"""Write trained weights as the ONNX files that come with the package.

python -m pipeline.train.export --work DIR
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from pipeline.train.classifier_data import label_of, labels
from pipeline.train.classifier_net import Folded, membership, trained
from pipeline.train.detector_net import SignNet
from pipeline.train.quantize import quantized

MODELS = Path(__file__).resolve().parents[2] / "automap" / "vision" / "models"
_KEY = "automap"
_OPSET = 17
_CALIBRATION = 24


class _FromPixels(nn.Module):
    """The classifier with crops [n, h, w, 3] of 8 bits as input."""

    def __init__(self, net: nn.Module) -> None:
        super().__init__()
        self.net = net

    def forward(self, crops: Tensor) -> Tensor:
        logits: Tensor = self.net(crops.permute(0, 3, 1, 2).float())
        return logits


def export_detector(checkpoint: Path, out: Path) -> None:
    """The running mean of a detector's training as ONNX in 8 bits, for pictures of any size.

    Calibrated on the training pictures that lie beside the checkpoint.
    """
    net = SignNet()
    net.load_state_dict(torch.load(checkpoint, weights_only=True)["mean"])
    axes = {"image": {2: "height", 3: "width"}, "maps": {2: "rows", 3: "columns"}}
    notes = scores_of(checkpoint.parent)
    plain = checkpoint.with_suffix(".onnx")
    _write(net, torch.zeros(1, 3, 256, 256), plain, ("image", "maps"), axes, notes)
    streets = np.load(checkpoint.with_name("streets.npy"), mmap_mode="r")
    chosen = np.linspace(0, len(streets) - 1, _CALIBRATION).astype(int).tolist()
    quantized(plain, out, (np.array(streets[i]) for i in chosen))


def scores_of(work: Path) -> dict[str, Any]:
    """The weights of the joint score that the calibration left, as a note; none without."""
    scores = work / "scores.json"
    return {"score": json.loads(scores.read_text(encoding="utf-8"))} if scores.is_file() else {}


def export_classifier(checkpoint: Path, out: Path) -> None:
    """A trained classifier as ONNX with its labels and temperature."""
    state = torch.load(checkpoint, weights_only=True)
    folded = Folded(
        trained(state), membership([label_of(name) for name in state["labels"]], labels())
    )
    notes = {"labels": labels(), "temperature": state.get("temperature", 1.0)}
    axes = {"crops": {0: "n"}, "logits": {0: "n"}}
    crops = torch.zeros(2, 48, 48, 3, dtype=torch.uint8)
    _write(_FromPixels(folded), crops, out, ("crops", "logits"), axes, notes)


def _write(
    net: nn.Module,
    example: Tensor,
    out: Path,
    names: tuple[str, str],
    axes: dict[str, dict[int, str]],
    notes: dict[str, Any],
) -> None:
    net.eval()
    torch.onnx.export(
        net, (example,), str(out), input_names=[names[0]], output_names=[names[1]],
        dynamic_axes=axes, opset_version=_OPSET, dynamo=False,
    )  # fmt: skip
    note(out, notes)


def note(path: Path, notes: dict[str, Any]) -> None:
    """Write what who runs a network must know into its file, in place of what it said before."""
    model = onnx.load(str(path))
    kept = [entry for entry in model.metadata_props if entry.key != _KEY]
    del model.metadata_props[:]
    model.metadata_props.extend(kept)
    added = model.metadata_props.add()
    added.key, added.value = _KEY, json.dumps(notes)
    model.doc_string = ""
    onnx.save(model, str(path))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Write the trained networks as ONNX")
    parser.add_argument("--work", type=Path, required=True, help="folder of the checkpoints")
    parser.add_argument("--out", type=Path, default=MODELS)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if (options.work / "detector.pt").is_file():
        export_detector(options.work / "detector.pt", options.out / "sign-detector.onnx")
    elif scores := scores_of(options.work):
        # a classifier trained on alone: the detector that is there joins it with other weights
        note(options.out / "sign-detector.onnx", scores)
    if (options.work / "classifier.pt").is_file():
        export_classifier(options.work / "classifier.pt", options.out / "sign-classifier.onnx")


if __name__ == "__main__":
    main()
