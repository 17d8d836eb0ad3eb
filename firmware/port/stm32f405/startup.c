/*
 * From reset to main, and the vector table (DDI 0403E, B1.5.3; RM0090, table 61). Every vector
 * without a handler of its own is a fault.
 */
#include <stddef.h>
#include <stdint.h>

#include "port/stm32f405/fault.h"
#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

#define CORE_VECTORS 16U
#define INTERRUPTS 82U

extern uint8_t stack_begin[]; /* stm32f405.ld */
extern uint32_t data_begin[];
extern uint32_t data_end[];
extern const uint32_t data_source[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];

void main_prepare(void); /* main.c */
int main(void);
_Noreturn void startup_reset(void);

typedef union {
    /* cppcheck-suppress unusedStructMember ; the core reads it */
    void (*handler)(void);
    /* cppcheck-suppress unusedStructMember ; the core reads it */
    void *stack;
} vector_t;

__attribute__((section(".vectors"),
               used)) static const vector_t vectors[CORE_VECTORS + INTERRUPTS] = {
    [0] = {.stack = stack_begin},
    [1] = {.handler = startup_reset},
    [2 ... CORE_VECTORS - 1U] = {.handler = fault_entry},
    [14] = {.handler = interrupt_node},
    [15] = {.handler = interrupt_time},
    [CORE_VECTORS... CORE_VECTORS + INTERRUPTS - 1U] = {.handler = fault_entry},
    [CORE_VECTORS + IRQ_CAN1_RX0] = {.handler = interrupt_can_cyclic},
    [CORE_VECTORS + IRQ_CAN1_RX1] = {.handler = interrupt_can_other},
    [CORE_VECTORS + IRQ_TIM2] = {.handler = interrupt_tick_timer},
    [CORE_VECTORS + IRQ_USART1] = {.handler = interrupt_usart1},
};

_Noreturn void startup_reset(void) {
    const size_t data_words = ((uintptr_t)data_end - (uintptr_t)data_begin) / sizeof data_begin[0];
    const size_t bss_words = ((uintptr_t)bss_end - (uintptr_t)bss_begin) / sizeof bss_begin[0];
    for (size_t i = 0; i < data_words; i++) {
        data_begin[i] = data_source[i];
    }
    for (size_t i = 0; i < bss_words; i++) {
        bss_begin[i] = 0;
    }
#ifdef __ARM_FP
    register_set(SCB_CPACR, SCB_CPACR_CP10 | SCB_CPACR_CP11);
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
    main_prepare();
    (void)main();
    for (;;) { /* main does not return */
    }
}
