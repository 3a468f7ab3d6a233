"""How Python calls machine code: as a built-in function of NumPy arrays.

A call by `ctypes` costs a microsecond for every array, as much as a step of an environment. The machine code takes the
arrays themselves instead and reads what NumPy's documented `PyArrayObject` tells: data, shape, strides, type, flags.
"""

import ctypes
from typing import Any

import numpy as np

_HEAD = object.__basicsize__
_DATA, _NDIM, _SHAPE, _STRIDES, _TYPE, _FLAGS = _HEAD, _HEAD + 8, _HEAD + 16, _HEAD + 24, _HEAD + 40, _HEAD + 48
_FLAGS_NEEDED = 0x0100  # aligned
_FASTCALL = 0x0080
_MANY = 128  # columns
_FIXED = 3  # constants, working memory, results


class _MethodDef(ctypes.Structure):
    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def function(address: int, name: str) -> Any:
    """The built-in function whose machine code `entry` has written."""
    _check_layout()
    method = _MethodDef(name.encode(), address, _FASTCALL, None)
    # Python keeps its address, and reads it when it frees the function: at its end even after all modules are empty.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(method))
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype, new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return new(ctypes.addressof(method), True, None)


def _check_layout() -> None:
    """Compare what machine code will read of an array with what NumPy says.

    Raises:
        RuntimeError: they differ: this is another Python or NumPy than the package knows.
    """
    array = np.zeros((2, 3))
    found = [ctypes.c_int64.from_address(id(array) + at).value for at in (_DATA, _TYPE, _SHAPE, _STRIDES)]
    ndim, flags = (ctypes.c_int32.from_address(id(array) + at).value for at in (_NDIM, _FLAGS))
    fine = found[:2] == [array.ctypes.data, id(array.dtype)] and ndim == 2 and flags & _FLAGS_NEEDED == _FLAGS_NEEDED
    read = [ctypes.c_int64.from_address(place + 8 * k).value for place in found[2:] for k in (0, 1)] if fine else []
    if read != [2, 3, 24, 8]:
        raise RuntimeError("arrays of this NumPy are laid out in an unknown way; NumPy 2 on a 64-bit CPython is known")


