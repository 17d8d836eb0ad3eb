#include "port/stm32f405/joint_io.h"

#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/encoder_timer.h"
#include "port/stm32f405/motor_adc.h"
#include "port/stm32f405/servo_pwm.h"

static encoder_timer_config_t encoder_config = {.timer = TIM5_BASE, .bits = 32};
static encoder_timer_t encoder;
static motor_adc_t adc;

void joint_io_start(void) {
    gpio_start();
    servo_pwm_start();
    gpio_configure(PIN_TORQUE_LIGHT);
    gpio_configure(PIN_ENCODER_A);
    gpio_configure(PIN_ENCODER_B);
    gpio_configure(PIN_ENCODER_INDEX);
    motor_adc_start(&adc);
}

void joint_io_start_encoder(const object_dictionary_t *od) {
    encoder_config.reversed = od->joint_hardware_encoder_reversed != 0U;
    encoder_timer_start(&encoder_config, &encoder);
}

void joint_io_sample(const object_dictionary_t *od, motor_node_input_t *input) {
    const motor_adc_config_t adc_config = {
        .current_zero_mV = od->joint_hardware_current_zero_mV,
        .current_mA_per_V = od->joint_hardware_current_mA_per_V,
        .temperature_zero_mV = od->joint_hardware_temperature_zero_mV,
        .temperature_uV_per_K = od->joint_hardware_temperature_uV_per_K,
    };
    const encoder_reading_t position = encoder_timer_read(&encoder_config, &encoder);
    const motor_adc_reading_t motor = motor_adc_step(&adc_config, &adc);
    input->position_inc = position.position_inc;
    input->index_seen = position.index_seen;
    input->index_position_inc = position.index_position_inc;
    input->current_mA = motor.current_mA;
    input->temperature_dC = motor.temperature_dC;
}

void joint_io_write(const object_dictionary_t *od, int16_t torque_mNm, bool enabled) {
    const servo_pwm_config_t servo_config = {
        .full_scale_mNm = od->joint_hardware_full_scale_mNm,
        .offset_centi_percent = od->joint_hardware_offset_centi_percent,
    };
    servo_pwm_write(&servo_config, torque_mNm, enabled);
    gpio_write(PIN_TORQUE_LIGHT, enabled);
}
