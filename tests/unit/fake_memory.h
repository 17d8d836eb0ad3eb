/* A parameter memory that loses power after a given number of bytes. */
#ifndef FAKE_MEMORY_H
#define FAKE_MEMORY_H

#include <string.h>

#include "node/parameter_store.h"

typedef struct {
    uint8_t bytes[2][PARAMETER_STORE_COPY_BYTES];
    size_t budget; /* bytes that can still be erased or written */
    bool written_twice;
    bool unreadable;
} fake_memory_t;

static inline bool fake_read(void *context, uint8_t copy, size_t offset, uint8_t *data,
                             size_t size) {
    const fake_memory_t *fake = context;
    memcpy(data, &fake->bytes[copy][offset], size);
    return !fake->unreadable;
}

static inline bool fake_erase(void *context, uint8_t copy) {
    fake_memory_t *fake = context;
    for (size_t i = 0; i < PARAMETER_STORE_COPY_BYTES; i++) {
        if (fake->budget == 0U) {
            return false;
        }
        fake->budget--;
        fake->bytes[copy][i] = 0xFF;
    }
    return true;
}

static inline bool fake_write(void *context, uint8_t copy, size_t offset, const uint8_t *data,
                              size_t size) {
    fake_memory_t *fake = context;
    for (size_t i = 0; i < size; i++) {
        if (fake->budget == 0U) {
            return false;
        }
        fake->budget--;
        fake->written_twice = fake->written_twice || fake->bytes[copy][offset + i] != 0xFFU;
        fake->bytes[copy][offset + i] = data[i];
    }
    return true;
}

static inline parameter_memory_t fake_memory(fake_memory_t *fake) {
    memset(fake, 0xFF, sizeof *fake);
    fake->budget = SIZE_MAX;
    fake->written_twice = false;
    fake->unreadable = false;
    const parameter_memory_t memory = {
        .context = fake, .read = fake_read, .erase = fake_erase, .write = fake_write};
    return memory;
}

#endif
