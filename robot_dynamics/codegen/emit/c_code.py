"""Programs as C99: a header and a source that need nothing but math.h, compile as C++ too, and keep no state.

No memory is allocated, and a function reads all that it is given before it writes, so that outputs may lie where inputs
do. It may be called from several threads at once.
"""

import textwrap

from robot_dynamics.codegen.emit.code_text import (
    UniqueNames,
    VariableNames,
    float_literal,
    input_comment,
    joints_comment,
    operations_used,
    output_comment,
    sanitize_comment,
    setup_nodes,
)
from robot_dynamics.codegen.trace.scalar import PARAMETER, SIGN

KEYWORDS = """
    alignas alignof and and_eq asm atomic_cancel atomic_commit atomic_noexcept auto bitand bitor bool break case catch
    char char8_t char16_t char32_t class co_await co_return co_yield compl complex concept const consteval constexpr
    constinit const_cast continue decltype default delete do double dynamic_cast else enum explicit export extern false
    final float for fortran friend goto if imaginary import inline int long module mutable namespace new noexcept not
    not_eq nullptr operator or or_eq override private protected public reflexpr register reinterpret_cast requires
    restrict return short signed sizeof static static_assert static_cast struct switch synchronized template this
    thread_local throw true try typedef typeid typename typeof typeof_unqual union unsigned using virtual void volatile
    wchar_t while xor xor_eq
"""
MACROS = """
    CHAR_BIT EOF FP_FAST_FMA FP_FAST_FMAF FP_FAST_FMAL FP_ILOGB0 FP_ILOGBNAN FP_INFINITE FP_NAN FP_NORMAL FP_SUBNORMAL
    FP_ZERO HUGE HUGE_VAL HUGE_VALF HUGE_VALL I INFINITY MATH_ERREXCEPT MATH_ERRNO M_1_PI M_2_PI M_2_SQRTPI M_E M_LN10
    M_LN2 M_LOG10E M_LOG2E M_PI M_PI_2 M_PI_4 M_SQRT1_2 M_SQRT2 MAXFLOAT NAN NDEBUG NULL assert errno fpclassify i386
    isfinite isgreater isgreaterequal isinf isless islessequal islessgreater isnan isnormal isunordered linux
    math_errhandling mips offsetof setjmp signbit sparc stderr stdin stdout unix
"""
MATH = """
    acos acosh asin asinh atan atan2 atanh cabs cacos cacosh canonicalize carg casin casinh catan catanh cbrt ccos
    ccosh ceil cexp cimag clog clog10 conj copysign cos cosh cpow cproj creal csin csinh csqrt ctan ctanh drem erf
    erfc exp exp10 exp2 expm1 fabs fdim finite floor fma fmax fmaxmag fmin fminmag fmod frexp gamma hypot ilogb
    isinf isnan j0 j1 jn ldexp lgamma llogb llrint llround log log10 log1p log2 logb lrint lround modf nan nearbyint
    nextafter nextdown nexttoward nextup pow pow10 remainder remquo rint round roundeven scalb scalbln scalbn
    signbit significand sin sincos sinh sqrt tan tanh tgamma trunc y0 y1 yn
"""
MATH_SUFFIXES = "f l f_r l_r _r f16 f32 f32x f64 f64x f128 d32 d64 d128"  # of other types of numbers
LIBRARY = """
    abort abs aligned_alloc alloca arc4random atexit atof atoi atol atoll bcmp bcopy bsearch bzero calloc clearerr
    clock clock_t close ctime dadd dcgettext ddiv dfma dgettext difftime div dmul double_t dsqrt dsub execl execle
    execlp execv execve execvp exit fadd fclose fdiv feclearexcept fegetenv fegetexceptflag fegetround feholdexcept
    feof feraiseexcept ferror fesetenv fesetexceptflag fesetround fetestexcept feupdateenv fflush ffma ffs ffsimax
    ffsl ffsll fgetc fgetpos fgets float_t fmul fopen fork fprintf fprintf_unlocked fputc fputc_unlocked fputs
    fputs_unlocked fread free freopen fscanf fseek fsetpos fsqrt fsub ftell fwrite fwrite_unlocked getc getchar
    getenv gets gettext gmtime imaxabs imaxdiv index int16_t int32_t int64_t int8_t isalnum isalpha isascii isblank
    iscntrl isdigit isgraph islower isprint ispunct isspace isupper iswalnum iswalpha iswblank iswcntrl iswdigit
    iswgraph iswlower iswprint iswpunct iswspace iswupper iswxdigit isxdigit key_t labs ldiv link llabs lldiv
    localeconv localtime longjmp main malloc max_align_t mblen mbstowcs memchr memcmp memcpy memmove mempcpy memset
    mktime open perror pipe posix_memalign printf printf_unlocked ptrdiff_t putc putc_unlocked putchar
    putchar_unlocked puts puts_unlocked qsort raise rand read realloc remove rename rewind rindex scanf setbuf
    setlocale setvbuf signal signgam size_t snprintf sprintf srand sscanf std stpcpy stpncpy strcasecmp strcat
    strchr strcmp strcoll strcpy strcspn strdup strerror strfmon strftime strlen strncasecmp strncat strncmp strncpy
    strndup strnlen strpbrk strrchr strspn strstr strtod strtof strtok strtol strtold strtoll strtoul strtoull
    strxfrm system time time_t tmpfile tmpnam toascii tolower toupper towlower towupper uint uint16_t uint32_t
    uint64_t uint8_t ungetc unlink va_list vfprintf vfscanf vprintf vscanf vsnprintf vsprintf vsscanf wait write
"""
RESERVED = {*KEYWORDS.split(), *MACROS.split(), *MATH.split(), *LIBRARY.split(), "settled", "given", "sign_of"}
RESERVED |= {name + suffix for name in MATH.split() for suffix in MATH_SUFFIXES.split()}
OPERATION_LABELS = ("multiplications", "additions", "divisions", "sines and cosines", "square roots", "signs")
WIDTH = 110
SIGN_FUNCTION = """
/* 1, -1 or 0; NaN of NaN */
static double sign_of(double x)
{
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);
}
"""


