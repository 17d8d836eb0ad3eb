#include "port/stm32f405/time_base.h"

#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

static uint32_t MHz;
static uint32_t begin_us; /* of the beat under way */
static uint32_t length_us;

void time_base_start(uint32_t core_MHz, uint32_t beat_us) {
    MHz = core_MHz;
    length_us = beat_us;
    register_write(SYST_RVR, beat_us * MHz - 1U);
    register_write(SYST_CVR, 0);
    register_write(SYST_CSR, SYST_CSR_CLKSOURCE | SYST_CSR_TICKINT | SYST_CSR_ENABLE);
}

/** Of the beat under way; at its first cycle the counter shows 0. */
static uint32_t passed_us(void) {
    const uint32_t left = register_read(SYST_CVR) & SYST_RVR_RELOAD;
    return left == 0U ? 0U : length_us - (left + MHz - 1U) / MHz;
}

uint32_t time_base_now_us(void) {
    const uint32_t before = interrupts_block();
    uint32_t now_us = begin_us + passed_us();
    if ((register_read(SCB_ICSR) & SCB_ICSR_PENDSTSET) != 0U) { /* ended, but not yet counted */
        now_us = begin_us + length_us + passed_us();
    }
    interrupts_restore(before);
    return now_us;
}

void time_base_expired(void) {
    begin_us += length_us;
}
