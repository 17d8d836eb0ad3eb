#include "node/crc32.h"

uint32_t crc32(const uint8_t *data, size_t size, uint32_t crc) {
    /* Four bits a step: a quarter of the time of single bits, which counts at boot. */
    static const uint32_t table[16] = {0x00000000U, 0x1DB71064U, 0x3B6E20C8U, 0x26D930ACU,
                                       0x76DC4190U, 0x6B6B51F4U, 0x4DB26158U, 0x5005713CU,
                                       0xEDB88320U, 0xF00F9344U, 0xD6D6A3E8U, 0xCB61B38CU,
                                       0x9B64C2B0U, 0x86D3D2D4U, 0xA00AE278U, 0xBDBDF21CU};
    uint32_t register_ = ~crc;
    for (size_t i = 0; i < size; i++) {
        register_ ^= data[i];
        register_ = (register_ >> 4) ^ table[register_ & 15U];
        register_ = (register_ >> 4) ^ table[register_ & 15U];
    }
    return ~register_;
}
