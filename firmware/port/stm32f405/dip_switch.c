#include "port/stm32f405/dip_switch.h"

#include "canopen/lss.h"
#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum { SWITCHES = 7, FIRST_PIN = 2, AGREEING = 256, READINGS_MAX = 4096 };

#define SWITCH_BITS 0x7FU
/* Two bits a pin, PC2 to PC8. */
#define PULL_BITS (0x3FFFU << (2U * FIRST_PIN))
#define PULL_UPS (0x1555U << (2U * FIRST_PIN))

uint8_t dip_switch_read(void) {
    const gpio_pin_t pins[SWITCHES] = {PIN_NODE_ID_BIT0, PIN_NODE_ID_BIT1, PIN_NODE_ID_BIT2,
                                       PIN_NODE_ID_BIT3, PIN_NODE_ID_BIT4, PIN_NODE_ID_BIT5,
                                       PIN_NODE_ID_BIT6};
    for (uint32_t i = 0; i < SWITCHES; i++) {
        gpio_configure(pins[i]);
    }
    if ((register_read(GPIO_PUPDR(GPIOC_BASE)) & PULL_BITS) != PULL_UPS) {
        return LSS_UNCONFIGURED;
    }
    uint32_t last = 0;
    uint32_t agreeing = 0;
    for (uint32_t i = 0; i < READINGS_MAX && agreeing < AGREEING; i++) {
        const uint32_t closed = ~(register_read(GPIO_IDR(GPIOC_BASE)) >> FIRST_PIN) & SWITCH_BITS;
        agreeing = closed == last ? agreeing + 1U : 1U;
        last = closed;
    }
    return agreeing == AGREEING && last != 0U ? (uint8_t)last : (uint8_t)LSS_UNCONFIGURED;
}
