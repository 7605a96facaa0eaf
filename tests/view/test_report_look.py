"""The report as its readers meet it: contrast in light and dark, and a browser's window of a desk and of a phone."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)


def luminance(colour):
    """Relative luminance of #rgb or #rrggbb; WCAG 2.2."""
    text = colour.lstrip("#")
    parts = [int(c, 16) / 255 for c in (text[i : i + 2] for i in (0, 2, 4))] if len(text) == 6 else [
        int(2 * c, 16) / 255 for c in text]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def schemes(path):
    style = "".join(re.findall(r"<style>(.*?)</style>", path.read_text(encoding="utf-8"), re.DOTALL))
    return [dict(re.findall(r"--(\w+): (#\w+)", rule)) for rule in re.findall(r":root[^{]*\{(.*?)\}", style)]


def test_contrast_in_light_dark_and_print(written):
    found = schemes(written)
    assert len(found) == 3
    for colours in ({**found[0], **one} for one in found):
        for paper in ("paper", "tint"):
            assert contrast(colours["ink"], colours[paper]) >= 7
            for words in ("link", "soft", "good", "beware", "missed", "open"):
                assert contrast(colours[words], colours[paper]) >= 4.5, (words, paper)
        for line in ("measured", "base", "tip", "accent"):
            assert contrast(colours[line], colours["paper"]) >= 3, line
        assert contrast(colours["measured"], colours["tip"]) >= 2  # told apart without colour, by width as well


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs: pip install pliant[browser]")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with sync_api.sync_playwright() as play:
        found = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def opened(browser, written):
    """A page that counts what it asks for and what it complains of."""
    pages = []

    def go(width=1280, scheme="light"):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        page.asked, page.complaints = [], []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("console", lambda message: page.complaints.append(message.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.goto(written.as_uri())
        page.wait_for_selector("html[data-ready=yes]")
        pages.append(page)
        return page

    yield go
    for page in pages:
        page.close()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (420, "dark")], ids=["desk", "phone"])
def test_in_a_browser(opened, width, scheme):
    page = opened(width, scheme)
    assert [url.split("/")[-1] for url in page.asked] == ["report.html"]
    assert not page.complaints
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    for _ in range(60):  # a definition shows itself where the keyboard stands, and Enter leads to it
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.className") == "def":
            break
    look = "const s = getComputedStyle(document.activeElement, '::after'); "
    assert page.evaluate(f"(() => {{ {look} return s.position }})()") == "fixed"
    assert "Euclidean distance" in page.evaluate(f"(() => {{ {look} return s.content }})()")
    page.keyboard.press("Enter")
    assert page.url.endswith("#def-rmse_mm")


def test_long_names_of_fits_fit_on_a_phone(opened):
    page = opened(390)
    page.evaluate("document.getElementById('fit').options[0].textContent = 'stiffness of each joint, '.repeat(5)")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390


def number(text):
    return float(text.replace("−", "-"))


def test_hover_tells_the_values_of_that_instant(opened, outcome):
    page = opened()
    page.evaluate("pliantReport.choose(0, 'low')")
    over = page.locator("#plot-y .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + 0.37 * box["width"], box["y"] + 30)
    record = outcome.fits[0].records[0]
    exp = record.experiment
    shown = page.evaluate("pliantReport.frame")
    assert shown == pytest.approx(0.37 * (exp.time.size - 1), abs=1)
    assert page.locator("#clock").inner_text() == f"{exp.time[shown]:.3f} s"
    row = page.locator("#values tr").last.locator("td").all_inner_texts()
    told = [1e3 * v for pair in zip(exp.position[shown, -1], record.modelled[shown, -1], strict=True) for v in pair]
    assert [number(v) for v in row[:4]] == pytest.approx(told, abs=0.01)
    assert number(row[4]) == pytest.approx(np.hypot(told[0] - told[1], told[2] - told[3]), abs=0.02)


def test_the_scrubber_moves_the_body_and_every_cursor(opened, outcome):
    page = opened()
    page.evaluate("pliantReport.choose(0, 'low')")
    page.locator("#time").focus()
    page.keyboard.press("Home")
    before = page.locator("#body").screenshot()
    for _ in range(55):
        page.keyboard.press("ArrowRight")
    assert page.evaluate("pliantReport.frame") == 55
    record = outcome.fits[0].records[0]
    drawn = page.evaluate("""() => { const r = pliantReport.now, width = r.chain.flat.length / r.t.length;
        return Array.from(r.chain.flat.slice(55 * width, 56 * width)); }""")
    assert drawn == pytest.approx(1e3 * record.body[55].ravel(), abs=0.01)
    assert page.locator("#body").screenshot() != before
    cursors = "pliantReport.plots.map((u) => [u.cursor.left, u.valToPos(pliantReport.now.t[55], 'x')])"
    for left, at in page.evaluate(cursors):
        assert left == pytest.approx(at, abs=1)


def test_the_body_plays_and_stops(opened):
    page = opened()
    page.evaluate("pliantReport.go(0)")
    page.select_option("#speed", "1")
    page.click("#play")
    page.wait_for_function("pliantReport.frame > 10")
    page.click("#play")
    still = page.evaluate("pliantReport.frame")
    page.wait_for_timeout(200)
    assert page.evaluate("pliantReport.frame") == still


def test_zoom_is_shared_and_a_cell_shows_its_record(opened):
    page = opened()
    page.click("#closer")
    windows = page.evaluate("pliantReport.plots.map((u) => [u.scales.x.min, u.scales.x.max])")
    assert all(w == windows[0] for w in windows)
    assert windows[0][1] - windows[0][0] < 1.0
    page.click("#whole")
    assert page.evaluate("pliantReport.plots[0].scales.x.max") == pytest.approx(1.39)
    cell = page.locator("button[data-fit='1'][data-record='low']")
    cell.click()
    assert cell.get_attribute("aria-pressed") == "true"
    assert page.evaluate("[pliantReport.now.k, pliantReport.now.name]") == [1, "low"]
    drawn = page.evaluate("pliantReport.plots[0].series.length")
    page.locator("#stations input").nth(0).click()
    assert page.evaluate("pliantReport.plots[0].series.length") != drawn


LAID_OUT = """async () => {
    dispatchEvent(new Event("beforeprint"));
    await Promise.resolve();
    const body = document.getElementById("body"), plots = [...document.querySelectorAll(".uplot")];
    const found = { body: [body.width / body.clientWidth, body.height / body.clientHeight],
        wide: plots.map((u) => u.querySelector("canvas").getBoundingClientRect().width - u.parentElement.clientWidth),
        paper: document.querySelector("main").clientWidth };
    dispatchEvent(new Event("afterprint"));
    await Promise.resolve();
    const over = (u) => u.querySelector("canvas").getBoundingClientRect().width - u.parentElement.clientWidth;
    found.after = plots.map(over);
    return found;
}"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [1600, 900, 400])
def test_print_draws_for_the_paper(opened, width):
    """When the browser lays the printed page out nothing can be drawn any more: it is drawn for the paper before."""
    page = opened(width)
    found = page.evaluate(LAID_OUT)
    assert found["paper"] == pytest.approx(180 / 25.4 * 96, abs=1)
    assert found["body"][0] == pytest.approx(found["body"][1], rel=0.01)  # not stretched
    assert len(found["wide"]) > 4
    assert max(map(abs, found["wide"])) <= 1  # not cut
    assert max(map(abs, found["after"])) <= 1  # as it was
