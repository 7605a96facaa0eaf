"""Machine code of recorded kernels, made by LLVM alone, stored as bytes, and called by address from compiled loops.

The code of a kernel belongs to the shapes of its arguments. A table in memory holds the address of the code of each
kernel for each set of shapes, under a key that both Python (`key`) and the loops (`calls`) compute from the shapes. A
loop finds the code of the chain at hand there, so that one compiled loop serves chains of every size.

A stored file begins with a checksum of the rest, which is compared before the code is used.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from secrets import token_hex
from typing import Any

import llvmlite
import numpy as np
from llvmlite import binding
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from pliant.compiler import cache as loops
from pliant.compiler.kernel_files import alone, evict, mark_used

FINDER = "pliant_address"  # name by which compiled loops call `ADDRESS`
PRIME, WORD = 0x100000001B3, (1 << 64) - 1  # of the key, a hash of Fowler, Noll and Vo
SLOTS_OF_TABLE = 1 << 14
MOST_ENTRIES = SLOTS_OF_TABLE // 2
ADDRESS = f"""
define i64 @{FINDER}_code(i64 %key) {{
entry:
  br label %probe
probe:
  %slot = phi i64 [ %key, %entry ], [ %next, %other ]
  %row = and i64 %slot, {SLOTS_OF_TABLE - 1}
  %two = shl i64 %row, 1
  %place = getelementptr i64, ptr inttoptr (i64 TABLE to ptr), i64 %two
  %stored = load i64, ptr %place
  %hit = icmp eq i64 %stored, %key
  br i1 %hit, label %good, label %miss
miss:
  %empty = icmp eq i64 %stored, 0
  br i1 %empty, label %none, label %other
other:
  %next = add i64 %slot, 1
  br label %probe
good:
  %behind = getelementptr i64, ptr %place, i64 1
  %address = load i64, ptr %behind
  ret i64 %address
none:
  ret i64 0
}}
"""
DIGEST = 32  # bytes of a checksum
LONG = 500_000  # characters of LLVM's text; the dense step of 12 links is shorter


def key(seed: int, sizes: list[int]) -> int:
    """Return the key of a kernel's machine code for arguments whose arrays have the given sizes, all in one list."""
    value = seed
    for size in sizes:
        value = (value ^ size) * PRIME & WORD
    return value or 1


def seed_of(name: str) -> int:
    """Return the number with which the keys of a kernel begin."""
    return int.from_bytes(sha256(name.encode()).digest()[:8], "little") | 1


@cache
def target() -> Any:
    """Return LLVM's description of this processor, as Numba has it."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    triple, (cpu, features) = binding.Target.from_triple(binding.get_process_triple()), host()
    return triple.create_target_machine(
        cpu=cpu, features=features, opt=3, jit=True, codemodel="jitdefault",
        reloc="static" if triple.name.startswith("x86") else "default",
    )


@cache
def host() -> tuple[str, str]:
    """Return the name and the instruction sets for which Numba compiles: loops pass vectors in their registers."""
    _, cpu, features = cpu_target.target_context.codegen().magic_tuple()
    return cpu, features


@cache
def processor() -> str:
    """Return a digest of everything but the text on which machine code depends."""
    return sha256(repr((llvmlite.__version__, *host())).encode()).hexdigest()[:8]


class CodeTable:
    """Machine code of this process, and the table of its addresses."""

    def __init__(self) -> None:
        self.engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target())
        self.rows = np.zeros((SLOTS_OF_TABLE, 2), dtype=np.uint64)
        self.known: set[int] = set()
        finder = binding.parse_assembly(ADDRESS.replace("TABLE", str(self.rows.ctypes.data)))
        self.engine.add_object_file(binding.ObjectFileRef.from_data(machine_code(finder)))
        self.engine.finalize_object()
        binding.add_symbol(FINDER, self.engine.get_function_address(f"{FINDER}_code"))

    def load(self, name: str, code: bytes, entry: int) -> None:
        """Load the machine code of the function `name`, and enter its address in the table under the key `entry`."""
        if len(self.known) >= MOST_ENTRIES:  # a full table would never answer
            raise RuntimeError(f"more than {MOST_ENTRIES} chains of different sizes in one process: start another one")
        self.engine.add_object_file(binding.ObjectFileRef.from_data(code))
        self.engine.finalize_object()
        row = entry % SLOTS_OF_TABLE
        while self.rows[row, 0]:
            row = (row + 1) % SLOTS_OF_TABLE
        self.rows[row, 1] = self.engine.get_function_address(name)
        self.rows[row, 0] = entry  # last: other threads may look it up at this moment
        self.known.add(entry)


@cache
def only_table() -> CodeTable:
    """Return the machine code of this process, made in the first call. The caller holds the compiler's lock."""
    return CodeTable()


def code_table() -> CodeTable:
    """Return the machine code of this process. Must be called before a loop is compiled or loaded that calls it."""
    with global_compiler_lock:
        return only_table()


def provide(entry: int, name: str, text: Callable[[], str]) -> None:
    """Make sure that the machine code of the function `name` stands in the table under the key `entry`.

    `name` identifies everything on which the code depends, except the processor. `text` returns the function in LLVM's
    language where the code is not stored.
    """
    with global_compiler_lock:
        if entry not in code_table().known:
            code_table().load(name, stored(f"{name}-{processor()}", text), entry)


def machine_code(module: Any) -> bytes:
    """Return the machine code of an LLVM module after optimisation, as an object file."""
    module.verify()
    tuning = binding.create_pipeline_tuning_options(speed_level=3)
    text = str(module)
    worth = len(text) < LONG and not ("x double>" in text or "contract" in text)  # else no gain, but seconds of work
    tuning.slp_vectorization = worth
    passes = binding.create_pass_builder(target(), tuning)
    passes.getModulePassManager().run(module, passes)
    return bytes(target().emit_object(module))


def stored(name: str, text: Callable[[], str]) -> bytes:
    """Return the machine code stored under `name`; where there is none, make it from LLVM's `text` and store it."""
    folder: Path | None = None if loops.kernel_cache is None else loops.kernel_cache.folder()
    if folder is None:
        return machine_code(binding.parse_assembly(text()))
    file = folder / f"{name}.code"
    if (code := read(file)) is None:
        with alone(file.with_suffix(".lock")):
            if (code := read(file)) is None:  # else another process was first
                code = machine_code(binding.parse_assembly(text()))
                write(file, code)
    return code


def read(file: Path) -> bytes | None:
    """Return the machine code in a file, or None if it is absent or damaged. A damaged file is removed."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    if content[:DIGEST] == sha256(content[DIGEST:]).digest():
        mark_used(file)
        return content[DIGEST:]
    with suppress(OSError):  # another process may have been first
        file.unlink()
    loops.kernel_cache.tell_damaged(file.parent)
    return None


def write(file: Path, code: bytes) -> None:
    """Store machine code with its checksum, and remove files beyond the limit of the cache."""
    draft = file.with_name(f"{file.name}.tmp.{os.getpid()}.{token_hex(4)}")
    try:
        with draft.open("xb") as out:  # with the permissions of the folder's other files
            out.write(sha256(code).digest() + code)
        draft.replace(file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        loops.kernel_cache.tell_unsaved(file.parent, error.strerror or str(error))
    else:
        with suppress(OSError):
            evict(file.parent)
