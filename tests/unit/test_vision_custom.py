"""A detector of the user's own: small networks built here, right ones and wrong ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from automap.errors import ConfigError
from automap.vision.custom import CustomDetector, suppress_overlaps
from pipeline.cli.root import run_command
from pipeline.detect.search_setup import detector_files, read_description
from pipeline.settings.load import Settings

SIZE = 64
CELL = 16
CELLS = SIZE // CELL
CLASSES = ("red", "green", "blue")


def build(path: Path, layout: str = "4+nc", fraction: bool = False, size: int | str = SIZE) -> None:
    """A network whose boxes are the cells of a grid, and whose score of a class is the mean
    brightness of its colour in the cell."""
    from onnx import TensorProto, checker, helper, save

    at = (np.arange(CELLS) + 0.5) * CELL
    x, y = np.meshgrid(at, at)
    grid = np.stack([x.ravel(), y.ravel(), np.full(CELLS**2, CELL), np.full(CELLS**2, CELL)])
    rows = [grid / SIZE if fraction else grid]
    if layout == "5+nc":
        rows.append(np.ones((1, CELLS**2)))
    fixed = np.concatenate(rows).astype(np.float32)[None]
    nodes = [
        helper.make_node(
            "AveragePool", ["images"], ["means"], kernel_shape=[CELL, CELL], strides=[CELL, CELL]
        ),
        helper.make_node("Reshape", ["means", "shape"], ["scores"]),
        helper.make_node("Concat", ["fixed", "scores"], ["rows"], axis=1),
    ]
    if layout == "5+nc":
        nodes.append(helper.make_node("Transpose", ["rows"], ["output"], perm=[0, 2, 1]))
    else:
        nodes.append(helper.make_node("Identity", ["rows"], ["output"]))
    graph = helper.make_graph(
        nodes,
        "grid",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, size, size])],
        [helper.make_tensor_value_info("output", TensorProto.FLOAT, ["a", "b", "c"])],
        [
            helper.make_tensor("fixed", TensorProto.FLOAT, fixed.shape, fixed.ravel()),
            helper.make_tensor("shape", TensorProto.INT64, [3], [1, 3, CELLS**2]),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    checker.check_model(model)
    save(model, str(path))


def describe(folder: Path, extra: str = "", classes: tuple[str, ...] = CLASSES) -> Path:
    path = folder / "mine.toml"
    names = ", ".join(f'"{name}"' for name in classes)
    path.write_text(
        f'schema = "automap.detector/1"\nmodel = "mine.onnx"\nclasses = [{names}]\n'
        f"score_threshold = 0.5\n{extra}\n"
    )
    return path


def picture(colour: tuple[int, int, int], box: tuple[int, int, int, int], size: tuple[int, int]):  # type: ignore[no-untyped-def]
    """A black picture of (width, height) with a filled box, colour BGR."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    image[box[1] : box[3], box[0] : box[2]] = colour
    return image


def described(path: Path) -> CustomDetector:
    return CustomDetector(path, read_description(path))


