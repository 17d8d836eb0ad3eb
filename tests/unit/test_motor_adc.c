/* Motor current and temperature. */
#include "unity.h"

#include "port/stm32f405/motor_adc.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

/* A current sensor of 100 mV/A around 1650 mV, a temperature sensor of 10 mV/K and 500 mV. */
static const motor_adc_config_t config = {.current_zero_mV = 1650,
                                          .current_mA_per_V = 10000,
                                          .temperature_zero_mV = 500,
                                          .temperature_uV_per_K = 10000};
static motor_adc_t adc;

static uint32_t steps_of(uint32_t mV) {
    return (mV * 4095U + 1650U) / 3300U;
}

static motor_adc_reading_t measure(uint32_t current_steps, uint32_t temperature_steps) {
    bus_set(ADC1_SR, ADC1_SR_JEOC);
    bus_set(ADC1_JDR1, current_steps);
    bus_set(ADC1_JDR2, temperature_steps);
    return motor_adc_step(&config, &adc);
}

void setUp(void) {
    bus_reset();
    motor_adc_start(&adc);
}
void tearDown(void) {}

void test_converts_channels_10_and_11_in_a_group(void) {
    TEST_ASSERT_EQUAL_HEX32((1U << 20) | (10U << 10) | (11U << 15), bus_get(ADC1_JSQR));
    TEST_ASSERT_EQUAL_HEX32(ADC1_CR1_SCAN, bus_get(ADC1_CR1));
    TEST_ASSERT_EQUAL_HEX32(0x1B, bus_get(ADC1_SMPR1));
    TEST_ASSERT_EQUAL_HEX32(1U << 16, bus_get(ADC_COMMON_CCR));
    TEST_ASSERT_EQUAL_HEX32(ADC1_CR2_ADON, bus_get(ADC1_CR2));
    TEST_ASSERT_EQUAL_HEX32(RCC_APB2ENR_ADC1EN, bus_get(RCC_APB2ENR));
    TEST_ASSERT_EQUAL_HEX32(0xF, bus_get(GPIO_MODER(GPIOC_BASE)));
}

void test_each_step_starts_the_next_conversion(void) {
    bus_set(ADC1_SR, ADC1_SR_JEOC);
    bus_forget();
    (void)motor_adc_step(&config, &adc);
    BUS_EXPECT_WRITES({ADC1_SR, ~ADC1_SR_JEOC}, {ADC1_CR2, ADC1_CR2_ADON | ADC1_CR2_JSWSTART});
    TEST_ASSERT_EQUAL_UINT(3, bus_reads()); /* no wait */
}

void test_scales(void) {
    motor_adc_reading_t reading = measure(steps_of(1650 + 123), steps_of(500 + 253));
    TEST_ASSERT_UINT32_WITHIN(8, 1230, reading.current_mA);
    TEST_ASSERT_INT16_WITHIN(1, 253, reading.temperature_dC);
    reading = measure(steps_of(1650 - 500), steps_of(500 - 100));
    TEST_ASSERT_UINT32_WITHIN(8, 5000, reading.current_mA); /* its size */
    TEST_ASSERT_INT16_WITHIN(1, -100, reading.temperature_dC);
}

void test_a_sensor_that_falls_with_temperature(void) {
    const motor_adc_config_t falling = {
        .current_mA_per_V = 1, .temperature_zero_mV = 2000, .temperature_uV_per_K = -5000};
    bus_set(ADC1_SR, ADC1_SR_JEOC);
    bus_set(ADC1_JDR1, 1000);
    bus_set(ADC1_JDR2, steps_of(1500));
    TEST_ASSERT_INT16_WITHIN(2, 1000, motor_adc_step(&falling, &adc).temperature_dC);
}

void test_saturates(void) {
    motor_adc_config_t steep = {
        .current_mA_per_V = UINT16_MAX, .temperature_zero_mV = 0, .temperature_uV_per_K = 1};
    bus_set(ADC1_SR, ADC1_SR_JEOC);
    bus_set(ADC1_JDR1, 4075);
    bus_set(ADC1_JDR2, 4075);
    motor_adc_reading_t reading = motor_adc_step(&steep, &adc);
    TEST_ASSERT_UINT32_WITHIN(70, 215216, reading.current_mA);
    TEST_ASSERT_EQUAL_INT16(INT16_MAX, reading.temperature_dC);
    steep.temperature_uV_per_K = -1;
    bus_set(ADC1_SR, ADC1_SR_JEOC);
    TEST_ASSERT_EQUAL_INT16(INT16_MIN, motor_adc_step(&steep, &adc).temperature_dC);
    steep.temperature_uV_per_K = 0; /* not a sensor */
    TEST_ASSERT_EQUAL_INT16(MOTOR_ADC_TEMPERATURE_FAULT_dC,
                            motor_adc_step(&steep, &adc).temperature_dC);
}

void test_a_broken_wire_is_a_fault(void) {
    const uint32_t rails[2] = {19, 4076};
    for (uint32_t i = 0; i < 2U; i++) {
        motor_adc_reading_t reading = measure(rails[i], steps_of(750));
        TEST_ASSERT_EQUAL_UINT32(MOTOR_ADC_CURRENT_FAULT_mA, reading.current_mA);
        TEST_ASSERT_INT16_WITHIN(1, 250, reading.temperature_dC);
        reading = measure(steps_of(1650), rails[i]);
        TEST_ASSERT_UINT32_WITHIN(8, 0, reading.current_mA);
        TEST_ASSERT_EQUAL_INT16(MOTOR_ADC_TEMPERATURE_FAULT_dC, reading.temperature_dC);
    }
    TEST_ASSERT_TRUE(measure(20, 4075).current_mA != MOTOR_ADC_CURRENT_FAULT_mA);
}

void test_a_converter_that_stands_still_is_a_fault(void) {
    motor_adc_reading_t reading = measure(steps_of(1650 + 100), steps_of(750));
    bus_set(ADC1_SR, 0);
    for (uint32_t i = 0; i < 10U; i++) { /* keeps the newest result */
        reading = motor_adc_step(&config, &adc);
        TEST_ASSERT_UINT32_WITHIN(8, 1000, reading.current_mA);
    }
    for (uint32_t i = 0; i < 300U; i++) {
        reading = motor_adc_step(&config, &adc);
        TEST_ASSERT_EQUAL_UINT32(MOTOR_ADC_CURRENT_FAULT_mA, reading.current_mA);
        TEST_ASSERT_EQUAL_INT16(MOTOR_ADC_TEMPERATURE_FAULT_dC, reading.temperature_dC);
    }
    reading = measure(steps_of(1650 + 100), steps_of(750));
    TEST_ASSERT_UINT32_WITHIN(8, 1000, reading.current_mA);
}

void test_before_the_first_result_the_motor_is_at_rest(void) {
    motor_adc_reading_t reading = motor_adc_step(&config, &adc);
    TEST_ASSERT_EQUAL_UINT32(0, reading.current_mA);
    TEST_ASSERT_EQUAL_INT16(0, reading.temperature_dC);
    for (uint32_t i = 0; i < 10U; i++) { /* but not for ever */
        reading = motor_adc_step(&config, &adc);
    }
    TEST_ASSERT_EQUAL_UINT32(MOTOR_ADC_CURRENT_FAULT_mA, reading.current_mA);
}
