"""Sines and cosines of vectors, as LLVM IR text: both share the reduction of the angle to [-π/4, π/4].

Up to MAX_ANGLE both are within 2 ulp. Beyond it, and on processors without fused multiply-add, the C library computes
each number, with an exact reduction of any angle. Of nan and of ±inf both are nan.

Source: W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980, for the reduction; the polynomials
are those of FDLIBM (Sun Microsystems, 1993), e_rem_pio2.c and k_sin.c, k_cos.c.
"""

import struct
from collections.abc import Sequence

RUNTIME = "@runtime = external global ptr"
"""Declares the table of functions of the process."""

MAX_ANGLE = 2.0**30
"""[rad] Up to here k = round(x / (π/2)) times the third part of π/2 is far below half an ulp of any remainder."""

HALF_PI = ("0x3FF921FB54442D18", "0x3C91A62633145C07", "0xB91F1976B7ED8FBC")
"""π/2 as a sum of three doubles P1, P2, P3, within 2^-160.

With a fused multiply-add x - k P1 is exact for any k: it is a multiple of 2^-52, or of the last place of x, below 1.
"""

ROUNDING_SHIFT = 1.5 * 2.0**52
"""Added to a number below 2^51 in magnitude, it leaves the nearest integer in the last bits of the mantissa."""

