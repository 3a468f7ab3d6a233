"""From LLVM's intermediate representation to functions of this process, by llvmlite."""

import ctypes
import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm


@cache
def _machine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=_features(), opt=2, reloc="pic", codemodel="jitdefault"
    )


def _features() -> str:
    return str(llvm.get_host_cpu_features().flatten())


@cache
def version() -> str:
    """What machine code depends on beside its source: this package's compiler, llvmlite, and the processor."""
    parts = [
        llvmlite.__version__,
        str(llvm.llvm_version_info),
        str(object.__basicsize__),
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
    ]
    digest = hashlib.sha256("\n".join([*parts, _features()]).encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def to_object(source: str, is_plain: bool = False) -> bytes:
    """The object code of a module; of a plain one, whose loops are not vector code yet, more is to be made."""
    module = llvm.parse_assembly(source)
    machine = _machine()
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    # The loops are vector code already, without repetitions: what is left to do is little, and quickly done.
    options = llvm.create_pipeline_tuning_options(speed_level=2 if is_plain else 1)
    options.loop_unrolling = not is_plain  # which takes most of the time, and hinders vectors
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


@cache
def _add_symbols() -> None:
    for symbol in ("Py_IncRef", "PyEval_SaveThread", "PyEval_RestoreThread"):
        llvm.add_symbol(symbol, ctypes.cast(getattr(ctypes.pythonapi, symbol), ctypes.c_void_p).value)


_ENGINES: list[Any] = []  # an engine's code is gone with it


def load(code: bytes, name: str) -> int:
    """The address of the function of that name in some object code.

    Raises:
        RuntimeError: this is no object code, or it has no such function.
    """
    _add_symbols()
    empty = llvm.parse_assembly("")
    empty.triple = _machine().triple
    engine = llvm.create_mcjit_compiler(empty, _machine())  # one that has been finalized relocates no more objects
    _ENGINES.append(engine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    address = engine.get_function_address(name)
    if not address:
        raise RuntimeError(f"the object code has no function {name!r}")
    return int(address)
