// Checks of tests: a check that fails prints what it is and where, and the test fails at its end.

#ifndef CHECK_HPP
#define CHECK_HPP

#include <cmath>
#include <cstdio>
#include <string>

inline int failed_checks = 0;

inline bool check(bool is_true, const char* text, const char* file, int line)
{
    if (!is_true) {
        std::printf("%s:%d: failed: %s\n", file, line, text);
        ++failed_checks;
    }
    return is_true;
}

inline bool near(double value, double expected, double tolerance = 1e-12)
{
    return std::abs(value - expected) <= tolerance;
}

inline bool contains(const std::string& text, const std::string& part)
{
    const bool found = text.find(part) != std::string::npos;
    if (!found) {
        std::printf("'%s' does not contain '%s'\n", text.c_str(), part.c_str());
    }
    return found;
}

/// The exit status of the test.
inline int report()
{
    std::printf(failed_checks == 0 ? "all checks passed\n" : "%d checks failed\n", failed_checks);
    return failed_checks == 0 ? 0 : 1;
}

#define CHECK(condition) check((condition), #condition, __FILE__, __LINE__)

#endif