def entry(name: str, sizes: list[int]) -> list[str]:
    """The function that Python calls: with constants, working memory, results, and matrices.

    It returns its `self`, True, if it has done its work: if all matrices are of float64, have rows whose numbers stand
    next to one another, at least as many rows as `sizes` tells, and as many columns as the results; otherwise the
    constants.
    """
    lines = ["declare void @Py_IncRef(ptr)", "declare ptr @PyEval_SaveThread()"]
    lines += ["declare void @PyEval_RestoreThread(ptr)"]
    lines += [f"define ptr @{name}(ptr %self, ptr %args, i64 %number) {{", "entry:"]
    lines += [f"  %enough = icmp eq i64 %number, {_FIXED + len(sizes)}", "  br i1 %enough, label %start, label %bad.0"]
    lines += ["bad.0:", "  %first = load ptr, ptr %args", "  br label %give", "start:"]

    def read(k: int, what: str, at: int, kind: str) -> None:
        lines.extend(
            [
                f"  %{what}.at{k} = getelementptr i8, ptr %a{k}, i64 {at}",
                f"  %{what}{k} = load {kind}, ptr %{what}.at{k}",
            ]
        )

    for k in range(_FIXED + len(sizes)):
        lines += [f"  %p{k} = getelementptr ptr, ptr %args, i64 {k}", f"  %a{k} = load ptr, ptr %p{k}"]
        read(k, "data", _DATA, "ptr")

    def read_strides(k: int) -> None:
        read(k, "strides", _STRIDES, "ptr")
        lines.extend(
            [
                f"  %bytes{k} = load i64, ptr %strides{k}",
                f"  %row{k} = ashr exact i64 %bytes{k}, 3",
                f"  %next.at{k} = getelementptr i64, ptr %strides{k}, i64 1",
                f"  %next{k} = load i64, ptr %next.at{k}",
            ]
        )

    read(0, "type", _TYPE, "ptr")
    read(2, "shape", _SHAPE, "ptr")
    lines += ["  %n.at = getelementptr i64, ptr %shape2, i64 1", "  %n = load i64, ptr %n.at"]
    lines += ["  %alone = icmp sle i64 %n, 1"]
    read_strides(2)
    for k, size in enumerate(sizes, _FIXED):
        read(k, "type", _TYPE, "ptr")
        read(k, "flags", _FLAGS, "i32")
        read(k, "ndim", _NDIM, "i32")
        read(k, "shape", _SHAPE, "ptr")
        lines += [
            f"  %ok.type{k} = icmp eq ptr %type{k}, %type0",
            f"  %set{k} = and i32 %flags{k}, {_FLAGS_NEEDED}",
            f"  %ok.set{k} = icmp eq i32 %set{k}, {_FLAGS_NEEDED}",
            f"  %ok.ndim{k} = icmp eq i32 %ndim{k}, 2",
            f"  %and1.{k} = and i1 %ok.type{k}, %ok.set{k}",
            f"  %and2.{k} = and i1 %and1.{k}, %ok.ndim{k}",
            f"  br i1 %and2.{k}, label %sizes{k}, label %bad",
            f"sizes{k}:",
            f"  %rows{k} = load i64, ptr %shape{k}",
            f"  %n.at{k} = getelementptr i64, ptr %shape{k}, i64 1",
            f"  %n{k} = load i64, ptr %n.at{k}",
            f"  %ok.rows{k} = icmp sge i64 %rows{k}, {size}",
            f"  %ok.n{k} = icmp eq i64 %n{k}, %n",
            f"  %and3.{k} = and i1 %ok.rows{k}, %ok.n{k}",
        ]
        read_strides(k)
        lines += [
            f"  %ok.next{k} = icmp eq i64 %next{k}, {8 if size else f'%next{k}'}",
            f"  %ok.line{k} = or i1 %ok.next{k}, %alone",
            f"  %and4.{k} = and i1 %and3.{k}, %ok.line{k}",
            f"  br i1 %and4.{k}, label %fine{k}, label %bad",
            f"fine{k}:",
        ]
    passed = ", ".join(f"ptr %data{k}, i64 %row{k}" for k in range(2, _FIXED + len(sizes)))
    lines += ["  %any = icmp sgt i64 %n, 0", "  br i1 %any, label %work, label %give.self"]
    call = f"  call void @columns(ptr %data0, i64 %n, ptr %data1, {passed})"
    # Many columns take long: other threads may run meanwhile.
    lines += ["work:", f"  %many = icmp sge i64 %n, {_MANY}", "  br i1 %many, label %long, label %short"]
    lines += ["short:", call, "  br label %give.self"]
    lines += ["long:", "  %thread = call ptr @PyEval_SaveThread()", call]
    lines += ["  call void @PyEval_RestoreThread(ptr %thread)", "  br label %give.self"]
    lines += ["give.self:", "  br label %give"]
    lines += ["bad:", "  br label %give", "give:"]
    lines += ["  %result = phi ptr [%first, %bad.0], [%self, %give.self], [%a0, %bad]"]
    lines += ["  call void @Py_IncRef(ptr %result)", "  ret ptr %result", "}"]
    return lines


def entry_of_arrays(name: str, target: str, dimensions: list[int], gaps: list[bool]) -> list[str]:
    """A function that Python calls with arrays of so many dimensions, which must be those that `target` takes.

    Of those that may have gaps between their rows, which are of float64, the distance from row to row is passed instead
    of the rows' length.
    """
    lines = ["declare void @Py_IncRef(ptr)", f"define ptr @{name}(ptr %self, ptr %args, i64 %number) {{"]
    passed = []
    for k, count in enumerate(dimensions):
        lines += [
            f"  %p{k} = getelementptr ptr, ptr %args, i64 {k}",
            f"  %a{k} = load ptr, ptr %p{k}",
            f"  %data.at{k} = getelementptr i8, ptr %a{k}, i64 {_DATA}",
            f"  %data{k} = load ptr, ptr %data.at{k}",
            f"  %shape.at{k} = getelementptr i8, ptr %a{k}, i64 {_SHAPE}",
            f"  %shape{k} = load ptr, ptr %shape.at{k}",
        ]
        passed.append(f"ptr %data{k}")
        if gaps[k]:
            lines += [
                f"  %n.at{k} = load i64, ptr %shape{k}",
                f"  %strides.at{k} = getelementptr i8, ptr %a{k}, i64 {_STRIDES}",
                f"  %strides{k} = load ptr, ptr %strides.at{k}",
                f"  %bytes{k} = load i64, ptr %strides{k}",
                f"  %row{k} = ashr exact i64 %bytes{k}, 3",
            ]
            passed += [f"i64 %n.at{k}", f"i64 %row{k}"]
            continue
        for i in range(count):
            lines += [
                f"  %s{k}.{i} = getelementptr i64, ptr %shape{k}, i64 {i}",
                f"  %n{k}.{i} = load i64, ptr %s{k}.{i}",
            ]
            passed.append(f"i64 %n{k}.{i}")
    lines += [
        f"  call void @{target}({', '.join(passed)})",
        "  call void @Py_IncRef(ptr %self)",
        "  ret ptr %self",
        "}",
    ]
    return lines
