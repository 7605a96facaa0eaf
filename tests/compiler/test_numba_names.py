"""Every name that Numba keeps to itself and that pliant uses stands here, and is there in the Numba installed."""

from __future__ import annotations

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from packaging.requirements import Requirement

import pliant
from pliant.compiler import cache

SOURCE = Path(pliant.__file__).parent
PUBLIC = {"numba", "numba.extending"}
NAMES = {
    "numba.core.caching": {"CompileResultCacheImpl", "FunctionCache", "IndexDataCacheFile", "_CacheLocator"},
    "numba.core.codegen": {"JITCodeLibrary"},
    "numba.core.compiler": {"Compiler"},
    "numba.core.compiler_lock": {"global_compiler_lock"},
    "numba.core.registry": {"cpu_target"},
    "numba.core.runtime.nrt": {"rtsys"},
    "numba.core.typeconv.castgraph": {"Conversion"},
}
METHODS = {  # of Numba's classes, called or overridden
    ("numba.core.caching", "FunctionCache"): {
        "_index_key", "_load_overload", "load_overload", "save_overload", "_guard_against_spurious_io_errors",
        "disable", "enable", "cache_path"},
    ("numba.core.caching", "IndexDataCacheFile"): {
        "load", "_load_index", "_save_index", "_save_data", "_data_path", "_dump", "_open_for_write"},
    ("numba.core.caching", "CompileResultCacheImpl"): {"_locator_classes", "filename_base"},
    ("numba.core.codegen", "JITCodeLibrary"): {
        "_optimize_final_module", "enable_object_caching", "_finalize_final_module", "_finalize_dynamic_globals",
        "_verify_declare_only_symbols", "_get_module_for_linking", "_finalized", "_final_module"},
    ("numba.core.compiler", "Compiler"): {"define_pipelines"},
    ("numba.core.codegen", "JITCPUCodegen"): {"_module_pass_manager"},
}


def used() -> dict[str, set[str]]:
    """Names that the package imports from modules of Numba, by module."""
    names: dict[str, set[str]] = {}
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "numba":
                names.setdefault(str(node.module), set()).update(a.name for a in node.names)
    return {module: found for module, found in names.items() if module not in PUBLIC}


def test_the_list_is_what_the_package_uses() -> None:
    assert used() == NAMES


@pytest.mark.parametrize("module", NAMES)
def test_each_name_exists(module: str) -> None:
    assert [name for name in NAMES[module] if not hasattr(importlib.import_module(module), name)] == []


@pytest.mark.parametrize("owner", METHODS)
def test_each_method_exists(owner: tuple[str, str]) -> None:
    kind = getattr(importlib.import_module(owner[0]), owner[1])
    text = "".join(inspect.getsource(k) for k in kind.__mro__[:-1] if k.__module__.startswith("numba"))
    assert [name for name in METHODS[owner] if not (hasattr(kind, name) or f"self.{name} =" in text)] == []


def test_the_numba_installed_lies_within_the_bounds() -> None:
    project = SOURCE.parents[1] / "pyproject.toml"
    line = next(x for x in project.read_text(encoding="utf-8").splitlines() if x.strip().startswith('"numba>='))
    assert Requirement(line.split('"')[1]).specifier.contains(numba.__version__)


def test_without_an_inner_name_kernels_are_compiled_anew() -> None:
    code = (
        "import numba.core.caching, warnings\n"
        "del numba.core.caching._CacheLocator\n"
        "from pliant.compiler import cache\n"
        "assert cache.kernel_cache is None\n"
        "def doubled(x): return 2.0 * x\n"
        "with warnings.catch_warnings(record=True) as caught:\n"
        "    warnings.simplefilter('always')\n"
        "    kernels = [cache.kept(doubled), cache.part(cache.kept(doubled))]\n"
        "assert len(caught) == 1 and 'compiles them again' in str(caught[0].message), caught\n"
        "print([kernel(3.0) for kernel in kernels[:1]])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "[6.0]"), done.stderr
    assert cache.kernel_cache is not None
