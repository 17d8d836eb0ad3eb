/**
 * Set value and enable of a servo amplifier in torque mode: PWM of 10..90 % duty on TIM1 channel 1
 * (PA8), 50 % = no torque, and an enable line (PB13), high = power stage on.
 *
 * 5 kHz, the highest frequency that common servo controllers take, from 168 MHz: 26880 steps from
 * one full scale to the other. A new duty begins with the next period; so the amplifier has the
 * torque one to two periods, 200 to 400 us, after it was computed.
 *
 * The enable line needs a resistor to ground: it is low before the firmware runs and while the chip
 * is in reset. The emergency stop cuts the same line (docs/hardware/wiring.md).
 */
#ifndef SERVO_PWM_H
#define SERVO_PWM_H

#include <stdbool.h>
#include <stdint.h>

/** From objects 2106h:01 and :02 of the node. */
typedef struct {
    uint16_t full_scale_mNm;      /**< torque at 90 % duty, 1..65535; 0 keeps the output off */
    int16_t offset_centi_percent; /**< added to the duty, 1/100 %, -500..500: it nulls the
                                       amplifier's own offset; more is taken as +-500 */
} servo_pwm_config_t;

/** Off, then clock, pins and timer: 50 % duty, enable low. */
void servo_pwm_start(void);

/** Set value and enable of this tick. The torque saturates at full scale. On: the duty is written
 * before the line rises; off: as servo_pwm_off(). */
void servo_pwm_write(const servo_pwm_config_t *config, int16_t torque_mNm, bool enabled);

/** Enable low at once, 50 % duty from the next period on. Two register writes, without state: safe
 * in fault handlers and before servo_pwm_start(). */
void servo_pwm_off(void);

/** Duty in counts of the timer's 33600 for a torque; pure. */
uint32_t servo_pwm_duty(const servo_pwm_config_t *config, int16_t torque_mNm);

#endif
