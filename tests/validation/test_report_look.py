"""The report as its readers meet it: contrast in light and dark, and a browser's window of a desk and of a phone."""

from __future__ import annotations

import re
import shutil

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


def test_contrast_in_light_dark_and_print(written):
    style = re.search(r"<style>(.*?)</style>", written.read_text(encoding="utf-8"), re.DOTALL)[1]
    schemes = [dict(re.findall(r"--(\w+): (#\w+)", rule)) for rule in re.findall(r":root \{(.*?)\}", style)]
    assert len(schemes) == 3
    for colours in schemes:
        for paper in ("paper", "tint"):
            assert contrast(colours["ink"], colours[paper]) >= 7
            assert contrast(colours["link"], colours[paper]) >= 4.5
            assert contrast(colours["soft"], colours[paper]) >= 4.5


def test_curves_of_measurements_stand_out_from_the_page():
    from pliant.validation.figures import MEASURED

    grey = f"{round(255 * float(MEASURED['color'])):02x}"
    assert contrast(3 * grey, "#fff") >= 3
    inverted = 0.102 * float(MEASURED["color"]) + 0.898 * (1 - float(MEASURED["color"]))
    assert contrast(3 * f"{round(255 * inverted):02x}", "#1a1a1a") >= 3


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs: pip install pliant[browser]")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with sync_api.sync_playwright() as play:
        found = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")], ids=["desk", "phone"])
def test_in_a_browser(browser, written, width, scheme):
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    asked, complaints = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(written.as_uri())
    assert all(url.startswith(("file:", "data:")) for url in asked)
    assert not complaints
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("[...document.images].every(i => i.naturalWidth > 0 && i.alt)")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    for _ in range(40):  # a definition shows itself where the keyboard stands, and Enter leads to it
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.className") == "def":
            break
    look = "const s = getComputedStyle(document.activeElement, '::after'); "
    assert page.evaluate(f"(() => {{ {look} return s.position }})()") == "fixed"
    assert "Euclidean distance" in page.evaluate(f"(() => {{ {look} return s.content }})()")
    page.keyboard.press("Enter")
    assert page.url.endswith("#def-rmse_mm")
    page.close()
