"""Tests of the rebuilt net and its ONNX file; they need PyTorch."""

# ruff: noqa: E402

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is missing (apt-get install python3-torch)")

from roadplane_train.detect.model import STRIDES, NanoDet, with_classes
from roadplane_train.detect.onnx_file import ORIGINAL, answers, read_net, rounded, write_net
from roadplane_train.detect.release import mixed

TOLERANCE = 1e-5
NAMES = [f"{kind}_{stride}" for stride in STRIDES for kind in ("scores", "bins")]


def picture(seed: int, batch: int, height: int, width: int) -> torch.Tensor:
    """Returns pictures of coarse blocks with noise, 0…1."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((batch, 3, height // 16, width // 16)).repeat(16, 2).repeat(16, 3)
    return torch.from_numpy((0.7 * coarse + 0.3 * rng.random((batch, 3, height, width))).astype(np.float32))


def run(path: Path, image: torch.Tensor) -> dict[str, np.ndarray]:
    """Returns the outputs of an ONNX file."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    return dict(zip(NAMES, session.run(NAMES, {"image": image.numpy()}), strict=True))


def assert_same(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    """Checks that the outputs differ by at most the tolerance, relative for values above 1."""
    for name in NAMES:
        np.testing.assert_allclose(found[name], expected[name], rtol=TOLERANCE, atol=TOLERANCE, err_msg=name)


def changed(seed: int) -> NanoDet:
    """Returns the net with slightly changed weights."""
    net = read_net()
    torch.manual_seed(seed)
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.mul_(1 + 0.02 * torch.randn_like(parameter))
    return net


@pytest.mark.parametrize(("seed", "batch", "height", "width"), [(1, 2, 416, 416), (2, 1, 96, 224)])
def test_the_module_equals_the_original(seed: int, batch: int, height: int, width: int) -> None:
    image = picture(seed, batch, height, width)
    assert_same(answers(read_net(), image), run(ORIGINAL, image))


@pytest.mark.parametrize("half", [False, True])
def test_the_written_file_equals_the_module(tmp_path: Path, half: bool) -> None:
    net, image = changed(3), picture(4, 1, 192, 256)
    write_net(net, tmp_path / "net.onnx", half)
    assert_same(run(tmp_path / "net.onnx", image), answers(rounded(net) if half else net, image))
    assert_same(answers(read_net(tmp_path / "net.onnx"), image), answers(rounded(net) if half else net, image))


def test_the_written_file_has_the_names_and_shapes_of_the_original(tmp_path: Path) -> None:
    write_net(changed(5), tmp_path / "net.onnx")
    original, written = (onnx.load(path).graph for path in (ORIGINAL, tmp_path / "net.onnx"))
    assert list(written.input) == list(original.input)
    assert list(written.output) == list(original.output)
    kept = [[node for node in graph.node if node.op_type != "Cast"] for graph in (original, written)]
    assert kept[0] == kept[1]


def test_the_unchanged_net_is_written_without_loss(tmp_path: Path) -> None:
    write_net(read_net(), tmp_path / "net.onnx", half=True)
    image = picture(6, 1, 64, 64)
    expected, found = run(ORIGINAL, image), run(tmp_path / "net.onnx", image)
    for name in NAMES:
        np.testing.assert_array_equal(found[name], expected[name])


def test_a_new_class_changes_no_other(tmp_path: Path) -> None:
    net, image = read_net(), picture(7, 1, 64, 96)
    wider = with_classes(net, 4)
    write_net(wider, tmp_path / "net.onnx")
    found, expected = run(tmp_path / "net.onnx", image), answers(net, image)
    for stride in STRIDES:
        scores = found[f"scores_{stride}"]
        np.testing.assert_allclose(scores[:, :3], expected[f"scores_{stride}"], atol=TOLERANCE)
        np.testing.assert_allclose(scores[:, 3], 0.01, atol=1e-4)
        np.testing.assert_allclose(found[f"bins_{stride}"], expected[f"bins_{stride}"], rtol=TOLERANCE, atol=TOLERANCE)


def test_other_nets_are_refused() -> None:
    with pytest.raises(ValueError, match="other convolutions"):
        read_net(ORIGINAL.with_name("hourglass.onnx"))


def test_mixed_weights_lie_between_the_trained_and_the_original_ones() -> None:
    trained, original = with_classes(changed(5), 4), with_classes(read_net(), 4)
    with torch.no_grad():
        for parameter in trained.heads[0].out.parameters():
            parameter[3] = 0.3  # the class that the original lacks
    state, old, new = mixed(trained, 0.25).state_dict(), original.state_dict(), trained.state_dict()
    for name, values in state.items():
        expected = 0.75 * old[name] + 0.25 * new[name]
        if ".out." in name:
            expected[3] = new[name][3]
        torch.testing.assert_close(values, expected)
