/**
 * How drivers reach registers: two functions and what is made of them.
 *
 * In the image they are single volatile accesses, without call. With REGISTER_BUS_DOUBLE defined
 * (unit tests on the host) they are functions of the test's register bus, which records every
 * access in order and answers as the hardware would (tests/unit/register_bus_double.h).
 */
#ifndef REGISTER_BUS_H
#define REGISTER_BUS_H

#include <stdint.h>

#ifdef REGISTER_BUS_DOUBLE

/** Content of the register at this address. */
uint32_t register_read(uint32_t address);
/** Writes the whole register at this address. */
void register_write(uint32_t address, uint32_t value);

#else

/** Content of the register at this address. */
static inline uint32_t register_read(uint32_t address) {
    return *(volatile uint32_t *)(uintptr_t)address;
}

/** Writes the whole register at this address. */
static inline void register_write(uint32_t address, uint32_t value) {
    *(volatile uint32_t *)(uintptr_t)address = value;
}

#endif

/** Value at the place of a field. mask: not 0, its bits side by side; excess bits are cut. */
static inline uint32_t register_field(uint32_t mask, uint32_t value) {
    return (value * (mask & (0U - mask))) & mask;
}

/** What a register's content says in a field. mask: not 0. */
static inline uint32_t register_field_of(uint32_t mask, uint32_t content) {
    return (content & mask) / (mask & (0U - mask));
}

/** Reads a register (address), changes the bits of mask to those of value (in place), and writes
 * it: not atomic. */
static inline void register_modify(uint32_t address, uint32_t mask, uint32_t value) {
    register_write(address, (register_read(address) & ~mask) | (value & mask));
}

/** Sets the bits of mask at an address; not atomic. */
static inline void register_set(uint32_t address, uint32_t mask) {
    register_modify(address, mask, mask);
}

/** Clears the bits of mask at an address; not atomic. */
static inline void register_clear(uint32_t address, uint32_t mask) {
    register_modify(address, mask, 0);
}

/** Reads an address until the bits of mask are those of value, attempts times at most: 0 = they
 * never were. */
static inline int register_wait(uint32_t address, uint32_t mask, uint32_t value,
                                uint32_t attempts) {
    for (uint32_t left = attempts; left > 0U; left--) {
        if ((register_read(address) & mask) == value) {
            return 1;
        }
    }
    return 0;
}

#endif
