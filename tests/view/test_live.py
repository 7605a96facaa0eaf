"""The live page: the model behind it, who is let in, and what a browser sees."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from contextlib import closing
from types import SimpleNamespace
from urllib.parse import urlsplit

import numpy as np
import pytest
from test_report_look import CHROMIUM

from pliant.errors import InputError
from pliant.identification import Parameter
from pliant.loop.log import LoopLog, read_log
from pliant.loop.run import log_columns
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Extension, chain_model, save_model
from pliant.simulation import Stepper, equilibrium
from pliant.view.live import Live, PageContent, PageRequest, Pull, page_content, sliders_of
from pliant.view.server import WatchedLoop


@pytest.fixture(scope="module")
def model():
    return chain_model(length=0.11, mass=0.05, links=3, stiffness=0.6, damping=8e-3, torque=[3e-6])


@pytest.fixture
def content(model):
    return PageContent(model, sliders_of(model), {})


def test_a_body_that_rings_takes_shorter_steps(model):
    ringing = model.with_(damping=1e-5)
    live = Live(PageContent(ringing, sliders_of(ringing), {}))
    assert 1e-4 <= live.stepper.time_step < 1e-3
    live.advance(0.02)
    assert live.stepper.time == pytest.approx(0.02)


def test_frames_of_any_length_are_the_steps_of_the_model(content, model):
    live, alone = Live(content), Stepper(model, 1e-3)
    live.receive(PageRequest(pressure_kpa=[20.0]))
    for elapsed in (0.016, 0.017, 0.0004, 0.0166, 0.05):
        live.advance(elapsed)
    for _ in range(100):
        alone.step(20e3)
    np.testing.assert_array_equal(live.stepper.angle, alone.angle)
    assert live.frame()["kpa"] == [20.0]


def test_slow_motion_is_slow_and_a_late_frame_does_not_run_away(content):
    live = Live(content)
    live.receive(PageRequest(speed=0.25))
    live.advance(0.1)
    assert live.stepper.time == pytest.approx(0.025)
    live.advance(60.0)
    assert live.stepper.time == pytest.approx(0.125, abs=2e-3)


def test_a_hand_that_holds_still_ends_in_the_equilibrium_of_its_force(content, model):
    """Against the equilibrium under a tip force, which comes from a root search."""
    live = Live(content)
    live.receive(PageRequest(pull=Pull(link=2, share=1.0, x_mm=40.0, y_mm=90.0)))
    for _ in range(30):
        live.advance(0.1)
    assert np.linalg.norm(live.force) > 0.05
    q = equilibrium(model, 0.0, live.force)
    np.testing.assert_allclose(live.stepper.angle, mechanics_of(model).coordinates(q), atol=2e-3)


def test_parameters_stay_within_their_intervals_and_the_motion_goes_on(model):
    fitted = (Parameter("stiffness", 0.6, std=0.01), Parameter("start", 0.01, std=1e-3), Parameter("damping", 8e-3))
    sliders = sliders_of(model, fitted)
    assert [s.name for s in sliders] == ["stiffness"]
    live = Live(PageContent(model, sliders, {}))
    live.receive(PageRequest(pressure_kpa=[20.0]))
    live.advance(0.08)
    before = live.stepper.angle.copy()
    live.receive(PageRequest(parameters={"stiffness": 9.0, "moon": 1.0}, gravity=(0.0, -9.81)))
    live.build()
    assert live.model.stiffness[0] == pytest.approx(0.6 + 1.959964 * 0.01)
    assert live.model.gravity[1] == -9.81
    np.testing.assert_array_equal(live.stepper.angle, before)


def test_what_no_body_follows_is_told_and_the_body_rests(content):
    live = Live(content)
    live.receive(PageRequest(pressure_kpa=[2000.0]))
    live.stepper.rate[:] = 5e3
    live.advance(0.002)
    frame = live.frame()
    assert "put back to rest" in frame["message"]
    assert live.frame()["message"] == ""


def test_a_recording_is_played_under_the_model(outcome):
    first = outcome.fits[0]
    live = Live(PageContent(outcome.model, (), {r.name: r.experiment for r in first.records}))
    trace = next(r for r in first.records if r.experiment.pressure is not None)
    live.receive(PageRequest(record=trace.name))
    live.build()
    for _ in range(3):
        live.advance(0.1)
    assert live.command[0] == trace.experiment.pressure(np.array([0.3]))[0]
    seen = live.frame()["measured"]
    np.testing.assert_allclose(seen[-1], 1e3 * trace.experiment.position[30, -1], atol=1e-3)
    live.receive(PageRequest(record=None))
    live.build()
    assert live.frame()["measured"] is None


@pytest.mark.parametrize("by_hand", [0.0, 7.0])
def test_a_recording_that_is_put_away_in_mid_pulse_leaves_the_pressure_to_the_sliders(outcome, by_hand):
    first = outcome.fits[0]
    live = Live(PageContent(outcome.model, (), {r.name: r.experiment for r in first.records}))
    trace = next(r for r in first.records if r.experiment.pressure is not None)
    live.receive(PageRequest(pressure_kpa=[by_hand]))
    live.receive(PageRequest(record=trace.name))
    live.build()
    for _ in range(3):
        live.advance(0.1)
    assert live.frame()["command"] == [20.0]  # on the plateau
    live.receive(PageRequest(record=None))
    live.build()
    live.advance(0.1)
    assert live.frame()["command"] == live.frame()["kpa"] == [by_hand]


def test_of_many_wishes_the_last_is_built_and_the_motion_goes_on_meanwhile(content, monkeypatch):
    built = []
    monkeypatch.setattr("pliant.view.live.apply", lambda model, numbers: built.append(dict(numbers)) or model)
    live = Live(content)
    live.receive(PageRequest(pressure_kpa=[20.0]))
    for k in range(3000):
        live.receive(PageRequest(parameters={"stiffness x": 1.0}, gravity=(0.0, -k / 1000)))
    assert not built
    job = live.job()
    made = live.prepare(job)
    live.advance(0.05)
    live.receive(PageRequest(gravity=(1.0, 1.0)))  # while that is built
    before = live.stepper.angle.copy()
    live.replace_model(job, made)
    np.testing.assert_array_equal(live.stepper.angle, before)
    assert live.frame()["kpa"] == [20.0]
    assert live.model.gravity[1] == -2.999
    live.build()
    live.build()
    assert live.model.gravity.tolist() == [1.0, 1.0]
    assert len(built) == 2


def test_a_loop_is_watched_by_its_log(model, tmp_path):
    columns = log_columns(3)
    log = LoopLog(tmp_path / "loop.csv", columns)
    for k in range(200):
        row = dict.fromkeys(columns, 0.0) | {"time_s": 0.01 * k, "pressure_pa": 1e3, "phi_3_rad": 0.1 + 1e-3 * k}
        log.write([row[c] for c in columns])
    log.close()
    watched = WatchedLoop(tmp_path / "loop.csv", model)
    watched.advance(0.016)
    early = watched.frame()
    for _ in range(200):
        watched.advance(0.016)
    late = watched.frame()
    assert early["t"] < late["t"] == pytest.approx(1.99)
    assert late["kpa"] == [1.0]
    assert "in control; target 0.00 mm, error 0.00 mm" in late["message"]
    turn = np.arctan2(-np.diff(late["body"], axis=0)[-1, 0], np.diff(late["body"], axis=0)[-1, 1])
    assert turn == pytest.approx(0.1 + 0.199, abs=1e-4)


def test_a_fault_that_did_not_vent_is_told_from_its_row_on(model, tmp_path):
    columns = log_columns(3)
    log = LoopLog(tmp_path / "loop.csv", columns)
    for k in range(100):
        if k == 60:
            log.remark("fault at 1.800 s: the quadratic program was not solved")
        log.write([(dict.fromkeys(columns, 0.0) | {"time_s": 0.03 * k})[c] for c in columns])
    log.close()
    watched, told = WatchedLoop(tmp_path / "loop.csv", model), {}
    for _ in range(200):
        watched.advance(0.016)
        frame = watched.frame()
        told[frame["t"]] = frame["message"]
    assert any(t > 1.8 for t in told)
    assert any(t < 1.8 for t in told)
    for t, sentence in told.items():
        assert ("in control, but fault at 1.800 s: the quadratic program" in sentence) == (t >= 1.8)
        assert sentence.startswith("in control")


def test_every_output_that_a_loop_brings_to_its_place_is_told(model, tmp_path):
    columns = log_columns(3, chambers=2, outputs=["tip_x", "angle_sum"])
    log = LoopLog(tmp_path / "loop.csv", columns)
    wanted = {"target_tip_x_m": 0.03, "error_tip_x_m": -2e-4, "target_angle_sum_rad": np.pi / 6, "pressure_2_pa": 4e3}
    for second in (0.0, 3.0):
        log.write([(dict.fromkeys(columns, 0.0) | wanted | {"time_s": second})[c] for c in columns])
    log.close()
    watched = WatchedLoop(tmp_path / "loop.csv", model)
    watched.advance(0.016)
    frame = watched.frame()
    assert "tip x target 30.00 mm, error -0.20 mm; angle sum target 30.00 deg, error 0.00 deg" in frame["message"]
    assert frame["kpa"] == [0.0, 4.0]


def test_a_touch_is_shown_where_it_is_and_a_fault_is_told(model, tmp_path):
    """Torques by hand: the moment of the force about each joint, of a body bent by 0.2 rad a link."""
    angle = np.array([0.2, 0.4, 0.6])
    joints = np.vstack([[0.0, 0.0], mechanics_of(model).tips(angle)])
    at, force = joints[2] + 0.5 * (joints[3] - joints[2]), np.array([0.4, 0.1])
    torque = [(at - p)[0] * force[1] - (at - p)[1] * force[0] for p in joints[:3]]
    columns = log_columns(3)
    log = LoopLog(tmp_path / "loop.csv", columns)
    for k in range(100):
        row = dict.fromkeys(columns, 0.0) | {"time_s": 0.03 * k, "vented": float(k > 90)}
        for i in range(3):
            row |= {f"phi_{i + 1}_rad": angle[i], f"torque_{i + 1}_nm": (k > 70) * torque[i],
                    f"torque_sd_{i + 1}_nm": 5e-4}
        if k == 91:
            log.remark("fault at 2.730 s: stale shape")
        log.write([row[c] for c in columns])
    log.close()
    watched = WatchedLoop(tmp_path / "loop.csv", model, 5e-3)
    frames = []
    for _ in range(100):
        watched.advance(0.016)
        frames.append(watched.frame())
    touches = [f.get("touch") for f in frames]
    assert touches[0] is None
    x, y, fx, fy = touches[-1]
    assert [x, y] == pytest.approx((1e3 * at).tolist(), abs=6)  # it is sought on the smooth body, not on the chain
    along = (joints[3] - joints[2]) / np.linalg.norm(joints[3] - joints[2])
    left = np.array([-along[1], along[0]])  # what runs along a nearly straight body cannot be seen
    assert left @ [fx, fy] == pytest.approx(left @ force, rel=0.2)
    assert "VENTED, fault at 2.730 s: stale shape" in frames[-1]["message"]
    assert read_log(tmp_path / "loop.csv").attrs["remarks"] == ["fault at 2.730 s: stale shape"]
    assert len(read_log(tmp_path / "loop.csv")) == 100
    blind = WatchedLoop(tmp_path / "loop.csv", model)
    blind.advance(0.016)
    assert blind.frame()["touch"] is None


def test_pressures_are_called_as_their_chambers(model):
    pytest.importorskip("starlette", reason="needs: pip install pliant[view]")
    from pliant.view.server import live_page

    pair = [Chamber(np.array([3e-6]), sign * np.ones(3), name=name) for name, sign in (("left", 1.0), ("right", -1.0))]
    both = PageContent(model.with_(chambers=tuple(pair)), (), {})
    assert '"chambers":["left","right"]' in live_page(both, Live(both))
    one = PageContent(model, (), {})
    assert '"chambers":["pressure"]' in live_page(one, Live(one))


def test_what_is_no_log_is_one_sentence(model, tmp_path):
    (tmp_path / "a.csv").write_text("time,x\n0,1\n")
    with pytest.raises(InputError, match="is not the log of a control loop"):
        WatchedLoop(tmp_path / "a.csv", model)
    with pytest.raises(InputError, match="cannot read the log"):
        WatchedLoop(tmp_path / "none.csv", model)
    LoopLog(tmp_path / "b.csv", log_columns(5)).close()
    with pytest.raises(InputError, match="has 5 angles, but the model has 3 joint angles"):
        WatchedLoop(tmp_path / "b.csv", model)
    LoopLog(tmp_path / "c.csv", log_columns(3)).close()
    with pytest.raises(InputError, match="length is fixed"):
        WatchedLoop(tmp_path / "c.csv", model.with_(extensions=(Extension(100.0),)))


@pytest.fixture(scope="module")
def served(model, tmp_path_factory):
    pytest.importorskip("uvicorn", reason="needs: pip install pliant[view]")
    from pliant.view.server import Server

    path = tmp_path_factory.mktemp("live") / "model.json"
    save_model(model, path)
    server = Server(page_content(path))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    parts = urlsplit(server.address)
    for _ in range(100):
        try:
            with closing(http.client.HTTPConnection(parts.hostname, parts.port, timeout=1)) as connection:
                connection.connect()
            break
        except OSError:
            time.sleep(0.05)
    yield server.address
    server.stop()
    thread.join(10)
    assert not thread.is_alive()


def answer(address, path=None, **headers):
    parts = urlsplit(address)
    with closing(http.client.HTTPConnection(parts.hostname, parts.port, timeout=5)) as connection:
        connection.request("GET", parts.path if path is None else path, headers=headers)
        found = connection.getresponse()
        found.read()
        return found


def test_only_who_knows_the_token_and_asks_this_host_is_let_in(served):
    good = answer(served)
    assert good.status == 200
    assert "default-src 'none'" in good.headers["Content-Security-Policy"]
    assert urlsplit(served).hostname == "127.0.0.1"
    for path in ("/", "/live", "/AAAAAAAAAAAAAAAAAAAAAA/", "/..%2f"):
        assert answer(served, path).status == 404
    assert answer(served, Host="evil.example").status == 404


@pytest.mark.parametrize(("origin", "token"), [("http://evil.example", True), (None, True), ("own", False)])
def test_another_page_cannot_open_the_socket(served, origin, token):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    parts = urlsplit(served)
    own = f"http://{parts.netloc}"
    path = f"{parts.path if token else '/moon/'}live"
    with pytest.raises(InvalidStatus):
        connect(f"ws://{parts.netloc}{path}", origin=own if origin == "own" else origin)


def test_the_address_is_listened_at_as_soon_as_it_is_known(content):
    from pliant.view.server import Server

    server = Server(content)
    parts = urlsplit(server.address)
    with socket.create_connection((parts.hostname, parts.port), timeout=5):
        pass
    server.socket.close()


@pytest.fixture
def slow_builds(monkeypatch):
    """Builds of models that wait until `released` is set; how many are inside now, and how many at once at most."""
    builds, own = SimpleNamespace(inside=0, most=0, released=threading.Event()), Live.prepare

    def prepare(live, job):
        builds.inside += 1
        builds.most = max(builds.most, builds.inside)
        try:
            assert builds.released.wait(60.0)
            return own(live, job)
        finally:
            builds.inside -= 1

    monkeypatch.setattr(Live, "prepare", prepare)
    yield builds
    builds.released.set()


def socket_of(address):
    parts = urlsplit(address)
    return {"uri": f"ws://{parts.netloc}{parts.path}live", "origin": f"http://{parts.netloc}"}


def pass_frames(page, seconds):
    began = json.loads(page.recv(timeout=30))["t"]
    while json.loads(page.recv(timeout=30))["t"] < began + seconds:
        pass


def test_a_page_that_asks_for_thousands_of_models_does_not_hold_up_another(served, slow_builds):
    """Builds run one at a time beside the frames: while a slow one runs, both pages get theirs."""
    from websockets.sync.client import connect

    with connect(**socket_of(served)) as one, connect(**socket_of(served)) as other:
        for k in range(3000):
            one.send(json.dumps({"gravity": [0.0, -k / 1000]}))
        other.send(json.dumps({"gravity": [1.0, 0.0]}))
        other.send(json.dumps({"pressure_kpa": [20.0]}))
        for page in (other, one):
            pass_frames(page, 0.2)
        assert slow_builds.inside == slow_builds.most == 1
        slow_builds.released.set()
        while json.loads(other.recv(timeout=30))["body"][-1][0] == 0.0:
            pass
    assert slow_builds.most == 1


def test_the_build_of_a_closed_page_ends_before_the_next_begins(served, slow_builds):
    from websockets.sync.client import connect

    with connect(**socket_of(served)) as other:
        with connect(**socket_of(served)) as one:
            one.send(json.dumps({"gravity": [0.0, -1.0]}))
            pass_frames(one, 0.2)
            assert slow_builds.inside == 1
        other.send(json.dumps({"gravity": [1.0, 0.0]}))
        pass_frames(other, 0.3)
        assert slow_builds.inside == 1
        slow_builds.released.set()
        while json.loads(other.recv(timeout=30))["body"][-1][0] == 0.0:
            pass
    assert slow_builds.most == 1


def test_nonsense_from_the_page_is_told_not_done(served):
    from websockets.sync.client import connect

    parts = urlsplit(served)
    with connect(f"ws://{parts.netloc}{parts.path}live", origin=f"http://{parts.netloc}") as page:
        for text in ("{", "[]", json.dumps({"pressure_kpa": [1e9]}), json.dumps({"moon": 1}), "x" * 9000):
            page.send(text)
            deadline = time.monotonic() + 5
            while not json.loads(page.recv(timeout=5))["message"]:
                assert time.monotonic() < deadline
        assert json.loads(page.recv(timeout=5))["kpa"] == [0.0]


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs: pip install pliant[browser]")
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    with sync_api.sync_playwright() as play:
        found = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


def until(page, true):
    """Wait until an expression holds; the page's own policy forbids what Playwright would wait with."""
    for _ in range(600):
        if page.evaluate(true):
            return
        page.wait_for_timeout(25)
    pytest.fail(f"never: {true}")


