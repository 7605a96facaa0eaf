"""Kernels on disk: found again by every process, never stale, compiled once however many ask at once."""

from __future__ import annotations

import gc
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import types

import pliant
from pliant.compiler import cache, choose, kernel_cache, simd, twin
from pliant.compiler.duals import CARRYING
from pliant.compiler.twin import compiled_twin, fingerprint, reached, stable
from pliant.equations import extension, linearised, motion, spatial, tendon
from pliant.estimation import kalman_loops
from pliant.identification import follow_loops
from pliant.simulation import march_loops
from pliant.testbed import stepping_loops

SOURCE = Path(pliant.__file__).parent
PROBE = """
import json
import numpy as np
import pliant
from oracles.chains import paper_chain, workspace
from pliant.compiler.choose import twin
from pliant.equations.energy import add_step_work
chain = paper_chain()
total = np.zeros(2)
compiled = twin(add_step_work)
compiled(np.arange(5.0), 1e-3, chain.drive(0.08), chain.joints(), workspace(5), total)
count = lambda c: sum(c.values())
print(json.dumps({
    "hits": count(compiled.stats.cache_hits), "misses": count(compiled.stats.cache_misses),
    "value": total.tolist(),
    "name": compiled.py_func.__qualname__, "file": pliant.__file__,
}))
"""


