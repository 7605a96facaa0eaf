"""Damaged files of the kernel cache: removed with a line, compiled again, nothing of them unpickled or run."""

from __future__ import annotations

import pickle
import warnings
from pathlib import Path

import pytest

from pliant.compiler import cache, kernel_cache


def doubled(x):
    return 2.0 * x + 1.0


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache with one kernel in it."""
    monkeypatch.setattr(kernel_cache, "folder", lambda: tmp_path)
    assert asked()[0] == ["compiled"]
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".lock", ".nbc", ".nbi"]
    return tmp_path


def asked():
    """What a process that begins does for the kernel, and the lines of its warnings; its value is always right."""
    kernel_cache.tell_damaged.cache_clear()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kernel = cache.kept(doubled)
        assert kernel(3.0) == 7.0
    return [*["found"] * sum(kernel.stats.cache_hits.values()),
            *["compiled"] * sum(kernel.stats.cache_misses.values())], [str(w.message) for w in caught]


def damages(content, every):
    """Cut, empty, lengthened, with flipped bytes at even distances, and replaced."""
    size = len(content)
    yield from (content[: size * k // every] for k in range(every))
    yield content + b"\0"
    yield b"\0" * size
    for at in sorted({0, size - 1, *range(0, size, max(1, size // every))}):
        yield content[:at] + bytes([content[at] ^ 0x10]) + content[at + 1 :]


def repaired(folder, every):
    """Damage each file in every way; the count of the ways."""
    count = 0
    for suffix in (".nbi", ".nbc"):
        (file,) = folder.glob(f"*{suffix}")
        whole = file.read_bytes()
        for content in damages(whole, every):
            file.write_bytes(content)
            done, told = asked()
            assert done == ["compiled"]
            assert told == [f"damaged kernels in the cache {folder} are removed and compiled again"]
            assert asked() == (["found"], [])
            count += 1
    return count


def test_a_kernel_is_found_again(folder):
    assert asked() == (["found"], [])


def test_a_damaged_file_is_compiled_again_with_one_line(folder):
    assert repaired(folder, 2) >= 12


@pytest.mark.slow
def test_damage_anywhere_is_seen(folder):
    assert repaired(folder, 60) >= 240


class Trap:
    """Leaves a file when it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return Path.touch, (self.file,)


def test_nothing_is_unpickled_that_has_not_its_checksum(folder, tmp_path_factory):
    sprung = tmp_path_factory.mktemp("trap") / "sprung"
    trap = pickle.dumps(Trap(sprung))
    for suffix in (".nbi", ".nbc"):
        (file,) = folder.glob(f"*{suffix}")
        for content in (trap, file.read_bytes()[:32] + trap):
            file.write_bytes(content)
            assert asked()[0] == ["compiled"]
    assert not sprung.exists()
    pickle.loads(trap)
    assert sprung.exists()


def test_a_class_that_is_gone_is_no_crash(folder):
    from hashlib import sha256

    (file,) = folder.glob("*.nbc")
    body = b"cpliant.compiler.cache\nNoSuchClass\n."
    file.write_bytes(sha256(body).digest() + body)
    done, told = asked()
    assert (done, told) == (["compiled"], [])  # of an older version, not damaged
    assert asked() == (["found"], [])


def test_with_an_index_all_that_it_listed_is_removed(folder):
    """A new index gives its numbers out again: an old data file must not answer for another signature."""
    (index,) = folder.glob("*.nbi")
    (data,) = folder.glob("*.nbc")
    index.write_bytes(b"")
    kernel_cache.tell_damaged.cache_clear()
    with pytest.warns(RuntimeWarning, match="damaged kernels"):
        assert cache.kept(doubled)._cache._cache_file._load_index() == {}
    assert not index.exists()
    assert not data.exists()
