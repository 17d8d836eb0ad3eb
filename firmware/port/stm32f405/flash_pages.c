#include "port/stm32f405/flash_pages.h"

#include <string.h>

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "port/stm32f405/watchdog.h"

#define KEY_1 0x45670123U /* RM0090, section 3.6.1 */
#define KEY_2 0xCDEF89ABU
#define ERRORS                                                                                     \
    (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR)
#define ATTEMPTS 20000000U /* 1 s at 168 MHz: erasing takes 0.8 s at most (DS8626, table 40) */
#define ERASED 0xFFU

static uint32_t address_of(uint8_t copy, size_t offset) {
    return FLASH_PAGES_ADDRESS + copy * FLASH_PAGES_SECTOR_BYTES + (uint32_t)offset;
}

static const uint8_t *at(uint8_t copy, size_t offset) {
    return (const uint8_t *)(uintptr_t)address_of(copy, offset);
}

static bool ready(void) {
    return register_wait(FLASH_SR, FLASH_SR_BSY, 0, ATTEMPTS) != 0 &&
           (register_read(FLASH_SR) & ERRORS) == 0U;
}

static bool unlock(void) {
    if (register_wait(FLASH_SR, FLASH_SR_BSY, 0, ATTEMPTS) == 0) {
        return false;
    }
    register_write(FLASH_KEYR, KEY_1);
    register_write(FLASH_KEYR, KEY_2);
    register_write(FLASH_SR, ERRORS | FLASH_SR_EOP); /* ones clear what was before */
    return (register_read(FLASH_CR) & FLASH_CR_LOCK) == 0U;
}

/** Also what the data cache has of the sector is outdated (RM0090, section 3.5.3). */
static void lock(void) {
    const uint32_t access = register_read(FLASH_ACR);
    register_write(FLASH_CR, FLASH_CR_LOCK);
    register_write(FLASH_ACR, access & ~FLASH_ACR_DCEN);
    register_write(FLASH_ACR, (access & ~FLASH_ACR_DCEN) | FLASH_ACR_DCRST);
    register_write(FLASH_ACR, access);
}

static bool read_bytes(void *context, uint8_t copy, size_t offset, uint8_t *data, size_t size) {
    (void)context;
    memcpy(data, at(copy, offset), size);
    return true;
}

static bool erase(void *context, uint8_t copy) {
    (void)context;
    bool done = unlock() && watchdog_set_window(WATCHDOG_WINDOW_FLASH_us);
    if (done) {
        register_write(FLASH_CR, FLASH_CR_SER |
                                     register_field(FLASH_CR_SNB, FLASH_PAGES_FIRST_SECTOR + copy));
        register_set(FLASH_CR, FLASH_CR_STRT);
        done = ready();
    }
    (void)watchdog_set_window(WATCHDOG_WINDOW_MOVING_us); /* else the wide one stays: safe enough */
    lock();
    for (size_t i = 0; done && i < PARAMETER_STORE_COPY_BYTES; i++) {
        done = *at(copy, i) == ERASED;
    }
    return done;
}

static bool write_bytes(void *context, uint8_t copy, size_t offset, const uint8_t *data,
                        size_t size) {
    (void)context;
    bool done = unlock();
    watchdog_feed(); /* a save keeps main waiting for longer than its window on a slow flash */
    for (size_t i = 0; done && i < size; i++) {
        register_write(FLASH_CR, FLASH_CR_PG); /* PSIZE 0: byte by byte, at any supply voltage */
        *(volatile uint8_t *)(uintptr_t)address_of(copy, offset + i) = data[i];
        done = ready();
    }
    lock();
    return done && memcmp(at(copy, offset), data, size) == 0;
}

const parameter_memory_t flash_pages = {
    .context = NULL, .read = read_bytes, .erase = erase, .write = write_bytes};
