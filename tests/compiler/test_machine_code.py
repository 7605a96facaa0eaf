"""Machine code of steps: stored with a checksum, made again where it is damaged, found by the shapes of arguments."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pliant.compiler import calls, choose, kernel_cache, machine_code, trace
from pliant.equations import motion


def text(scale: float) -> str:
    """A function that multiplies the number at its pointer."""
    return (
        "define void @scaled(ptr %x) {\n"
        f"  %a = load double, ptr %x\n  %b = fmul double %a, {scale:e}\n  store double %b, ptr %x\n  ret void\n}}"
    )


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(kernel_cache, "folder", lambda: tmp_path)
    kernel_cache.tell_damaged.cache_clear()
    return tmp_path


def test_machine_code_is_made_once_and_found_again(folder: Path) -> None:
    first = machine_code.stored("scaled", lambda: text(2.0))
    assert machine_code.stored("scaled", lambda: pytest.fail("it is stored")) == first
    assert [file.name for file in folder.iterdir() if file.suffix != ".lock"] == ["scaled.code"]


@pytest.mark.parametrize("damage", [lambda b: b"", lambda b: b[:40], lambda b: b[:-1] + bytes([b[-1] ^ 1]),
                                    lambda b: b[32:]])  # fmt: skip
def test_damaged_machine_code_is_made_again_with_one_line(folder: Path, damage) -> None:
    first = machine_code.stored("scaled", lambda: text(2.0))
    (file,) = folder.glob("*.code")
    file.write_bytes(damage(file.read_bytes()))
    with pytest.warns(RuntimeWarning, match="damaged kernels"):
        assert machine_code.stored("scaled", lambda: text(2.0)) == first
    assert machine_code.stored("scaled", lambda: pytest.fail("it is stored")) == first


def test_without_a_folder_it_is_made_in_every_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "folder", lambda: None)
    assert machine_code.stored("scaled", lambda: text(2.0)) == machine_code.stored("scaled", lambda: text(2.0))


def test_a_full_disk_costs_one_warning(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    kernel_cache.tell_unsaved.cache_clear()
    with pytest.warns(RuntimeWarning, match="No space left on device"):
        machine_code.stored("scaled", lambda: text(2.0))
    assert [file.name for file in folder.iterdir() if file.suffix != ".lock"] == []


def test_every_size_and_kind_has_code_of_its_own(folder: Path) -> None:
    entries = []
    for n in (2, 3):
        for kind in ("float", "vector", "dual"):
            before = set(machine_code.code_table().known)
            examples, sources = trace.examples_of(motion.step, n), (*choose.SOURCES, __file__)  # as if of another text
            calls.provide(motion.step, motion.step, examples, kind, sources, fused=False)
            (entry,) = machine_code.code_table().known - before
            entries.append(entry)
    assert len(set(entries)) == 6
    assert len(list(folder.glob("*.code"))) == len(entries)


def test_keys_depend_on_the_order_of_sizes() -> None:
    assert machine_code.key(7, [2, 3]) != machine_code.key(7, [3, 2])
    assert 0 < machine_code.key(7, list(range(40))) < 2**64


def test_one_loop_serves_all_sizes(rng: np.random.Generator) -> None:
    """The same compiled step moves chains of 2 and of 7 links, each as the plain text does."""
    from pliant.actuators import chen2018
    from pliant.mechanics import mechanics_of

    steps = []
    for n in (2, 7):
        chain = mechanics_of(chen2018.model(links=n))
        steps.append(choose.twin(motion.step, n))
        x, v, torque = 0.1 * rng.normal(size=n), rng.normal(size=n), np.full(n, 0.01)
        y, w = x.copy(), v.copy()
        steps[-1](x, v, 1e-3, torque, *chain.parts())
        motion.step(y, w, 1e-3, torque, *chain.parts())
        np.testing.assert_allclose([x, v], [y, w], rtol=1e-12)
    assert steps[0] is steps[1]


def test_a_full_table_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    table = machine_code.CodeTable.__new__(machine_code.CodeTable)
    table.known = {1, 2}
    monkeypatch.setattr(machine_code, "MOST_ENTRIES", 2)
    with pytest.raises(RuntimeError, match="more than 2 chains"):
        table.load("scaled", b"", 3)


def test_machine_code_is_for_the_processor_for_which_loops_are_compiled() -> None:
    """Numba heeds its own variables, and vectors are passed in the registers that both assume."""
    code = (
        "from numba.core.registry import cpu_target\n"
        "from pliant.compiler import machine_code\n"
        "print(machine_code.host(), machine_code.processor(), cpu_target.target_context.codegen()._tm_features)"
    )
    plain, other = (
        subprocess.run([sys.executable, "-c", code], env={**os.environ, **more}, capture_output=True, text=True,
                       check=True).stdout
        for more in ({}, {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""})
    )  # fmt: skip
    assert "('generic', '')" in other
    assert plain.split(")")[1].split()[0] != other.split(")")[1].split()[0]
