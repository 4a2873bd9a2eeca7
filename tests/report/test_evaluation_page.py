"""The page of an evaluation in a real browser."""

import json

import numpy as np
import pytest

from oneframe.report.evaluation_page import evaluation_page
from tests.report.synthetic_evaluation import CASES, METHODS


@pytest.fixture(scope="module")
def page(evaluation, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "evaluation.html"
    path.write_bytes(evaluation_page(evaluation))
    return path


def cells(browser, table: str) -> list[list[str]]:
    return browser.evaluate(
        f"[...document.querySelectorAll('{table} tbody tr')].map(line => [...line.children].map(it => it.textContent))"
    )


def test_pictures_scores_and_frames_belong_together(browser, page, evaluation):
    browser.open(page)
    content = json.loads((evaluation / "evaluation.json").read_text())
    names = [image for image in CASES["relief"]]
    for image in [*names[1:], names[0]]:
        browser.key("ArrowRight")
        assert browser.evaluate("document.querySelector('#frame-name').textContent") == image
        rows = [row for row in content["rows"] if row["image"] == image]
        expected = {row["method"]: f"{row['ssim_observed']:.3f}" for row in rows}
        found = {line[0]: line[3] for line in cells(browser, "#frame-scores")}
        assert found == expected
        best = max(expected, key=lambda method: float(expected[method]))
        marked = browser.evaluate("document.querySelector('#frame-scores .best').parentElement.firstChild.textContent")
        assert marked == best
    # both sides of the slider, and its line by the keyboard
    browser.wait("document.querySelector('.slider .over').naturalWidth === 160")
    sources = browser.evaluate("[...document.querySelectorAll('.slider img')].map(it => it.src)")
    assert sources[0] != sources[1]
    browser.evaluate("document.querySelector('.slider input').value = 20;"
                     "document.querySelector('.slider input').dispatchEvent(new Event('input'))")  # fmt: skip
    assert browser.evaluate("getComputedStyle(document.querySelector('.slider .over')).clipPath").endswith("20%)")
    assert (browser.errors, browser.outside_requests()) == ([], [])


def test_tables_sort_and_intervals_stand_where_their_numbers_are(browser, page, evaluation):
    browser.open(page)
    rows = json.loads((evaluation / "evaluation.json").read_text())["rows"]
    expected = sorted((f"{row['ssim_observed']:.3f}" for row in rows), key=float)
    heading = "#all-rows th:nth-child(6) button"
    browser.click(heading)
    assert [line[5] for line in cells(browser, "#all-rows")] == expected[::-1]
    browser.click(heading)
    assert [line[5] for line in cells(browser, "#all-rows")] == expected
    assert browser.evaluate("document.querySelector('#all-rows th:nth-child(6)').ariaSort") == "ascending"
    found = browser.evaluate(
        "[...document.querySelectorAll('.intervals li:not(.axis)')].map(line => ["
        "line.querySelector('strong').textContent, parseFloat(line.querySelector('.dot').style.left)])"
    )
    means, places = np.array(found, float).T
    assert len(means) == len(METHODS)
    # best first, and positions in proportion to the means
    assert (np.diff(means) < 0).all()
    assert np.polyval(np.polyfit(means, places, 1), means) == pytest.approx(places, abs=0.5)


def test_an_evaluation_without_pictures_still_has_a_page(browser, evaluation, tmp_path):
    content = json.loads((evaluation / "evaluation.json").read_text())
    content |= {key: [] for key in ("summary", "distribution", "bound", "pictures", "charts")}
    content |= {"missing": "no features were given", "rows": content["rows"][:1]}
    (tmp_path / "evaluation.json").write_text(json.dumps(content))
    page = tmp_path / "page.html"
    page.write_bytes(evaluation_page(tmp_path))
    browser.open(page)
    assert len(cells(browser, "#all-rows")) == 1
    assert "no features were given" in browser.evaluate("document.querySelector('#distribution').textContent")
    assert browser.errors == []