SINE_COEFFICIENTS = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE_COEFFICIENTS = (
    -0.5,
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def double_literal(value: float) -> str:
    """A double as exact IR text."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"


def vector_type(lanes: int) -> str:
    """The type of a vector of doubles."""
    return f"<{lanes} x double>"


def splat(text: str | int, element: str = "double") -> str:
    """A constant vector with the same number in each lane."""
    return f"splat ({element} {text})"


def out_of_range_mask(name: str, x: str, lanes: int) -> list[str]:
    """IR lines that define `%name`, an integer with a bit for each lane: whether that lane of x is out of range.

    nan is within range: the polynomials give nan.
    """
    V = vector_type(lanes)
    return [
        f"%{name}.size = call {V} @llvm.fabs.v{lanes}f64({V} {x})",
        f"%{name}.lanes = fcmp ogt {V} %{name}.size, {splat(double_literal(MAX_ANGLE))}",
        f"%{name} = bitcast <{lanes} x i1> %{name}.lanes to i{lanes}",
    ]


def sincos_module(lanes: int, fused: bool) -> str:
    """IR text of `@sincos_anywhere<lanes>`: a vector of angles [rad] to {sines, cosines}.

    It is the same for all programs. `fused`: whether the processor has a fused multiply-add.
    """
    V = vector_type(lanes)
    library = [] if not fused else [_library(lanes)]
    return "\n".join(
        [
            RUNTIME,
            *library,
            sincos_function(lanes, fused),
            f"define {{{V}, {V}}} @sincos_anywhere{lanes}({V} %x) noinline {{",
            *out_of_range_mask("is_out_of_range", "%x", lanes),
            f"%within = icmp eq i{lanes} %is_out_of_range, 0",
            "br i1 %within, label %fast, label %exact",
            "fast:",
            f"%near = call {{{V}, {V}}} @sincos{lanes}({V} %x)",
            f"ret {{{V}, {V}}} %near",
            "exact:",
            f"%far = call {{{V}, {V}}} @sincos_library{lanes}({V} %x)",
            f"ret {{{V}, {V}}} %far",
            "}",
        ]
    )


def sincos_declaration(lanes: int) -> str:
    """IR text that declares `@sincos_anywhere<lanes>`."""
    V = vector_type(lanes)
    return f"declare {{{V}, {V}}} @sincos_anywhere{lanes}({V})"


def sincos_function(lanes: int, fused: bool) -> str:
    """IR text of `@sincos<lanes>`, valid for angles within the range; the module must declare `@runtime`."""
    V = vector_type(lanes)
    declarations = [
        f"declare {V} @llvm.fma.v{lanes}f64({V}, {V}, {V})",
        f"declare {V} @llvm.fabs.v{lanes}f64({V})",
    ]
    library = [f"%both = call {{{V}, {V}}} @sincos_library{lanes}({V} %x)"]
    return "\n".join(
        [
            *declarations,
            *([] if fused else [_library(lanes)]),
            f"define internal {{{V}, {V}}} @sincos{lanes}({V} %x) alwaysinline {{",
            *(_polynomials(lanes) if fused else library),
            f"ret {{{V}, {V}}} %both",
            "}",
        ]
    )


def _library(lanes: int) -> str:
    """IR text of `@sincos_library<lanes>`: each lane by the C library, whose functions are in `@runtime`."""
    V = vector_type(lanes)
    return f"""define internal {{{V}, {V}}} @sincos_library{lanes}({V} %x) noinline cold {{
entry:
  %sin = load ptr, ptr getelementptr ([0 x ptr], ptr @runtime, i64 0, i64 0)
  %cos = load ptr, ptr getelementptr ([0 x ptr], ptr @runtime, i64 0, i64 1)
  %angles = alloca {V}
  %sines = alloca {V}
  %cosines = alloca {V}
  store {V} %x, ptr %angles
  br label %lane
lane:
  %index = phi i64 [0, %entry], [%next, %lane]
  %angle.at = getelementptr double, ptr %angles, i64 %index
  %sine.at = getelementptr double, ptr %sines, i64 %index
  %cosine.at = getelementptr double, ptr %cosines, i64 %index
  %angle = load double, ptr %angle.at
  %sine = call double %sin(double %angle)
  store double %sine, ptr %sine.at
  %cosine = call double %cos(double %angle)
  store double %cosine, ptr %cosine.at
  %next = add i64 %index, 1
  %more = icmp slt i64 %next, {lanes}
  br i1 %more, label %lane, label %done
done:
  %all.sines = load {V}, ptr %sines
  %all.cosines = load {V}, ptr %cosines
  %first = insertvalue {{{V}, {V}}} poison, {V} %all.sines, 0
  %both = insertvalue {{{V}, {V}}} %first, {V} %all.cosines, 1
  ret {{{V}, {V}}} %both
}}"""


def _pair(V: str, sines: str, cosines: str) -> list[str]:
    """IR lines that define %both, {sines, cosines}."""
    return [
        f"%first = insertvalue {{{V}, {V}}} poison, {V} {sines}, 0",
        f"%both = insertvalue {{{V}, {V}}} %first, {V} {cosines}, 1",
    ]


def _polynomials(lanes: int) -> list[str]:
    """IR lines from %x to %both.

    No flag allows LLVM to reorder them: the rounding step and the remainder depend on exact operations.
    """
    V = vector_type(lanes)
    words = f"<{lanes} x i64>"
    lines: list[str] = []

    def fma(name: str, a: str, b: str, c: str) -> str:
        lines.append(f"%{name} = call {V} @llvm.fma.v{lanes}f64({V} {a}, {V} {b}, {V} {c})")
        return f"%{name}"

    def constant(value: str | float) -> str:
        return splat(value if isinstance(value, str) else double_literal(value))

    def polynomial(name: str, coefficients: Sequence[float]) -> str:
        value = constant(coefficients[-1])
        for degree, coefficient in reversed(list(enumerate(coefficients[:-1]))):
            value = fma(f"{name}{degree}", "%z", value, constant(coefficient))
        return value

    shifted = fma("shifted", "%x", constant("0x3FE45F306DC9C883"), constant(ROUNDING_SHIFT))  # x 2/π
    lines += [f"%k = fsub {V} {shifted}, {constant(ROUNDING_SHIFT)}", f"%minus_k = fneg {V} %k"]
    remainder = "%x"
    for index, part in enumerate(HALF_PI):
        remainder = fma(f"r{index}", "%minus_k", constant(part), remainder)
    lines += [f"%z = fmul {V} {remainder}, {remainder}", f"%rz = fmul {V} {remainder}, %z"]
    sine = fma("sine", "%rz", polynomial("s", SINE_COEFFICIENTS), remainder)
    cosine = fma("cosine", "%z", polynomial("c", COSINE_COEFFICIENTS), constant(1.0))
    # k mod 4, the quadrant, is in the last two bits of `shifted`: odd quadrants swap sine and cosine, and bit 1 of k
    # (sine) or of k + 1 (cosine) negates
    lines += [
        f"%quadrant = bitcast {V} {shifted} to {words}",
        f"%next = add {words} %quadrant, {splat(1, 'i64')}",
        f"%bit = and {words} %quadrant, {splat(1, 'i64')}",
        f"%odd = icmp ne {words} %bit, zeroinitializer",
    ]
    for name, even, odd, quadrant in (("sin", sine, cosine, "quadrant"), ("cos", cosine, sine, "next")):
        lines += [
            f"%{name}.size = select <{lanes} x i1> %odd, {V} {odd}, {V} {even}",
            f"%{name}.bits = bitcast {V} %{name}.size to {words}",
            f"%{name}.high = shl {words} %{quadrant}, {splat(62, 'i64')}",
            f"%{name}.sign = and {words} %{name}.high, {splat(-(2**63), 'i64')}",
            f"%{name}.signed = xor {words} %{name}.bits, %{name}.sign",
            f"%{name} = bitcast {words} %{name}.signed to {V}",
        ]
    return [*lines, *_pair(V, "%sin", "%cos")]
