/* Set value and enable of the servo amplifier. */
#include "unity.h"

#include "port/stm32f405/registers.h"
#include "port/stm32f405/servo_pwm.h"
#include "register_bus_double.h"

enum { PERIOD = 33600, MIDDLE = 16800 };

static const servo_pwm_config_t plain = {.full_scale_mNm = 30000};
static bool enabled; /* level of the enable line */

static uint32_t take(uint32_t address, uint32_t content, uint32_t value) {
    (void)content;
    if (address == GPIO_BSRR(GPIOB_BASE) && (value & ((1U << 13) | (1U << 29))) != 0U) {
        enabled = (value & (1U << 13)) != 0U;
    }
    return value;
}

void setUp(void) {
    bus_reset();
    bus_on_write(take);
    enabled = true;
}
void tearDown(void) {}

void test_starts_with_the_amplifier_off(void) {
    servo_pwm_start();
    TEST_ASSERT_FALSE(enabled);
    TEST_ASSERT_EQUAL_UINT32(PERIOD - 1, bus_get(TIM_ARR(TIM1_BASE))); /* 168 MHz / 5 kHz */
    TEST_ASSERT_EQUAL_UINT32(MIDDLE, bus_get(TIM_CCR1(TIM1_BASE)));
    TEST_ASSERT_EQUAL_HEX32(0x68, bus_get(TIM_CCMR1(TIM1_BASE)));
    TEST_ASSERT_EQUAL_HEX32(TIM_CCER_CC1E, bus_get(TIM_CCER(TIM1_BASE)));
    TEST_ASSERT_EQUAL_HEX32(TIM_BDTR_MOE, bus_get(TIM_BDTR(TIM1_BASE)));
    TEST_ASSERT_EQUAL_HEX32(TIM_CR1_ARPE | TIM_CR1_CEN, bus_get(TIM_CR1(TIM1_BASE)));
    TEST_ASSERT_EQUAL_HEX32(RCC_APB2ENR_TIM1EN, bus_get(RCC_APB2ENR));
    TEST_ASSERT_EQUAL_HEX32(1, bus_get(GPIO_AFRH(GPIOA_BASE)));
}

void test_the_line_is_low_before_the_pin_drives(void) {
    servo_pwm_start();
    bus_forget();
    bus_reset();
    servo_pwm_start();
    TEST_ASSERT_EQUAL_HEX32(1U << 26, bus_get(GPIO_MODER(GPIOB_BASE)));
    TEST_ASSERT_EQUAL_HEX32(1U << 29, bus_get(GPIO_BSRR(GPIOB_BASE)));
}

void test_duty_is_10_to_90_percent(void) {
    TEST_ASSERT_EQUAL_UINT32(MIDDLE, servo_pwm_duty(&plain, 0));
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 9 / 10, servo_pwm_duty(&plain, 30000));
    TEST_ASSERT_EQUAL_UINT32(PERIOD / 10, servo_pwm_duty(&plain, -30000));
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 7 / 10, servo_pwm_duty(&plain, 15000));
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 9 / 10, servo_pwm_duty(&plain, INT16_MAX));
    TEST_ASSERT_EQUAL_UINT32(PERIOD / 10, servo_pwm_duty(&plain, INT16_MIN));
}

void test_every_torque_within_one_step(void) {
    for (int32_t torque = -30000; torque <= 30000; torque++) {
        const double exact = MIDDLE + torque / 30000.0 * 0.4 * PERIOD;
        const double error = servo_pwm_duty(&plain, (int16_t)torque) - exact;
        TEST_ASSERT_TRUE(error > -1.0 && error < 1.0);
    }
}

void test_offset_moves_the_middle_and_stays_within_the_limits(void) {
    servo_pwm_config_t config = {.full_scale_mNm = 30000, .offset_centi_percent = 150};
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 515 / 1000, servo_pwm_duty(&config, 0));
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 9 / 10, servo_pwm_duty(&config, 30000));
    config.offset_centi_percent = INT16_MIN; /* taken as -5 % */
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 45 / 100, servo_pwm_duty(&config, 0));
    config.offset_centi_percent = INT16_MAX;
    TEST_ASSERT_EQUAL_UINT32(PERIOD * 55 / 100, servo_pwm_duty(&config, 0));
}

void test_the_duty_is_there_before_the_line_rises(void) {
    servo_pwm_write(&plain, 15000, true);
    BUS_EXPECT_WRITES({TIM_CCR1(TIM1_BASE), PERIOD * 7 / 10}, {GPIO_BSRR(GPIOB_BASE), 1U << 13});
}

void test_off_cuts_the_line_first(void) {
    servo_pwm_write(&plain, 15000, true);
    bus_forget();
    servo_pwm_write(&plain, 15000, false);
    BUS_EXPECT_WRITES({GPIO_BSRR(GPIOB_BASE), 1U << 29}, {TIM_CCR1(TIM1_BASE), MIDDLE});
    bus_forget();
    servo_pwm_off(); /* two writes, no read: nothing that a fault handler could trip over */
    BUS_EXPECT_WRITES({GPIO_BSRR(GPIOB_BASE), 1U << 29}, {TIM_CCR1(TIM1_BASE), MIDDLE});
    TEST_ASSERT_EQUAL_UINT(0, bus_reads());
}

void test_without_a_scale_it_stays_off(void) {
    const servo_pwm_config_t config = {0};
    servo_pwm_write(&config, 1000, true);
    TEST_ASSERT_FALSE(enabled);
    TEST_ASSERT_EQUAL_UINT32(MIDDLE, bus_get(TIM_CCR1(TIM1_BASE)));
    TEST_ASSERT_EQUAL_UINT32(MIDDLE, servo_pwm_duty(&config, 1000));
}