def start(folder, kernels):
    """PROBE on the copy of the package in `folder`, in a process of its own, with its kernels in another folder."""
    paths = [str(folder), str(Path(__file__).parents[1])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(kernels)}
    environment["PYTHONHASHSEED"] = str(len(list(Path(folder).parent.iterdir())))
    return subprocess.Popen(
        [sys.executable, "-c", PROBE], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def probe(folder, kernels):
    running = start(folder, kernels)
    out, err = running.communicate()
    assert running.returncode == 0, err
    found = json.loads(out)
    assert Path(found["file"]).is_relative_to(folder)
    return found


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder with a copy of the package, and the kernels that a first process compiled there; what it found."""
    place = tmp_path_factory.mktemp("compiled")
    shutil.copytree(SOURCE, place / "one" / "pliant", ignore=shutil.ignore_patterns("__pycache__"))
    return place, probe(place / "one", place / "kernels")


@pytest.fixture
def first(compiled):
    return compiled[1]


@pytest.fixture
def package(compiled, tmp_path):
    """A copy of both for one test to edit, bytecode and all, with the kernels in `tmp_path` / "kernels"."""
    shutil.copytree(compiled[0], tmp_path, dirs_exist_ok=True)
    return tmp_path / "one"


def replace(package, file, old, new):
    path = package / "pliant" / "equations" / file
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.mark.slow
def test_one_kernel_is_found_again_and_an_edit_in_a_callee_is_seen(first, package, tmp_path):
    kernels = tmp_path / "kernels"
    assert (first["hits"], first["misses"]) == (0, 1)
    again = probe(package, kernels)
    assert (again["hits"], again["misses"], again["value"]) == (1, 0, first["value"])
    kept = [f for f in kernels.rglob("*.nb[ci]") if ".add_step_work_" in f.name]
    assert len(kept) == 2
    for file in kept:
        os.utime(file, (0.0, 0.0))
    replace(package, "energy.py", "torque[i] * (w[i] - before)", "2.0 * torque[i] * (w[i] - before)")
    edited = probe(package, kernels)
    assert (edited["hits"], edited["misses"]) == (0, 1)
    assert edited["value"] == pytest.approx([2 * first["value"][0], first["value"][1]], rel=1e-12)
    assert not any(file.exists() for file in kept), "nobody will look for it"


@pytest.mark.slow
@pytest.mark.parametrize("damage", [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:-1] + bytes([b[-1] ^ 1])])
def test_damage_to_every_file_costs_a_compilation_and_a_line(first, package, tmp_path, damage):
    files = list((tmp_path / "kernels").rglob("*.nb[ci]"))
    assert len(files) >= 2
    for file in files:
        file.write_bytes(damage(file.read_bytes()))
    running = start(package, tmp_path / "kernels")
    out, err = running.communicate()
    assert running.returncode == 0, err
    found = json.loads(out)
    assert (found["hits"], found["misses"], found["value"]) == (0, 1, first["value"])
    assert err.count("are removed and compiled again") == 1
    assert probe(package, tmp_path / "kernels")["hits"] == 1


@pytest.mark.slow
def test_another_checkout_and_another_comment_find_what_was_compiled(package, tmp_path):
    other = shutil.copytree(package, tmp_path / "two")
    path = other / "pliant" / "equations" / "energy.py"
    path.write_text("# a remark\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    found = probe(other, tmp_path / "kernels")
    assert (found["hits"], found["misses"]) == (1, 0)


@pytest.mark.slow
def test_an_edit_that_no_kernel_reads_is_not_seen_and_one_of_its_text_is(package, tmp_path):
    replace(package, "energy.py", "def add_step_work(", "LATER = 1\n\n\ndef add_step_work(")
    assert probe(package, tmp_path / "kernels")["hits"] == 1, "a name that no kernel reads"
    path = package / "pliant" / "equations" / "energy.py"
    text = path.read_text(encoding="utf-8")
    at = text.index("    for i in range", text.index("def add_step_work("))
    path.write_text(text[:at] + "    count = 1\n" + text[at:], encoding="utf-8")
    found = probe(package, tmp_path / "kernels")
    assert (found["hits"], found["misses"]) == (0, 1)


@pytest.mark.slow
def test_fields_that_trade_places_are_seen(first, package, tmp_path):
    """Numba compiles the places of a NamedTuple's fields: two that trade places must not meet an old twin."""
    symbols = package / "pliant" / "equations" / "symbols.py"
    lines = symbols.read_text(encoding="utf-8").splitlines()
    spring = next(i for i, line in enumerate(lines) if line.startswith("    K:"))
    damper = next(i for i, line in enumerate(lines) if line.startswith("    D:"))
    lines[spring], lines[damper] = lines[damper], lines[spring]
    symbols.write_text("\n".join(lines), encoding="utf-8")
    after = probe(package, tmp_path / "kernels")
    assert (after["hits"], after["misses"], after["value"]) == (0, 1, first["value"])


@pytest.mark.slow
def test_processes_that_start_together_compile_once(package, tmp_path):
    running = [start(package, tmp_path / "none yet") for _ in range(3)]
    found = [json.loads(p.communicate()[0]) for p in running]
    assert [p.returncode for p in running] == [0, 0, 0]
    assert sorted(f["misses"] for f in found) == [0, 0, 1]
    assert found[0]["value"][1] > 0.0
    assert all(f["value"] == found[0]["value"] for f in found)


def test_a_process_that_hangs_holds_nobody_up(tmp_path):
    file = tmp_path / "kernel.lock"
    with cache.alone(file) as first, cache.alone(file, wait=0.05) as second:
        assert (first, second) == (True, False)
    with cache.alone(file, wait=0.0) as third:
        assert third


def test_where_nothing_can_be_written_numba_chooses(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setattr(kernel_cache.config, "CACHE_DIR", str(tmp_path / "file"))
    assert kernel_cache.folder.__wrapped__() is None


def test_everything_that_machine_code_comes_from_is_in_its_digest():
    makers = {"trace.py", "llvm.py", "trig.py", "simd.py", "__init__.py", "dual_numbers.py", "duals.py"}
    assert {Path(f).name for f in choose.SOURCES} == makers
    assert all(Path(f).is_file() for f in choose.SOURCES)
    digests = {fingerprint(motion.step), fingerprint(motion.step, simd.__file__), fingerprint(motion.acceleration)}
    assert len(digests) == 3


def test_replacements_and_what_they_call_are_in_the_digest():
    """Two replacements differ by what they call: the names of their compiled forms, and of their callers, differ."""

    def name(step):
        made = {motion.step: choose.twin(step)}
        jacobian = compiled_twin(linearised.step_jacobian, "t", made.__getitem__, (), replaced=made, names=CARRYING)
        return jacobian.py_func.__qualname__

    assert name(spatial.step) == name(spatial.step) != name(tendon.step)


def test_a_twin_that_takes_duals_too_has_their_rules_in_its_digest():
    shared = choose.made(motion.step, "_duals", choose.Family(lines=False, lengthens=True))
    assert shared is choose.twin(extension.step)
    assert shared.__qualname__.endswith(fingerprint(extension.step, twin.__file__, *choose.SOURCES))


def test_constants_and_expressions_are_in_the_digest(monkeypatch):
    before = fingerprint(stepping_loops.march)
    monkeypatch.setattr(stepping_loops, "TOLERANCE", 2.0 * stepping_loops.TOLERANCE)
    assert fingerprint(stepping_loops.march) != before


@pytest.mark.parametrize("value", [[1.0], {"a": 1}, np.zeros(2), pliant, object()])
def test_what_may_change_is_refused(value):
    with pytest.raises(TypeError, match="may use global numbers, tuples, functions and records"):
        stable(value)


def test_sets_are_written_alike_in_every_process():
    assert stable(frozenset({"b", "a"})) == stable(frozenset({"a", "b"})) == ("frozenset", ["\"'a'\"", "\"'b'\""])


def test_a_kernel_has_one_twin_whoever_calls_it():
    """The marches of one model share what they call: no callee is compiled for each of them again."""
    entries = (march_loops.march, march_loops.hold, kalman_loops.predict_span, linearised.step_jacobian)
    for make, links in ((choose.twin, 5), (choose.lane_twin, 5), (choose.twin, 20)):
        made = {}
        for entry in entries:
            for kernel in reached(entry):
                made.setdefault((kernel.__module__, kernel.__qualname__), set()).add(id(make(kernel, links)))
        assert all(len(twins) == 1 for twins in made.values())


def dual_form(kernel, links, segments=0, turns=1, tendons=0, laws=0):
    return choose.made(kernel, "_duals", choose.family_of(links, segments, turns, tendons, laws, "_duals"))


def test_kernels_are_compiled_once_for_all_sizes():
    """What depends only on whether a chain lengthens or moves in space has one compiled form, and so has a march."""
    sizes = {"plane": [(2,), (5,)], "lengthens": [(2, 1), (5, 2, 1, 0, 1)], "space": [(2, 0, 2), (3, 2, 3)]}
    observers = {}
    for kind, chains in sizes.items():
        for make in (choose.twin, dual_form):
            made = [make(follow_loops.look_before, *[*chain, *(0, 1, 0, 0)[len(chain) - 1 :]]) for chain in chains]
            assert made[0] is made[1], (kind, make)
            observers[kind, make] = made[0]
            marches = [make(march_loops.march, *[*chain, *(0, 1, 0, 0)[len(chain) - 1 :]]) for chain in chains]
            assert marches[0] is marches[1], (kind, make)
    assert len(set(map(id, observers.values()))) >= 4
    cords = [choose.twin(march_loops.march, 2, 0, 2, tendons) for tendons in (0, 1, 4)]
    assert cords[1] is cords[2] is not cords[0]


def test_a_kernel_that_only_kernels_call_has_no_machine_code():
    """Only its callers have: to them its code is linked."""
    callee = cache.part(cache.kept(doubled_0))
    callee._cache.disable()
    callee.compile((types.float64,))
    library = callee.overloads[types.float64,].library
    assert [f.name for f in library._final_module.functions] == []
    assert any(not f.is_declaration and "doubled" in f.name for f in library._get_module_for_linking().functions)


def test_what_is_compiled_knows_the_rules_of_all_numbers_from_the_beginning(monkeypatch):
    loaded = []
    monkeypatch.setattr(kernel_cache, "import_module", loaded.append)
    kernel = cache.kept(doubled_0)
    kernel._cache.disable()
    kernel.compile((types.float64,))
    assert loaded == ["pliant.compiler.dual_numbers"]


@pytest.mark.parametrize("usual", [700, 0])
def test_garbage_is_sought_rarely_while_a_kernel_is_compiled(monkeypatch, usual):
    """Then as before; never where the caller switched the search off."""
    during, before = [], gc.get_threshold()
    monkeypatch.setattr(kernel_cache, "import_module", lambda _: during.append(gc.get_threshold()[0]))
    kernel = cache.kept(doubled_0)
    kernel._cache.disable()
    gc.set_threshold(usual, *before[1:])
    try:
        kernel.compile((types.float64,))
        assert (during, gc.get_threshold()[0]) == ([cache.OBJECTS if usual else 0], usual)
    finally:
        gc.set_threshold(*before)


def doubled_0(x):
    return 2.0 * x


READ_ONLY = """
import tempfile, warnings

def refuse(*_, **__):
    raise OSError(30, "Read-only file system")

tempfile.TemporaryFile = refuse  # by which every folder for a cache is tried
import pliant
from pliant.simulation import inputs
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    model = pliant.chain_model(length=0.1, mass=0.02, links=1, stiffness=0.5, damping=1e-3, torque=[1e-6])
    for stiffness in (0.5, 0.6):
        pliant.simulate(model.with_(stiffness=stiffness), pliant.Step(1e4), duration=0.02)
print([str(w.message) for w in caught])
"""


@pytest.mark.slow
def test_where_nothing_can_be_written_it_compiles_and_says_so_once():
    done = subprocess.run([sys.executable, "-c", READ_ONLY], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.count("compiled kernels cannot be stored") == 1