@pytest.mark.slow
def test_two_pages_follow_their_own_steps(browser, served, model):
    pages, asked, complaints = [], [], []
    for _ in range(2):
        page = browser.new_page(viewport={"width": 900, "height": 900}, reduced_motion="reduce")
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text))
        page.goto(served)
        until(page, "pliantLive.now && pliantLive.now.t > 0.1")
        pages.append(page)
    pages[0].evaluate("pliantLive.ask({pressure_kpa: [20]})")
    until(pages[0], "pliantLive.now.kpa[0] === 20 && pliantLive.now.t > 4")
    q = equilibrium(model, 20e3)
    tip = 1e3 * mechanics_of(model).tips(mechanics_of(model).coordinates(q))[-1]
    assert pages[0].evaluate("pliantLive.now.body.at(-1)") == pytest.approx(tip.tolist(), abs=0.5)
    assert pages[1].evaluate("pliantLive.now.kpa[0]") == 0
    rest = 1e3 * mechanics_of(model).tips(mechanics_of(model).coordinates(np.zeros(3)))[-1]
    assert pages[1].evaluate("pliantLive.now.body.at(-1)") == pytest.approx(rest.tolist(), abs=0.01)
    assert asked == [served, served]
    assert not complaints
    for page in pages:
        page.close()


