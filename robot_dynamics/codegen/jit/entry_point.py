"""The Python function of a program, as LLVM IR text: the same for all programs, with a table of arguments for each.

The function checks its arguments itself, because checks in Python take longer than most models. Everything that may run
other Python code (buffers, new arrays) is done before the address of any array is read.
"""

from collections.abc import Mapping
from math import prod
from string import Template

from robot_dynamics.codegen.jit.argument_checks import TEMPLATE_FIELDS, argument_checks, c_string
from robot_dynamics.codegen.jit.runtime import SLOTS

TYPES = """
%signature = type {i64, i64, i64, ptr, ptr} ; counts of inputs, arrays and results; name, usage
%argument = type {i64, ptr, ptr, i32, i32} ; count of numbers, name, shape, axes, flags of NumPy that it needs
"""

CONTIGUOUS = 0x0001
WRITABLE = 0x0400
"""Flags of a NumPy array."""


def entry_point_text() -> str:
    """IR of `@evaluate`, which is linked with the `@sample` and the signature of a program.

    Called with the inputs alone it returns new arrays (one, or a tuple of several); called with arrays for the outputs
    too, it writes to these and returns None. And IR of `@attempt`, for programs with a status.
    """
    table = f"@runtime = global [{len(SLOTS)} x ptr] zeroinitializer"
    return "\n".join([TYPES, table, EXTERNAL, argument_checks(), ENTRY.substitute(TEMPLATE_FIELDS)])


def signature(name: str, inputs: Mapping[str, int], outputs: Mapping[str, tuple[int, ...]]) -> str:
    """IR of `@signature` and `@arguments`, from the sizes of the inputs and the shapes of the outputs."""
    arrays = len(inputs) + len(outputs)
    usage = f"{name} takes ({', '.join(inputs)}), or these and ({', '.join(outputs)}) to write to: "
    usage = usage.replace("%", "%%") + f"{len(inputs)} or {arrays} arrays, not %zd"
    lines = [TYPES, c_string("name", name), c_string("usage", usage)]
    arguments = []
    shapes = [*((key, (size,)) for key, size in inputs.items()), *outputs.items()]
    for index, (key, shape) in enumerate(shapes):
        sizes = ", ".join(f"i64 {size}" for size in shape)
        lines += [c_string(f"name{index}", key), f"@shape{index} = private constant [{len(shape)} x i64] [{sizes}]"]
        needed = CONTIGUOUS if index < len(inputs) else CONTIGUOUS | WRITABLE
        fields = f"i64 {prod(shape)}, ptr @name{index}, ptr @shape{index}, i32 {len(shape)}, i32 {needed}"
        arguments.append(f"%argument {{{fields}}}")
    counts = f"i64 {len(inputs)}, i64 {arrays}, i64 {len(outputs)}"
    return "\n".join(
        [
            *lines,
            f"@signature = constant %signature {{{counts}, ptr @name, ptr @usage}}",
            f"@arguments = constant [{arrays} x %argument] [{', '.join(arguments)}]",
        ]
    )


EXTERNAL = """
@signature = external constant %signature
@arguments = external constant %argument
declare void @sample(ptr)
"""

