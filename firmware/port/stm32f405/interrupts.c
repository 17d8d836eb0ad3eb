#include "port/stm32f405/interrupts.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

#define PRIORITY_SHIFT 4U /* the chip has the upper four bits */

void interrupts_init(void) {
    register_write(SCB_SHPR1, 0);
    register_write(SCB_SHPR2, 0);
    /* SysTick's stays PRIORITY_TIME, 0. */
    register_write(SCB_SHPR3, register_field(SCB_SHPR3_PRI_14, PRIORITY_NODE << PRIORITY_SHIFT));
}

void interrupts_enable(uint32_t interrupt) {
    const uint32_t shift = 8U * (interrupt % 4U);
    register_modify(NVIC_IPR(interrupt / 4U), 0xFFU << shift,
                    (PRIORITY_RECEIVE << PRIORITY_SHIFT) << shift);
    register_write(NVIC_ISER(interrupt / 32U), 1U << (interrupt % 32U));
}

void interrupts_request_node(void) {
    register_write(SCB_ICSR, SCB_ICSR_PENDSVSET);
}
