"""The body in space on report and live page: cameras of the canvas, run by Node; the model behind a hand that pulls."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracles.packed_page import unpack

import pliant.view
from pliant.errors import InputError
from pliant.identification import Experiment
from pliant.loop.log import LoopLog
from pliant.loop.run import log_columns
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Space, Tendon, chain_model
from pliant.simulation import Trace, equilibrium
from pliant.validation.outcome import RecordOutcome
from pliant.view.data import Pack, modelled_of
from pliant.view.live import Live, PageContent, PageRequest, Pull, sliders_of
from pliant.view.report import report_page
from pliant.view.server import BARE_KPA, WatchedLoop, live_page, ranges

NODE = shutil.which("node")
FIGURES = Path(pliant.view.__file__).with_name("assets") / "figures.js"
PAGE = """
const calls = [], ctx = new Proxy({}, { get: (_, name) => (...a) => calls.push([name, ...a]), set: () => true });
const classes = new Set();
globalThis.document = { documentElement: { classList: { contains: (c) => classes.has(c) } } };
globalThis.getComputedStyle = () => ({ getPropertyValue: () => "#000000" });
globalThis.ResizeObserver = class { observe() {} };
globalThis.devicePixelRatio = 1;
const canvas = { clientWidth: 600, clientHeight: 200, getContext: () => ctx };
"""
SCRIPT = """
const body = new Pliant.Body(canvas), out = {}, p = [10, 20, 30];
let seen = [];
body.show({ low: [-50, -50, 0], high: [50, 50, 100], paint: (b) => seen.push([...b.flat(p), b.k]) });
out.turned = body.flat(p);
out.beside = body.beside(p, [5, -7]);
out.there = body.flat(out.beside);
const { right, up } = body.camera;
out.basis = [right, up];
body.turn(30, 1e6);
out.above = body.turned.height;
seen = [];
classes.add("print");
body.draw();
out.print = seen;
out.letters = calls.filter((c) => c[0] === "fillText").map((c) => c[1]).filter((t) => t.endsWith("(mm)"));
classes.clear();
body.show({ low: [-50, 0], high: [50, 100], paint: () => {} });
out.plane = [body.inSpace, body.flat([3, 4]), body.beside([3, 4], [1, 2])];
console.log(JSON.stringify(out));
"""


@pytest.fixture(scope="module")
def arm():
    chambers = [Chamber(torque=(2e-6,), joint_gain=np.sin(a), cross_gain=-np.cos(a), name=f"c{k}")
                for k, a in enumerate(np.radians([90, 210, 330]))]  # fmt: skip
    return chain_model(length=0.3, mass=0.1, links=2, joint_placement="midsegment", stiffness=0.5, damping=6e-2,
                       gravity=(0, 0, -9.81), chambers=chambers, space=Space())  # fmt: skip


def test_the_canvas_turns_and_prints_three_views(tmp_path):
    if NODE is None:
        pytest.skip("no Node on this machine")
    script = tmp_path / "page.js"
    script.write_text(PAGE + FIGURES.read_text(encoding="utf-8") + SCRIPT, encoding="utf-8")
    done = subprocess.run([NODE, script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout)
    right, up = map(np.array, found["basis"])
    towards = np.cross(right, up)
    np.testing.assert_allclose([right @ right, up @ up, right @ up, right[2]], [1, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found["turned"], [right @ [10, 20, 30], up @ [10, 20, 30]])
    np.testing.assert_allclose(found["there"], [5, -7], atol=1e-12)
    assert towards @ found["beside"] == pytest.approx(towards @ [10, 20, 30])  # as far from the viewer
    assert found["above"] == pytest.approx(np.pi / 2)
    np.testing.assert_allclose([view[:2] for view in found["print"]], [[10, 30], [20, 30], [10, 20]], atol=1e-9)
    assert len({round(view[2], 9) for view in found["print"]}) == 1  # one scale
    assert found["letters"] == ["z (mm)", "x (mm)", "z (mm)", "y (mm)", "y (mm)", "x (mm)"]
    assert found["plane"] == [False, [3, 4], [1, 2]]


def test_a_hand_in_space_ends_in_the_equilibrium_of_its_force(arm):
    live = Live(PageContent(arm, sliders_of(arm), {}))
    live.receive(PageRequest(pull=Pull(link=1, share=1.0, x_mm=120.0, y_mm=90.0, z_mm=200.0)))
    for _ in range(15):
        live.advance(0.1)
    assert np.linalg.norm(live.force) > 0.02
    q = equilibrium(arm, np.zeros(3), live.force)
    np.testing.assert_allclose(live.stepper.angle, q, atol=2e-3)
    live.receive(PageRequest(gravity=[0.0, 0.0, 5.0], pull=None))
    live.build()
    assert live.model.gravity.tolist() == [0.0, 0.0, 5.0]
    live.receive(PageRequest(gravity=[0.0, 1.0]))
    live.build()
    assert "gravity must be 3 numbers" in live.frame()["message"]
    assert np.shape(live.frame()["body"]) == (4, 3)


def test_tendons_are_moved_in_their_units(arm):
    cords = [Tendon.at_azimuth(0.0, np.ones(2), driven_by="displacement", lever=8e-3, line_stiffness=2e3, name="cord"),
             Tendon.at_azimuth(1.0, np.ones(2), lever=8e-3, name="pull"), replace(arm.chambers[0], name="bellows")]
    model = arm.with_(chambers=cords)
    live = Live(PageContent(model, sliders_of(model), {}))
    live.receive(PageRequest(pressure_kpa=[-2.0, 1.5, -20.0]))
    assert live.command.tolist() == [-2e-3, 1.5, 0.0]  # a cord is let out, a chamber is not sucked empty
    live.receive(PageRequest(pressure_kpa=[2.0, 1.5, 20.0]))
    live.advance(0.01)
    assert live.frame()["kpa"] == [2.0, 1.5, 20.0]
    data = json.loads(live_page(live.content, live).split('id="data">')[1].split("</script>")[0])
    assert data["units"] == ["mm", "N", "kPa"]
    assert data["lowest"][1:] == [0.0, 0.0]
    assert data["lowest"][0] == -data["highest"][0] < 0
    assert len(data["gravity"]) == 3
    time = np.linspace(0.0, 1.0, 12)
    drawn = {"cord": Trace(time, 5e-3 * time), "bellows": Trace(time, 3e4 * time)}
    for names, most in (("cord", BARE_KPA), ("cord bellows", 37.5)):
        seen = Experiment("r", time, time[:, None, None] * np.ones((1, 1, 3)), ("tip",), "trace",
                          drives={name: drawn[name] for name in names.split()})  # fmt: skip
        assert ranges(PageContent(model, (), {"r": seen}), 3)["highest"][2] == pytest.approx(most)


def test_a_loop_of_tendons_in_space_is_watched_by_its_log(arm, tmp_path):
    """Inputs in mm, of columns in m; joints where the coordinates of the log place them."""
    cords = [Tendon.at_azimuth(k, np.ones(2), driven_by="displacement", lever=8e-3, line_stiffness=2e3, name=f"c{k}")
             for k in range(2)]  # fmt: skip
    model = arm.with_(chambers=cords)
    columns = log_columns(model.size, 2, ("tip_x", "tip_z"), "m")
    log = LoopLog(tmp_path / "loop.csv", columns)
    x = np.array([0.1, -0.2, 0.3, 0.05])
    values = {"displacement_1_m": 1e-3, "displacement_2_m": -2e-3, "command_2_m": -2.5e-3, "target_tip_z_m": 0.01,
              **{f"phi_{k + 1}_rad": float(v) for k, v in enumerate(x)}}  # fmt: skip
    for second in (0.0, 3.0):
        log.write([(dict.fromkeys(columns, 0.0) | values | {"time_s": second})[c] for c in columns])
    log.close()
    watched = WatchedLoop(tmp_path / "loop.csv", model, touch=0.01)
    assert np.shape(watched.frame()["body"]) == (4, 3)
    watched.advance(0.016)
    frame = watched.frame()
    assert (frame["kpa"], frame["command"], frame["touch"]) == ([1.0, -2.0], [0.0, -2.5], None)
    np.testing.assert_allclose(frame["body"], 1e3 * mechanics_of(model).nodes(x), atol=1e-3)
    assert "tip z target 10.00 mm" in frame["message"]
    data = json.loads(live_page(PageContent(model, (), {}, log=tmp_path / "loop.csv"), watched)
                      .split('id="data">')[1].split("</script>")[0])  # fmt: skip
    assert (data["units"], data["chambers"]) == (["mm", "mm"], ["c0", "c1"])
    with pytest.raises(InputError, match="has 4 angles, but the model has 2 joint angles about x and 2 joint"):
        WatchedLoop(tmp_path / "loop.csv", arm.with_(space=Space(twist_ratio=0.8, radius=0.01)))


@pytest.fixture(scope="module")
def record(arm):
    time = np.arange(30) / 30
    x = np.stack([0.1 * np.sin(time), 0.2 * np.cos(time), 0.05 * time, 0.1 * time], axis=-1)
    chain = mechanics_of(arm)
    exp = Experiment("round", time, chain.tips(x), ("a", "b"), "release")
    return RecordOutcome("round", "train", exp, chain.tips(1.1 * x), np.zeros((30, 3)), {}, body=chain.nodes(x))


def test_a_record_in_space_comes_back_from_the_page(record):
    pack = Pack()
    note = modelled_of(record, 1, pack)
    text = pack.text()
    np.testing.assert_allclose(unpack(text, note["body"]), 1e3 * record.body, atol=0.01)
    assert unpack(text, note["position"]).shape == (30, 2, 3)
    assert unpack(text, note["correlation"]).shape[1] == 3


def test_the_report_has_a_plot_for_each_axis_and_says_how_to_turn_the_body(arm, record, outcome):
    metrics = outcome.fits[0].records[0].metrics
    fit = replace(outcome.fits[0], records=(replace(record, metrics=metrics),))
    text = report_page(replace(outcome, model=arm, fits=(fit,), shape=None, forecasts=(), clocks={}))
    data = json.loads(text.split('id="data">')[1].split("</script>")[0])
    assert data["axes"] == ["x", "y", "z"]
    for axis in "xyz":
        assert f'id="plot-{axis}"' in text
        assert f'<th scope="col">{axis} measured</th>' in text
    assert "drag the body to turn it" in text
    assert "x solid, y dashed, z dotted" in text
