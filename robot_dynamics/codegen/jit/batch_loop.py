"""The loop over samples, as LLVM IR text: blocks of as many samples as a vector has lanes.

Threads that compute one batch take the next chunk of its samples until none is left, so that no thread waits for one
that started late or runs on a busy core.
"""

from string import Template


def batch_function(arrays: int, lanes: int) -> str:
    """IR of `@batch(ptr %pointers, ptr %strides, ptr %next, i64 %chunk, i64 %samples)` for a number of arrays.

    Row i of an array is i strides [bytes] after its pointer. %next points to the number of the first sample that no
    thread has taken, which grows by a chunk at a time. Spare lanes of the last block of a chunk compute its last sample
    again. A sample with an angle out of the range of the vector functions is computed again by `@sample`. Outputs must
    not overlap inputs.
    """
    rows = "".join(ROW.substitute(array=array) for array in range(arrays))
    return BATCH.substitute(arrays=arrays, lanes=lanes, rows=rows)


ROW = Template("""
  %from$array.at = getelementptr inbounds ptr, ptr %pointers, i64 $array
  %from$array = load ptr, ptr %from$array.at, align 8
  %stride$array.at = getelementptr inbounds i64, ptr %strides, i64 $array
  %stride$array = load i64, ptr %stride$array.at, align 8
  %offset$array = mul i64 %sample, %stride$array
  %row$array = getelementptr i8, ptr %from$array, i64 %offset$array
  %row$array.at = getelementptr inbounds ptr, ptr %rows, i64 $array
  store ptr %row$array, ptr %row$array.at, align 8""")

BATCH = Template("""
declare void @sample(ptr)
declare i64 @llvm.smin.i64(i64, i64)
define void @batch(ptr %pointers, ptr %strides, ptr %next, i64 %chunk, i64 %samples) noinline {
entry:
  br label %take
take:
  %start = atomicrmw add ptr %next, i64 %chunk monotonic
  %all = add i64 %start, %chunk
  %end = call i64 @llvm.smin.i64(i64 %all, i64 %samples)
  %last = sub i64 %end, 1
  %some = icmp slt i64 %start, %samples
  br i1 %some, label %blocks, label %done
blocks:
  %first = phi i64 [%start, %take], [%following, %continue]
  %following = add i64 %first, $lanes
  %mask = call i$lanes @block(ptr %pointers, ptr %strides, i64 %first, i64 %last)
  %right = icmp eq i$lanes %mask, 0
  br i1 %right, label %continue, label %again
again:
  call void @recompute(ptr %pointers, ptr %strides, i64 %first, i64 %last, i$lanes %mask)
  br label %continue
continue:
  %more = icmp slt i64 %following, %end
  br i1 %more, label %blocks, label %take
done:
  ret void
}
define internal void @recompute(ptr %pointers, ptr %strides, i64 %first, i64 %last, i$lanes %mask) noinline cold {
entry:
  %rows = alloca [$arrays x ptr]
  br label %lanes
lanes:
  %sample = phi i64 [%first, %entry], [%next, %continue]
  %left = phi i$lanes [%mask, %entry], [%rest, %continue]
  %is_marked = trunc i$lanes %left to i1
  %within = icmp sle i64 %sample, %last
  %computed = and i1 %is_marked, %within
  br i1 %computed, label %compute, label %continue
compute:$rows
  call void @sample(ptr %rows)
  br label %continue
continue:
  %next = add i64 %sample, 1
  %rest = lshr i$lanes %left, 1
  %more = icmp ne i$lanes %rest, 0
  br i1 %more, label %lanes, label %done
done:
  ret void
}
""")
