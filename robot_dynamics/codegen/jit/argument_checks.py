"""Checks of the arguments of the Python function of a program, as LLVM IR text; each error names the argument.

The memory of a float64 array whose type is exactly numpy.ndarray or array.array is read directly; all other objects are
read through the buffer protocol.
"""

import sys
from string import Template

from robot_dynamics.codegen.jit.runtime import OBJECT_HEAD_SIZE, SLOTS, ArrayFields, BufferFields, SequenceFields

MESSAGES = {
    "no_buffer": "%s: argument %zd (%s) must be a contiguous buffer of float64, not %.100s",
    "other_type": "%s: argument %zd (%s) must hold float64 (format 'd')",
    "other_format": "%s: argument %zd (%s) must hold float64 (format 'd'), not '%.20s'",
    "scattered": "%s: argument %zd (%s) must be C-contiguous",
    "read_only": "%s: argument %zd (%s) is written to and must not be read-only",
    "other_count": "%s: argument %zd (%s) must hold %zd numbers, not %zd",
}

TEMPLATE_FIELDS: dict[str, str | int] = {
    # offsets [bytes] in an object, a NumPy array, an array.array ("sequence") or a Py_buffer ("view")
    "type_at": OBJECT_HEAD_SIZE - 8,
    "type_name_at": OBJECT_HEAD_SIZE + 8,
    **{f"array_{field}": OBJECT_HEAD_SIZE + getattr(ArrayFields, field).offset for field, _ in ArrayFields._fields_},
    **{
        f"sequence_{field}": OBJECT_HEAD_SIZE + getattr(SequenceFields, field).offset
        for field, _ in SequenceFields._fields_
    },
    **{f"view_{field}": getattr(BufferFields, field).offset for field, _ in BufferFields._fields_},
    "view_words": BufferFields.internal.offset // 8 + 1,
    "native": ord("<" if sys.byteorder == "little" else ">"),
    # addresses of entries of @runtime
    **{
        slot: f"getelementptr ([{len(SLOTS)} x ptr], ptr @runtime, i64 0, i64 {index})"
        for index, slot in enumerate(SLOTS)
    },
}


def c_string(name: str, text: str) -> str:
    """IR of a constant C string."""
    coded = text.encode() + b"\0"
    escaped = "".join(f"\\{byte:02X}" for byte in coded)
    return f'@{name} = private constant [{len(coded)} x i8] c"{escaped}"'


def argument_checks() -> str:
    """IR of the functions that `@evaluate` calls."""
    return "\n".join(
        [*(c_string(f"text.{key}", text) for key, text in MESSAGES.items()), CHECKS.substitute(TEMPLATE_FIELDS)]
    )


