"""Storage of compiled kernels on disk between runs, as Numba's cache with a checksum in each file.

The name of an entry contains a digest of everything that determines its machine code
(`pliant.compiler.twin.fingerprint`). An entry is therefore never stale, and all installations, environments and
processes of a user share one folder: the one in the environment variable NUMBA_CACHE_DIR, or ``pliant`` in the user's
cache folder. (Numba's default cache lies beside each source file, and two processes which save into one of its indices
at once may give a signature the other's code.)

Kernels that were not used for 30 days are removed, and those that were used least recently where the files hold more
than 128 MB. Where a kernel cannot be stored, for example on a full disk, one warning says so, and the calculation goes
on.

Every file begins with a checksum of the rest, which is compared before anything is unpickled or run. A damaged file,
for example after a power cut or on a full disk, is removed with a warning, and the kernel is compiled again.

The names of Numba used here are private and may change. `pliant.compiler.cache` works without this module where one is
missing.
"""

from __future__ import annotations

import pickle
import tempfile
from contextlib import suppress
from functools import cache
from glob import escape
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any
from warnings import warn

import llvmlite
import numba
from llvmlite.binding import parse_assembly
from numba import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime.nrt import rtsys
from platformdirs import user_cache_dir

from pliant.compiler.kernel_files import evict, mark_used

config: Any = numba.config  # set from environment variables by Numba
DIGEST = 32  # bytes of a checksum
UNREADABLE = (  # errors of unpickling where a class of the content has changed
    pickle.UnpicklingError, AttributeError, ImportError, EOFError, ValueError, TypeError, KeyError, IndexError)
ENVIRONMENT = "_ZN08NumbaEnv"  # how Numba's names of pointers to a function's environment begin


@cache
def folder() -> Path | None:
    """Return the folder for this user's compiled kernels, created if absent; None if it cannot be written."""
    path = Path(config.CACHE_DIR or user_cache_dir("pliant", appauthor=False))
    path = path / f"kernels-checked-numba{numba.__version__}-llvmlite{llvmlite.__version__}"
    try:
        path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError:
        return None
    return path


class _Locator(_CacheLocator):
    """Numba cache locator with one folder for all kernels, whose names identify their source."""

    def __init__(self, file: str, place: Path) -> None:
        self._py_file, self._place = file, place

    @classmethod
    def from_function(cls, _function: Any, file: str) -> _Locator | None:
        cache_folder = folder()
        return None if cache_folder is None else cls(file, cache_folder)

    def get_cache_path(self) -> str:
        return str(self._place)

    def get_source_stamp(self) -> str:
        return "in the name"

    def get_disambiguator(self) -> str:
        return "0"


class _Place(CompileResultCacheImpl):
    _locator_classes = [_Locator, *CompileResultCacheImpl._locator_classes]  # noqa: RUF012, SLF001  Numba's own way


class CheckedFiles(IndexDataCacheFile):
    """Numba's index and data files of compiled kernels, with a checksum at the start of each file."""

    def load(self, key: Any) -> Any:
        """Return the compiled kernel stored under `key`, or None if it is absent or its file is damaged."""
        name = self._load_index().get(key)
        if name is None:
            return None
        mark_used(Path(self._index_path))
        return self._read(Path(self._data_path(name)))

    def _load_index(self) -> Any:
        content = self._read(Path(self._index_path))
        return {} if content is None else content

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, overloads)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        body = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(sha256(body).digest() + body)

    def _read(self, path: Path) -> Any:
        """Return the content of a file, or None if it is absent or damaged; a damaged file is never unpickled."""
        try:
            content = path.read_bytes()
        except OSError:
            return None
        digest, body = content[:DIGEST], content[DIGEST:]
        whole = digest == sha256(body).digest()
        if whole:
            with suppress(*UNREADABLE):
                return pickle.loads(body)  # noqa: S301  written by this user, and unchanged since
        self._drop(path)
        if not whole:  # else it was written by a version whose records had other names
            tell_damaged(path.parent)
        return None

    def _drop(self, path: Path) -> None:
        """Remove a file that cannot be read; with an index file, also all data files which it listed."""
        damaged = [path]
        if str(path) == self._index_path:
            damaged += path.parent.glob(f"{escape(path.stem)}.*.nbc")
        for file in damaged:
            with suppress(OSError):  # another process may have been first
                file.unlink()


class KernelCache(FunctionCache):
    """Numba's cache of one function's compiled code, in the folder shared by all processes of the user."""

    _impl_class = _Place

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = CheckedFiles(self._cache_path, self._impl.filename_base, "in the name")

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return Numba's key with the field names of record arguments, because compiled code uses their positions."""
        return (*super()._index_key(sig, codegen), tuple(fields(kind) for kind in sig))

    @property
    def index(self) -> Path:
        """Path of the file that lists the stored compiled versions of this kernel."""
        return Path(self.cache_path) / f"{self._impl.filename_base}.nbi"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code stored for a signature, or None if none is stored. The slow initialisation of Numba's
        compiler is avoided.

        Loading needs only the runtime for reference counts. The compiler is initialised when something must be
        compiled, with the rules for dual numbers and vectors. Otherwise a list of stored signatures that holds such
        numbers would load these rules while a kernel is compiled, and Numba would mix them with the rules before.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            if (loaded := self._load_overload(sig, target_context)) is not None:
                return loaded
        import_module("pliant.compiler.dual_numbers")
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store compiled machine code on disk, and remove kernels beyond the limits of the cache. Warn once if the code
        cannot be stored.
        """
        try:
            super().save_overload(sig, data)
            evict(self.index.parent)
        except OSError as error:
            tell_unsaved(self.index.parent, error.strerror or str(error))


def fields(kind: Any) -> Any:
    """Return the field names of a Numba record type: first its own, then one tuple for each of its fields, which holds
    the field names inside that field.
    """
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    inside = tuple(map(fields, parts))
    return (*getattr(kind, "fields", ()), *inside)


class Part(Compiler):
    """Numba compiler for kernels that only other kernels call: a first round of optimisation, no machine code."""

    def define_pipelines(self) -> Any:
        """Return Numba's compiler pipelines, set up for code that becomes machine code inside its callers only."""
        self.state.library = _PartLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class _PartLibrary(JITCodeLibrary):
    def _optimize_final_module(self) -> None:
        """Run the first of Numba's two rounds of optimisation."""
        codegen = self._codegen
        passes, builder = codegen._module_pass_manager(opt=codegen._opt_level, cost="cheap")  # noqa: SLF001  as Numba does
        passes.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        """Keep the code for its callers, whose copies become machine code, and hand only its environments, pointers
        which Numba sets, to the execution engine.
        """
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True
        whole = self._get_module_for_linking()
        environments = [str(x) for x in whole.global_variables if x.name.startswith(ENVIRONMENT)]
        self._final_module = parse_assembly("\n".join(environments))
        self._final_module.triple, self._final_module.data_layout = whole.triple, whole.data_layout
        super()._finalize_final_module()


@cache
def tell_damaged(place: Path) -> None:
    """Warn once that damaged compiled kernels in the cache folder `place` are removed and compiled again."""
    warn(f"damaged kernels in the cache {place} are removed and compiled again", RuntimeWarning, stacklevel=2)


@cache
def tell_unsaved(place: Path, reason: str) -> None:
    """Warn once that compiled kernels cannot be stored in the cache folder `place`."""
    warn(
        f"compiled kernels cannot be stored in {place} ({reason}), so the next start compiles them again, which takes "
        "seconds: free space there, or set the environment variable NUMBA_CACHE_DIR to another folder",
        RuntimeWarning, stacklevel=2,
    )
