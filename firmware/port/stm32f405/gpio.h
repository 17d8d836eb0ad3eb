/**
 * Pins of the ports A to C (RM0090 section 8): configured once, then written.
 *
 * A pin's data register is written before its mode, so that an output never shows a level that was
 * not asked for.
 */
#ifndef GPIO_H
#define GPIO_H

#include <stdbool.h>
#include <stdint.h>

typedef enum { GPIO_INPUT = 0, GPIO_OUTPUT = 1, GPIO_ALTERNATE = 2, GPIO_ANALOG = 3 } gpio_mode_t;
typedef enum { GPIO_NO_PULL = 0, GPIO_PULL_UP = 1, GPIO_PULL_DOWN = 2 } gpio_pull_t;

/** One pin and its use on this board. */
typedef struct {
    uint32_t port;     /**< GPIOx_BASE; x = A, B or C */
    uint8_t number;    /**< 0..15 */
    uint8_t mode;      /**< gpio_mode_t */
    uint8_t alternate; /**< number of the alternate function, 0..15; 0 unless GPIO_ALTERNATE */
    uint8_t pull;      /**< gpio_pull_t */
} gpio_pin_t;

/** Clocks of the ports A to C on. Before any other function here. */
void gpio_start(void);

/** Configures a pin; an output begins low, push-pull, at medium speed (25 MHz). */
void gpio_configure(gpio_pin_t pin);

/** Level of an output, in one write. */
void gpio_write(gpio_pin_t pin, bool high);

#endif
