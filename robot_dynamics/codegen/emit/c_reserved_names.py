"""Names that generated C must not define: keywords of C and C++, macros, and functions of the standard library."""

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
MATH_SUFFIXES = "f l f_r l_r _r f16 f32 f32x f64 f64x f128 d32 d64 d128"
"""Suffixes of the functions of math.h for other types of numbers."""

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
GENERATED = "constants parameters sign_of"
"""Names in the generated source itself."""

RESERVED_NAMES = {*KEYWORDS.split(), *MACROS.split(), *MATH.split(), *LIBRARY.split(), *GENERATED.split()}
RESERVED_NAMES |= {name + suffix for name in MATH.split() for suffix in MATH_SUFFIXES.split()}
