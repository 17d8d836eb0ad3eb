#include "port/stm32f405/encoder_timer.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum { INPUT = 1, ENCODER_BOTH_EDGES = 3, FILTER_8_PERIODS = 3 };

static uint32_t clock_bit(uint32_t timer) {
    switch (timer) {
    case TIM2_BASE:
        return RCC_APB1ENR_TIM2EN;
    case TIM3_BASE:
        return RCC_APB1ENR_TIM3EN;
    case TIM4_BASE:
        return RCC_APB1ENR_TIM4EN;
    default:
        return RCC_APB1ENR_TIM5EN;
    }
}

void encoder_timer_start(const encoder_timer_config_t *config, encoder_timer_t *encoder) {
    const uint32_t timer = config->timer;
    *encoder = (encoder_timer_t){0};
    register_set(RCC_APB1ENR, clock_bit(timer));
    (void)register_read(RCC_APB1ENR);
    register_write(TIM_CR1(timer), 0);
    register_write(TIM_CCER(timer), 0); /* channels are chosen while they are off */
    register_write(TIM_CCMR1(timer), register_field(TIM_CCMR1_CC1S, INPUT) |
                                         register_field(TIM_CCMR1_IC1F, FILTER_8_PERIODS) |
                                         register_field(TIM_CCMR1_CC2S, INPUT) |
                                         register_field(TIM_CCMR1_IC2F, FILTER_8_PERIODS));
    register_write(TIM_CCMR2(timer), register_field(TIM_CCMR2_CC3S, INPUT) |
                                         register_field(TIM_CCMR2_IC3F, FILTER_8_PERIODS));
    register_write(TIM_SMCR(timer), register_field(TIM_SMCR_SMS, ENCODER_BOTH_EDGES));
    register_write(TIM_PSC(timer), 0);
    register_write(TIM_ARR(timer), config->bits == 16U ? 0xFFFFU : 0xFFFFFFFFU);
    register_write(TIM_CNT(timer), 0);
    register_write(TIM_SR(timer), 0);
    register_write(TIM_CCER(timer), TIM_CCER_CC3E | (config->reversed ? TIM_CCER_CC1P : 0U));
    register_write(TIM_CR1(timer), TIM_CR1_CEN);
}

/** Way from one count to another, the shorter one round. */
static int32_t way(const encoder_timer_config_t *config, uint32_t from, uint32_t to) {
    const uint32_t difference = to - from;
    return config->bits == 16U ? (int16_t)(uint16_t)difference : (int32_t)difference;
}

static int32_t add(int32_t position, int32_t way_inc) {
    return (int32_t)((uint32_t)position + (uint32_t)way_inc);
}

encoder_reading_t encoder_timer_read(const encoder_timer_config_t *config,
                                     encoder_timer_t *encoder) {
    const uint32_t timer = config->timer;
    encoder_reading_t reading = {0};
    /* State first: a pulse after it is the next read's, whose position is the later one then. */
    const uint32_t state = register_read(TIM_SR(timer));
    const uint32_t count = register_read(TIM_CNT(timer));
    const int32_t before_inc = encoder->position_inc;
    encoder->position_inc = add(before_inc, way(config, encoder->last_count, count));
    reading.position_inc = encoder->position_inc;
    if ((state & TIM_SR_CC3IF) != 0U) {
        const uint32_t at_pulse = register_read(TIM_CCR3(timer)); /* clears CC3IF */
        reading.index_seen = true;
        reading.index_position_inc = add(reading.position_inc, way(config, count, at_pulse));
    }
    if ((state & TIM_SR_CC3OF) != 0U) {
        register_write(TIM_SR(timer), ~TIM_SR_CC3OF);
        encoder->double_pulses += encoder->double_pulses < UINT32_MAX ? 1U : 0U;
    }
    encoder->last_count = count;
    return reading;
}
