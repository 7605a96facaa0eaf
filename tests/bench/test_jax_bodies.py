"""The scripts that measure many bodies run at small sizes: in JAX on its processor, and in SIMD vectors."""

from __future__ import annotations

import pytest
from benchmark_scripts import FOLDER, loaded

pytestmark = pytest.mark.slow  # JAX compiles the steps of two bodies, the other script those of five links


def test_bodies_in_jax(monkeypatch):
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    monkeypatch.syspath_prepend(FOLDER)
    peers = loaded("jax_peers")
    with jax.enable_x64(True):
        rows = [peers.many_bodies(model, 64, bodies=3, steps=4, bandwidth=1e9) for model in peers.BODIES.values()]
    assert len(rows) == 2
    assert all(row["steps/s"] > 0.0 and row["of bandwidth (%)"] > 0.0 for row in rows)


def test_batches_in_space(capsys):
    loaded("space_batch").main(samples=9, runs=1)
    out = capsys.readouterr().out
    assert out.count("ratio") == 5


def test_peers_move_the_same_arm(monkeypatch):
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install -e '.[jax]'")
    monkeypatch.syspath_prepend(FOLDER)  # a program's scripts are imported where it runs
    peers = loaded("jax_peers")
    with jax.enable_x64(True):
        pliant, module = (measure(1, bodies=3, steps=4) for measure in (peers.pliant_itself, peers.exported))
    assert module["tip (mm)"] == pytest.approx(pliant["tip (mm)"], rel=1e-9)
    assert pliant["tip (mm)"] > 0.01
    assert min(module["one (ns)"], module["many (ns)"], module["gradient, many (ns)"], pliant["one (ns)"]) > 0.0
