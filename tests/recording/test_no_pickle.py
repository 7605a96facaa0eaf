"""No reader can run what a file holds: neither it nor what it imports of pliant unpickles, evaluates or loads code."""

from __future__ import annotations

import ast
from importlib.util import find_spec
from pathlib import Path

import pytest

from pliant.recording import apart_worker
from pliant.recording.registry import BUILT_IN

MODULES = {"pickle", "cPickle", "_pickle", "pickletools", "dill", "cloudpickle", "joblib", "shelve", "marshal",
           "tables", "hickle", "jsonpickle", "code", "runpy"}  # fmt: skip
CALLS = {"eval", "exec", "compile", "__import__", "read_hdf", "read_pickle", "to_hdf", "HDFStore", "unsafe_load",
         "full_load", "open_mfdataset", "Unpickler"}  # fmt: skip
PLUGINS = "pliant.plugins"  # imports what an entry point of an installed package names, never what a file names


def faults(source: str) -> list[str]:
    """What a source does that could run the content of a file."""
    found = []
    for node in ast.walk(ast.parse(source)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        found += [f"imports {name}" for name in names if name.partition(".")[0] in MODULES]
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        last = called.rpartition(".")[2]
        given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
        if last in CALLS and not called.startswith("re."):
            found.append(f"calls {called}")
        if called in ("np.load", "numpy.load", "np.lib.format.read_array") and given.get("allow_pickle") != "False":
            found.append(f"calls {called} without allow_pickle=False")
        if given.get("allow_pickle", "False") != "False":
            found.append(f"calls {called} with allow_pickle")
        if called == "yaml.load" and given.get("Loader", "") not in ("yaml.SafeLoader", "yaml.CSafeLoader"):
            found.append("calls yaml.load without a safe loader")
    return found


def imported(source: str) -> set[str]:
    """Modules of pliant that a source imports, within functions too, and those that it names as text."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in names if name.startswith("pliant.") and is_module(name)}


def is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def reached() -> dict[str, str]:
    """Sources of all modules that reading reaches, from the readers, the registry and the helper process on."""
    targets = [target for target, _ in BUILT_IN.values()]
    waiting = {"pliant.recording.registry", "pliant.recording.apart", *apart_worker.READ.values(),
               *(target.partition(":")[0] for target in targets)}  # fmt: skip
    sources: dict[str, str] = {}
    while waiting:
        name = waiting.pop()
        spec = find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        sources[name] = Path(spec.origin).read_text(encoding="utf-8")
        waiting |= imported(sources[name]) - set(sources)
    return sources


def test_no_reader_reaches_what_runs_a_file():
    sources = reached()
    assert {"pliant.recording.deeplabcut", "pliant.recording.apart_hdf5", "pliant.recording.pandas_layout",
            "pliant.recording.npz", "pliant.files", PLUGINS} <= set(sources)  # fmt: skip
    assert {name: faults(source) for name, source in sources.items() if faults(source)} == {}


def test_modules_are_imported_by_names_of_our_own_alone():
    """`import_module` takes constants, the table of the helper process, or entry points; never text of a file."""
    allowed = {"pliant.plugins": {"module"}, "pliant.recording.apart": {"'xarray'"},
               "pliant.recording.apart_worker": {"READ[kind]"}}  # fmt: skip
    for name, source in reached().items():
        calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
        given = {ast.unparse(c.args[0]) for c in calls if ast.unparse(c.func).rpartition(".")[2] == "import_module"}
        assert given <= allowed.get(name, set()), name


@pytest.mark.parametrize("source", [
    "import pickle", "from pickle import loads", "def f():\n    import joblib", "import pandas as pd\npd.read_hdf(p)",
    "pd.read_pickle(p)", "np.load(p)", "np.load(p, allow_pickle=True)", "np.lib.format.read_array(f)", "yaml.load(t)",
    "eval(t)", "exec(t)", "from tables import open_file", "import pickletools", "x.fetch(allow_pickle=1)",
])
def test_the_check_sees_each_of_them(source):
    assert faults(source)


@pytest.mark.parametrize("source", [
    "np.load(p, allow_pickle=False)", "re.compile(t)", "yaml.load(t, Loader=yaml.SafeLoader)", "import json",
])
def test_the_check_lets_the_others_pass(source):
    assert faults(source) == []
