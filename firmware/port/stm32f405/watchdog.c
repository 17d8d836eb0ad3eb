#include "port/stm32f405/watchdog.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum {
    KEY_UNLOCK = 0x5555,
    KEY_FEED = 0xAAAA,
    KEY_START = 0xCCCC,
    PRESCALER_MAX = 6,
    RELOAD_MAX = 0xFFF,
    LSI_MAX_kHz = 47,
    us_PER_ms = 1000,
    WAIT_READS = 20000
};

watchdog_setting_t watchdog_setting(uint32_t window_us) {
    const uint32_t window = window_us < WATCHDOG_WINDOW_MAX_us ? window_us : WATCHDOG_WINDOW_MAX_us;
    /* periods of the fastest oscillator, rounded up: at most 22300 * 47 */
    const uint32_t periods = (window / us_PER_ms) * LSI_MAX_kHz +
                             ((window % us_PER_ms) * LSI_MAX_kHz + us_PER_ms - 1U) / us_PER_ms;
    watchdog_setting_t setting = {0};
    uint32_t divider = 4;
    /* bites after reload + 1 counts, and the first one may be short */
    while (setting.prescaler < PRESCALER_MAX && (periods + divider - 1U) / divider > RELOAD_MAX) {
        setting.prescaler++;
        divider *= 2U;
    }
    const uint32_t reload = (periods + divider - 1U) / divider;
    setting.reload = (uint16_t)(reload < RELOAD_MAX ? reload : RELOAD_MAX);
    return setting;
}

bool watchdog_set_window(uint32_t window_us) {
    const watchdog_setting_t setting = watchdog_setting(window_us);
    const uint32_t busy = IWDG_SR_PVU | IWDG_SR_RVU;
    if (!register_wait(IWDG_SR, busy, 0, WAIT_READS)) {
        return false;
    }
    register_write(IWDG_KR, KEY_UNLOCK);
    register_write(IWDG_PR, setting.prescaler);
    register_write(IWDG_RLR, setting.reload);
    const bool taken = register_wait(IWDG_SR, busy, 0, WAIT_READS) != 0;
    watchdog_feed(); /* loads the new value and locks the registers */
    return taken;
}

bool watchdog_start(uint32_t window_us) {
    register_write(IWDG_KR, KEY_START); /* first: it starts the oscillator that the rest needs */
    return watchdog_set_window(window_us);
}

void watchdog_feed(void) {
    register_write(IWDG_KR, KEY_FEED);
}
