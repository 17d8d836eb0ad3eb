#include "allocation_counter.h"

#include <cstddef>
#include <cstdlib>
#include <new>

namespace {

long count = 0;

} // namespace

long test::allocations() {
    return count;
}

extern "C" {
void *__real_malloc(std::size_t size);
void *__wrap_malloc(std::size_t size);

void *__wrap_malloc(std::size_t size) {
    ++count;
    return __real_malloc(size);
}
}

void *operator new(std::size_t size) {
    if (void *memory = __wrap_malloc(size)) {
        return memory;
    }
    throw std::bad_alloc();
}

void operator delete(void *memory) noexcept {
    std::free(memory);
}
void operator delete(void *memory, std::size_t) noexcept {
    std::free(memory);
}
