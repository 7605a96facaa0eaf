"""Where compiled kernels are kept between runs, by Numba's own cache with a checksum before each file.

A name in this cache holds a digest of all that its machine code comes from (`pliant.compiler.twin.fingerprint`), so an
entry is never stale and every checkout, environment and process of a user may use one folder: the one that the
environment variable NUMBA_CACHE_DIR names, or ``pliant`` among the user's caches. Numba alone keeps a cache beside each
source file, and two processes that save into one of its indices at once may give a signature the other's code.

Every file begins with a checksum of the rest, which is compared before anything of it is unpickled or run: a file that
a power cut or a full disk left damaged is removed, with a line that says so, and the kernel is compiled again.

Numba keeps the names used here to itself and may change them: `pliant.compiler.cache` does without this module where
one is missing.
"""

from __future__ import annotations

import pickle
import tempfile
from contextlib import suppress
from functools import cache
from glob import escape
from hashlib import sha256
from pathlib import Path
from time import time
from typing import Any
from warnings import warn

import llvmlite
import numba
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime.nrt import rtsys
from numba.misc.appdirs import AppDirs

config: Any = numba.config  # it fills itself from the environment
DIGEST = 32  # bytes of a checksum
UNREADABLE = (  # what unpickling ends in where a class of the content is not as it was
    pickle.UnpicklingError, AttributeError, ImportError, EOFError, ValueError, TypeError, KeyError, IndexError)
FORGOTTEN = 14 * 86400.0  # s, after which another text's code is removed


@cache
def folder() -> Path | None:
    """The folder of this user's kernels, made when it is absent; None when nothing can be written there."""
    place = Path(config.CACHE_DIR or AppDirs(appname="pliant", appauthor=False).user_cache_dir)
    place = place / f"kernels-checked-numba{numba.__version__}-llvmlite{llvmlite.__version__}"
    try:
        place.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=place).close()
    except OSError:
        return None
    return place


class _Locator(_CacheLocator):
    """One folder for all kernels; their names say what they come from."""

    def __init__(self, file: str, place: Path) -> None:
        self._py_file, self._place = file, place

    @classmethod
    def from_function(cls, _function: Any, file: str) -> _Locator | None:
        place = folder()
        return None if place is None else cls(file, place)

    def get_cache_path(self) -> str:
        return str(self._place)

    def get_source_stamp(self) -> str:
        return "in the name"

    def get_disambiguator(self) -> str:
        return "0"


class _Place(CompileResultCacheImpl):
    _locator_classes = [_Locator, *CompileResultCacheImpl._locator_classes]  # noqa: RUF012, SLF001  Numba's own way


class CheckedFiles(IndexDataCacheFile):
    """Numba's index and data files, each behind a checksum of its content."""

    def load(self, key: Any) -> Any:
        """What is kept under a key; None where nothing is, or only what is damaged."""
        name = self._load_index().get(key)
        return None if name is None else self._read(Path(self._data_path(name)))

    def _load_index(self) -> Any:
        found = self._read(Path(self._index_path))
        return {} if found is None else found

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, overloads)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        body = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(sha256(body).digest() + body)

    def _read(self, path: Path) -> Any:
        """The content of a file; None where it is absent or damaged, and then nothing of it was unpickled."""
        try:
            content = path.read_bytes()
        except OSError:
            return None
        digest, body = content[:DIGEST], content[DIGEST:]
        whole = digest == sha256(body).digest()
        if whole:
            with suppress(*UNREADABLE):
                return pickle.loads(body)  # noqa: S301  this user wrote it, and it is as it was written
        self._drop(path)
        if not whole:  # else it is of a version whose records had other names
            tell_damaged(path.parent)
        return None

    def _drop(self, path: Path) -> None:
        """Remove a file that cannot be read; with an index all that it listed, which a new one would list otherwise."""
        damaged = [path]
        if str(path) == self._index_path:
            damaged += path.parent.glob(f"{escape(path.stem)}.*.nbc")
        for file in damaged:
            with suppress(OSError):  # another process may have been first
                file.unlink()


class KernelCache(FunctionCache):
    """Numba's cache in the shared folder; its keys see the order of a NamedTuple's fields."""

    _impl_class = _Place

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = CheckedFiles(self._cache_path, self._impl.filename_base, "in the name")

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's key, and the fields of the records among the arguments: compiled code knows them by their place."""
        return (*super()._index_key(sig, codegen), tuple(fields(kind) for kind in sig))

    @property
    def index(self) -> Path:
        """The file that lists what is kept of this kernel."""
        return Path(self.cache_path) / f"{self._impl.filename_base}.nbi"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept for a signature, or None, without all that Numba learns first of how each thing is compiled.

        To load takes only the runtime that counts references; what is to be compiled makes Numba learn the rest.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, and remove what nobody has asked for in a long time."""
        super().save_overload(sig, data)
        self.sweep()

    def sweep(self) -> None:
        """Remove what older texts of this kernel left: their names hold other digests, nobody will look for them."""
        kernel, _, rest = self.index.name.rpartition("_")
        digest = rest.partition("-")[0]
        for file in self.index.parent.glob(f"{kernel}_????????????-*"):
            with suppress(OSError):  # another process may have been first
                if f"_{digest}-" not in file.name and time() - file.stat().st_mtime > FORGOTTEN:
                    file.unlink()


def fields(kind: Any) -> Any:
    """Names of a record's fields in their order, and those of the records in it."""
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    inside = tuple(map(fields, parts))
    return (*getattr(kind, "fields", ()), *inside)


class Part(Compiler):
    """Compiles what others take in: inlined and simplified; the rest is done where it ends up."""

    def define_pipelines(self) -> Any:
        """Numba's steps, into a library of little optimisation."""
        self.state.library = _PartLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class _PartLibrary(JITCodeLibrary):
    def _optimize_final_module(self) -> None:
        """The first of the two rounds that Numba makes of a library."""
        made = self._codegen
        passes, builder = made._module_pass_manager(opt=made._opt_level, cost="cheap")  # noqa: SLF001  as Numba does
        passes.run(self._final_module, builder)


@cache
def tell_damaged(place: Path) -> None:
    """Warn, once, that kernels in this folder are damaged."""
    warn(f"damaged kernels in the cache {place} are removed and compiled again", RuntimeWarning, stacklevel=2)
