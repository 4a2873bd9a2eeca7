"""The page of a registration in a real browser."""

import cv2
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.pose_record import PoseRecord
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
    evidence = RegistrationEvidence(tuple(frames), source, PoseRecord(error_px=1.5), is_film=True, surface=check)
    path = tmp_path_factory.mktemp("page") / "registration.html"
    path.write_bytes(registration_page(evidence, name="one & two"))
    return path


def test_frames_with_their_states_and_reasons(browser, page):
    browser.open(page, dark=True)
    assert browser.evaluate("document.querySelector('h1').textContent") == "one & two"
    text = browser.evaluate("document.body.textContent")
    assert "10% lies -1.0 to +1.0 mm" in text
    # of a stretch the first frame's reason
    assert "40 to 60, refused: <b>4</b> of 9 places" in text
    states = browser.evaluate("[...document.querySelectorAll('#grid button')].map(it => it.dataset.state)")
    assert states == list(STATES)
    for place, probability in enumerate(PROBABILITIES):
        shown = "[document.querySelector('#name').textContent, document.querySelector('#note').textContent]"
        assert browser.evaluate(shown) == [f"{10 * place}", f"<b>{place}</b> of 9 places"]
        figures = browser.evaluate("[...document.querySelectorAll('#facts dd')].map(it => it.textContent)")
        assert figures[:2] == [STATES[place], f"{probability:.3f}"]
        browser.key("ArrowRight")
    browser.evaluate(
        f"(() => {{ const it = document.querySelector('#only'); it.value = '{DOUBTFUL}';"
        " it.dispatchEvent(new Event('change')); })()"
    )
    assert browser.evaluate("document.querySelector('#name').textContent") == "30"
    assert (browser.errors, browser.outside_requests()) == ([], [])
