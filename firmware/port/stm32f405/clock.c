#include "port/stm32f405/clock.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

/* Reads of a ready bit, at 16 MHz some 6 cycles each: 100 ms for the crystal, which takes 2 ms, and
 * 4 ms for what takes microseconds (DS8626, tables 32 and 36). */
#define ATTEMPTS_CRYSTAL 250000U
#define ATTEMPTS 10000U

#define PLL_M 8U   /* 8 MHz / 8 = 1 MHz */
#define PLL_N 336U /* x 336 = 336 MHz; PLLP 0: / 2 = 168 MHz */
#define PLL_Q 7U   /* / 7 = 48 MHz */
#define SOURCE_PLL 2U
#define DIVIDE_BY_4 5U
#define DIVIDE_BY_2 4U
#define WAIT_STATES 5U /* 168 MHz at 2.7 V to 3.6 V: RM0090, table 10 */

#define CRYSTAL_CORE_MHz 168U
#define CRYSTAL_APB2_Hz 84000000U
#define INTERNAL_CORE_MHz 16U
#define INTERNAL_APB2_Hz 16000000U

static bool start_crystal(void) {
    register_set(RCC_CR, RCC_CR_HSEON);
    if (!register_wait(RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY, ATTEMPTS_CRYSTAL)) {
        return false;
    }
    register_write(RCC_PLLCFGR, register_field(RCC_PLLCFGR_PLLM, PLL_M) |
                                    register_field(RCC_PLLCFGR_PLLN, PLL_N) | RCC_PLLCFGR_PLLSRC |
                                    register_field(RCC_PLLCFGR_PLLQ, PLL_Q));
    register_set(RCC_CR, RCC_CR_PLLON);
    if (!register_wait(RCC_CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, ATTEMPTS)) {
        return false;
    }
    register_write(FLASH_ACR, register_field(FLASH_ACR_LATENCY, WAIT_STATES) | FLASH_ACR_PRFTEN |
                                  FLASH_ACR_ICEN | FLASH_ACR_DCEN);
    if (!register_wait(FLASH_ACR, FLASH_ACR_LATENCY, register_field(FLASH_ACR_LATENCY, WAIT_STATES),
                       ATTEMPTS)) {
        return false;
    }
    register_modify(RCC_CFGR, RCC_CFGR_HPRE | RCC_CFGR_PPRE1 | RCC_CFGR_PPRE2,
                    register_field(RCC_CFGR_PPRE1, DIVIDE_BY_4) |
                        register_field(RCC_CFGR_PPRE2, DIVIDE_BY_2));
    register_modify(RCC_CFGR, RCC_CFGR_SW, register_field(RCC_CFGR_SW, SOURCE_PLL));
    return register_wait(RCC_CFGR, RCC_CFGR_SWS, register_field(RCC_CFGR_SWS, SOURCE_PLL),
                         ATTEMPTS) != 0;
}

clock_tree_t clock_init(void) {
    static const clock_tree_t crystal = {
        .crystal = true, .core_MHz = CRYSTAL_CORE_MHz, .apb2_Hz = CRYSTAL_APB2_Hz};
    static const clock_tree_t internal = {
        .crystal = false, .core_MHz = INTERNAL_CORE_MHz, .apb2_Hz = INTERNAL_APB2_Hz};
    if (start_crystal()) {
        /* A crystal that stops later is a non-maskable interrupt: torque off and reset. */
        register_set(RCC_CR, RCC_CR_CSSON);
        return crystal;
    }
    register_modify(RCC_CFGR, RCC_CFGR_SW, 0);
    (void)register_wait(RCC_CFGR, RCC_CFGR_SWS, 0, ATTEMPTS); /* before its source goes */
    register_modify(RCC_CFGR, RCC_CFGR_HPRE | RCC_CFGR_PPRE1 | RCC_CFGR_PPRE2, 0);
    register_clear(RCC_CR, RCC_CR_HSEON | RCC_CR_PLLON);
    return internal;
}
