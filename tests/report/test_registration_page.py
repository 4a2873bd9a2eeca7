"""The page of a registration in a real browser."""

import cv2
import numpy as np
import pytest

from oneframe.case.pose_record import PoseRecord
from oneframe.registration.register import RegisteredFrame
from oneframe.registration.register_case import FrameEvidence, RegistrationEvidence
from oneframe.registration.verdict import ACCEPTED, DOUBTFUL, REFUSED, FilmChange, Verdict
from oneframe.report.registration_page import registration_page

STATES = (ACCEPTED, REFUSED, ACCEPTED, DOUBTFUL, REFUSED, REFUSED, REFUSED, ACCEPTED)
PROBABILITIES = (0.98, 0.1, 0.999, 0.7, 0.0, 0.0, 0.0, 0.99)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    picture = cv2.imencode(".webp", np.full((30, 40, 3), 90, np.uint8))[1].tobytes()
    frames = []
    for number, (state, probability) in enumerate(zip(STATES, PROBABILITIES, strict=True)):
        verdict = Verdict(state, probability, f"<b>{number}</b> of 9 places")
        frames.append(FrameEvidence("", 10 * number, RegisteredFrame(verdict), 0.3, picture))
    change = FilmChange(12, 0.25, np.eye(4, 5, dtype=bool))
    evidence = RegistrationEvidence(
        tuple(frames), np.full((120, 160, 3), 0.6), PoseRecord(error_px=1.5), is_film=True, change=change
    )
    path = tmp_path_factory.mktemp("page") / "registration.html"
    path.write_bytes(registration_page(evidence, name="one & two"))
    return path


def test_frames_with_their_states_and_reasons(browser, page):
    browser.open(page, dark=True)
    assert browser.evaluate("document.querySelector('h1').textContent") == "one & two"
    text = browser.evaluate("document.body.textContent")
    assert "it states 1.5 px" in text
    assert "from frame 12 on, 25% of what the case's frame shows" in text
    assert browser.evaluate("document.querySelector('section img.wide').naturalWidth") == 160
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