@pytest.mark.slow
def test_the_body_is_dragged_and_ten_minutes_of_frames_do_not_grow(browser, served):
    page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    page.goto(served)
    until(page, "pliantLive.now && pliantLive.now.t > 0.1")
    box = page.locator("#body").bounding_box()
    x, y = page.evaluate("pliantLive.body.at(...pliantLive.now.body.at(-1))")
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x + 60, box["y"] + y + 20, steps=4)
    until(page, "Math.hypot(...pliantLive.now.force) > 0.01 && pliantLive.now.body.at(-1)[0] > 1")
    page.mouse.up()
    until(page, "Math.hypot(...pliantLive.now.force) === 0")
    kept = page.evaluate("""() => { const f = pliantLive.now;
        for (let k = 1; k <= 36000; k++) pliantLive.keep({ ...f, t: f.t + k / 60 });
        return [pliantLive.roll.t.length, ...pliantLive.roll.series.map((s) => s.length)]; }""")
    assert max(kept) <= 650
    page.close()


@pytest.mark.slow
def test_the_page_begins_with_a_pulse_until_a_person_asks_for_something(browser, served):
    page = browser.new_page(viewport={"width": 900, "height": 900})
    page.goto(served)
    until(page, "pliantLive.now && pliantLive.now.kpa[0] > 1")
    page.evaluate("pliantLive.ask({pressure_kpa: [7]})")
    until(page, "pliantLive.now.kpa[0] === 7")
    page.wait_for_timeout(2000)  # longer than the pulse
    assert page.evaluate("pliantLive.now.kpa[0]") == 7
    assert page.locator("#pressures input").get_attribute("step") == "1"
    page.close()


@pytest.mark.slow
def test_the_slider_shows_the_pressure_that_the_model_holds(browser, served):
    page = browser.new_page(viewport={"width": 900, "height": 900}, reduced_motion="reduce")
    page.goto(served)
    until(page, "pliantLive.now && pliantLive.now.t > 0.1")
    for kpa in (12, 0):
        page.evaluate(f"pliantLive.ask({{pressure_kpa: [{kpa}]}})")
        until(page, f"pliantLive.now.kpa[0] === {kpa}")
        shown = page.locator("#pressures output")
        assert shown.inner_text() == f"{kpa:.1f} kPa"
    page.close()
