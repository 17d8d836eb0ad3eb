#include "register_bus_double.h"

#include <stdio.h>

#include "unity.h"

#include "port/stm32f405/register_bus.h"

enum { REGISTERS_MAX = 256, WRITES_MAX = 512 };

static register_value_t contents[REGISTERS_MAX];
static size_t used;
static register_value_t writes[WRITES_MAX];
static size_t write_count;
static size_t read_count;
static bool absent;
static register_read_hook_t read_hook;
static register_write_hook_t write_hook;

static uint32_t *content_of(uint32_t address) {
    for (size_t i = 0; i < used; i++) {
        if (contents[i].address == address) {
            return &contents[i].value;
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(used < REGISTERS_MAX, "more registers than the double has");
    contents[used] = (register_value_t){.address = address};
    return &contents[used++].value;
}

void bus_reset(void) {
    used = 0;
    absent = false;
    read_hook = NULL;
    write_hook = NULL;
    bus_forget();
}

void bus_set_absent(void) {
    absent = true;
}

void bus_on_read(register_read_hook_t hook) {
    read_hook = hook;
}

void bus_on_write(register_write_hook_t hook) {
    write_hook = hook;
}

void bus_set(uint32_t address, uint32_t value) {
    *content_of(address) = value;
}

uint32_t bus_get(uint32_t address) {
    return *content_of(address);
}

size_t bus_reads(void) {
    return read_count;
}

size_t bus_writes(void) {
    return write_count;
}

void bus_forget(void) {
    read_count = 0;
    write_count = 0;
}

uint32_t register_read(uint32_t address) {
    read_count++;
    if (absent) {
        return 0;
    }
    uint32_t *content = content_of(address);
    return read_hook != NULL ? read_hook(address, *content) : *content;
}

void register_write(uint32_t address, uint32_t value) {
    if (write_count < WRITES_MAX) {
        writes[write_count] = (register_value_t){.address = address, .value = value};
    }
    write_count++;
    if (absent) {
        return;
    }
    const uint32_t content = *content_of(address);
    const uint32_t left = write_hook != NULL ? write_hook(address, content, value) : value;
    *content_of(address) = left;
}

void bus_expect_writes(const register_value_t *expected, size_t count) {
    char what[64];
    for (size_t i = 0; i < count && i < write_count && i < WRITES_MAX; i++) {
        (void)snprintf(what, sizeof what, "write %u", (unsigned)i);
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(expected[i].address, writes[i].address, what);
        TEST_ASSERT_EQUAL_HEX32_MESSAGE(expected[i].value, writes[i].value, what);
    }
    TEST_ASSERT_EQUAL_UINT_MESSAGE(count, write_count, "number of writes");
}