def c_name(program, prefix=""):
    """The name of the function that computes a program; the source includes its header as <name>.h."""
    return _Writer(program, prefix).function


def c_source(program, prefix="", joint_names=(), other_vectors=()):
    """(header, source): the texts of <name>.h, which C++ can include too, and of the source that goes with it.

    They define `void <name>(const double q[7], ..., double efforts[7])`, where <name> is prefix and name of the
    program as far as C allows. An output with more than one axis is given row by row. Where the program has parameters,
    `void <name>_setup(<name>_settled *settled, const double given[])` fills a struct with what depends on them alone,
    to which the last argument before the outputs points. joint_names: what comments call the entries of joint vectors;
    others: (sentence, names) of vectors that have other joints.
    """
    writer = _Writer(program, prefix)
    return writer.header(joints_comment(joint_names, other_vectors)), writer.source()


class _Writer:
    """A program and the names that its parts have in C."""

    def __init__(self, program, prefix):
        name = UniqueNames(RESERVED).take(f"{prefix}{program.name}", "model")
        self.program, self.guard = program, f"{name.upper()}_H"
        self.struct, self.setup = f"{name}_settled", f"{name}_setup"
        variables = VariableNames(
            program, UniqueNames(RESERVED | {self.guard, self.struct, self.setup}), _literal, prefix
        )
        self.variables, self.nodes, self.function = variables, variables.nodes, variables.function
        self.settled = setup_nodes(program)

    def header(self, joints):
        """The text of the header, with lines about the joints."""
        declarations = [f"{self._signature()};"]
        if self.program.parameters:
            # a struct of C has at least one member
            fields = [f"double {self.nodes[node]};" for node in self.settled] or ["double unused;"]
            struct = f"typedef struct {{\n{_lines(fields)}\n}} {self.struct};"
            declarations = [struct, f"{self._setup_signature()};", *declarations]
        parts = [
            _comment(self._told(joints)),
            f"#ifndef {self.guard}\n#define {self.guard}",
            '#ifdef __cplusplus\nextern "C" {\n#endif',
            *declarations,
            "#ifdef __cplusplus\n}\n#endif",
            "#endif",
        ]
        return "\n\n".join(parts) + "\n"

    def source(self):
        """The text of the source."""
        program = self.program
        parts = [
            _comment(
                [
                    f"{sanitize_comment(program.name)}: a model of a robot in straight lines, generated by robot_dynamics."
                ]
            ),
            f'#include <math.h>\n\n#include "{self.function}.h"',
        ]
        if SIGN in operations_used(program):
            parts.append(SIGN_FUNCTION.strip("\n"))
        if program.parameters:
            parts.append(f"{self._setup_signature()}\n{{\n{_lines(self._setup_body())}\n}}")
        parts.append(f"{self._signature()}\n{{\n{_lines(self._body())}\n}}")
        return "\n\n".join(parts) + "\n"

    def _told(self, joints):
        """Lines about the model."""
        program = self.program
        counts = zip(OPERATION_LABELS, program.operations, strict=True)
        told = [f"{kind} {count}" for kind, count in counts if count]
        lines = [
            f"{sanitize_comment(program.name)}: a model of a robot in straight lines, generated by robot_dynamics.",
            "",
        ]
        lines += [*joints, ""] if joints else []
        lines += ["Inputs:", *(f"    {input_comment(*pair)}" for pair in program.inputs.items())]
        lines += ["Outputs, which may lie where inputs do but not where other outputs do:"]
        lines += [f"    {output_comment(output)}" for output in program.outputs]
        if program.parameters:
            lines += [f"Parameters, given to {self.setup}:"]
            lines += [f"    {place}: {sanitize_comment(name)}" for place, name in enumerate(program.parameters)]
        lines.append(f"Operations of a call: {', '.join(told) or 'none'}.")
        return lines

    def _signature(self):
        names = self.variables
        arguments = [_array("const double", names.inputs[name], size) for name, size in self.program.inputs.items()]
        if self.program.parameters:
            arguments.append(f"const {self.struct} *settled")
        for name, output in zip(names.outputs, self.program.outputs, strict=True):
            arguments.append(_array("double", name, len(output.entries)))
        return _call(f"void {self.function}", arguments)

    def _setup_signature(self):
        given = _array("const double", "given", len(self.program.parameters))
        return _call(f"void {self.setup}", [f"{self.struct} *settled", given])

    def _setup_body(self):
        places = {name: place for place, name in enumerate(self.program.parameters)}
        lines = []
        for number, operation, operands in self.program.leaves:
            if operation == PARAMETER:
                lines.append(f"const double {self.nodes[number]} = given[{places[operands[0]]}];")
        lines += self._statements(self.program.setup)
        lines += [f"settled->{self.nodes[node]} = {self.nodes[node]};" for node in self.settled]
        return lines if self.settled else [*lines, "(void)settled;"]

    def _body(self):
        program, names = self.program, self.variables
        lines = []
        for name in program.inputs:
            read = names.used_entries(program, name)
            given = names.inputs[name]
            lines += [f"const double {entry} = {given}[{place}];" for place, entry in sorted(read.items())]
            lines += [f"(void){given};"] * (not read)
        if program.parameters:
            lines += [f"const double {self.nodes[node]} = settled->{self.nodes[node]};" for node in self.settled]
            lines += ["(void)settled;"] * (not self.settled)
        else:
            lines += self._statements(program.setup)
        lines += self._statements(program.statements)
        for name, output in zip(names.outputs, program.outputs, strict=True):
            lines += [f"{name}[{place}] = {entry};" for place, entry in enumerate(names.entries(output))]
            lines += [f"(void){name};"] * (not output.entries)
        return lines

    def _statements(self, statements):
        lines = []
        for statement in statements:
            right = self.variables.expression(statement)
            if statement.operation == SIGN:
                right = f"sign_of({self.nodes[statement.operands[0]]})"
            lines.append(f"const double {self.nodes[statement.number]} = {right};")
        return lines


def _literal(value):
    return float_literal(value, "(double)INFINITY", "(double)NAN")


def _array(kind, name, size):
    """A parameter that is an array; C has none without entries."""
    return f"{kind} {name}[{size}]" if size else f"{kind} *{name}"


def _call(name, arguments):
    """The head of a function, in lines that are not too long."""
    whole = [argument.replace(" ", "\0") for argument in arguments or ["void"]]  # no line ends within one
    text = f"{name.replace(' ', chr(0))}({', '.join(whole)})"
    wrapped = textwrap.fill(text, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return wrapped.replace("\0", " ")


def _lines(statements):
    return "\n".join(f"    {line}" for line in statements)


def _comment(lines):
    """A comment of some lines, none of which may end it."""
    return "/*\n" + "\n".join(f" * {line}".rstrip() for line in lines) + "\n */"