ENTRY = Template("""
; As @evaluate with the inputs alone, for programs whose last output is `status`: the first output, or None where the
; status is not zero or where an argument is not a contiguous NumPy array (size,) of float64. The caller then takes
; another way, which says what is wrong.
define ptr @attempt(ptr %self, ptr %arguments, i64 %count) noinline {
entry:
  %inputs = load i64, ptr @signature
  %arrays = load i64, ptr getelementptr (%signature, ptr @signature, i64 0, i32 1)
  %pointers = alloca ptr, i64 %arrays
  %complete = icmp eq i64 %count, %inputs
  br i1 %complete, label %input, label %none
input:
  %i = phi i64 [0, %entry], [%i.next, %pointed]
  %object.at = getelementptr ptr, ptr %arguments, i64 %i
  %object = load ptr, ptr %object.at
  %kind = call i8 @kind(ptr %object)
  %is_array = icmp eq i8 %kind, 1
  br i1 %is_array, label %array, label %none
array:
  %flags.at = getelementptr i8, ptr %object, i64 $array_flags
  %flags = load i32, ptr %flags.at
  %piece = and i32 %flags, 1
  %axes.at = getelementptr i8, ptr %object, i64 $array_dimensions
  %axes = load i32, ptr %axes.at
  %shape = shl i32 %axes, 1
  %both = or i32 %shape, %piece
  %is_row = icmp eq i32 %both, 3 ; one axis, contiguous
  br i1 %is_row, label %row, label %none
row:
  %sizes.at = getelementptr i8, ptr %object, i64 $array_shape
  %sizes = load ptr, ptr %sizes.at
  %size = load i64, ptr %sizes
  %needed.at = getelementptr %argument, ptr @arguments, i64 %i, i32 0
  %needed = load i64, ptr %needed.at
  %fits = icmp eq i64 %size, %needed
  br i1 %fits, label %pointed, label %none
pointed:
  %data.at = getelementptr i8, ptr %object, i64 $array_data
  %data = load ptr, ptr %data.at
  %pointer.at = getelementptr ptr, ptr %pointers, i64 %i
  store ptr %data, ptr %pointer.at
  %i.next = add i64 %i, 1
  %i.more = icmp slt i64 %i.next, %inputs
  br i1 %i.more, label %input, label %result
result:
  %result.object = call ptr @new_array(i64 %inputs)
  %is_missing = icmp eq ptr %result.object, null
  br i1 %is_missing, label %failed, label %made
failed:
  ret ptr null
made:
  %result.data.at = getelementptr i8, ptr %result.object, i64 $array_data
  %result.data = load ptr, ptr %result.data.at
  %result.at = getelementptr ptr, ptr %pointers, i64 %inputs
  store ptr %result.data, ptr %result.at
  %second = add i64 %inputs, 1
  br label %output
output: ; the other outputs are dropped; the last one is the status
  %o = phi i64 [%second, %made], [%o.next, %output]
  %count.at = getelementptr %argument, ptr @arguments, i64 %o, i32 0
  %doubles = load i64, ptr %count.at
  %scratch = alloca double, i64 %doubles, align 64
  %scratch.at = getelementptr ptr, ptr %pointers, i64 %o
  store ptr %scratch, ptr %scratch.at
  %o.next = add i64 %o, 1
  %o.more = icmp slt i64 %o.next, %arrays
  br i1 %o.more, label %output, label %compute
compute:
  call void @sample(ptr %pointers)
  %status = load double, ptr %scratch
  %succeeded = fcmp oeq double %status, 0.0
  br i1 %succeeded, label %done, label %drop
done:
  ret ptr %result.object
drop:
  %decrease = load ptr, ptr $Py_DecRef
  call void %decrease(ptr %result.object)
  br label %none
none:
  %none.object = load ptr, ptr $None
  %increase = load ptr, ptr $Py_IncRef
  call void %increase(ptr %none.object)
  ret ptr %none.object
}

define internal ptr @new_array(i64 %index) noinline optnone {
  %shape.at = getelementptr %argument, ptr @arguments, i64 %index, i32 2
  %shape = load ptr, ptr %shape.at
  %axes.at = getelementptr %argument, ptr @arguments, i64 %index, i32 3
  %axes = load i32, ptr %axes.at
  %new = load ptr, ptr $PyArray_New
  %type = load ptr, ptr $ndarray
  %array = call ptr %new(ptr %type, i32 %axes, ptr %shape, i32 12, ptr null, ptr null, i32 0, i32 0, ptr null) ; float64
  ret ptr %array
}

; The result of a call with the inputs alone: one new array, or a tuple that takes over their references.
define internal ptr @new_result(ptr %arrays) noinline optnone {
entry:
  %results = load i64, ptr getelementptr (%signature, ptr @signature, i64 0, i32 2)
  %single = icmp eq i64 %results, 1
  br i1 %single, label %single_array, label %several
single_array:
  %array = load ptr, ptr %arrays
  ret ptr %array
several:
  %make = load ptr, ptr $PyTuple_New
  %set = load ptr, ptr $PyTuple_SetItem
  %tuple = call ptr %make(i64 %results)
  %failed = icmp eq ptr %tuple, null
  br i1 %failed, label %done, label %items
items:
  %index = phi i64 [0, %several], [%next, %items]
  %item.at = getelementptr ptr, ptr %arrays, i64 %index
  %item = load ptr, ptr %item.at
  %ignored = call i32 %set(ptr %tuple, i64 %index, ptr %item)
  %next = add i64 %index, 1
  %more = icmp slt i64 %next, %results
  br i1 %more, label %items, label %done
done:
  ret ptr %tuple
}

define ptr @evaluate(ptr %self, ptr %arguments, i64 %count) noinline {
entry:
  %inputs = load i64, ptr @signature
  %arrays = load i64, ptr getelementptr (%signature, ptr @signature, i64 0, i32 1)
  %objects = alloca ptr, i64 %arrays
  %pointers = alloca ptr, i64 %arrays
  %views = alloca [$view_words x i64], i64 %arrays
  %fresh = icmp eq i64 %count, %inputs
  %full = icmp eq i64 %count, %arrays
  %fits = or i1 %fresh, %full
  br i1 %fits, label %collect, label %usage
usage:
  %format = load ptr, ptr $PyErr_Format
  %TypeError = load ptr, ptr $TypeError
  %usage.text = load ptr, ptr getelementptr (%signature, ptr @signature, i64 0, i32 4)
  call ptr (ptr, ptr, ...) %format(ptr %TypeError, ptr %usage.text, i64 %count)
  ret ptr null

collect: ; the objects, passed or new; no view is acquired yet
  %c = phi i64 [0, %entry], [%c.next, %collected]
  %c.object.at = getelementptr ptr, ptr %objects, i64 %c
  %c.owner.at = getelementptr [$view_words x i64], ptr %views, i64 %c, i64 1
  store ptr null, ptr %c.owner.at
  %c.is_argument = icmp slt i64 %c, %count
  br i1 %c.is_argument, label %take, label %make
take:
  %c.argument.at = getelementptr ptr, ptr %arguments, i64 %c
  %c.argument = load ptr, ptr %c.argument.at
  br label %collected
make:
  %c.new = call ptr @new_array(i64 %c)
  br label %collected
collected:
  %c.object = phi ptr [%c.argument, %take], [%c.new, %make]
  store ptr %c.object, ptr %c.object.at
  %c.next = add i64 %c, 1
  %c.more = icmp slt i64 %c.next, %arrays
  br i1 %c.more, label %collect, label %made
made:
  br i1 %fresh, label %check_made, label %view
check_made:
  %m = phi i64 [%inputs, %made], [%m.next, %check_next]
  %m.object.at = getelementptr ptr, ptr %objects, i64 %m
  %m.object = load ptr, ptr %m.object.at
  %m.missing = icmp eq ptr %m.object, null
  br i1 %m.missing, label %finish, label %check_next
check_next:
  %m.next = add i64 %m, 1
  %m.more = icmp slt i64 %m.next, %arrays
  br i1 %m.more, label %check_made, label %view

view: ; acquire the buffers of objects that are not read directly
  %v = phi i64 [0, %made], [0, %check_next], [%v.next, %viewed]
  %v.object.at = getelementptr ptr, ptr %objects, i64 %v
  %v.object = load ptr, ptr %v.object.at
  %v.kind = call i8 @kind(ptr %v.object)
  %v.plain = icmp ne i8 %v.kind, 0
  br i1 %v.plain, label %viewed, label %acquire
acquire:
  %v.view = getelementptr [$view_words x i64], ptr %views, i64 %v
  %v.acquired = call i1 @acquire(ptr %v.object, ptr %v.view, i64 %v)
  br i1 %v.acquired, label %viewed, label %finish
viewed:
  %v.next = add i64 %v, 1
  %v.more = icmp slt i64 %v.next, %arrays
  br i1 %v.more, label %view, label %point

point: ; from here to the end of the computation no Python code runs
  %p = phi i64 [0, %viewed], [%p.next, %pointed]
  %p.owner.at = getelementptr [$view_words x i64], ptr %views, i64 %p, i64 1
  %p.owner = load ptr, ptr %p.owner.at
  %p.viewed = icmp ne ptr %p.owner, null
  br i1 %p.viewed, label %in_view, label %in_array
in_view:
  %p.view = getelementptr [$view_words x i64], ptr %views, i64 %p
  %p.in_view = load ptr, ptr %p.view
  br label %pointed
in_array:
  %p.object.at = getelementptr ptr, ptr %objects, i64 %p
  %p.object = load ptr, ptr %p.object.at
  %p.located = call {i1, ptr} @located(ptr %p.object, i64 %p)
  %p.fits = extractvalue {i1, ptr} %p.located, 0
  %p.in_array = extractvalue {i1, ptr} %p.located, 1
  br i1 %p.fits, label %pointed, label %finish
pointed:
  %p.pointer = phi ptr [%p.in_view, %in_view], [%p.in_array, %in_array]
  %p.pointer.at = getelementptr ptr, ptr %pointers, i64 %p
  store ptr %p.pointer, ptr %p.pointer.at
  %p.next = add i64 %p, 1
  %p.more = icmp slt i64 %p.next, %arrays
  br i1 %p.more, label %point, label %compute
compute:
  call void @sample(ptr %pointers)
  br i1 %fresh, label %new, label %none
new:
  %new.at = getelementptr ptr, ptr %objects, i64 %inputs
  %new.result = call ptr @new_result(ptr %new.at)
  br label %finish
none:
  %none.object = load ptr, ptr $None
  %increase = load ptr, ptr $Py_IncRef
  call void %increase(ptr %none.object)
  br label %finish

finish: ; release the views, and new arrays that are not returned
  %result = phi ptr [null, %check_made], [null, %acquire], [null, %in_array], [%new.result, %new], [%none.object, %none]
  %failed = icmp eq ptr %result, null
  %unused = and i1 %failed, %fresh
  br label %release
release:
  %r = phi i64 [0, %finish], [%r.next, %released]
  %r.view = getelementptr [$view_words x i64], ptr %views, i64 %r
  %r.owner.at = getelementptr i64, ptr %r.view, i64 1
  %r.owner = load ptr, ptr %r.owner.at
  %r.viewed = icmp ne ptr %r.owner, null
  br i1 %r.viewed, label %give_back, label %array
give_back:
  %give = load ptr, ptr $PyBuffer_Release
  call void %give(ptr %r.view)
  br label %array
array:
  %r.new = icmp sge i64 %r, %inputs
  %r.dropped = and i1 %r.new, %unused
  br i1 %r.dropped, label %drop, label %released
drop:
  %r.object.at = getelementptr ptr, ptr %objects, i64 %r
  %r.object = load ptr, ptr %r.object.at
  %r.none = icmp eq ptr %r.object, null
  br i1 %r.none, label %released, label %decrease
decrease:
  %decrease.function = load ptr, ptr $Py_DecRef
  call void %decrease.function(ptr %r.object)
  br label %released
released:
  %r.next = add i64 %r, 1
  %r.more = icmp slt i64 %r.next, %arrays
  br i1 %r.more, label %release, label %done
done:
  ret ptr %result
}
""")
