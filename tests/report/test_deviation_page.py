"""The page of a corrected surface in a real browser: the model turns, and says what it is for."""

from pathlib import Path

import numpy as np
import pytest

from oneframe.case.case_file import Case
from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import LoadedCase, LoadedSurface
from oneframe.report.deviation_page import deviation_page
from oneframe.surface_correction.correct_surface import SurfaceCorrection
from tests.surface_correction.test_surface_correction import CAMERA, POSES, bump, surface

COUNTS = """(() => {
    const it = document.getElementById('model'), context = it.getContext('2d');
    const rgba = context.getImageData(0, 0, it.width, it.height).data;
    const found = {all: 0, red: 0, blue: 0};
    for (let at = 0; at < rgba.length; at += 4) {
        if (!rgba[at + 3]) continue;
        found.all += 1;
        found.red += rgba[at] > 2 * rgba[at + 2];
        found.blue += rgba[at + 2] > 2 * rgba[at];
    }
    return found;
})()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    mesh = surface()
    deviation = bump(mesh, 1.0)
    confirmed = mesh.vertices[:, 0] > -20
    found = SurfaceCorrection(mesh, deviation, np.full(len(deviation), 0.05), confirmed, 12, 0, 30.0, 0.2)
    image = np.full((*CAMERA.shape_hw, 3), 0.5, np.float32)
    frame = PosedFrame(image, np.ones(CAMERA.shape_hw, bool), CAMERA, POSES[0])
    case = Case(Path("case.toml"), 1.0, Path("0.png"), CAMERA, None, Path("surface.ply"), POSES[0])
    loaded = LoadedCase(case, LoadedSurface(mesh, np.eye(4), ()), (frame,), ())
    path = tmp_path_factory.mktemp("page") / "deviation.html"
    path.write_bytes(deviation_page(loaded, found))
    return path


def painted(browser):
    # what was asked for is painted with the next picture
    browser.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return browser.evaluate(COUNTS)


def test_the_model_turns_grows_and_comes_back(browser, page):
    browser.open(page)
    text = browser.evaluate("document.body.textContent")
    assert "must not guide a surgeon" in text
    assert "+1.0 mm" in text
    assert "smooth, wet, dark floor" in text
    before = painted(browser)
    # nothing is farther away
    assert before["red"] > 500
    assert before["blue"] == 0
    browser.drag("#model", 100, 100)
    turned = painted(browser)
    assert turned["red"] < 0.9 * before["red"]
    browser.wheel("#model", -400)
    assert painted(browser)["red"] > 1.1 * turned["red"]
    browser.key("ArrowLeft")
    browser.click("#reset")
    assert painted(browser) == before
    assert (browser.errors, browser.outside_requests()) == ([], [])
