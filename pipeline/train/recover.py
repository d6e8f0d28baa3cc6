"""Make a checkpoint of the classifier that comes with the package, so that its training goes on.

python -m pipeline.train.recover --data DIR --work DIR

The exported network has its normalisation within the convolutions. Here every layer gets the mean
and spread of what it sees of training crops, and the scale and shift that undo them, so that the
outputs stay what they are and training can normalise by batches again.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker, label_of, labels
from pipeline.train.classifier_net import FaceNet, Folded, membership
from pipeline.train.export import MODELS

_CROPS = 512
_STEPS = 19374
"""Of the training that made the shipped weights (``classifier-log.jsonl``)."""
_SAME = 1e-3
"""Largest difference of the logits, whose sums are of 32 bits in another order."""


def recovered(path: Path, names: list[str], crops: Tensor) -> FaceNet:
    """The network of an exported classifier, ``names`` of its outputs before they are folded.

    ``crops`` [n, 3, 48, 48] of 0..255 to normalise by. Raises ValueError where the file is that of
    another network, or of other names.
    """
    graph = onnx.load(str(path)).graph
    stored = {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in graph.initializer}
    own = {name: value for name, value in stored.items() if name.startswith("net.net.")}
    layers = [node for node in graph.node if node.op_type == "Conv" and node.input[1] not in own]
    if len(stored.get("net.net.out.bias", ())) != len(names):
        raise ValueError(f"{path} is not a classifier of these {len(names)} kinds of faces")
    net = FaceNet(len(names), len(stored["net.net.hidden.bias"]))
    net.eval()
    net.load_state_dict({n.removeprefix("net.net."): v for n, v in own.items()}, strict=False)
    with torch.no_grad():
        for layer, node in zip(net.body, layers, strict=True):
            convolution, norm = layer[0], layer[1]
            convolution.weight.copy_(stored[node.input[1]])
            norm.bias.copy_(stored[node.input[2]])
            _normalise(net, convolution, norm, crops)
    belongs = membership([label_of(name) for name in names], labels())
    _check(Folded(net, belongs), path, crops[:64])
    return net


def _normalise(net: FaceNet, convolution: nn.Module, norm: nn.BatchNorm2d, crops: Tensor) -> None:
    """Give ``norm`` the moments of what it sees, its output as before: bias alone."""
    seen: list[Tensor] = []
    watch = convolution.register_forward_hook(lambda _m, _i, out: seen.append(out))
    net(crops)
    watch.remove()
    assert norm.running_mean is not None
    assert norm.running_var is not None
    mean, power = seen[0].mean(dim=(0, 2, 3)), seen[0].var(dim=(0, 2, 3))
    norm.running_mean.copy_(mean)
    norm.running_var.copy_(power)
    norm.weight.copy_((power + norm.eps).sqrt())
    norm.bias.add_(mean)


def _check(net: Folded, path: Path, crops: Tensor) -> None:
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path))
    told = session.run(None, {"crops": crops.permute(0, 2, 3, 1).numpy().astype(np.uint8)})[0]
    with torch.no_grad():
        off = float(np.abs(net.eval()(crops).numpy() - told).max())
    print(f"largest difference of a logit {off:.2g}")
    if off > _SAME:
        raise ValueError(f"logits differ by {off:.2g}: {path} was trained on other names")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    maker = CropMaker(*face_data(options.data, options.work), faces)
    rng = np.random.default_rng(17)
    makers = (maker.real, maker.drawn, maker.other, maker.nothing)
    images = np.stack([makers[i % 4](rng)[0] for i in range(_CROPS)])
    crops = torch.from_numpy(images.transpose(0, 3, 1, 2).copy()).float()
    net = recovered(MODELS / "sign-classifier.onnx", maker.names, crops)
    state = net.state_dict()
    torch.save(
        {"net": state, "mean": state, "labels": maker.names, "step": _STEPS},
        options.work / "classifier.pt",
    )


if __name__ == "__main__":
    main()
