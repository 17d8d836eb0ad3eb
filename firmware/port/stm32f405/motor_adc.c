#include "port/stm32f405/motor_adc.h"

#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum {
    CHANNEL_CURRENT = 10,
    CHANNEL_TEMPERATURE = 11,
    DIVIDE_BY_4 = 1,      /* of APB2 84 MHz: 21 MHz */
    SAMPLE_56_CYCLES = 3, /* 2.7 us: source impedance up to 50 kohm (DS8626 equation 1) */
    TWO_CONVERSIONS = 1,
    STEPS_MAX = 4095,
    STEPS_MARGIN = 20,
    REFERENCE_mV = 3300,
    AGE_MAX_ticks = 10,
    uV_PER_mV = 1000,
    mV_PER_V = 1000,
    dC_PER_K = 10
};

void motor_adc_start(motor_adc_t *adc) {
    *adc = (motor_adc_t){0};
    gpio_configure(PIN_MOTOR_CURRENT);
    gpio_configure(PIN_MOTOR_TEMPERATURE);
    register_set(RCC_APB2ENR, RCC_APB2ENR_ADC1EN);
    (void)register_read(RCC_APB2ENR);
    register_modify(ADC_COMMON_CCR, ADC_COMMON_CCR_ADCPRE,
                    register_field(ADC_COMMON_CCR_ADCPRE, DIVIDE_BY_4));
    register_write(ADC1_CR1, ADC1_CR1_SCAN);
    /* SMPR1: three bits a channel, from channel 10 on */
    register_write(ADC1_SMPR1, (uint32_t)SAMPLE_56_CYCLES | ((uint32_t)SAMPLE_56_CYCLES << 3));
    /* A sequence of two begins at JSQ3 (RM0090 section 13.13.12). */
    register_write(ADC1_JSQR, register_field(ADC1_JSQR_JL, TWO_CONVERSIONS) |
                                  register_field(ADC1_JSQR_JSQ3, CHANNEL_CURRENT) |
                                  register_field(ADC1_JSQR_JSQ4, CHANNEL_TEMPERATURE));
    register_write(ADC1_CR2, ADC1_CR2_ADON); /* steady after 3 us, before the first tick */
}

static bool plausible(uint16_t steps) {
    return steps >= STEPS_MARGIN && steps <= STEPS_MAX - STEPS_MARGIN;
}

static int32_t to_mV(uint16_t steps) {
    return ((int32_t)steps * REFERENCE_mV + STEPS_MAX / 2) / STEPS_MAX;
}

static uint32_t current_mA(const motor_adc_config_t *config, uint16_t steps) {
    const int32_t over_mV = to_mV(steps) - (int32_t)config->current_zero_mV;
    const uint32_t size_mV = (uint32_t)(over_mV < 0 ? -over_mV : over_mV);
    return size_mV * config->current_mA_per_V / mV_PER_V;
}

static int16_t temperature_dC(const motor_adc_config_t *config, uint16_t steps) {
    const int32_t over_uV = (to_mV(steps) - (int32_t)config->temperature_zero_mV) * uV_PER_mV;
    if (config->temperature_uV_per_K == 0) {
        return MOTOR_ADC_TEMPERATURE_FAULT_dC;
    }
    const int32_t temperature = over_uV * dC_PER_K / config->temperature_uV_per_K;
    return temperature > INT16_MAX
               ? (int16_t)INT16_MAX
               : (temperature < INT16_MIN ? (int16_t)INT16_MIN : (int16_t)temperature);
}

motor_adc_reading_t motor_adc_step(const motor_adc_config_t *config, motor_adc_t *adc) {
    motor_adc_reading_t reading = {0};
    if ((register_read(ADC1_SR) & ADC1_SR_JEOC) != 0U) {
        adc->current_steps = (uint16_t)register_read(ADC1_JDR1);
        adc->temperature_steps = (uint16_t)register_read(ADC1_JDR2);
        adc->age_ticks = 0;
        adc->known = true;
        register_write(ADC1_SR, ~ADC1_SR_JEOC);
    } else if (adc->age_ticks < UINT8_MAX) {
        adc->age_ticks++;
    } else {
        /* stays at its highest */
    }
    register_write(ADC1_CR2, ADC1_CR2_ADON | ADC1_CR2_JSWSTART);
    const bool dead = adc->age_ticks > AGE_MAX_ticks;
    if (dead || adc->known) {
        reading.current_mA = dead || !plausible(adc->current_steps)
                                 ? MOTOR_ADC_CURRENT_FAULT_mA
                                 : current_mA(config, adc->current_steps);
        reading.temperature_dC = dead || !plausible(adc->temperature_steps)
                                     ? (int16_t)MOTOR_ADC_TEMPERATURE_FAULT_dC
                                     : temperature_dC(config, adc->temperature_steps);
    }
    return reading;
}