@pytest.mark.parametrize("layout", ["4+nc", "5+nc"])
@pytest.mark.parametrize("fraction", [False, True])
@pytest.mark.parametrize("resize", ["letterbox", "stretch"])
def test_boxes_come_back_in_the_pictures_own_pixels(
    tmp_path: Path, layout: str, fraction: bool, resize: str
) -> None:
    build(tmp_path / "mine.onnx", layout, fraction)
    unit = "fraction" if fraction else "pixels"
    extra = f'layout = "{layout}"\nbox_unit = "{unit}"\nresize = "{resize}"\npadding = 0'
    detector = described(describe(tmp_path, extra))
    # 256x128 in 64x64: a letterbox shrinks by 4 and leaves 16 rows above
    image = picture((0, 0, 255), (64, 0, 128, 64), (256, 128))
    found = detector.detect(image)
    assert set(found.class_name) == {"red"}
    low, high = found.box[:, :2].min(axis=0), found.box[:, 2:].max(axis=0)
    np.testing.assert_allclose(low, [63.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(high, [127.5, 63.5], atol=1e-6)
    assert len(found) == (1 if resize == "letterbox" else 2)
    assert (found.score > 0.95).all()
    assert found.alternatives is not None
    assert found.alternatives[0][0][0] == "red"


def test_order_and_range_of_the_channels_are_settings(tmp_path: Path) -> None:
    build(tmp_path / "mine.onnx")
    image = picture((0, 0, 255), (0, 0, 16, 16), (64, 64))
    assert described(describe(tmp_path)).detect(image).class_name == ("red",)
    swapped = described(describe(tmp_path, 'channels = "BGR"'))
    assert swapped.detect(image).class_name == ("blue",)
    weak = described(describe(tmp_path, "mean = [0.6, 0.0, 0.0]"))
    assert len(weak.detect(image)) == 0


def test_a_model_for_any_size_needs_one(tmp_path: Path) -> None:
    build(tmp_path / "mine.onnx", size="side")
    with pytest.raises(ConfigError, match="add input_size"):
        described(describe(tmp_path))
    detector = described(describe(tmp_path, f"input_size = [{SIZE}, {SIZE}]"))
    assert len(detector.detect(picture((0, 255, 0), (16, 16, 32, 32), (64, 64)))) == 1


def test_overlapping_boxes_are_one_sign() -> None:
    box = np.array([[0, 0, 10, 10], [1, 1, 11, 11], [30, 0, 40, 10], [0, 0, 10, 4]], float)
    kept = suppress_overlaps(box, np.array([0.8, 0.9, 0.3, 0.7]), 0.5)
    assert kept.tolist() == [1, 3, 2]
    assert suppress_overlaps(np.zeros((0, 4)), np.zeros(0), 0.5).tolist() == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("schema = ", "not valid TOML"),
        ('schema = "automap.detector/9"', "first line"),
        ('schema = "automap.detector/1"\nclasses = ["a"]', "model is missing"),
        ('schema = "automap.detector/1"\nmodel = "m"\nclasses = []', "classes"),
        ('schema = "automap.detector/1"\nmodel = "m"\nclasses = ["a"]\nnms = 1', "unknown key nms"),
        (
            'schema = "automap.detector/1"\nmodel = "m"\nclasses = ["a"]\nlayout = "yolo"',
            "layout = 'yolo'",
        ),
    ],
)
def test_a_wrong_description_is_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=said) as error:
        read_description(path)
    assert str(path) in str(error.value)


def test_a_wrong_model_is_one_sentence_and_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), picture((0, 0, 255), (0, 0, 16, 16), (64, 64)))
    words = ["detect", str(folder), "-o", str(tmp_path / "o.csv"), "--detector"]
    path = describe(tmp_path)
    cases: list[tuple[bytes | None, str]] = [
        (None, "is missing"),
        (b"", "no usable ONNX model"),
        (b"not a network at all", "no usable ONNX model"),
    ]
    for content, said in cases:
        if content is not None:
            (tmp_path / "mine.onnx").write_bytes(content)
        assert run_command([*words, str(path)]) == 3
        text = capsys.readouterr().err
        assert said in text
        assert "mine.onnx" in text
        assert len(text.strip().splitlines()) == 1
    build(tmp_path / "mine.onnx")
    assert run_command([*words, str(describe(tmp_path, classes=("one", "two")))]) == 3
    assert "correct classes or layout" in capsys.readouterr().err
    assert run_command([*words, str(tmp_path / "nothing.toml")]) == 2
    assert not (tmp_path / "o.csv").exists()
    assert run_command([*words, str(describe(tmp_path))]) == 0
    assert (tmp_path / "o.csv").read_text().splitlines()[1].startswith("a.png,red,")


def test_the_files_of_a_detector_are_inputs_of_the_stage(tmp_path: Path) -> None:
    path = describe(tmp_path)
    chosen = Settings.model_validate({"detect": {"detector": str(path)}})
    assert detector_files(chosen) == [path, tmp_path / "mine.onnx"]
    path.write_text("broken")
    assert detector_files(chosen) == [path]
