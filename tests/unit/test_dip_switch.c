/* Node-id from the switches. */
#include "unity.h"

#include "canopen/lss.h"
#include "port/stm32f405/dip_switch.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

static uint32_t closed;    /* switches 1 to 7 as bits 0 to 6 */
static uint32_t unsettled; /* so many readings are wrong at first: the lines are being charged */
static uint32_t bounces;   /* switch 1 changes with each so many readings; 0 = never */
static uint32_t readings;

static uint32_t answer(uint32_t address, uint32_t content) {
    if (address != GPIO_IDR(GPIOC_BASE)) {
        return content;
    }
    readings++;
    uint32_t now = readings <= unsettled ? 0x7FU : closed;
    now ^= bounces != 0U && readings / bounces % 2U == 1U ? 1U : 0U;
    return ((~now & 0x7FU) << 2) | 0xFE03U; /* the port's other pins */
}

void setUp(void) {
    bus_reset();
    bus_on_read(answer);
    closed = 0;
    unsettled = 0;
    bounces = 0;
    readings = 0;
}
void tearDown(void) {}

void test_every_node_id(void) {
    for (closed = 1; closed <= 127U; closed++) {
        TEST_ASSERT_EQUAL_UINT8(closed, dip_switch_read());
    }
}

void test_no_switch_closed_waits_for_lss(void) {
    TEST_ASSERT_EQUAL_UINT8(LSS_UNCONFIGURED, dip_switch_read());
}

void test_waits_until_the_pull_ups_have_charged_the_lines(void) {
    closed = 5;
    unsettled = 200;
    TEST_ASSERT_EQUAL_UINT8(5, dip_switch_read());
}

void test_a_switch_that_does_not_settle_is_not_believed(void) {
    closed = 4;
    bounces = 100;
    TEST_ASSERT_EQUAL_UINT8(LSS_UNCONFIGURED, dip_switch_read());
    TEST_ASSERT_EQUAL_UINT32(4096, readings);
}

void test_pulls_up_seven_pins_and_no_other(void) {
    (void)dip_switch_read();
    TEST_ASSERT_EQUAL_HEX32(0x15550, bus_get(GPIO_PUPDR(GPIOC_BASE)));
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(GPIO_MODER(GPIOC_BASE)));
}

void test_a_port_that_is_not_there(void) {
    bus_set_absent(); /* reads 0: all switches would be closed */
    TEST_ASSERT_EQUAL_UINT8(LSS_UNCONFIGURED, dip_switch_read());
    TEST_ASSERT_EQUAL_UINT32(0, readings);
}
