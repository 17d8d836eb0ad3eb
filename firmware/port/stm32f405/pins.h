/** Pins of the board. Placeholder until the drivers come. */
#ifndef PINS_H
#define PINS_H
#include "port/stm32f405/registers.h"
#define PINS_ENABLE_BSRR (GPIOB_BASE + 0x18U)
#define PINS_ENABLE_OFF (1U << (16 + 12))
#endif
