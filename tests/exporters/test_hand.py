"""The example hand: it holds under pressure, its finger presses as it should, its crawler goes where it is told."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from target_models import demo

import pliant
from pliant.mechanics import mechanics_of
from pliant.model import Station
from pliant.simulation import state
from pliant.simulation.forces import PointForce, link_loads

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'pliant[bench]'")
FOLDER = Path(__file__).parents[2] / "examples" / "hand"
ERRORS = {"stiffness": 0.03, "damping": 2e-4}


@pytest.fixture(scope="module", autouse=True)
def scripts():
    """The folder of the scripts on the path, as when one of them runs."""
    sys.path.insert(0, str(FOLDER))
    yield
    sys.path.remove(str(FOLDER))


def test_three_bodies_hold_a_ball_under_pressure_alone():
    import grasp
    from hand import bodies

    fingers = bodies(demo(), ERRORS, 3)
    assert len({float(f.model.stiffness[0]) for f in fingers}) == 3
    held = grasp.grasp(fingers, end=grasp.SHAKEN + 0.5)
    assert held.dropped < 2e-3
    assert np.abs(held.shake).max() > 4.0
    weak = grasp.grasp(fingers, level=1e4, end=grasp.GONE + 0.5)
    released = grasp.grasp(fingers, letting_go=1.1, end=1.5)
    assert min(weak.dropped, released.dropped) > 0.05


def test_the_force_on_the_post_is_that_of_the_laboratory():
    """An independent rod against the same post; the model was identified without any contact."""
    import post

    model = pliant.load_model(post.MODELS / "model_a.json")
    true, made = post.laboratory("a", 1.3), post.in_mujoco(model, 1.3)[0]
    assert true.held > 0.5
    assert made.held == pytest.approx(true.held, rel=0.1)


def test_the_post_holds_the_finger_where_statics_has_it():
    """The forces of MuJoCo's contacts, put on pliant's chain at rest, give MuJoCo's shape."""
    import mujoco
    import post

    model, forces = demo(), []
    made, _, d = post.in_mujoco(model, 1.6)
    shape = d.qpos[: model.n]
    tips = mechanics_of(model).tips(mechanics_of(model).coordinates(shape))
    for k in range(d.ncon):
        link = int(d.model.geom_bodyid[d.contact[k].geom].max()) - 2  # behind the world and the base
        way = tips[link] - tips[link - 1]
        along, at = way / np.linalg.norm(way), d.contact[k].pos[:2] - tips[link - 1]
        six = np.zeros(6)
        mujoco.mj_contactForce(d.model, d, k, six)
        push = six[0] * d.contact[k].frame[:2] * np.sign(d.contact[k].frame[:2] @ made.force[-1])
        across = along[0] * at[1] - along[1] * at[0]
        forces.append(PointForce(np.zeros(1), push[None], Station("contact", link, float(along @ at), float(across))))
    load = link_loads(model, forces, np.stack([f.force for f in forces], axis=1))[0]
    assert forces
    assert state.equilibrium(model, post.LEVEL, link_load=load) == pytest.approx(shape, abs=1e-3)
    assert np.abs(state.equilibrium(model, post.LEVEL) - shape).max() > 0.02


def test_the_crawler_goes_where_its_wave_goes():
    import crawler
    from hand import bodies

    rear, front = bodies(demo(), ERRORS, 2)
    assert crawler.crawl(rear, front, "forward", 1, time_step=5e-4).way > 5e-3
    assert crawler.crawl(rear, front, "backward", 1, time_step=5e-4).way < -5e-3


@pytest.mark.slow
def test_the_crawlers_step_is_short_enough(tmp_path):
    """A gait whose way is a small difference: half the step changes it by little, and a step of 1 ms by far more."""
    import crawler
    from hand import bodies, fit_of

    assert invoke("demo", "-o", tmp_path / "demo", "--quiet").exit_code == 0
    fit = fit_of(tmp_path / "demo", "softening")
    rear, front = bodies(fit.model, fit, 2)
    long, chosen, half = (
        crawler.crawl(rear, front, "together", 1, time_step=h).way for h in (1e-3, crawler.STEP, 0.5 * crawler.STEP)
    )
    assert abs(chosen - half) < 0.3e-3
    assert abs(long - half) > 3e-3


def test_a_film_moves(tmp_path):
    import post
    from PIL import Image

    _, camera, _ = post.in_mujoco(demo(), 0.3)
    camera.film(tmp_path / "post.gif", post.LIMITS, height=2.0)
    with Image.open(tmp_path / "post.gif") as film:
        assert film.n_frames == 8
        first = np.array(film.convert("L"))
        film.seek(7)
        assert np.abs(np.array(film.convert("L")).astype(int) - first).max() > 100
