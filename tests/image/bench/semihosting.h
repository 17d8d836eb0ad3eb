/**
 * Files of the machine that runs the emulator, by ARM semihosting (ARM IHI 0100, T32: BKPT 0xAB).
 * For programs on the emulator only: without a debugger the breakpoint is a fault.
 */
#ifndef SEMIHOSTING_H
#define SEMIHOSTING_H

#include <stddef.h>
#include <stdint.h>

#define SEMIHOSTING_READ_BINARY 1U
#define SEMIHOSTING_WRITE_BINARY 5U

static inline int32_t semihosting_call(uint32_t operation, const void *arguments) {
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return (int32_t)r0;
}

/** Handle of a file in the emulator's working folder; -1: there is none. */
static inline int32_t semihosting_open(const char *name, size_t length, uint32_t mode) {
    const uint32_t arguments[3] = {(uint32_t)(uintptr_t)name, mode, length};
    return semihosting_call(0x01, arguments);
}

/** Bytes that were not read. */
static inline int32_t semihosting_read(int32_t handle, void *content, size_t size) {
    const uint32_t arguments[3] = {(uint32_t)handle, (uint32_t)(uintptr_t)content, size};
    return semihosting_call(0x06, arguments);
}

/** Bytes that were not written. */
static inline int32_t semihosting_write(int32_t handle, const void *content, size_t size) {
    const uint32_t arguments[3] = {(uint32_t)handle, (uint32_t)(uintptr_t)content, size};
    return semihosting_call(0x05, arguments);
}

/** Ends the emulator with this exit status. */
_Noreturn static inline void semihosting_exit(uint32_t status) {
    const uint32_t arguments[2] = {0x20026U, status}; /* ADP_Stopped_ApplicationExit */
    (void)semihosting_call(0x20, arguments);
    for (;;) {
    }
}

#endif
