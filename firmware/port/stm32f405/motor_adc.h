/**
 * Motor current and temperature by ADC1, channels 10 (PC0) and 11 (PC1), without a wait: each joint
 * tick takes the results of the conversions that the tick before it has started (injected group,
 * RM0090 section 13.3.9; 6.5 us of the tick for both).
 *
 * A voltage within 20 steps of either rail (12 bits: 16 mV) is a broken wire or a short circuit,
 * and results that stay away for more than 10 ticks are a dead converter. Both give the fault
 * values below, on which the node takes the torque off (errors 2310h and 4310h).
 */
#ifndef MOTOR_ADC_H
#define MOTOR_ADC_H

#include <stdbool.h>
#include <stdint.h>

#define MOTOR_ADC_CURRENT_FAULT_mA UINT32_MAX
#define MOTOR_ADC_TEMPERATURE_FAULT_dC INT16_MAX

/** From objects 2106h:03 to :06 of the node. Reference voltage: 3300 mV = 4095 steps. */
typedef struct {
    uint16_t current_zero_mV;     /**< at no current, 0..3300 */
    uint16_t current_mA_per_V;    /**< 1..65535 */
    uint16_t temperature_zero_mV; /**< at 0 degree Celsius, 0..3300 */
    int16_t temperature_uV_per_K; /**< -32768..32767, falling for some sensors; 0 is a fault */
} motor_adc_config_t;

typedef struct {
    uint16_t current_steps; /**< newest results, 0..4095 */
    uint16_t temperature_steps;
    uint8_t age_ticks; /**< since the newest results; saturates */
    bool known;        /**< there has been a result */
} motor_adc_t;

typedef struct {
    uint32_t current_mA;    /**< its size, 0..UINT16_MAX * 3.3, or MOTOR_ADC_CURRENT_FAULT_mA */
    int16_t temperature_dC; /**< 0.1 degree Celsius, or MOTOR_ADC_TEMPERATURE_FAULT_dC */
} motor_adc_reading_t;

/** Clock, converter and pins; the first conversion starts with the first step. */
void motor_adc_start(motor_adc_t *adc);

/** Once a joint tick. Until the first results, the values of a motor at rest at 0 degree. */
motor_adc_reading_t motor_adc_step(const motor_adc_config_t *config, motor_adc_t *adc);

#endif
