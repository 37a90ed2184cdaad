"""What compiled code needs of the process that it runs in: addresses, in a table that each process fills anew.

The code itself knows places in the table alone, so that it may be kept on disk and loaded by another process.
"""

import ctypes
import sys
from array import array, typecodes

import numpy as np

OBJECT_HEAD_SIZE = object.__basicsize__
"""Bytes of PyObject_HEAD: the fields of an object begin here; its type is in the last word before."""

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
PYTHON_OBJECTS = {
    "None": None,
    "TypeError": TypeError,
    "ValueError": ValueError,
    "BufferError": BufferError,
    "ndarray": np.ndarray,
    "float64": np.dtype(np.float64),
}
SLOTS = ("sin", "cos", *PYTHON_API_FUNCTIONS, "PyArray_New", *PYTHON_OBJECTS, "sequence_type", "sequence_of_doubles")
"""What each place of the table `@runtime` holds the address of."""

ARRAY_TYPE_SLOT, NEW_ARRAY_SLOT = 2, 93
"""Places in the table of NumPy's C interface, which are the same in all its versions since 1.0."""


def runtime_table():
    """The addresses of SLOTS, as a ctypes array. Raises OSError, AttributeError or RuntimeError if one is not found."""
    library = _mathematics()
    addresses = [_address(library.sin), _address(library.cos)]
    addresses += [_address(getattr(ctypes.pythonapi, name)) for name in PYTHON_API_FUNCTIONS]
    addresses += [_new_array(), *map(id, PYTHON_OBJECTS.values()), *_sequences()]
    return (ctypes.c_void_p * len(SLOTS))(*addresses)


def _address(function):
    return ctypes.cast(function, ctypes.c_void_p).value


def _mathematics():
    try:
        return ctypes.CDLL("libm.so.6")
    except OSError:
        return ctypes.CDLL(None)


def _new_array():
    """The address of PyArray_New, after making sure that NumPy's arrays lie in memory as the entry reads them."""
    core = sys.modules.get("numpy._core._multiarray_umath") or sys.modules["numpy.core._multiarray_umath"]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    functions = ctypes.cast(pointer(core._ARRAY_API, None), ctypes.POINTER(ctypes.c_void_p))
    seen = np.zeros((2, 3))
    fields = ArrayFields.from_address(id(seen) + OBJECT_HEAD_SIZE)
    expected = (seen.ctypes.data, 2, (2, 3), id(seen.dtype), seen.flags.num)
    found = (fields.data, fields.dimensions, tuple(fields.shape[:2]), fields.dtype, fields.flags)
    if found != expected or _type_address(seen) != id(np.ndarray) or functions[ARRAY_TYPE_SLOT] != id(np.ndarray):
        raise RuntimeError(f"arrays of NumPy {np.__version__} do not lie in memory as expected")
    return functions[NEW_ARRAY_SLOT]


def _sequences():
    """Addresses by which the entry knows an array.array, and that one holds float64.

    None where these do not lie in memory as the entry reads them: then they go by the buffer protocol. What the entry
    reads stays where it is, as nothing else of Python runs until the entry returns.
    """
    seen = [array(code, [1, 2, 3]) for code in typecodes if code not in "uw"] + [array("d", [1.0])]
    seen[-1].append(4.0)
    fields = [SequenceFields.from_address(id(sequence) + OBJECT_HEAD_SIZE) for sequence in seen]
    as_read = all(
        (f.data, f.length) == s.buffer_info() and _type_address(s) == id(array)
        for f, s in zip(fields, seen, strict=True)
    )
    descriptions = {}
    for sequence, field in zip(seen, fields, strict=True):
        descriptions.setdefault(sequence.typecode, set()).add(field.description)
    one_each = all(len(found) == 1 for found in descriptions.values())
    if not (as_read and one_each and len(set().union(*descriptions.values())) == len(descriptions)):
        return None, None
    return id(array), descriptions["d"].pop()


def _type_address(thing):
    return ctypes.c_void_p.from_address(id(thing) + OBJECT_HEAD_SIZE - ctypes.sizeof(ctypes.c_void_p)).value


class ArrayFields(ctypes.Structure):
    """The fields of a NumPy array after PyObject_HEAD, the same in all versions since 1.7."""

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
    """The fields of an array.array after PyObject_HEAD."""

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


def make_python_callable(address, name, docstring, owner):
    """A Python function of positional arguments, whose code is at an address and lives as long as its owner."""
    definition = MethodDefinition(name.encode(), address, FASTCALL, docstring.encode())
    owner.definition = definition
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    return make(ctypes.addressof(definition), owner, None)
