"""Weights between two trainings are a network between them."""

from __future__ import annotations

from typing import Any

import pytest

torch = pytest.importorskip("torch", reason="the training needs torch")


from pipeline.train.classifier_net import FaceNet  # noqa: E402
from pipeline.train.mean_weights import (  # noqa: E402
    between,
    with_moments,
    with_outputs_of,
)

OUTPUTS = 5


def crops(seed: int) -> Any:
    return torch.randint(0, 256, (32, 3, 48, 48), generator=torch.Generator().manual_seed(seed))


def trained_on(net: FaceNet) -> FaceNet:
    """A network a little away from ``net``, with other moments of what its layers see."""
    other = FaceNet(OUTPUTS)
    other.load_state_dict(net.state_dict())
    with torch.no_grad():
        for weight in other.parameters():
            weight.mul_(1.0 + 0.3 * torch.rand(weight.shape))
    for layer in other.body:
        layer[1].running_mean.normal_(0.0, 0.5)
    other.eval()
    return other


def test_the_share_says_how_near_to_the_other_training_the_weights_are() -> None:
    torch.manual_seed(7)
    one = FaceNet(OUTPUTS).eval()
    other = trained_on(one)
    start, end = one.state_dict(), other.state_dict()
    # the same start and end give themselves, and what lies between is a straight line
    for share, wanted in ((0.0, start), (1.0, end)):
        assert all(torch.equal(v, wanted[k]) for k, v in between(start, end, share).items()
                   if v.is_floating_point())  # fmt: skip
    third = between(start, end, 1.0 / 3.0)["out.weight"]
    assert torch.allclose(third, (2.0 * one.out.weight + other.out.weight) / 3.0, atol=1e-6)
    with pytest.raises(ValueError, match="other layers or outputs"):
        between(start, FaceNet(OUTPUTS + 1).state_dict(), 0.5)


def test_layers_between_see_what_they_are_normalised_by() -> None:
    torch.manual_seed(8)
    one = FaceNet(OUTPUTS).eval()
    other = trained_on(one)
    shown = crops(9).float()
    net = FaceNet(OUTPUTS)
    half = between(one.state_dict(), other.state_dict(), 0.5)
    state = with_moments(net, half, shown.split(16))
    assert not net.training
    assert torch.equal(state["out.bias"], net.out.bias)
    seen: list[Any] = []
    last = net.body[-1]
    watch = last[0].register_forward_hook(lambda _m, _i, out: seen.append(out))
    with torch.no_grad():
        net(shown)
    watch.remove()
    off = (seen[0].mean(dim=(0, 2, 3)) - last[1].running_mean).abs()
    spread = last[1].running_var.sqrt()
    # the moments are of what the layer sees, not those of either training
    assert float((off / spread).max()) < 0.2
    stale = half["body.6.1.running_mean"]
    assert float(((stale - last[1].running_mean).abs() / spread).max()) > 0.5


def test_what_the_other_training_never_saw_stays_as_it_was() -> None:
    torch.manual_seed(10)
    one = FaceNet(OUTPUTS).eval()
    start, half = one.state_dict(), between(one.state_dict(), trained_on(one).state_dict(), 0.5)
    state = with_outputs_of(half, start, [1, 3])
    for name in ("out.weight", "out.bias"):
        assert torch.equal(state[name][[1, 3]], start[name][[1, 3]])
        assert torch.equal(state[name][[0, 2, 4]], half[name][[0, 2, 4]])
        assert not torch.equal(half[name][[1, 3]], start[name][[1, 3]])
    assert torch.equal(state["hidden.weight"], half["hidden.weight"])
