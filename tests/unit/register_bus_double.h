/**
 * The register bus of the unit tests: keeps what is written, records every access in order, and
 * lets a test answer as the hardware would.
 */
#ifndef REGISTER_BUS_DOUBLE_H
#define REGISTER_BUS_DOUBLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint32_t address;
    uint32_t value;
} register_value_t;

/** What a read gives, or a write leaves; content: what the register holds. */
typedef uint32_t (*register_read_hook_t)(uint32_t address, uint32_t content);
typedef uint32_t (*register_write_hook_t)(uint32_t address, uint32_t content, uint32_t value);

/** All registers 0, nothing recorded, no hooks. */
void bus_reset(void);

/** Reads give 0 and writes are lost, as in emulation. */
void bus_set_absent(void);

void bus_on_read(register_read_hook_t hook);
void bus_on_write(register_write_hook_t hook);

/** The content of a register, without an access. */
void bus_set(uint32_t address, uint32_t value);
uint32_t bus_get(uint32_t address);

/** Reads and writes so far, or since bus_forget(). */
size_t bus_reads(void);
size_t bus_writes(void);
void bus_forget(void);

/** Fails the test unless just these writes were made, in this order, since the last bus_forget().
 */
void bus_expect_writes(const register_value_t *expected, size_t count);

#define BUS_EXPECT_WRITES(...)                                                                     \
    bus_expect_writes((const register_value_t[]){__VA_ARGS__},                                     \
                      sizeof((const register_value_t[]){__VA_ARGS__}) / sizeof(register_value_t))

#endif
