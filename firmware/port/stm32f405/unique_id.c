#include "port/stm32f405/unique_id.h"

#include "node/crc32.h"
#include "port/stm32f405/fault.h"

#define UNIQUE_ID_ADDRESS 0x1FFF7A10U
#define WORDS 3U

uint32_t unique_id_serial_number(void) {
    uint32_t words[WORDS];
    for (uint32_t i = 0; i < WORDS; i++) {
        if (!fault_probe(UNIQUE_ID_ADDRESS + 4U * i, &words[i])) {
            return 0;
        }
    }
    const uint32_t serial = crc32((const uint8_t *)words, sizeof words, 0);
    return serial == 0U ? 1U : serial;
}
