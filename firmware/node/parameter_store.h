/**
 * Keeps the configuration of the node over power loss (objects 1010h and 1011h, LSS store).
 *
 * Two copies in turn: a save erases the older one and writes it anew, with a sequence number and a
 * CRC-32 over all of it, so that power loss at any byte leaves the old set or the new one. A copy
 * names each value by index and subindex; a load skips what a newer firmware does not have and what
 * is out of range there.
 */
#ifndef PARAMETER_STORE_H
#define PARAMETER_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "od/object_dictionary.h"

/** Bytes that a copy may take. */
#define PARAMETER_STORE_COPY_BYTES 2048U

/**
 * Non-volatile memory, provided by the port. copy: 0 or 1; offset + size <=
 * PARAMETER_STORE_COPY_BYTES. Each byte is written once after an erase. All return false on
 * failure; bytes never written are none: they read as any value, 0xFF where erased.
 */
typedef struct {
    void *context;
    bool (*read)(void *context, uint8_t copy, size_t offset, uint8_t *data, size_t size);
    bool (*erase)(void *context, uint8_t copy);
    bool (*write)(void *context, uint8_t copy, size_t offset, const uint8_t *data, size_t size);
} parameter_memory_t;

/** What a save writes as values; node-id and serial number go with each. */
typedef enum {
    PARAMETER_STORE_VALUES,  /**< those of the object dictionary */
    PARAMETER_STORE_KEPT,    /**< those that are stored already */
    PARAMETER_STORE_DEFAULTS /**< none but the serial number: a load leaves the defaults */
} parameter_source_t;

/** Is this entry part of the configuration that is stored? */
bool parameter_store_has(const od_entry_t *entry);

/** No copy is whole although the memory is not blank (erased, or zero as in an emulator): what was
 * stored is lost. */
bool parameter_store_damaged(const parameter_memory_t *memory);

/** Sets the values of the newest whole copy that can be read, and *node_id. False when there is
 * none or the memory fails on the way: od may then hold a part of them and is to be set anew;
 * *node_id is as before. */
bool parameter_store_load(const parameter_memory_t *memory, object_dictionary_t *od,
                          uint8_t *node_id);

/** False when the memory failed; the set before is then still there. Nothing is erased while a copy
 * cannot be read: it might be that set. */
bool parameter_store_save(const parameter_memory_t *memory, parameter_source_t source,
                          const object_dictionary_t *od, uint8_t node_id);

#endif
