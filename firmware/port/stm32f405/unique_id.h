/**
 * Serial number (1018h:04) from the chip's unique identifier: three words at 1FFF7A10h (RM0090
 * section 39.1), read through a guard, since an access there faults where the memory does not exist
 * (emulation).
 */
#ifndef UNIQUE_ID_H
#define UNIQUE_ID_H

#include <stdbool.h>
#include <stdint.h>

#define UNIQUE_ID_ADDRESS 0x1FFF7A10U
#define UNIQUE_ID_WORDS 3U

/** Reads one word; false, and nothing stored, when the access faults. Provided by the image. */
typedef bool (*unique_id_read_t)(uint32_t address, uint32_t *value);

/**
 * Hash (FNV-1a, 32 bits) of the identifier's twelve bytes, lowest first; of n boards, two have the
 * same with a chance of about n * n / 8.6e9. When a word faults, or all are 0 or all FFFFFFFFh:
 * fallback, the serial number from the parameter page. Never 0 unless fallback is.
 */
uint32_t unique_id_serial(unique_id_read_t read, uint32_t fallback);

#endif
