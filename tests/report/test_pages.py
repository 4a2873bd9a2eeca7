"""The pages of a dataset and of a registration in a real browser, and the command that writes the first."""

import json
import re
import shutil

import cv2
import numpy as np
import pytest

from oneframe.dataset.check.check_dataset import check_dataset
from oneframe.dataset.layout import ViewPaths
from oneframe.dataset.run.resume_record import read_record
from oneframe.report.dataset_page import dataset_page
from oneframe.report.page import Column, Item, html_page
from tests.dataset.synthetic_dataset import CAMERA, COUNT, DEPTH_SCALE, pose_of

HOSTILE = "<script>window.pwned = 1</script>\"'><img src=x onerror='window.pwned = 2'>&amp;${1}</title>"


def page_data(page: bytes) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', page.decode())[1])


def grid_names(browser) -> list[str]:
    return browser.evaluate("[...document.querySelectorAll('#grid .name')].map(it => it.textContent)")


def test_grid_and_large_picture_follow_keys_order_and_choice(browser, dataset, tmp_path):
    path = tmp_path / "report.html"
    check = check_dataset(dataset)
    path.write_bytes(dataset_page(dataset, check=check))
    browser.open(path, width=390, height=844, dark=True)
    assert browser.evaluate("document.documentElement.scrollWidth") == 390
    items = page_data(path.read_bytes())["items"]
    assert grid_names(browser) == [str(number) for number in range(COUNT)]
    name = "document.querySelector('#name').textContent"
    for key, shown in (("ArrowRight", "1"), ("ArrowLeft", "0"), ("ArrowLeft", str(COUNT - 1))):
        browser.key(key)
        assert browser.evaluate(name) == shown
    browser.evaluate(
        "(() => { const it = document.querySelector('#sort'); it.value = 'observed';"
        " it.dispatchEvent(new Event('change')); })()"
    )
    assert grid_names(browser) == sorted(
        grid_names(browser), key=lambda each: (items[int(each)]["observed"], int(each))
    )
    source = browser.evaluate("document.querySelector('#picture').src")
    browser.key("m")
    assert browser.evaluate("document.querySelector('#picture').src") != source
    said = f"{len(check.findings)} findings" if check.findings else "Complete and consistent"
    assert said in browser.evaluate("document.querySelector('main ~ section').textContent")
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_figures_are_those_of_the_records(dataset):
    items = page_data(dataset_page(dataset))["items"]
    for number, item in enumerate(items):
        record = read_record(ViewPaths(dataset, number))
        visible = record.gt_info.px_count_visib
        assert item["observed"] == pytest.approx(100 * record.px_count_observed / visible)
        assert item["surface"] == pytest.approx(100 * visible / (CAMERA.width * CAMERA.height))
        # the source frame has the pose of the first view
        cosine = pose_of(number)[2, :3] @ pose_of(0)[2, :3]
        assert item["angle"] == pytest.approx(np.degrees(np.arccos(np.clip(cosine, -1, 1))), abs=1e-4)
        depth = cv2.imread(str(ViewPaths(dataset, number).file("depth")), cv2.IMREAD_UNCHANGED) * DEPTH_SCALE
        assert item["depth"] == pytest.approx(np.median(depth[depth > 0]), rel=1e-6)
    sample = dataset_page(dataset, views=2)
    assert [item["name"] for item in page_data(sample)["items"]] == ["0", str(COUNT - 1)]
    assert "shown: 2, evenly spaced" in sample.decode()


def test_text_from_files_is_no_code(browser, dataset, tmp_path):
    root = tmp_path / "<img src=x onerror=alert(1)>"
    shutil.copytree(dataset, root)
    content = json.loads((root / "dataset.json").read_text())
    content["object"] = content["conventions"] = content["options"]["sampler"] = HOSTILE
    (root / "dataset.json").write_text(json.dumps(content))
    (root / f"{HOSTILE.replace('/', '')}.json").write_text("no file of a dataset")
    page = tmp_path / "report.html"
    page.write_bytes(dataset_page(root, check=check_dataset(root)))
    browser.open(page)
    assert browser.evaluate("window.pwned") is None
    assert browser.evaluate("document.querySelectorAll('script').length") == 2
    assert browser.evaluate("document.querySelectorAll('img[src=x]').length") == 0
    assert HOSTILE in browser.evaluate("document.body.textContent")
    columns, items = [Column("word", HOSTILE, HOSTILE)], [Item(HOSTILE, (None,), {"word": HOSTILE}, HOSTILE, HOSTILE)]
    page.write_bytes(
        html_page(HOSTILE, HOSTILE, [HOSTILE], columns, items, layers=(HOSTILE,), sections=[(HOSTILE, "")])
    )
    browser.open(page)
    assert browser.evaluate("window.pwned") is None
    assert browser.evaluate("document.querySelector('#name').textContent") == HOSTILE
    # not even the policy had to stop anything
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_a_damaged_dataset_gives_a_page_that_names_what_is_missing(dataset, tmp_path):
    root = tmp_path / "damaged"
    shutil.copytree(dataset, root)
    paths = [ViewPaths(root, number) for number in range(COUNT)]
    paths[0].file("rgb").unlink()
    paths[1].file("rgb").write_bytes(paths[1].file("rgb").read_bytes()[:200])
    paths[2].file("frame").write_text("{")
    page = dataset_page(root)
    for name in (paths[0].relative("rgb"), paths[1].relative("rgb"), paths[2].relative("frame")):
        assert name in page.decode(), name
    assert str(root) not in page.decode()
    items = page_data(page)["items"]
    assert [item["pictures"][0] is None for item in items[:3]] == [True, True, False]


def test_the_command_refuses_what_it_cannot_show(run_oneframe, dataset, tmp_path):
    out = tmp_path / "new" / "page.html"
    for _ in range(2):
        # the second time it replaces its own page
        ended = run_oneframe("report", dataset, "--no-check", "--out", out)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert ended.stdout.endswith(f"MB: {out}\n")
    refused = {
        (tmp_path, "--out", out): "expected the folder of a dataset, found no",
        (dataset, "--out", dataset / "report.html"): "expected a file outside the folder of the dataset",
        (dataset, "--out", out, "--views", "-1"): "expected 0 or more",
        (dataset, "--out", tmp_path / "case.toml"): "expected the name of a page",
    }
    for arguments, message in refused.items():
        ended = run_oneframe("report", *arguments)
        assert ended.returncode == 2
        assert message in ended.stderr
        assert ended.stderr.count("\n") == 1
