/* Fields in registers. */
#include "unity.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

void setUp(void) {
    bus_reset();
}
void tearDown(void) {}

void test_fields_are_placed_and_read(void) {
    TEST_ASSERT_EQUAL_HEX32(336U << 6, register_field(RCC_PLLCFGR_PLLN, 336));
    TEST_ASSERT_EQUAL_HEX32(0, register_field(RCC_PLLCFGR_PLLN, 512)); /* nine bits */
    TEST_ASSERT_EQUAL_HEX32(0x7FU, register_field_of(CAN_ESR_TEC, 0xFF7FFFFFU));
    TEST_ASSERT_EQUAL_HEX32(0xFFU, register_field_of(CAN_ESR_REC, 0xFF000000U));
}

void test_a_change_leaves_the_other_bits(void) {
    bus_set(RCC_CR, 0x12345678U);
    register_modify(RCC_CR, 0x0000FF00U, 0xFFFFABFFU);
    TEST_ASSERT_EQUAL_HEX32(0x1234AB78U, bus_get(RCC_CR));
    register_set(RCC_CR, 0x1U);
    register_clear(RCC_CR, 0xF0000000U | 0x8U);
    TEST_ASSERT_EQUAL_HEX32(0x0234AB71U & ~0x8U, bus_get(RCC_CR));
}

void test_a_wait_is_bounded(void) {
    TEST_ASSERT_FALSE(register_wait(RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY, 100));
    TEST_ASSERT_EQUAL_UINT(100, bus_reads());
    bus_set(RCC_CR, RCC_CR_HSERDY);
    TEST_ASSERT_TRUE(register_wait(RCC_CR, RCC_CR_HSERDY, RCC_CR_HSERDY, 1));
}
