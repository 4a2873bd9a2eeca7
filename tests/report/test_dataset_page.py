"""The page of a dataset in a real browser: what it shows is what the files hold."""

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
from tests.dataset.synthetic_dataset import CAMERA, COUNT, DEPTH_SCALE, pose_of

GREEN, ORANGE = [0, 125, 90], [213, 94, 0]
"""Seen and not seen, on a light page."""


@pytest.fixture(scope="module")
def page(dataset, tmp_path_factory):
    """Views with one number each, and the order of the page."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_bytes(dataset_page(dataset, check=check_dataset(dataset)))
    return path


def mask_pixels(dataset, index):
    paths = ViewPaths(dataset, index)
    mask, observed = (cv2.imread(str(paths.file(kind)), 0) > 0 for kind in ("mask_visib", "mask_observed"))
    return mask, observed & mask


def overlay_pixels(browser) -> np.ndarray:
    """``(H, W, 4)`` of the layers over the large picture."""
    browser.wait("!document.querySelector('#overlay').hidden")
    width, height, values = browser.evaluate(
        "(() => { const c = document.querySelector('#overlay'), copy = new OffscreenCanvas(c.width, c.height);"
        " const context = copy.getContext('2d', {willReadFrequently: true}); context.drawImage(c, 0, 0);"
        " return [c.width, c.height, Array.from(context.getImageData(0, 0, c.width, c.height).data)]; })()"
    )
    return np.reshape(values, (height, width, 4))


def shown_view(browser) -> int:
    return int(browser.evaluate("document.querySelector('#number').value"))


def grid_order(browser) -> list[int]:
    return browser.evaluate("[...document.querySelectorAll('#grid .number')].map(it => Number(it.textContent))")


def view_values(browser) -> list[dict]:
    views = browser.evaluate("JSON.parse(document.getElementById('data').textContent).views")
    return [{key: view[key] for key in ("angle", "distance", "observed", "surface")} for view in views]


def test_masks_over_the_picture_are_those_of_the_files(browser, dataset, tmp_path):
    root, page = tmp_path / "dataset", tmp_path / "report.html"
    shutil.copytree(dataset, root)
    # stripes, at the least distance of two edges
    observed = np.where(np.arange(CAMERA.width) % 3 == 0, 255, 0).astype(np.uint8)[None].repeat(CAMERA.height, 0)
    cv2.imwrite(str(ViewPaths(root, 1).file("mask_observed")), observed)
    dataset = root
    page.write_bytes(dataset_page(dataset))
    browser.open(page)
    browser.key("ArrowRight")
    assert shown_view(browser) == 1
    mask, observed = mask_pixels(dataset, 1)
    assert observed.any()
    assert not observed[mask].all()
    browser.click("#layer-observed")
    drawn = overlay_pixels(browser)
    assert np.array_equal(drawn[..., 3] > 0, mask)
    # colours with an alpha are kept to a few levels only
    seen, unseen = (np.abs(drawn[..., :3] - colour).max(-1) <= 6 for colour in (GREEN, ORANGE))
    assert np.array_equal(seen & mask, observed)
    assert np.array_equal(unseen & mask, mask & ~observed)
    browser.key("o")
    browser.wait("document.querySelector('#overlay').hidden")
    browser.key("m")
    assert np.array_equal(overlay_pixels(browser)[..., 3] > 0, mask)
    assert browser.evaluate("document.querySelector('#layer-mask').getAttribute('aria-pressed')") == "true"
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_the_depth_under_the_pointer_is_that_of_the_file(browser, page, dataset):
    browser.open(page)
    browser.key("d")
    assert np.array_equal(overlay_pixels(browser)[..., 3] > 0, mask_pixels(dataset, 0)[0])
    depth = cv2.imread(str(ViewPaths(dataset, 0).file("depth")), cv2.IMREAD_UNCHANGED) * DEPTH_SCALE
    step = (depth.max() - depth[depth > 0].min()) / 255
    left, top, width = browser.evaluate(
        "(() => { document.querySelector('#stage').scrollIntoView({block: 'center'});"
        " const b = document.querySelector('#stage').getBoundingClientRect(); return [b.x, b.y, b.width]; })()"
    )
    inner = cv2.erode((depth > 0).astype(np.uint8), np.ones((7, 7)))
    rows, columns = np.nonzero(inner)
    for place in np.linspace(0, len(rows) - 1, 6).astype(int):
        scale = width / CAMERA.width
        browser._mouse("mouseMoved", left + (columns[place] + 0.5) * scale, top + (rows[place] + 0.5) * scale, 0)
        browser.wait("/mm/.test(document.querySelector('#readout').textContent)")
        found = float(
            re.search(r"≈ ([\d.]+) mm", browser.evaluate("document.querySelector('#readout').textContent"))[1]
        )
        # WebP's own error, a median over 3 x 3 px, and the rounding of the text
        around = depth[rows[place] - 1 : rows[place] + 2, columns[place] - 1 : columns[place] + 2]
        assert around.min() - 6 * step - 0.1 <= found <= around.max() + 6 * step + 0.1


def test_filters_and_order_of_the_grid_follow_the_records(browser, page, dataset):
    browser.open(page)
    values = view_values(browser)
    for index, value in enumerate(values):
        record = read_record(ViewPaths(dataset, index))
        assert value["observed"] == pytest.approx(
            100 * record.px_count_observed / record.gt_info.px_count_visib, abs=0.01
        )
        assert value["surface"] == pytest.approx(
            100 * record.gt_info.px_count_visib / (CAMERA.width * CAMERA.height), abs=0.01
        )
    # the source frame has the pose of the first view
    assert values[0]["angle"] == pytest.approx(0, abs=1e-3)
    assert grid_order(browser) == list(range(COUNT))
    for key in ("angle", "distance", "observed", "surface"):
        browser.evaluate(
            f"(() => {{ const it = document.querySelector('#sort'); it.value = '{key}';"
            " it.dispatchEvent(new Event('change')); })()"
        )
        assert grid_order(browser) == sorted(range(COUNT), key=lambda view: (values[view][key], view)), key
    browser.click("#descending")
    assert grid_order(browser) == sorted(range(COUNT), key=lambda view: (-values[view]["surface"], view))
    # the upper handle of the angle, moved by the keyboard
    browser.evaluate("document.querySelectorAll('.histogram input')[1].focus()")
    for _ in range(30):
        browser.key("ArrowLeft")
    most = float(re.findall(r"[\d.]+", browser.evaluate("document.querySelector('.histogram output').textContent"))[1])
    kept = [view for view in range(COUNT) if values[view]["angle"] <= most]
    assert 0 < len(kept) < COUNT
    assert sorted(grid_order(browser)) == kept
    assert browser.evaluate("document.querySelector('#count').textContent") == f"{len(kept)} of {COUNT} views"
    browser.click("#reset")
    assert len(grid_order(browser)) == COUNT


def test_a_camera_stands_where_the_pointer_names_it_and_a_click_selects_it(browser, page):
    browser.open(page, width=1600)
    data = browser.evaluate("JSON.parse(document.getElementById('data').textContent)")
    for number, side in enumerate(data["sides"]):
        browser.place_of(f"#scene figure:nth-child({number + 1}) canvas")
        places = browser.evaluate(
            f"(() => {{ const c = document.querySelectorAll('#scene canvas')[{number}];"
            " const b = c.getBoundingClientRect();"
            " const tip = document.querySelector('#scene output'), found = {};"
            " for (let y = b.top; y < b.bottom; y += 7) for (let x = b.left; x < b.right; x += 7) {"
            " c.dispatchEvent(new PointerEvent('pointermove', {clientX: x, clientY: y}));"
            " if (!tip.hidden) (found[/View (\\d+) /.exec(tip.textContent)[1]] ??= []).push([x, y]); }"
            " return found; })()"
        )
        assert places.keys() == {str(index) for index in range(COUNT)}
        middles = np.array([np.mean(places[str(index)], axis=0) for index in range(COUNT)])
        offsets = np.array([view["centre"] for view in data["views"]]) - data["source"]["pivot"]
        for axis, along in enumerate((np.array(side["across"]), -np.array(side["up"]))):
            away = offsets @ along
            # the drawing is to scale; what lies near another camera is named over less than a whole circle
            assert np.corrcoef(away, middles[:, axis])[0, 1] > 0.98 or np.ptp(away) < 20
        for index in (2, 1):
            browser.click_at(*middles[index])
            assert shown_view(browser) == index
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_nothing_is_wider_than_the_screen_of_a_phone(browser, page):
    browser.open(page, width=390, height=844, dark=True)
    assert browser.evaluate("document.documentElement.scrollWidth") == 390
    dark = browser.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    browser.click("#theme")
    light = browser.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    assert (dark, light) == ("rgb(13, 17, 23)", "rgb(255, 255, 255)")
    assert (browser.errors, browser.outside_requests()) == ([], [])


HOSTILE = "<script>window.pwned = 1</script>\"'><img src=x onerror='window.pwned = 2'>&amp;${1}</title>"


def test_text_from_files_is_no_code(browser, dataset, tmp_path):
    root = tmp_path / "<img src=x onerror=alert(1)>"
    shutil.copytree(dataset, root)
    content = json.loads((root / "dataset.json").read_text())
    content["object"] = content["conventions"] = content["options"]["sampler"] = HOSTILE
    content["structures"] = {HOSTILE: [HOSTILE, 0, 1]}
    content["inputs_sha256"][HOSTILE] = HOSTILE
    (root / "dataset.json").write_text(json.dumps(content))
    (root / f"{HOSTILE.replace('/', '')}.json").write_text("no file of a dataset")
    page = tmp_path / "report.html"
    page.write_bytes(dataset_page(root, check=check_dataset(root)))
    browser.open(page)
    assert browser.evaluate("window.pwned") is None
    assert browser.evaluate("document.querySelectorAll('script').length") == 2
    assert browser.evaluate("document.querySelectorAll('img[src=x]').length") == 0
    assert HOSTILE in browser.evaluate("document.querySelector('#provenance').textContent")
    # not even the policy had to stop anything
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_a_damaged_dataset_gives_a_page_that_names_what_is_missing(browser, dataset, tmp_path):
    root = tmp_path / "damaged"
    shutil.copytree(dataset, root)
    paths = [ViewPaths(root, index) for index in range(COUNT)]
    paths[0].file("rgb").unlink()
    paths[1].file("rgb").write_bytes(paths[1].file("rgb").read_bytes()[:200])
    paths[2].file("frame").write_text("{")
    for kind in ("rgb", "depth", "mask", "mask_visib", "mask_observed", "frame"):
        paths[3].file(kind).unlink()
    (root / "models" / "obj_000001.ply").write_bytes(b"ply\n")
    page = tmp_path / "report.html"
    page.write_bytes(dataset_page(root, check=check_dataset(root)))
    browser.open(page)
    named = browser.evaluate("document.querySelector('#check').textContent")
    missing = [paths[0].relative("rgb"), paths[1].relative("rgb"), paths[2].relative("frame")]
    for name in [*missing, "models/obj_000001.ply"]:
        assert name in named, name
    assert str(root) not in page.read_text(encoding="utf-8")
    assert browser.evaluate("document.querySelectorAll('#grid .absent').length") >= 2
    browser.key("ArrowRight")
    browser.key("ArrowRight")
    assert browser.evaluate("!document.querySelector('#picture').hidden")
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_a_sample_is_evenly_spaced_and_said_to_be_one(dataset):
    text = dataset_page(dataset, views=2).decode()
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])
    assert [view["index"] for view in data["views"]] == [0, COUNT - 1]
    assert "shown: 2, evenly spaced" in text


def test_angle_and_distance_are_those_of_the_camera_around_the_pivot(dataset):
    data = json.loads(re.search(r'id="data">(.*?)</script>', dataset_page(dataset).decode())[1])
    pivot = np.array(data["source"]["pivot"])
    centres = [-pose_of(index)[:3, :3].T @ pose_of(index)[:3, 3] for index in range(COUNT)]
    for view, centre in zip(data["views"], centres, strict=True):
        assert view["distance"] == pytest.approx(np.linalg.norm(centre - pivot), abs=1e-3)
        rays = [(point - pivot) / np.linalg.norm(point - pivot) for point in (centres[0], centre)]
        assert view["angle"] == pytest.approx(np.degrees(np.arccos(np.clip(rays[0] @ rays[1], -1, 1))), abs=1e-3)
    # the pivot lies on the surface, in the middle of the first view
    depth = cv2.imread(str(ViewPaths(dataset, 0).file("depth")), cv2.IMREAD_UNCHANGED) * DEPTH_SCALE
    pivot_cam = (pose_of(0) @ [*pivot, 1])[:3]
    u, v = CAMERA.project(pivot_cam[None])[0].round().astype(int)
    rows, columns = np.nonzero(depth)
    assert np.hypot(u - columns.mean(), v - rows.mean()) <= 2
    assert pivot_cam[2] == pytest.approx(depth[v, u], abs=0.5)
