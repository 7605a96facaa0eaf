"""The C takes the steps of `Stepper`: the same numbers, no warnings, under sanitizers, small enough for a chip."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from binding import COMPILER, STRICT, Arm
from target_models import EVERY_BRANCH, MODELS

import pliant
from pliant.actuators import chen2018
from pliant.compiler.trace import planar_workspace
from pliant.equations.laws import LAWS
from pliant.errors import InputError
from pliant.exporters.c99 import code
from pliant.exporters.provenance import Provenance
from pliant.mechanics import mechanics_of
from pliant.model import Chamber, Memory, Model, Valve
from pliant.simulation import Stepper, Trace, simulate
from pliant.simulation.time_step import AccuracyWarning, resolving_step

VALVES = [Valve(), Valve(rise_time=0.03, fall_time=0.05), Valve(rise_time=0.02, rise_rate=4e5, fall_rate=8e5)]
MEMORIES = [
    Memory(), Memory((0.1, 0.2), (0.1, 3.0)), Memory((), (), (0.2, 0.1), (0.01, 0.03)),
    Memory((0.1,), (0.5,), (0.1,), (0.02,), boucwen_share=0.2),
]


def random_model(rng: np.random.Generator, n: int, kind: int) -> Model:
    """Links, springs, laws, valves and memories as they come."""
    return Model(
        link_length=rng.uniform(0.02, 0.05, n), link_mass=rng.uniform(0.008, 0.02, n),
        stiffness=rng.uniform(0.8, 1.6, n), damping=rng.uniform(2e-3, 8e-3, n), rest_angle=rng.uniform(-0.2, 0.2, n),
        torque=[rng.uniform(4e-7, 8e-7), 1e-13][: 1 + kind % 2], joint_gain=rng.uniform(0.7, 1.2, n),
        stiffening=rng.uniform(-0.3, 0.1, n), mass_at=("rod", "tip")[kind % 2], tip_mass=0.004 * (kind % 3),
        tip_inertia=2e-6 * (kind % 3),
        cubic_stiffening=0.1 * (kind % 2), stiffening_bound=0.75 * (kind % 3 == 1),
        base_length=0.01 * (kind % 2), base_angle=rng.uniform(-0.5, 0.5),
        gravity=rng.uniform(-9, 9, 2), valve=VALVES[kind % 3], memory=MEMORIES[kind % 4],
        swell_share=0.2 * (kind in (2, 5)), swell_time=0.4, inflation_limit=9e5 * (kind in (3, 5)),
        inflation_jm=0.5 * (kind == 5), name="random",
    )


def held_pressures(rng: np.random.Generator, steps: int) -> np.ndarray:
    """A new level every fifth of a second."""
    return np.repeat(rng.uniform(0.0, 1.2e5, steps // 200 + 1), 200)[:steps]


@pytest.mark.parametrize("kind", range(6))
def test_the_steps_of_the_stepper(kind, rng, tmp_path):
    model = random_model(rng, (1, 5, 2, 5, 5, 2)[kind], kind)  # each number of links is compiled anew
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3)
    seen, wanted = np.empty((2, 20000, 2, model.n))
    for k, p in enumerate(held_pressures(rng, 20000)):
        assert arm.step(p) == 0
        stepper.step(p)
        seen[k], wanted[k] = (arm.angle, arm.rate), (stepper.angle, stepper.rate)
    worst = np.abs(seen - wanted).max(axis=(0, 2))
    assert max(worst[0], 1e-3 * worst[1]) < 1e-12


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_law_with_a_kernel(law, rng, tmp_path):
    levels = np.linspace(1e4, 1.2e5, 12)
    own = law.numbers(law.start(levels, 6e-7 * levels / (1.0 + levels / 1e5)))
    model = random_model(rng, 2, 1).with_(law=law.name, torque=own)
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3)
    for p in held_pressures(rng, 2000):
        arm.step(p)
        stepper.step(p)
    np.testing.assert_allclose(arm.angle, stepper.angle, atol=1e-12)


@pytest.mark.slow
def test_a_hundred_thousand_steps(model, rng, tmp_path):
    model = model.with_(valve=Valve(rise_time=0.03, fall_time=0.03))
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3)
    seen, wanted = np.empty((2, 100000, model.n))
    for k, p in enumerate(held_pressures(rng, 100000)):
        arm.step(p)
        stepper.step(p)
        seen[k], wanted[k] = arm.state[: model.n], stepper.angle
    assert np.abs(seen - wanted).max() < 1e-12


def test_several_chambers(rng, tmp_path):
    two = (
        Chamber(torque=[6e-7], joint_gain=[1.0, 1.0, 0.0, 0.0], valve=Valve(rise_time=0.02), name="near"),
        Chamber(torque=[-5e-7, -1e-13], joint_gain=[0.0, 0.5, 1.0, 1.0], swell_share=0.3, name="far"),
    )
    model = Model(
        link_length=[0.04], link_mass=[0.01], stiffness=[1.0, 0.9, 0.8, 0.7], damping=[5e-3], chambers=two,
        memory=MEMORIES[1],
    )
    arm, stepper = Arm(model, tmp_path), Stepper(model, 1e-3, np.zeros(2))
    for one, other in zip(held_pressures(rng, 4000), held_pressures(rng, 4000), strict=True):
        assert arm.step(one, other) == 0
        stepper.step(np.array([one, other]))
    assert np.abs(arm.angle - stepper.angle).max() < 1e-12
    assert np.abs(arm.angle).max() > 0.05


@pytest.mark.parametrize("dead", [0.002, 0.0037, 0.0004])
def test_dead_time_is_that_of_simulate(dead, rng, tmp_path):
    model = chen2018.model(valve=Valve(rise_time=0.01, fall_time=0.01, dead_time=dead))
    levels = np.repeat(rng.uniform(0.0, 1e5, 10), 20)
    edges = np.arange(levels.size + 1) * 1e-3
    trace = Trace(np.repeat(edges, 2)[1:-1], np.repeat(levels, 2))
    before = Trace(np.concatenate([[-1.0, 0.0], trace.time]), np.concatenate([[0.0, 0.0], trace.pressure]))
    run = simulate(model, before, times=edges, time_step=1e-3)
    arm = Arm(model, tmp_path)
    rows = []
    for p in levels:
        assert arm.step(p) == 0
        rows.append(mechanics_of(model).joint_angles(arm.angle))
    assert np.abs(rows).max() > 0.02
    assert np.abs(np.array(rows) - run.joint_angle.values[1:]).max() < 1e-11


def test_what_it_tells_of_its_state(model, tmp_path):
    model = model.with_(valve=Valve())
    arm = Arm(model, tmp_path)
    for _ in range(60):
        arm.step(8e4)
    q = mechanics_of(model).joint_angles(arm.angle)
    assert arm.ask("joint_angles", (model.n,))[0] == pytest.approx(q, abs=1e-14)
    assert arm.ask("tips", (model.n, 2))[0] == pytest.approx(mechanics_of(model).tips(arm.angle), abs=1e-14)
    places, angles = mechanics_of(model).stations(arm.angle)
    poses = arm.ask("stations", (len(model.points), 3))[0]
    assert poses[:, :2] == pytest.approx(places, abs=1e-14)
    assert poses[:, 2] == pytest.approx(angles, abs=1e-14)
    run = simulate(model, pliant.Pulse(0.0), times=[0.0, 1e-9], initial_angle=q,
                   initial_rate=np.diff(arm.rate, axis=-1, prepend=0.0))  # fmt: skip
    energies = [float(run[f"{k}_energy"][0]) for k in ("kinetic", "elastic", "gravitational")]
    assert arm.ask("energy", (3,))[0] == pytest.approx(energies, abs=1e-14)


@pytest.mark.parametrize(
    ("model", "memory"), [*zip(("paper", "demo", "creeping", "paper"), MEMORIES, strict=True)], indirect=["model"],
)
def test_linearise_is_that_of_pliant_at_rest(model, memory, tmp_path):
    model = model.with_(valve=Valve(), memory=memory)
    arm = Arm(model, tmp_path)
    linear, n = pliant.linearise(model, 0.0), model.n
    A, B = arm.ask("linearise", (2 * n, 2 * n), (2 * n, 1))
    assert pytest.approx(linear.A, rel=1e-9, abs=1e-7) == A
    assert pytest.approx(linear.B, rel=1e-9, abs=1e-12) == B


def test_linearise_in_motion_against_differences(tmp_path):
    model = chen2018.model(gravity=[2.0, -9.0], stiffening=-0.2)
    arm = Arm(model, tmp_path)
    for _ in range(30):
        arm.step(1e5)
    n = model.n
    A, _ = arm.ask("linearise", (2 * n, 2 * n), (2 * n, 1))
    from pliant.equations import motion

    def acceleration(phi, w):
        a = np.zeros(n)
        tau = model.joint_gain * model.torque_at(1e5)
        motion.acceleration(phi, w, tau, mechanics_of(model).body, mechanics_of(model).joints, planar_workspace(n), a)
        return a

    for k in range(n):
        d = 1e-6 * np.eye(n)[k]
        by_angle = (acceleration(arm.angle + d, arm.rate) - acceleration(arm.angle - d, arm.rate)) / 2e-6
        by_rate = (acceleration(arm.angle, arm.rate + d) - acceleration(arm.angle, arm.rate - d)) / 2e-6
        assert A[n:, k] == pytest.approx(by_angle, rel=1e-5, abs=1e-3)
        assert A[n:, n + k] == pytest.approx(by_rate, rel=1e-5, abs=1e-3)


def test_single_precision_follows_double(tmp_path):
    model = chen2018.model(memory=Memory((0.1,), (0.5,), (0.1,), (0.02,)))
    arm, stepper = Arm(model, tmp_path, precision="single"), Stepper(model, 1e-3)
    worst = 0.0
    for k in range(3000):
        p = 1e5 * (k // 500 % 2)
        assert arm.step(p) == 0
        stepper.step(p)
        worst = max(worst, np.abs(arm.angle - stepper.angle).max())
    assert worst < 1e-3


def test_a_step_that_fails_says_so(tmp_path):
    arm = Arm(chen2018.model(), tmp_path)
    assert arm.step(1e9) == -1
    arm.library.arm_init(arm.state)
    assert arm.step(1e5) == 0


@pytest.mark.parametrize("dead", [0.0, 0.0037])
@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_a_command_that_is_not_finite_is_refused_and_leaves_no_trace(dead, bad, tmp_path):
    """`Stepper` refuses it at once; here the state goes on as if it had not been given, in the dead time too."""
    model = chen2018.model(valve=Valve(rise_time=0.01, fall_time=0.01, dead_time=dead))
    arm, other = Arm(model, tmp_path), Arm(model, tmp_path)
    for k in range(40):
        if k % 3 == 0:
            before = bytes(arm.state)
            assert arm.step(bad) == -2
            assert bytes(arm.state) == before
        assert (arm.step(8e4), other.step(8e4)) == (0, 0)
    assert bytes(arm.state) == bytes(other.state)
    assert np.abs(arm.angle).max() > 0.01


CPP = """
#include "finger.h"
#include "finger.h"
extern "C" int run(double *tip)
{
    finger_parameters p; finger_state s; finger_real pressure[FINGER_CHAMBERS] = {5e4}, tips[FINGER_LINKS][2];
    finger_defaults(&p); finger_init(&s);
    for (int k = 0; k < 100; k++) if (finger_step(&s, &p, pressure) < 0) return 1;
    finger_tips(&s, &p, tips);
    *tip = tips[FINGER_LINKS - 1][0];
    return 0;
}
"""


def test_a_program_in_cpp_links_with_it(tmp_path):
    compiler = shutil.which("c++") or shutil.which("g++")
    if COMPILER is None or compiler is None:
        pytest.skip("no C++ compiler (c++ or g++) is on the path")
    pliant.export(chen2018.model(), "c99", tmp_path / "finger.c")
    (tmp_path / "main.cpp").write_text(CPP, encoding="utf-8")
    subprocess.run([COMPILER, *STRICT, "-fPIC", "-c", "finger.c", "-o", "finger.o"], cwd=tmp_path, check=True)
    flags = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fPIC", "-shared", "-Wl,-z,defs"]
    subprocess.run([compiler, *flags, "main.cpp", "finger.o", "-o", "run.so", "-lm"], cwd=tmp_path, check=True)
    tip = ctypes.c_double()
    assert ctypes.CDLL(str(tmp_path / "run.so")).run(ctypes.byref(tip)) == 0
    stepper = Stepper(chen2018.model(), 1e-3)
    for _ in range(100):
        stepper.step(5e4)
    assert tip.value == pytest.approx(stepper.tips()[-1, 0], abs=1e-12)


MAIN = """
#include <stdio.h>
#include "arm.h"
int main(void)
{
    arm_state s; arm_parameters p; arm_real tip[ARM_LINKS][2], q[ARM_LINKS], e[3], pose[ARM_STATIONS][3];
    arm_real A[2 * ARM_LINKS][2 * ARM_LINKS], B[2 * ARM_LINKS][ARM_CHAMBERS], u[ARM_CHAMBERS] = {1e5};
    arm_defaults(&p); arm_init(&s);
    for (int k = 0; k < 2000; k++) { if (arm_step(&s, &p, u) < 0) return 1; u[0] = k % 300 < 150 ? 1e5 : 0; }
    arm_tips(&s, &p, tip); arm_joint_angles(&s, &p, q); arm_energy(&s, &p, e); arm_stations(&s, &p, pose);
    arm_linearise(&s, &p, A, B);
    printf("%.17g", (double)tip[ARM_LINKS - 1][0]);
    return 0;
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("model", [*MODELS, "flat_longer"], indirect=True)
def test_sanitizers_find_nothing(model, tmp_path):
    program = MAIN
    if model.extensions:  # without a function that linearises, and with strains behind the angles
        model = model.with_(memory=EVERY_BRANCH)
        program = program.replace("arm_linearise(&s, &p, A, B)", "(void)A; (void)B")
        program = program.replace("q[ARM_LINKS]", "q[ARM_LINKS + 2]").replace("1e5", "6e4")
    arm = Arm(model, tmp_path)
    (tmp_path / "main.c").write_text(program, encoding="utf-8")
    flags = ["-fsanitize=address,undefined,float-divide-by-zero", "-fno-sanitize-recover=all", "-g"]
    files = [str(tmp_path / "main.c"), str(tmp_path / "arm.c")]
    built = subprocess.run([COMPILER, *STRICT, *flags, *files, "-o", str(tmp_path / "main"), "-lm"],
                           capture_output=True, text=True, check=False)  # fmt: skip
    if "cannot find" in built.stderr:
        pytest.skip("the sanitizers' libraries are not installed beside the compiler")
    assert built.returncode == 0, built.stderr[:2000]
    done = subprocess.run([str(tmp_path / "main")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr[:2000]
    high = 6e4 if model.extensions else 1e5
    levels = [high, *(high if k % 300 < 150 else 0.0 for k in range(1999))]
    for p in levels:
        assert arm.step(p, *[0.0] * (model.actuation.count - 1)) == 0
    assert float(done.stdout) == pytest.approx(arm.ask("tips", (model.n, 2))[0][-1, 0], abs=1e-12)


def test_a_microcontroller(tmp_path):
    compiler = shutil.which("arm-none-eabi-gcc")
    if compiler is None:
        pytest.skip("no arm-none-eabi-gcc: the cross-compile is not tried (Debian: gcc-arm-none-eabi)")
    origin = Provenance(chen2018.model(), "c99", "x")
    made = code(chen2018.model(), origin, time_step=1e-3, precision="single", pressure=0.0,
                prefix="arm")  # fmt: skip
    (tmp_path / "arm.h").write_text(made.header, encoding="utf-8")
    (tmp_path / "arm.c").write_text(made.source, encoding="utf-8")
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-Os"]
    done = subprocess.run([compiler, *core, *STRICT, "-c", str(tmp_path / "arm.c"), "-o", str(tmp_path / "arm.o")],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr[:2000]
    tool = shutil.which("arm-none-eabi-size")
    size = subprocess.run([tool, str(tmp_path / "arm.o")], capture_output=True, text=True, check=True).stdout
    text, data, bss = (int(v) for v in size.splitlines()[1].split()[:3])
    assert text < 65536, "the code of five links fits into 64 kB of flash"
    assert (data, bss) == (0, 0)


def test_no_memory_no_globals():
    origin = Provenance(chen2018.model(), "c99", "x")
    made = code(chen2018.model(), origin, time_step=1e-3, precision="double", pressure=0.0,
                prefix="arm")  # fmt: skip
    assert "malloc" not in made.source
    outside = [line for line in made.source.splitlines() if line and line[0] not in " {}/*#"]
    assert all(line.startswith(("static void ", "static int ", "void ", "int ")) for line in outside)


def test_bad_input(tmp_path):
    model = chen2018.model()
    with pytest.raises(InputError, match="precision must be double or single, got 'half'"):
        pliant.export(model, "c99", tmp_path / "a.c", precision="half")
    with pytest.raises(InputError, match="at most 24 links, got 30"):
        pliant.export(chen2018.model(links=30), "c99", tmp_path / "a.c")
    with pytest.raises(InputError, match="second-order valve: not expressible in c99"):
        pliant.export(chen2018.model(valve=Valve(natural_frequency=9.0)), "c99", tmp_path / "a.c")
    with pytest.raises(InputError):
        pliant.export(model, "c99", tmp_path / "a.c", time_step=1.0)
    assert not list(tmp_path.iterdir())
    for name in ('a"b.c', "a\nb.c", "a/*b.c".replace("/", "?"), "é.c"):
        with pytest.raises(InputError, match="use only letters, digits"):
            pliant.export(model, "c99", tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_two_files_that_find_each_other(tmp_path):
    done = pliant.export(chen2018.model(), "c99", tmp_path / "finger.c")
    assert [f.name for f in done.files] == ["finger.c", "finger.h"]
    if COMPILER:
        subprocess.run([COMPILER, *STRICT, "-c", str(done.files[0]), "-o", str(tmp_path / "finger.o")], check=True)


def test_an_export_without_a_step_takes_what_the_model_needs():
    ringing = chen2018.model(links=2, damping=1e-5)
    options = {"precision": "double", "pressure": 0.0, "prefix": "arm"}
    step = resolving_step(ringing)
    assert step < 1e-3
    origin = Provenance(ringing, "c99", "x")
    assert f"#define ARM_STEP {step!r} /* s */" in code(ringing, origin, time_step=0.0, **options).header
    with pytest.warns(AccuracyWarning, match="a step of 5 ms is too long for the mode of"):
        code(ringing, origin, time_step=5e-3, **options)
