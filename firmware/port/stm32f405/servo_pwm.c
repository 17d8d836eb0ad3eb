#include "port/stm32f405/servo_pwm.h"

#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/gpio.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum {
    PERIOD_counts = 33600, /* 168 MHz / 5 kHz */
    DUTY_MIN_counts = PERIOD_counts / 10,
    DUTY_MIDDLE_counts = PERIOD_counts / 2,
    DUTY_MAX_counts = PERIOD_counts * 9 / 10,
    DUTY_SPAN_counts = DUTY_MAX_counts - DUTY_MIDDLE_counts,
    OFFSET_MAX_centi_percent = 500,
    CENTI_PERCENT = 10000,
    PWM_MODE_1 = 6
};

static int32_t limit(int32_t value, int32_t low, int32_t high) {
    return value < low ? low : (value > high ? high : value);
}

uint32_t servo_pwm_duty(const servo_pwm_config_t *config, int16_t torque_mNm) {
    if (config->full_scale_mNm == 0U) {
        return DUTY_MIDDLE_counts;
    }
    const int32_t full_scale_mNm = config->full_scale_mNm;
    const int32_t torque = limit(torque_mNm, -full_scale_mNm, full_scale_mNm);
    const int32_t offset =
        limit(config->offset_centi_percent, -OFFSET_MAX_centi_percent, OFFSET_MAX_centi_percent);
    const int32_t duty = DUTY_MIDDLE_counts + torque * DUTY_SPAN_counts / full_scale_mNm +
                         offset * PERIOD_counts / CENTI_PERCENT;
    return (uint32_t)limit(duty, DUTY_MIN_counts, DUTY_MAX_counts);
}

void servo_pwm_off(void) {
    gpio_write(PIN_SERVO_ENABLE, false);
    register_write(TIM_CCR1(TIM1_BASE), DUTY_MIDDLE_counts);
}

void servo_pwm_start(void) {
    gpio_configure(PIN_SERVO_ENABLE);
    register_set(RCC_APB2ENR, RCC_APB2ENR_TIM1EN);
    (void)register_read(RCC_APB2ENR);
    register_write(TIM_CR1(TIM1_BASE), 0);
    register_write(TIM_PSC(TIM1_BASE), 0);
    register_write(TIM_ARR(TIM1_BASE), PERIOD_counts - 1);
    register_write(TIM_CCMR1(TIM1_BASE),
                   register_field(TIM_CCMR1_OC1M, PWM_MODE_1) | TIM_CCMR1_OC1PE);
    servo_pwm_off();
    register_write(TIM_EGR(TIM1_BASE), TIM_EGR_UG); /* 50 % holds from the first period on */
    register_write(TIM_CCER(TIM1_BASE), TIM_CCER_CC1E);
    register_write(TIM_BDTR(TIM1_BASE), TIM_BDTR_MOE);
    register_write(TIM_CR1(TIM1_BASE), TIM_CR1_ARPE | TIM_CR1_CEN);
    gpio_configure(PIN_SERVO_PWM);
}

void servo_pwm_write(const servo_pwm_config_t *config, int16_t torque_mNm, bool enabled) {
    if (!enabled || config->full_scale_mNm == 0U) {
        servo_pwm_off();
        return;
    }
    register_write(TIM_CCR1(TIM1_BASE), servo_pwm_duty(config, torque_mNm));
    gpio_write(PIN_SERVO_ENABLE, true);
}
