"""Measure the report and the live page: ``python benchmarks/view.py``.

The program measures the size of the demo's report, the time to write the report and its results, and the time until
Chromium has drawn it. For the live page it measures the frame rate and the delay of a slider. Needs the extras view and
browser.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from pliant.study import demo_study, load_study, run_study
from pliant.validation.store import save_results
from pliant.view import write_report
from pliant.view.live import page_content
from pliant.view.server import Server

CHROMIUM = next(p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p)
TRIES = 5


def seconds(what):
    began = time.perf_counter()
    what()
    return time.perf_counter() - began


def main():
    folder = Path(tempfile.mkdtemp())
    outcome = run_study(load_study(demo_study()), folder)
    print(f"report: {(folder / 'report.html').stat().st_size} bytes, "
          f"written in {min(seconds(lambda: write_report(outcome, folder)) for _ in range(TRIES)):.2f} s; "
          f"results kept in {min(seconds(lambda: save_results(outcome, folder)) for _ in range(TRIES)):.2f} s")
    server = Server(page_content(folder))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()

        def drawn():
            page.goto((folder / "report.html").as_uri())
            page.wait_for_selector("html[data-ready=yes]")

        print(f"first pictures after {min(seconds(drawn) for _ in range(TRIES)):.2f} s")
        page.goto(server.address)
        page.wait_for_timeout(1000)
        rate = """() => new Promise((done) => { let n = 0; const s = new Set(); const began = performance.now();
            const tick = () => { s.add(pliantLive.now.t); n += 1;
              if (performance.now() - began > 5000) done([n / 5, s.size / 5]); else requestAnimationFrame(tick); };
            requestAnimationFrame(tick); })"""
        cpu = time.process_time()
        painted, moved = page.evaluate(rate)
        print(f"live page: {painted:.0f} frames/s painted, {moved:.0f} of them new, "
              f"{100 * (time.process_time() - cpu) / 5:.0f} % of a core behind it")
        late = """(p) => new Promise((done) => { const began = performance.now(); pliantLive.ask({ pressure_kpa: [p] });
            const look = () => { if (pliantLive.now.command[0] === p) done(performance.now() - began);
              else requestAnimationFrame(look); }; look(); })"""
        print(f"a slider is seen after {sorted(page.evaluate(late, k) for k in range(1, 22))[10]:.0f} ms (median)")
        browser.close()
    server.stop()
    thread.join(10)
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
