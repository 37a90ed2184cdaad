// Replaces malloc and its kin by ones that count, whoever calls them. Include it in one file of a program.

#ifndef COUNTED_ALLOCATIONS_HPP
#define COUNTED_ALLOCATIONS_HPP

#include <cstddef>
#include <cstdlib>

namespace {
thread_local bool is_counting = false; // in this thread
unsigned long allocations = 0;
} // namespace

extern "C" {

// of the GNU C library, which calls the functions below wherever it allocates for others
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* pointer, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size)
{
    allocations += is_counting;
    return __libc_malloc(size);
}

void* calloc(std::size_t count, std::size_t size)
{
    allocations += is_counting;
    return __libc_calloc(count, size);
}

void* realloc(void* pointer, std::size_t size)
{
    allocations += is_counting;
    return __libc_realloc(pointer, size);
}

void* aligned_alloc(std::size_t alignment, std::size_t size)
{
    allocations += is_counting;
    return __libc_memalign(alignment, size);
}
}

#endif
