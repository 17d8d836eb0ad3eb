/**
 * CRC-32 of IEEE 802.3 (reflected polynomial EDB88320h, as zlib's crc32): parameter pages and the
 * image's own checksum.
 */
#ifndef CRC32_H
#define CRC32_H

#include <stddef.h>
#include <stdint.h>

/** CRC of what was counted in crc (0 at the beginning) and size more bytes. */
uint32_t crc32(const uint8_t *data, size_t size, uint32_t crc);

#endif
