"""Training on a device: samples are kept there, served several times, and the time is kept."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the training needs torch")

from pipeline.train.classifier_net import FaceNet, trained  # noqa: E402
from pipeline.train.detector_net import loss_behind  # noqa: E402
from pipeline.train.loop import Options, Recipe, fit, rate_share  # noqa: E402
from pipeline.train.moved import in_motion, moved, relit  # noqa: E402
from pipeline.train.served import Serving, Store, served  # noqa: E402
from pipeline.train.train_classifier import Taught, keep_taught, take_up  # noqa: E402
from pipeline.train.train_detector import _turned  # noqa: E402

CPU = torch.device("cpu")


def test_a_store_keeps_the_last_samples_whole() -> None:
    store = Store(4, CPU)
    for first in range(0, 9, 3):
        number = torch.arange(first, first + 3)
        store.add((number[:, None].repeat(1, 5), 10 * number))
    left, tens = store.draw(200)
    assert set(tens.tolist()) == {50, 60, 70, 80}
    assert bool((10 * left == tens[:, None]).all())


def test_a_batch_has_its_shares_of_the_sources() -> None:
    def batches() -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        while True:
            # nine in ten are of the first source
            source = (torch.arange(40) % 10 == 0).long()
            yield 100 * source, source

    serving = Serving(size=20, kept=100, fresh=40, shares=(0.25, 0.75))
    value, source = next(served(batches(), serving, CPU))
    assert source.bincount().tolist() == [5, 15]
    assert bool((value == 100 * source).all())


def test_samples_that_stop_coming_end_the_training() -> None:
    def batches() -> Iterator[tuple[torch.Tensor]]:
        yield (torch.zeros(4),)
        raise OSError("no drawing")

    with pytest.raises(RuntimeError, match="no more samples"):
        for _ in served(batches(), Serving(size=2, kept=4, fresh=4), CPU):
            pass


def test_pictures_that_are_not_moved_stay() -> None:
    torch.manual_seed(0)
    image = torch.randint(0, 256, (3, 3, 16, 16)).float()
    assert torch.allclose(moved(image, 0.0, 0.0, 0.0), image, atol=1e-2)
    other = moved(image, 5.0, 0.05, 1.0)
    assert other.shape == image.shape
    assert float((other - image).abs().mean()) > 1.0


def test_relit_pictures_are_of_eight_bits() -> None:
    torch.manual_seed(0)
    other = relit(torch.full((64, 3, 8, 8), 128.0), 0.5, 0.5)
    assert bool((other == other.round()).all())
    assert float(other.min()) >= 0.0
    assert float(other.max()) <= 255.0
    light = other.mean(dim=(1, 2, 3))
    assert float(light.std()) > 10.0


def test_a_mirrored_picture_has_mirrored_targets() -> None:
    torch.manual_seed(1)
    image = torch.zeros(16, 3, 8, 8)
    image[..., 1] = 255.0
    heat = torch.zeros(16, 2, 8, 8)
    heat[..., 1] = 1.0
    box = torch.arange(4.0).reshape(1, 4, 1, 1).repeat(16, 1, 8, 8)
    picture, heat, _, box, near = _turned(image, heat, heat, box, heat[:, 0])
    for k in range(16):
        bright = int(picture[k, 0, 0].argmax())
        left_first = bright == 1
        assert int(heat[k, 0, 0].argmax()) == bright == int(near[k, 0].argmax())
        assert box[k, :, 0, 0].tolist() == ([0, 1, 2, 3] if left_first else [2, 1, 0, 3])
    assert len({int(picture[k, 0, 0].argmax()) for k in range(16)}) == 2


def test_pictures_in_motion_keep_their_light_and_spread_it_along_a_line() -> None:
    torch.manual_seed(2)
    image = torch.zeros(40, 3, 33, 33)
    image[:, :, 16, 16] = 255.0
    smeared = in_motion(image, 0.5)
    spread = (smeared > 0.0).sum(dim=(2, 3))[:, 0]
    assert torch.allclose(smeared.sum(dim=(1, 2, 3)), torch.full((40,), 3 * 255.0), rtol=1e-4)
    assert 5 < int((spread > 1).sum()) < 35
    assert int(spread.max()) <= 30
    assert bool((smeared[spread == 1] == image[spread == 1]).all())
    # channels alike, since it is the camera that moved
    assert torch.allclose(smeared[:, 0], smeared[:, 2], atol=1e-3)


def test_a_network_is_held_back_only_where_it_lies_behind() -> None:
    heat = torch.zeros(1, 2, 4, 4)
    heat[0, 0, 1, 1] = 1.0
    weight = torch.ones_like(heat)
    told = torch.full((1, 6, 4, 4), -4.0)
    told[0, 0, 1, 1] = 1.0

    def behind(at_centre: float, elsewhere: float) -> float:
        maps = torch.full((1, 6, 4, 4), -4.0)
        maps[0, 0, 1, 1], maps[0, 1, 3, 3] = at_centre, elsewhere
        return float(loss_behind(maps, told, heat, weight))

    assert behind(1.0, -4.0) == behind(2.0, -6.0) == 0.0
    assert behind(0.0, -4.0) == pytest.approx(1.0 / 4.0)
    assert behind(-1.0, -4.0) == pytest.approx(2.0 / 4.0)
    assert behind(1.0, 0.0) > 0.1


def test_the_rate_falls_to_zero_when_the_time_is_over() -> None:
    options = Options(Path(), Path(), 1000, 100, 0, 1, 0, 1, "cpu", 100.0)
    shares = [rate_share(500, 10, options, at) for at in (0.0, 39.0, 70.0, 100.0, 120.0)]
    assert shares == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])


def test_a_training_of_a_given_time_ends_and_leaves_the_taught_network(tmp_path: Path) -> None:
    class Endless(torch.utils.data.IterableDataset):  # type: ignore[type-arg]
        def __iter__(self) -> Iterator[int]:
            while True:
                yield 1

    def judge(net: torch.nn.Module, batch: tuple[torch.Tensor]) -> tuple[torch.Tensor, dict]:
        assert isinstance(net, Taught)
        return net.net(batch[0].float()).square().mean(), {}

    torch.manual_seed(0)
    net = Taught(3)
    before = net.net.out.bias.detach().clone()
    recipe = Recipe(
        "classifier", 1e-3, 0.0, 1, 10.0, 4, stored={"labels": list("abc")},
        serving=Serving(size=2, kept=4, fresh=4),
    )  # fmt: skip
    options = Options(tmp_path, tmp_path, 0, 0, 0, 1, 0, 1, "cpu", 0.3)
    fit(net, recipe, options, lambda seed: Endless(), lambda s: (torch.zeros(4, 3, 48, 48),), judge)
    keep_taught(tmp_path / "classifier.pt")
    state = torch.load(tmp_path / "classifier.pt", weights_only=True)
    assert state["step"] > 0
    both = torch.load(tmp_path / "classifier-taught.pt", weights_only=True)["mean"]
    assert len(both) == 2 * len(state["mean"])
    again = trained(state)
    assert np.abs((again.out.bias - before).detach().numpy()).max() > 0.0


@pytest.mark.parametrize("both", [True, False])
def test_a_training_goes_on_with_its_teacher_or_begins_it_anew(tmp_path: Path, both: bool) -> None:
    torch.manual_seed(0)
    before, now = Taught(3), Taught(3)
    kept = before.state_dict() if both else before.net.state_dict()
    torch.save({"mean": kept}, tmp_path / "classifier.pt")
    take_up(now, tmp_path / "classifier.pt")
    assert torch.equal(now.net.out.weight, before.net.out.weight)
    assert torch.equal(now.teacher.out.weight, before.teacher.out.weight) == both
    started = torch.load(tmp_path / "classifier.pt", weights_only=True)["mean"]
    assert torch.equal(started["net.out.weight"], before.net.out.weight)


def test_a_network_of_other_widths_comes_back_from_its_checkpoint() -> None:
    net = FaceNet(5, 40, (8, 8, 16, 16, 24, 24, 32, 8)).eval()
    again = trained({"labels": list("abcde"), "mean": net.state_dict()})
    crops = torch.rand(2, 3, 48, 48) * 255
    with torch.no_grad():
        assert torch.equal(net(crops), again(crops))
