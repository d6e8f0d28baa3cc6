"""Make checkpoints of the networks that come with the package, so that their training goes on.

python -m pipeline.train.recover --data DIR --work DIR

The exported networks have their normalisation within the convolutions, and the detector's weights
are of 8 bits. Here every layer gets the mean and spread of what it sees of training pictures, and
the scale and shift that undo them, so that the outputs stay what they are and training can
normalise by batches again.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from pipeline.train.art import load_faces
from pipeline.train.cache import face_data
from pipeline.train.classifier_data import CropMaker, label_of, labels
from pipeline.train.classifier_net import FaceNet, Folded, membership, trained
from pipeline.train.detector_data import SampleMaker
from pipeline.train.detector_net import SignNet
from pipeline.train.export import MODELS
from pipeline.train.street_data import Street
from pipeline.train.train_classifier import SHARES
from pipeline.train.train_detector import IN_USE

_CROPS, _PICTURES = 512, 64
_STEPS = 67203
"""Of the three trainings that made the shipped classifier (``classifier-log.jsonl``)."""
_SAME = 1e-3
"""Largest difference of the logits, whose sums are of 32 bits in another order."""
_UNSEEN = -6.0
"""Logit of an output that the shipped classifier did not have yet, beside those that it knows."""


def recovered(path: Path, names: list[str], crops: Tensor) -> FaceNet:
    """The network of an exported classifier, ``names`` of its outputs before they are folded.

    ``crops`` [n, 3, 48, 48] of 0..255 to normalise by. Raises ValueError where the file is that of
    another network, or of other names.
    """
    graph = onnx.load(str(path)).graph
    stored = _numbers(graph)
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


def recovered_detector(path: Path, pictures: Tensor) -> SignNet:
    """The network of an exported detector, by ``pictures`` [n, 3, h, w] of 0..255."""
    graph = onnx.load(str(path)).graph
    stored = _numbers(graph)
    # weights of 8 bits, each channel's by its own scale
    for node in graph.node:
        if node.op_type == "DequantizeLinear" and node.input[0] in stored:
            whole, scale, zero = (stored[name].double() for name in node.input)
            shape = [-1] + [1] * (whole.dim() - 1)
            value = (whole - zero.reshape(shape)) * scale.reshape(shape)
            stored[node.output[0]] = value.float()
    layers = [node for node in graph.node if node.op_type == "Conv"]
    net = SignNet()
    net.eval()
    order: list[nn.Module] = []
    watches = [
        module.register_forward_hook(lambda m, _i, _o: order.append(m))
        for module in net.modules()
        if isinstance(module, nn.Conv2d | nn.BatchNorm2d)
    ]
    with torch.no_grad():
        net(pictures[:1])
        for watch in watches:
            watch.remove()
        following = dict(zip(order, [*order[1:], None], strict=True))
        convolutions = [module for module in order if isinstance(module, nn.Conv2d)]
        for convolution, node in zip(convolutions, layers, strict=True):
            weight, bias = stored[node.input[1]], stored[node.input[2]]
            if weight.shape != convolution.weight.shape:
                weight = _out_of_blocks(weight)
            convolution.weight.copy_(weight)
            norm = following[convolution]
            if isinstance(norm, nn.BatchNorm2d):
                norm.bias.copy_(bias)
                _normalise(net, convolution, norm, pictures)
            else:
                assert convolution.bias is not None
                convolution.bias.copy_(bias)
    return net


def _numbers(graph: Any) -> dict[str, Tensor]:
    return {i.name: torch.from_numpy(numpy_helper.to_array(i).copy()) for i in graph.initializer}


def _out_of_blocks(weight: Tensor) -> Tensor:
    """A first layer's kernels of 3 by 3 pixels out of such of 2 by 2 blocks (``quantize``)."""
    parts = weight.reshape(len(weight), 2, 2, 3, 2, 2).permute(0, 3, 4, 1, 5, 2)
    return parts.reshape(len(weight), 3, 4, 4)[:, :, 1:, 1:]


def with_outputs(net: FaceNet, had: list[str], wanted: list[str]) -> FaceNet:
    """A classifier of outputs ``had`` with ``wanted`` ones, the new of which say nothing yet."""
    state = net.state_dict()
    weight = torch.zeros(len(wanted), net.out.in_features)
    bias = torch.full((len(wanted),), _UNSEEN)
    for row, name in enumerate(wanted):
        if name in had:
            weight[row] = state["out.weight"][had.index(name)]
            bias[row] = state["out.bias"][had.index(name)]
    return trained({"mean": {**state, "out.weight": weight, "out.bias": bias}, "labels": wanted})


def _normalise(net: nn.Module, convolution: nn.Module, norm: nn.BatchNorm2d, x: Tensor) -> None:
    """Give ``norm`` the moments of what it sees, its output as before: bias alone."""
    seen: list[Tensor] = []
    watch = convolution.register_forward_hook(lambda _m, _i, out: seen.append(out))
    net(x)
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


def training_crops(maker: CropMaker, count: int) -> Tensor:
    """Crops [count, 3, 48, 48] of all kinds, with the shares that a training has."""
    makers = (maker.real, maker.drawn, maker.other, maker.nothing)
    return _stacked(lambda rng: makers[int(rng.choice(len(makers), p=SHARES))](rng)[0], count)


def training_pictures(samples: SampleMaker, count: int) -> Tensor:
    """Pictures [count, 3, h, w] as the detector is trained on."""
    return _stacked(lambda rng: samples.make(rng).image, count)


def _stacked(make: Callable[[np.random.Generator], np.ndarray], count: int) -> Tensor:
    rng = np.random.default_rng(17)
    images = np.stack([make(rng) for _ in range(count)])
    return torch.from_numpy(images.transpose(0, 3, 1, 2).copy()).float()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--new", default="", help="outputs that the shipped classifier lacks")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(1)
    faces = load_faces(options.data / "sign-art", options.work / "faces.pkl")
    streets, crops = face_data(options.data, options.work)
    maker = CropMaker(streets, crops, faces)
    seen = training_crops(maker, _CROPS)
    had = [name for name in maker.names if name not in options.new.split(",")]
    net = recovered(MODELS / "sign-classifier.onnx", had, seen)
    state = with_outputs(net, had, maker.names).state_dict()
    kept = {"net": state, "mean": state, "labels": maker.names, "step": _STEPS}
    torch.save(kept, options.work / "classifier.pt")
    _keep_detector(streets, faces, options.work / "detector.pt")


def _keep_detector(streets: list[Street], faces: list[Any], out: Path) -> None:
    pictures = training_pictures(SampleMaker(streets, faces), _PICTURES)
    state = recovered_detector(MODELS / "sign-detector.onnx", pictures).state_dict()
    # its training goes on from these, and keeps what they find
    for kept in (out, out.with_name(IN_USE)):
        torch.save({"net": state, "mean": state}, kept)


if __name__ == "__main__":
    main()
