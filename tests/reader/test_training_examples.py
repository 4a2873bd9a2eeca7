"""The examples of docs/examples give the arrays of the reader, in this process and in workers of a DataLoader."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from oneframe.reader import open_dataset

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_webdataset_gives_what_the_reader_gives(packed):
    pytest.importorskip("webdataset", reason="webdataset is not installed")
    expected = {f"000000_{view.index:06d}": view for view in open_dataset(packed)}
    found = {
        view["key"]: view for view in example("webdataset_views").views(str(packed / "shard-{000000..000001}.tar"))
    }
    assert found.keys() == expected.keys()
    for key, view in found.items():
        for name in ("rgb", "mask", "observed", "k", "cam_from_model"):
            np.testing.assert_array_equal(view[name], getattr(expected[key], name))
        # the float depth is not quantised
        np.testing.assert_allclose(view["depth_mm"], expected[key].depth_mm, atol=0.0051)
        assert tuple(view["bbox_visib"]) == expected[key].boxes.bbox_visib


@pytest.mark.parametrize("context", ["fork", "spawn"])
@pytest.mark.parametrize("workers", [0, 2])
def test_torch_gives_what_the_reader_gives(context, workers, packed, monkeypatch):
    torch = pytest.importorskip("torch", reason="torch is not installed")
    monkeypatch.syspath_prepend(str(EXAMPLES))  # workers that are spawned import it by name
    import torch_views

    expected = {view.index: view for view in open_dataset(packed)}
    options = {"num_workers": workers, "multiprocessing_context": context if workers else None, "batch_size": 2}
    streamed = torch_views.StreamedViews(packed, buffer=2)
    streamed.set_epoch(1)
    for data in (torch_views.Views(packed), streamed):
        views = 0
        for batch in torch.utils.data.DataLoader(data, **options):
            for place, index in enumerate(batch["index"].tolist()):
                view = expected[index]
                views += 1
                np.testing.assert_array_equal(batch["rgb"][place].permute(1, 2, 0), view.rgb)
                for name in ("depth_mm", "mask", "observed"):
                    np.testing.assert_array_equal(batch[name][place], getattr(view, name))
                np.testing.assert_allclose(batch["cam_from_model"][place], view.cam_from_model, rtol=1e-6, atol=1e-6)
                np.testing.assert_allclose(batch["k"][place], view.k, rtol=1e-6)
        assert views == len(expected)