CHECKS = Template("""

; 1 for a float64 array of type numpy.ndarray, 2 for an array.array("d"), 0 for all other objects: derived types may
; override the buffer protocol.
define internal i8 @kind(ptr %object) alwaysinline {
  %type.at = getelementptr i8, ptr %object, i64 $type_at
  %type = load ptr, ptr %type.at
  %ndarray = load ptr, ptr $ndarray
  %is_array = icmp eq ptr %type, %ndarray
  br i1 %is_array, label %array, label %no_array
array:
  %dtype.at = getelementptr i8, ptr %object, i64 $array_dtype
  %dtype = load ptr, ptr %dtype.at
  %float64 = load ptr, ptr $float64
  %is_float64 = icmp eq ptr %dtype, %float64
  %array.kind = zext i1 %is_float64 to i8
  ret i8 %array.kind
no_array:
  %sequence_type = load ptr, ptr $sequence_type
  %is_sequence = icmp eq ptr %type, %sequence_type
  br i1 %is_sequence, label %sequence, label %other
sequence:
  %description.at = getelementptr i8, ptr %object, i64 $sequence_description
  %description = load ptr, ptr %description.at
  %doubles = load ptr, ptr $sequence_of_doubles
  %is_doubles = icmp eq ptr %description, %doubles
  %sequence.kind = select i1 %is_doubles, i8 2, i8 0
  ret i8 %sequence.kind
other:
  ret i8 0
}

define internal void @refuse(ptr %kind.at, ptr %text, i64 %index, i64 %needed, i64 %count) noinline optnone cold {
  %kind = load ptr, ptr %kind.at
  %name.at = getelementptr %argument, ptr @arguments, i64 %index, i32 1
  %name = load ptr, ptr %name.at
  %format = load ptr, ptr $PyErr_Format
  %model = load ptr, ptr getelementptr (%signature, ptr @signature, i64 0, i32 3)
  %number = add i64 %index, 1
  call ptr (ptr, ptr, ...) %format(ptr %kind, ptr %text, ptr %model, i64 %number, ptr %name, i64 %needed, i64 %count)
  ret void
}

; As above, with a text in the message.
define internal void @refuse_text(ptr %text, i64 %index, ptr %description) noinline optnone cold {
  %number = ptrtoint ptr %description to i64
  call void @refuse(ptr $TypeError, ptr %text, i64 %index, i64 %number, i64 0)
  ret void
}

; Whether an argument holds the required count of numbers; if not, an exception is set.
define internal i1 @counts(i64 %count, i64 %index) alwaysinline {
  %needed.at = getelementptr %argument, ptr @arguments, i64 %index, i32 0
  %needed = load i64, ptr %needed.at
  %right = icmp eq i64 %count, %needed
  br i1 %right, label %yes, label %no
no:
  call void @refuse(ptr $ValueError, ptr @text.other_count, i64 %index, i64 %needed, i64 %count)
  ret i1 false
yes:
  ret i1 true
}

define internal i1 @is_double(ptr %format) noinline optnone cold {
  %missing = icmp eq ptr %format, null
  br i1 %missing, label %no, label %first
first:
  %a = load i8, ptr %format
  %b.at = getelementptr i8, ptr %format, i64 1
  %plain = icmp eq i8 %a, 100
  br i1 %plain, label %ends, label %prefixed
prefixed:
  %is_native = icmp eq i8 %a, $native
  %is_at = icmp eq i8 %a, 64
  %is_equal = icmp eq i8 %a, 61
  %either = or i1 %is_native, %is_at
  %prefix = or i1 %either, %is_equal
  br i1 %prefix, label %second, label %no
second:
  %b = load i8, ptr %b.at
  %is_d = icmp eq i8 %b, 100
  %c.at = getelementptr i8, ptr %format, i64 2
  br i1 %is_d, label %ends, label %no
ends:
  %end.at = phi ptr [%b.at, %first], [%c.at, %second]
  %end = load i8, ptr %end.at
  %ended = icmp eq i8 %end, 0
  ret i1 %ended
no:
  ret i1 false
}

; Fills a Py_buffer of any object and checks it. Returns whether it is valid; if not, an exception is set.
define internal i1 @acquire(ptr %object, ptr %view, i64 %index) noinline optnone {
  %get = load ptr, ptr $PyObject_GetBuffer
  %failed = call i32 %get(ptr %object, ptr %view, i32 284) ; PyBUF_FULL_RO: any layout, with its format
  %got = icmp eq i32 %failed, 0
  br i1 %got, label %format, label %refused
refused:
  %matches = load ptr, ptr $PyErr_ExceptionMatches
  %TypeError = load ptr, ptr $TypeError
  %ValueError = load ptr, ptr $ValueError
  %BufferError = load ptr, ptr $BufferError
  %is_type = call i32 %matches(ptr %TypeError)
  %is_value = call i32 %matches(ptr %ValueError)
  %is_buffer = call i32 %matches(ptr %BufferError)
  %either = or i32 %is_type, %is_value
  %any = or i32 %either, %is_buffer
  %is_expected = icmp ne i32 %any, 0
  br i1 %is_expected, label %no_buffer, label %no
no_buffer:
  %type.at = getelementptr i8, ptr %object, i64 $type_at
  %type = load ptr, ptr %type.at
  %type_name.at = getelementptr i8, ptr %type, i64 $type_name_at
  %type_name = load ptr, ptr %type_name.at
  call void @refuse_text(ptr @text.no_buffer, i64 %index, ptr %type_name)
  br label %no
format:
  %format.at = getelementptr i8, ptr %view, i64 $view_format
  %code = load ptr, ptr %format.at
  %right_format = call i1 @is_double(ptr %code)
  br i1 %right_format, label %layout, label %other_format
other_format:
  %unsaid = icmp eq ptr %code, null
  br i1 %unsaid, label %unsaid_format, label %said_format
unsaid_format:
  call void @refuse_text(ptr @text.other_type, i64 %index, ptr null)
  br label %no
said_format:
  call void @refuse_text(ptr @text.other_format, i64 %index, ptr %code)
  br label %no
layout:
  %is_contiguous = load ptr, ptr $PyBuffer_IsContiguous
  %contiguous = call i32 %is_contiguous(ptr %view, i8 67) ; 'C'
  %one_piece = icmp ne i32 %contiguous, 0
  br i1 %one_piece, label %access, label %scattered
scattered:
  call void @refuse(ptr $ValueError, ptr @text.scattered, i64 %index, i64 0, i64 0)
  br label %no
access:
  %read_only.at = getelementptr i8, ptr %view, i64 $view_read_only
  %read_only = load i32, ptr %read_only.at
  %writable = icmp eq i32 %read_only, 0
  %inputs = load i64, ptr @signature
  %read = icmp slt i64 %index, %inputs
  %accessible = or i1 %writable, %read
  br i1 %accessible, label %size, label %no_access
no_access:
  call void @refuse(ptr $ValueError, ptr @text.read_only, i64 %index, i64 0, i64 0)
  br label %no
size:
  %bytes.at = getelementptr i8, ptr %view, i64 $view_bytes
  %bytes = load i64, ptr %bytes.at
  %count = sdiv i64 %bytes, 8
  %right_size = call i1 @counts(i64 %count, i64 %index)
  ret i1 %right_size
no:
  ret i1 false
}

define internal i64 @product(ptr %sizes, i32 %axes) noinline optnone {
entry:
  br label %head
head:
  %axis = phi i32 [0, %entry], [%next, %body]
  %product = phi i64 [1, %entry], [%grown, %body]
  %more = icmp slt i32 %axis, %axes
  br i1 %more, label %body, label %done
body:
  %size.at = getelementptr i64, ptr %sizes, i32 %axis
  %size = load i64, ptr %size.at
  %grown = mul i64 %product, %size
  %next = add i32 %axis, 1
  br label %head
done:
  ret i64 %product
}

; Whether a NumPy array is valid; if not, an exception is set.
define internal i1 @fits(ptr %object, i64 %index) alwaysinline {
  %flags.at = getelementptr i8, ptr %object, i64 $array_flags
  %has = load i32, ptr %flags.at
  %needs.at = getelementptr %argument, ptr @arguments, i64 %index, i32 4
  %needs = load i32, ptr %needs.at
  %common = and i32 %has, %needs
  %all = icmp eq i32 %common, %needs
  br i1 %all, label %size, label %unfit
unfit:
  %piece = and i32 %has, 1
  %one_piece = icmp ne i32 %piece, 0
  %text = select i1 %one_piece, ptr @text.read_only, ptr @text.scattered
  call void @refuse(ptr $ValueError, ptr %text, i64 %index, i64 0, i64 0)
  ret i1 false
size:
  %axes.at = getelementptr i8, ptr %object, i64 $array_dimensions
  %axes = load i32, ptr %axes.at
  %sizes.at = getelementptr i8, ptr %object, i64 $array_shape
  %sizes = load ptr, ptr %sizes.at
  %row = icmp eq i32 %axes, 1
  br i1 %row, label %one_axis, label %several_axes
one_axis:
  %length = load i64, ptr %sizes
  br label %compare
several_axes:
  %product = call i64 @product(ptr %sizes, i32 %axes)
  br label %compare
compare:
  %count = phi i64 [%length, %one_axis], [%product, %several_axes]
  %right = call i1 @counts(i64 %count, i64 %index)
  ret i1 %right
}

; Whether an argument that is read directly is valid, and the address of its numbers; if not, an exception is set.
define internal {i1, ptr} @located(ptr %object, i64 %index) alwaysinline {
  %kind = call i8 @kind(ptr %object) ; checked again: code of another buffer may have changed it
  switch i8 %kind, label %other_type [i8 1, label %array i8 2, label %sequence]
other_type:
  call void @refuse(ptr $TypeError, ptr @text.other_type, i64 %index, i64 0, i64 0)
  br label %end
array:
  %array.fits = call i1 @fits(ptr %object, i64 %index)
  %array.data.at = getelementptr i8, ptr %object, i64 $array_data
  br label %read_data
sequence:
  %length.at = getelementptr i8, ptr %object, i64 $sequence_length
  %length = load i64, ptr %length.at
  %sequence.fits = call i1 @counts(i64 %length, i64 %index)
  %sequence.data.at = getelementptr i8, ptr %object, i64 $sequence_data
  br label %read_data
read_data:
  %data.at = phi ptr [%array.data.at, %array], [%sequence.data.at, %sequence]
  %data.fits = phi i1 [%array.fits, %array], [%sequence.fits, %sequence]
  %data = load ptr, ptr %data.at
  br label %end
end:
  %fits = phi i1 [false, %other_type], [%data.fits, %read_data]
  %at = phi ptr [null, %other_type], [%data, %read_data]
  %some = insertvalue {i1, ptr} poison, i1 %fits, 0
  %both = insertvalue {i1, ptr} %some, ptr %at, 1
  ret {i1, ptr} %both
}
""")
