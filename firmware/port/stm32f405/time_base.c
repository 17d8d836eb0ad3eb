#include "port/stm32f405/time_base.h"

#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

#define COUNTS_MIN 64U /* an expiry that is due already: soon, but not within this code */

static uint32_t MHz;
static int64_t begin_ns; /* of the interval under way */
static uint32_t counts;  /* its length */

static uint32_t to_ns(uint32_t interval) {
    return (uint32_t)((uint64_t)interval * 1000U / MHz);
}

static void begin(uint32_t length) {
    counts = length;
    register_write(SYST_RVR, length - 1U);
    register_write(SYST_CVR, 0); /* any value: the counter starts anew */
}

/** Counts of the interval that have passed. */
static uint32_t passed(void) {
    const uint32_t left = register_read(SYST_CVR) & SYST_RVR_RELOAD;
    return left == 0U ? 0U : counts - left;
}

static uint32_t longest(void) {
    return (uint32_t)(TIME_BASE_MAX_ns / 1000) * MHz;
}

void time_base_init(uint32_t core_MHz) {
    MHz = core_MHz;
    begin_ns = 0;
    begin(longest());
    register_write(SYST_CSR, SYST_CSR_CLKSOURCE | SYST_CSR_TICKINT | SYST_CSR_ENABLE);
}

/* An expiry that waits for its handler counts already. */
static int64_t now_blocked(void) {
    const uint32_t first = passed();
    if ((register_read(SCB_ICSR) & SCB_ICSR_PENDSTSET) != 0U) {
        return begin_ns + to_ns(counts) + to_ns(passed());
    }
    return begin_ns + to_ns(first);
}

int64_t time_base_now_ns(void) {
    const uint32_t before = interrupts_block();
    const int64_t now = now_blocked();
    interrupts_restore(before);
    return now;
}

void time_base_alarm(int64_t at_ns) {
    const uint32_t before = interrupts_block();
    if ((register_read(SCB_ICSR) & SCB_ICSR_PENDSTSET) == 0U) { /* else it has just expired */
        const int64_t now = now_blocked();
        const int64_t rest_ns = at_ns - now > TIME_BASE_MAX_ns ? TIME_BASE_MAX_ns : at_ns - now;
        const uint32_t length = rest_ns <= 0 ? 0U : (uint32_t)rest_ns / 1000U * MHz +
                                                        (uint32_t)rest_ns % 1000U * MHz / 1000U;
        begin_ns = now;
        begin(length < COUNTS_MIN ? COUNTS_MIN : length);
    }
    interrupts_restore(before);
}

void time_base_expired(void) {
    begin_ns += (int64_t)to_ns(counts) + (int64_t)to_ns(passed());
    begin(longest());
}
