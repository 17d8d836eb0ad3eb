/**
 * Whole numbers as bytes, the least significant byte first: so they stand in the data of every
 * frame (CiA 301, 7.1.4.4) and in stored parameters, whatever the processor's own order. data holds
 * at least as many bytes as the number; nothing can fail.
 */
#ifndef LITTLE_ENDIAN_H
#define LITTLE_ENDIAN_H

#include <stdint.h>

/** The number in 2 bytes. */
static inline uint16_t little_endian_u16(const uint8_t *data) {
    return (uint16_t)((uint16_t)data[0] | ((uint16_t)data[1] << 8));
}

/** The number in 4 bytes. */
static inline uint32_t little_endian_u32(const uint8_t *data) {
    return (uint32_t)data[0] | ((uint32_t)data[1] << 8) | ((uint32_t)data[2] << 16) |
           ((uint32_t)data[3] << 24);
}

/** Writes 2 bytes. */
static inline void little_endian_put_u16(uint16_t value, uint8_t *data) {
    data[0] = (uint8_t)value;
    data[1] = (uint8_t)(value >> 8);
}

/** Writes 4 bytes. */
static inline void little_endian_put_u32(uint32_t value, uint8_t *data) {
    data[0] = (uint8_t)value;
    data[1] = (uint8_t)(value >> 8);
    data[2] = (uint8_t)(value >> 16);
    data[3] = (uint8_t)(value >> 24);
}

#endif
