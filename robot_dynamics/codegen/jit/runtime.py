"""Addresses that compiled code needs, in a table that each process fills.

The code contains only indices in the table, so that it can be stored on disk and loaded by another process.
"""

from __future__ import annotations

import ctypes
import sys
from array import array, typecodes
from collections.abc import Callable
from typing import Any

import numpy as np

OBJECT_HEAD_SIZE = object.__basicsize__
"""Bytes of PyObject_HEAD: the fields of an object start here; its type is in the word before."""

PYTHON_API_FUNCTIONS = (
    "PyObject_GetBuffer",
    "PyBuffer_IsContiguous",
    "PyBuffer_Release",
    "PyErr_Format",
    "PyErr_ExceptionMatches",
    "Py_IncRef",
    "Py_DecRef",
    "PyTuple_New",
    "PyTuple_SetItem",
)
PYTHON_OBJECTS: dict[str, object] = {
    "None": None,
    "TypeError": TypeError,
    "ValueError": ValueError,
    "BufferError": BufferError,
    "ndarray": np.ndarray,
    "float64": np.dtype(np.float64),
}
SLOTS = ("sin", "cos", *PYTHON_API_FUNCTIONS, "PyArray_New", *PYTHON_OBJECTS, "sequence_type", "sequence_of_doubles")
"""The entries of the table `@runtime`: each is the address of a function or object."""

ARRAY_TYPE_SLOT = 2
NEW_ARRAY_SLOT = 93
"""Indices in the table of NumPy's C interface, the same in all versions since 1.0."""


def runtime_table() -> ctypes.Array[ctypes.c_void_p]:
    """The addresses of SLOTS. Raises OSError, AttributeError or RuntimeError if one is missing."""
    library = _math_library()
    addresses = [_address(library.sin), _address(library.cos)]
    addresses += [_address(getattr(ctypes.pythonapi, name)) for name in PYTHON_API_FUNCTIONS]
    addresses += [_new_array_address(), *map(id, PYTHON_OBJECTS.values()), *_array_array_addresses()]
    return (ctypes.c_void_p * len(SLOTS))(*addresses)


def _address(function: Any) -> int | None:
    return ctypes.cast(function, ctypes.c_void_p).value


def _math_library() -> ctypes.CDLL:
    try:
        return ctypes.CDLL("libm.so.6")
    except OSError:
        return ctypes.CDLL(None)


def _new_array_address() -> int | None:
    """The address of PyArray_New. Raises RuntimeError if NumPy arrays do not have the expected memory layout."""
    core = sys.modules.get("numpy._core._multiarray_umath") or sys.modules["numpy.core._multiarray_umath"]
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype = ctypes.c_void_p
    get_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    functions = ctypes.cast(get_pointer(core._ARRAY_API, None), ctypes.POINTER(ctypes.c_void_p))
    sample = np.zeros((2, 3))
    fields = ArrayFields.from_address(id(sample) + OBJECT_HEAD_SIZE)
    expected = (sample.ctypes.data, 2, (2, 3), id(sample.dtype), sample.flags.num)
    actual = (fields.data, fields.dimensions, tuple(fields.shape[:2]), fields.dtype, fields.flags)
    if actual != expected or _type_address(sample) != id(np.ndarray) or functions[ARRAY_TYPE_SLOT] != id(np.ndarray):
        raise RuntimeError(f"arrays of NumPy {np.__version__} do not have the expected memory layout")
    address: int | None = functions[NEW_ARRAY_SLOT]
    return address


def _array_array_addresses() -> tuple[int | None, int | None]:
    """The addresses of the type array.array, and of the description that its arrays of float64 share.

    None where array.array does not have the expected memory layout: then it is read through the buffer protocol. The
    memory that the entry point reads does not move, as no other Python code runs until the entry point returns.
    """
    samples: list[array[Any]] = [array(code, [1, 2, 3]) for code in typecodes if code not in "uw"]
    samples.append(array("d", [1.0]))
    samples[-1].append(4.0)
    fields = [SequenceFields.from_address(id(sample) + OBJECT_HEAD_SIZE) for sample in samples]
    has_layout = all(
        (field.data, field.length) == sample.buffer_info() and _type_address(sample) == id(array)
        for field, sample in zip(fields, samples, strict=True)
    )
    descriptions: dict[str, set[int]] = {}
    for sample, field in zip(samples, fields, strict=True):
        descriptions.setdefault(sample.typecode, set()).add(field.description)
    is_unique = all(len(addresses) == 1 for addresses in descriptions.values())
    if not (has_layout and is_unique and len(set().union(*descriptions.values())) == len(descriptions)):
        return None, None
    return id(array), descriptions["d"].pop()


def _type_address(value: object) -> int | None:
    return ctypes.c_void_p.from_address(id(value) + OBJECT_HEAD_SIZE - ctypes.sizeof(ctypes.c_void_p)).value


class ArrayFields(ctypes.Structure):
    """Fields of a NumPy array after PyObject_HEAD, the same in all versions since 1.7."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("dimensions", ctypes.c_int),
        ("shape", ctypes.POINTER(ctypes.c_ssize_t)),
        ("strides", ctypes.c_void_p),
        ("base", ctypes.c_void_p),
        ("dtype", ctypes.c_void_p),
        ("flags", ctypes.c_int),
    )


class SequenceFields(ctypes.Structure):
    """Fields of an array.array after PyObject_HEAD."""

    _fields_ = (
        ("length", ctypes.c_ssize_t),
        ("data", ctypes.c_void_p),
        ("allocated", ctypes.c_ssize_t),
        ("description", ctypes.c_void_p),  # one for each type code
    )


class BufferFields(ctypes.Structure):
    """Py_buffer."""

    _fields_ = (
        ("data", ctypes.c_void_p),
        ("object", ctypes.c_void_p),
        ("bytes", ctypes.c_ssize_t),
        ("item_bytes", ctypes.c_ssize_t),
        ("read_only", ctypes.c_int),
        ("dimensions", ctypes.c_int),
        ("format", ctypes.c_void_p),
        ("shape", ctypes.c_void_p),
        ("strides", ctypes.c_void_p),
        ("suboffsets", ctypes.c_void_p),
        ("internal", ctypes.c_void_p),
    )


class MethodDefinition(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("docstring", ctypes.c_char_p),
    )


FASTCALL = 0x0080


class FunctionOwner:
    """Keeps the code and the definition of a Python function alive."""

    def __init__(self, library: object) -> None:
        self.library = library
        self.definition: MethodDefinition | None = None


def make_python_callable(address: int, name: str, docstring: str, owner: FunctionOwner) -> Callable[..., Any]:
    """A Python function of positional arguments whose code is at an address; it keeps `owner` alive."""
    owner.definition = MethodDefinition(name.encode(), address, FASTCALL, docstring.encode())
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function: Callable[..., Any] = make(ctypes.addressof(owner.definition), owner, None)
    return function
