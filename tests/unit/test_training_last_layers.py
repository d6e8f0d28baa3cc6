"""The classifier's last layers learn that what lies between two classes is neither of them."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the training needs torch")

from automap.signs.classes import load_classes  # noqa: E402
from pipeline.train import last_layers  # noqa: E402
from pipeline.train.classifier_data import label_of, labels  # noqa: E402
from pipeline.train.classifier_net import FaceNet, fold, membership  # noqa: E402
from pipeline.train.last_layers import LastLayers, Seen, between, rows_by_group, train  # noqa: E402


def _seen() -> tuple[Seen, list[str]]:
    """Two classes of one group, one of another group, and crops of the other sources."""
    of_ring = [name for name, entry in load_classes().items() if entry.group == "red-circle"]
    names = [*of_ring[:2], "regulatory--stop--g1", "red-circle/no-horns", "no-sign"]
    rng = np.random.default_rng(4)
    centres = rng.normal(0.0, 1.0, (len(names), 32 * 6 * 6))
    output = np.repeat([0, 1, 2, 0, 3, 4], 40)
    source = np.repeat([1, 1, 1, 0, 2, 3], 40)
    features = centres[output] + rng.normal(0.0, 0.2, (len(output), centres.shape[1]))
    return Seen(
        torch.from_numpy(np.maximum(features, 0.0)).half(),
        torch.from_numpy(output),
        torch.from_numpy(source),
    ), names


def test_halfway_points_are_of_two_drawn_classes_of_one_group() -> None:
    seen, names = _seen()
    rows = rows_by_group(seen, names)
    unknown = labels().index("red-circle")
    # the octagon has one class only, and real crops show signs as they are
    assert list(rows) == [unknown]
    assert set(rows[unknown].tolist()) == set(range(80))
    mixed, label = between(seen, rows, 60, np.random.default_rng(1))
    assert 15 < len(mixed) < 45  # pairs of one class are left out
    assert set(label.tolist()) == {unknown}
    own = torch.stack([seen.features[:40].float().mean(0), seen.features[40:80].float().mean(0)])
    apart = (own[0] - own[1]).norm()
    assert (torch.cdist(mixed, own) < 0.75 * apart).all()


def test_trained_layers_name_classes_and_call_what_lies_between_unknown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(last_layers, "_BATCH", 40)
    monkeypatch.setattr(last_layers, "BETWEEN", 0.25)
    torch.manual_seed(2)
    seen, names = _seen()
    told: list[dict[str, float]] = []
    layers = train(LastLayers(FaceNet(len(names), 24)), seen, names, 200, told.append)
    assert [row["last layers, step"] for row in told] == [100, 200]
    belongs = membership([label_of(name) for name in names], labels())
    mixed, _ = between(seen, rows_by_group(seen, names), 60, np.random.default_rng(3))
    with torch.no_grad():
        own = fold(layers(seen.features.float()), belongs).argmax(dim=1)
        halfway = fold(layers(mixed), belongs).argmax(dim=1)
    wanted = belongs.argmax(dim=1)[seen.output]
    assert float((own == wanted).float().mean()) > 0.95
    assert float((halfway == labels().index("red-circle")).float().mean()) > 0.8
