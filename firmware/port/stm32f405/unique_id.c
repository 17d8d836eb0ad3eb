#include "port/stm32f405/unique_id.h"

#define FNV_OFFSET 2166136261U
#define FNV_PRIME 16777619U

uint32_t unique_id_serial(unique_id_read_t read, uint32_t fallback) {
    uint32_t hash = FNV_OFFSET;
    uint32_t any = 0;
    uint32_t all = UINT32_MAX;
    for (uint32_t i = 0; i < UNIQUE_ID_WORDS; i++) {
        uint32_t word = 0;
        if (!read(UNIQUE_ID_ADDRESS + 4U * i, &word)) {
            return fallback;
        }
        any |= word;
        all &= word;
        for (uint32_t shift = 0; shift < 32U; shift += 8U) {
            hash = (hash ^ ((word >> shift) & 0xFFU)) * FNV_PRIME;
        }
    }
    if (any == 0U || all == UINT32_MAX) {
        return fallback; /* nothing was programmed there */
    }
    return hash != 0U ? hash : 1U;
}
