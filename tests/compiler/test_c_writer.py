"""What kernels say in Python, said in C: conditions, loops that end early, and what is known when the text is made."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

from pliant.compiler.c import CWriter
from pliant.compiler.c_values import Real, cells

COMPILER = shutil.which("cc")


def chosen(a, b):
    low = min(b, a)
    return max(a, b, 0.5 * (a + b)) + 10.0 * low + (100.0 if 0.0 < a <= b < 2.0 else 0.0)


def first_above(values, bound):
    """Number of the first value above a bound, in a loop whose counter is an index and which is left early."""
    found = -1.0
    for i in range(len(values)):
        if values[i] > bound:
            found = i % 7 + 0.0
            break
    return found


def halved(x):
    """Turns of a loop that only counts, until x is small."""
    turns = 0.0
    for k in range(40):
        if x < 1.0 or k > 20:
            break
        x = 0.5 * x
        turns = turns + 1.0
    return turns


def doubled(x):
    return 2.0 * x


def in_c(folder, kernel, *arguments, instead=None):
    """Return the function of C of a kernel, of an array of numbers that the arguments name."""
    if COMPILER is None:
        pytest.skip("no C compiler (cc) is on the path")
    writer = CWriter(instead=instead)
    writer.say(f"return {writer.number(writer.call(kernel, *arguments))};")
    body = writer.body("double")
    source, library = folder / "f.c", folder / "f.so"
    source.write_text(f"#include <math.h>\ndouble f(const double *x)\n{{\n{body}\n}}\n")
    flags = ["-std=c99", "-Wall", "-Werror", "-fPIC", "-shared"]
    subprocess.run([COMPILER, *flags, source, "-o", library, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).f
    function.restype = ctypes.c_double
    return lambda *x: function((ctypes.c_double * len(x))(*x))


@pytest.mark.parametrize("pair", [(1.0, 1.5), (1.5, 1.0), (-1.0, 1.0), (1.0, 3.0), (1.0, 1.0)])
def test_choices_and_chains_of_comparisons(pair, tmp_path):
    assert in_c(tmp_path, chosen, Real("x[0]"), Real("x[1]"))(*pair) == chosen(*pair)


def test_a_long_loop_whose_counter_is_an_index(tmp_path):
    """Of 20 elements: a loop of C cannot name them, so it is written out."""
    values = np.linspace(0.0, 1.9, 20)
    function = in_c(tmp_path, first_above, cells("x", (20,)), 1.04)
    assert function(*values) == first_above(values, 1.04) == 4.0


@pytest.mark.parametrize("x", [0.5, 100.0, 1e12])
def test_a_long_loop_that_counts(x, tmp_path):
    assert in_c(tmp_path, halved, Real("x[0]"))(x) == halved(x)


def test_a_kernel_in_the_place_of_another(tmp_path):
    assert in_c(tmp_path, doubled, Real("x[0]"), instead={doubled: halved})(8.0) == 4.0
