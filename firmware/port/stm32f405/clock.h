/**
 * Clock tree (RM0090, section 7): crystal of 8 MHz and PLL to 168 MHz, APB1 42 MHz, APB2 84 MHz.
 * Every wait is bounded; whatever does not come up leaves the chip on its internal oscillator of
 * 16 MHz, whose tolerance would disturb a CAN bus.
 */
#ifndef CLOCK_H
#define CLOCK_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    bool crystal;      /**< false: internal oscillator */
    uint32_t core_MHz; /**< 16 or 168 MHz */
    uint32_t apb2_Hz;  /**< of USART1 */
} clock_tree_t;

/** Starts the crystal and the PLL, as far as they come. */
clock_tree_t clock_init(void);

#endif
