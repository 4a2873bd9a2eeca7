"""FID and KID against independent calculations, their laws, and the network that they take features from."""

import numpy as np
import pytest
from scipy.linalg import sqrtm

from oneframe.evaluation.distribution_distance import FEATURES, SIDE_PX, Inception, frechet_distance, kernel_distance
from tests.learning.onnx_by_hand import described, node, number, part, tensor


def features(rng: np.random.Generator, count: int, size: int, shift: float = 0.0) -> np.ndarray:
    mixing = np.random.default_rng(1).normal(size=(size, size)) / np.sqrt(size)
    return shift + rng.normal(size=(count, size)) @ mixing


@pytest.mark.parametrize(("count", "size"), [(200, 12), (40, 30)])
def test_fid_is_that_of_the_matrix_root(rng, count, size):
    a, b = features(rng, count, size), 1.3 * features(rng, count + 7, size, 0.2)
    covariances = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    root = sqrtm(covariances[0] @ covariances[1]).real
    expected = ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(covariances[0] + covariances[1] - 2 * root)
    assert frechet_distance(a, b) == pytest.approx(expected, rel=1e-6)


def test_fid_also_where_covariances_are_singular(rng):
    """Fewer images than features, as usual: equal sets have none, and a shift adds its square."""
    a = features(rng, 20, 64)
    assert frechet_distance(a, a) == pytest.approx(0, abs=1e-9)
    assert frechet_distance(a, a[::-1] + 0.5) == pytest.approx(64 * 0.25, rel=1e-9)


def test_kid_is_that_of_a_double_loop(rng):
    a, b = features(rng, 9, 5), features(rng, 9, 5, 0.4)

    def kernel(x: np.ndarray, y: np.ndarray) -> float:
        return (float(x @ y) / len(x) + 1) ** 3

    def mean(first: np.ndarray, second: np.ndarray, *, same: bool) -> float:
        pairs = [(i, j) for i in range(len(first)) for j in range(len(second)) if not same or i != j]
        return sum(kernel(first[i], second[j]) for i, j in pairs) / len(pairs)

    def distance(x: np.ndarray, y: np.ndarray) -> float:
        return mean(x, x, same=True) + mean(y, y, same=True) - 2 * mean(x, y, same=False)

    kid, error = kernel_distance(a, b)
    assert kid == pytest.approx(distance(a, b), rel=1e-10)
    left_out = [distance(np.delete(a, i, 0), np.delete(b, i, 0)) for i in range(9)]
    assert error == pytest.approx(np.sqrt(8 / 9 * ((left_out - np.mean(left_out)) ** 2).sum()), rel=1e-8)


def tiny_network(weights: np.ndarray, counted: int | None, producer: str = "pytorch") -> bytes:
    """Mean over 3x3 px, square, mean over the image, matrix: 3 channels to ``weights.shape[1]`` features."""
    size = weights.shape[1]
    rule = {} if counted is None else {"count_include_pad": counted}
    pool = node("AveragePool", ["image"], "blurred", kernel_shape=[3, 3], pads=[1] * 4, strides=[1, 1], **rule)
    nodes = pool + node("Mul", ["blurred", "blurred"], "squares") + node("GlobalAveragePool", ["squares"], "mean")
    nodes += node("Flatten", ["mean"], "flat", axis=1) + node("MatMul", ["flat", "weights"], "pool3")
    ends = described(11, "image", (1, 3, SIDE_PX, SIDE_PX)) + described(12, "pool3", (1, size))
    graph = nodes + part(2, "tiny") + tensor("weights", weights) + ends
    return number(1, 8) + part(2, producer) + part(7, graph) + part(8, number(2, 13))


def expected_features(image: np.ndarray, weights: np.ndarray, *, counted: bool) -> np.ndarray:
    padded = np.pad(2 * image.astype(float) - 1, ((1, 1), (1, 1), (0, 0)))
    inside = np.pad(np.ones((*image.shape[:2], 1)), ((1, 1), (1, 1), (0, 0)), constant_values=float(counted))
    side = SIDE_PX
    sums = [sum(a[i : i + side, j : j + side] for i in range(3) for j in range(3)) for a in (padded, inside)]
    return ((sums[0] / sums[1]) ** 2).mean(axis=(0, 1)) @ weights


@pytest.mark.parametrize("producer", ["pytorch", "tf2onnx"])
@pytest.mark.parametrize("counted", [0, 1, None])
def test_features_are_those_of_the_file(rng, tmp_path, counted, producer):
    """OpenCV decides about padding by the producer; whoever made the file, its own attribute must count."""
    weights = rng.normal(size=(3, FEATURES))
    path = tmp_path / "network.onnx"
    path.write_bytes(tiny_network(weights, counted, producer))
    image = rng.random((SIDE_PX, SIDE_PX, 3)).astype(np.float32)
    found = Inception(path)(image)
    assert found.shape == (FEATURES,)
    assert found == pytest.approx(expected_features(image, weights, counted=counted == 1), rel=1e-4, abs=1e-4)
    # another size: what is resized from a uniform image is uniform
    large = Inception(path)(np.full((400, 500, 3), 0.25, np.float32))
    small = Inception(path)(np.full((30, 20, 3), 0.25, np.float32))
    assert large == pytest.approx(small, abs=1e-4)
