"""Kinds of unknown faces are learnt one by one and used as one output for each group."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the training needs torch")

from pipeline.train.classifier_data import label_of, labels  # noqa: E402
from pipeline.train.classifier_net import FaceNet, Folded, fold, membership  # noqa: E402
from pipeline.train.detector_net import SignNet  # noqa: E402
from pipeline.train.export import export_classifier, export_detector, note  # noqa: E402
from pipeline.train.recover import recovered, recovered_detector, with_outputs  # noqa: E402

OUTPUTS = ["regulatory--stop--g1", "red-circle/number", "red-circle/no-horns", "other/x", "no-sign"]
WANTED = ["regulatory--stop--g1", "red-circle", "blue-circle", "other", "no-sign"]


def test_folding_adds_probabilities_up() -> None:
    belongs = membership([label_of(name) for name in OUTPUTS], WANTED)
    logits = torch.tensor([[3.0, 1.0, 2.0, -1.0, 0.0], [-50.0, 40.0, 39.0, 0.0, 2.0]])
    folded = fold(logits, belongs).softmax(dim=1)
    each = logits.softmax(dim=1)
    assert torch.allclose(folded[:, 0], each[:, 0], atol=1e-6)
    assert torch.allclose(folded[:, 1], each[:, 1] + each[:, 2], atol=1e-6)
    assert torch.allclose(folded[:, 3:], each[:, 3:], atol=1e-6)
    # a group that nothing belongs to is never chosen
    assert float(folded[:, 2].max()) < 1e-12


def test_the_network_as_it_is_used_knows_classes_groups_and_no_sign() -> None:
    names = [*labels()[:3], "red-circle/number", "no-sign"]
    net = FaceNet(len(names)).eval()
    folded = Folded(net, membership([label_of(name) for name in names], labels()))
    crops = torch.rand(2, 3, 48, 48) * 255
    with torch.no_grad():
        out = folded(crops)
        own = net(crops)
    assert out.shape == (2, len(labels()))
    assert torch.allclose(out[:, :3], own[:, :3], atol=1e-4)
    assert torch.allclose(out[:, -1], own[:, -1], atol=1e-4)


def test_an_exported_network_is_recovered_so_that_training_can_go_on(tmp_path: Path) -> None:
    torch.manual_seed(3)
    names = [*labels()[:3], "red-circle/number", "no-sign"]
    net = FaceNet(len(names)).eval()
    for layer in net.body:
        # as after a training: no norm is that of new weights
        torch.nn.init.uniform_(layer[1].weight, 0.5, 1.5)
        torch.nn.init.uniform_(layer[1].bias, -0.5, 0.5)
        layer[1].running_mean.uniform_(-0.2, 0.2)
    state = {"labels": names, "mean": net.state_dict(), "step": 1}
    torch.save(state, tmp_path / "classifier.pt")
    export_classifier(tmp_path / "classifier.pt", tmp_path / "classifier.onnx")
    crops = torch.randint(0, 256, (24, 3, 48, 48)).float()
    note(tmp_path / "classifier.onnx", {"said": "anew"})
    again = recovered(tmp_path / "classifier.onnx", names, crops)
    with torch.no_grad():
        assert torch.allclose(again(crops), net(crops), atol=1e-3)
        # batches are normalised as they were told: the outputs are nearly the same in training
        again.train()
        again.drop.eval()
        assert (again(crops) - net(crops)).abs().max() < 0.1
    with pytest.raises(ValueError, match="not a classifier"):
        recovered(tmp_path / "classifier.onnx", names[:-1], crops)


def test_a_classifier_gets_new_outputs_beside_those_it_has() -> None:
    had = [*labels()[:3], "red-circle/number", "no-sign"]
    wanted = [*labels()[:3], "red-circle/number", "red-circle/words", "no-sign"]
    net = FaceNet(len(had)).eval()
    crops = torch.rand(2, 3, 48, 48) * 255
    with torch.no_grad():
        before, after = net(crops), with_outputs(net, had, wanted)(crops)
    assert torch.allclose(after[:, [0, 1, 2, 3, 5]], before, atol=1e-5)
    assert float(after[:, 4].max()) < float(before.min())


def test_an_exported_detector_is_recovered_to_what_8_bits_leave(tmp_path: Path) -> None:
    torch.manual_seed(4)
    net = SignNet().eval()
    for layer in net.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(layer.weight, 0.8, 1.2)
            torch.nn.init.uniform_(layer.bias, -0.2, 0.2)
    pictures = np.random.default_rng(4).integers(0, 256, (24, 128, 128, 3), np.uint8)
    np.save(tmp_path / "streets.npy", pictures)
    torch.save({"mean": net.state_dict()}, tmp_path / "detector.pt")
    export_detector(tmp_path / "detector.pt", tmp_path / "detector.8bit.onnx")
    seen = torch.from_numpy(pictures[:8].transpose(0, 3, 1, 2).copy()).float()
    again = recovered_detector(tmp_path / "detector.8bit.onnx", seen)
    with torch.no_grad():
        wanted, got = net(seen), again(seen)
    off, spread = (got - wanted).std(), wanted.std(dim=(0, 2, 3)).mean()
    assert float(off) < 0.3 * float(spread)
