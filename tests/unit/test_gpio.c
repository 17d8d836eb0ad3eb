/* Pins. */
#include "unity.h"

#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/gpio.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

void setUp(void) {
    bus_reset();
}
void tearDown(void) {}

void test_an_output_is_low_before_it_drives(void) {
    gpio_configure(PIN_SERVO_ENABLE);
    BUS_EXPECT_WRITES({GPIO_BSRR(GPIOB_BASE), 1U << 29}, {GPIO_OTYPER(GPIOB_BASE), 0},
                      {GPIO_OSPEEDR(GPIOB_BASE), 1U << 26}, {GPIO_PUPDR(GPIOB_BASE), 0},
                      {GPIO_MODER(GPIOB_BASE), 1U << 26});
}

void test_the_alternate_function_is_chosen_before_the_mode(void) {
    bus_set(GPIO_MODER(GPIOB_BASE), 0x00000280U); /* reset value: PB3 and PB4 for the debugger */
    bus_set(GPIO_AFRH(GPIOB_BASE), 0xFFFFFFFFU);
    gpio_configure(PIN_CAN_RX);
    BUS_EXPECT_WRITES({GPIO_AFRH(GPIOB_BASE), 0xFFFFFFF9U}, {GPIO_OTYPER(GPIOB_BASE), 0},
                      {GPIO_OSPEEDR(GPIOB_BASE), 1U << 16}, {GPIO_PUPDR(GPIOB_BASE), 1U << 16},
                      {GPIO_MODER(GPIOB_BASE), 0x00020280U});
}

void test_low_pins_have_their_own_alternate_register(void) {
    gpio_configure(PIN_ENCODER_B);
    TEST_ASSERT_EQUAL_HEX32(0x20, bus_get(GPIO_AFRL(GPIOA_BASE)));
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(GPIO_AFRH(GPIOA_BASE)));
}

void test_levels(void) {
    gpio_write(PIN_SERVO_ENABLE, true);
    gpio_write(PIN_SERVO_ENABLE, false);
    BUS_EXPECT_WRITES({GPIO_BSRR(GPIOB_BASE), 1U << 13}, {GPIO_BSRR(GPIOB_BASE), 1U << 29});
}

void test_clocks_of_the_ports(void) {
    gpio_start();
    BUS_EXPECT_WRITES({RCC_AHB1ENR, 7});
}

void test_no_pin_is_used_twice(void) {
    const gpio_pin_t pins[] = {
        PIN_CAN_RX,
        PIN_CAN_TX,
        PIN_USART_TX,
        PIN_USART_RX,
        PIN_ENCODER_A,
        PIN_ENCODER_B,
        PIN_ENCODER_INDEX,
        PIN_SERVO_PWM,
        PIN_SERVO_ENABLE,
        PIN_MOTOR_CURRENT,
        PIN_MOTOR_TEMPERATURE,
        PIN_NODE_ID_BIT0,
        PIN_NODE_ID_BIT1,
        PIN_NODE_ID_BIT2,
        PIN_NODE_ID_BIT3,
        PIN_NODE_ID_BIT4,
        PIN_NODE_ID_BIT5,
        PIN_NODE_ID_BIT6,
        PIN_TORQUE_LIGHT,
        {.port = GPIOA_BASE, .number = 13},
        {.port = GPIOA_BASE, .number = 14}, /* SWD */
        {.port = GPIOB_BASE, .number = 3},
        {.port = GPIOB_BASE, .number = 2}, /* SWO, BOOT1 */
        {.port = GPIOA_BASE, .number = 11},
        {.port = GPIOA_BASE, .number = 12}, /* USB */
        {.port = GPIOC_BASE, .number = 14},
        {.port = GPIOC_BASE, .number = 15},
    };
    const size_t count = sizeof pins / sizeof pins[0];
    for (size_t i = 0; i < count; i++) {
        for (size_t j = i + 1U; j < count; j++) {
            TEST_ASSERT_FALSE_MESSAGE(pins[i].port == pins[j].port &&
                                          pins[i].number == pins[j].number,
                                      "two uses of one pin");
        }
    }
}
