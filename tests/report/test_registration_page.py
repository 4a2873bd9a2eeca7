"""The page of a registration in a real browser."""

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.colour.source_view import SourceView
from oneframe.projection.z_buffer import rasterise_depth
from oneframe.registration.report import FrameEvidence, RegistrationEvidence
from oneframe.registration.surface_check import SurfaceCheck
from oneframe.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED, Verdict
from oneframe.report.registration_page import registration_page
from oneframe.transforms import rigid, rotation_from_vector
from tests.alignment.test_refinement import hills

CAMERA = PinholeCamera(160, 120, 750.0, 750.0, 79.5, 59.5)
STATES = (ACCEPTED, REFUSED, ACCEPTED, DOUBTFUL, REFUSED, REFUSED, REFUSED, ACCEPTED)
PROBABILITIES = (0.98, 0.1, 0.999, 0.7, 0.0, 0.0, 0.0, 0.99)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    mesh, pose = hills(1), rigid(rotation_from_vector(np.array([np.pi, 0, 0])), np.array([0, 0, 300.0]))
    inverse = rasterise_depth(mesh, CAMERA, pose).inverse_depth.astype(np.float32)
    grey, everywhere = np.full((120, 160, 3), 0.6, np.float32), np.ones((120, 160), bool)
    picture = cv2.imencode(".webp", np.full((30, 40, 3), 90, np.uint8))[1].tobytes()
    frames = []
    for number, (state, probability) in enumerate(zip(STATES, PROBABILITIES, strict=True)):
        found = None if state == REFUSED else rigid(translation=np.array([5.0 * number, 0, 0])) @ pose
        reason = f"<b>{number}</b> of 9 places"
        frames.append(
            FrameEvidence("", 10 * number, Verdict(state, probability, reason), found, 0.1, 0.2, 0.3, picture)
        )
    source = SourceView(grey, everywhere, CAMERA, pose, inverse_depth=inverse)
    off_mm = np.linspace(-1, 1, 300).reshape(15, 20)
    check = SurfaceCheck(off_mm, np.abs(off_mm) > 0.9, 14)
    evidence = RegistrationEvidence(
        tuple(frames), mesh, source, np.zeros(3), {"error_px": 1.5}, is_film=True, surface=check
    )
    path = tmp_path_factory.mktemp("page") / "registration.html"
    path.write_bytes(registration_page(evidence, name="one & two"))
    return path


def test_time_line_frame_and_table_follow_each_other(browser, page):
    browser.open(page, dark=True)
    assert browser.evaluate("document.querySelector('h1').textContent") == "one & two"
    # stretches, the longest first, then the least sure
    numbers = "[...document.querySelectorAll('#worst-table tbody tr')].map(it => it.children[1].textContent)"
    assert "10% lies -1.0 to +1.0 mm" in browser.evaluate("document.querySelector('#limits').textContent")
    assert browser.evaluate(numbers) == ["40–60", "10", "30", "0", "70", "20"]
    shown = "[document.querySelector('#number').textContent, document.querySelector('#reason').textContent]"
    assert browser.evaluate(shown) == ["40", "<b>4</b> of 9 places"]
    for selector, number in (("#next-lost", "10"), ("#next-lost", "30"), ("#previous", "20"), ("#next", "30")):
        browser.click(selector)
        assert browser.evaluate(shown)[0] == number
    x, y = browser.place_of("#line")
    width = browser.evaluate("document.querySelector('#line').getBoundingClientRect().width")
    for place, (state, probability) in enumerate(zip(STATES, PROBABILITIES, strict=True)):
        browser.click_at(x + width * ((place + 0.5) / len(STATES) - 0.5), y)
        assert browser.evaluate(shown) == [f"{10 * place}", f"<b>{place}</b> of 9 places"]
        assert browser.evaluate("document.querySelector('#state').textContent") == state
        assert browser.evaluate("document.querySelector('#facts dd').textContent") == f"{probability:.3f}"
    assert (browser.errors, browser.outside_requests()) == ([], [])
