#include "port/stm32f405/gpio.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum { MEDIUM_SPEED = 1, PINS_PER_AFR = 8, RESET_SHIFT = 16 };

static void set_two_bits(uint32_t address, uint8_t number, uint32_t value) {
    const uint32_t shift = 2U * (uint32_t)number;
    register_modify(address, 3U << shift, value << shift);
}

void gpio_start(void) {
    register_set(RCC_AHB1ENR, RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN);
    (void)register_read(RCC_AHB1ENR); /* the clock is there two cycles later (RM0090 7.2.12) */
}

void gpio_configure(gpio_pin_t pin) {
    const uint32_t number = pin.number;
    if (pin.mode == GPIO_OUTPUT) {
        gpio_write(pin, false);
    }
    if (pin.mode == GPIO_ALTERNATE) {
        const uint32_t address = number < PINS_PER_AFR ? GPIO_AFRL(pin.port) : GPIO_AFRH(pin.port);
        const uint32_t shift = 4U * (number % PINS_PER_AFR);
        register_modify(address, 0xFU << shift, (uint32_t)pin.alternate << shift);
    }
    register_clear(GPIO_OTYPER(pin.port), 1U << number);
    set_two_bits(GPIO_OSPEEDR(pin.port), pin.number, MEDIUM_SPEED);
    set_two_bits(GPIO_PUPDR(pin.port), pin.number, pin.pull);
    set_two_bits(GPIO_MODER(pin.port), pin.number, pin.mode);
}

void gpio_write(gpio_pin_t pin, bool high) {
    const uint32_t bit = 1U << pin.number;
    register_write(GPIO_BSRR(pin.port), high ? bit : bit << RESET_SHIFT);
}
