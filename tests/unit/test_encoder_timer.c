/* Encoder on a timer that is acted by the register bus. */
#include "unity.h"

#include "port/stm32f405/encoder_timer.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

static const encoder_timer_config_t wide = {.timer = TIM5_BASE, .bits = 32};
static const encoder_timer_config_t narrow = {.timer = TIM3_BASE, .bits = 16};
static encoder_timer_t encoder;

static uint32_t answer(uint32_t address, uint32_t content) {
    if (address == TIM_CCR3(TIM5_BASE)) { /* reading it clears the flag (RM0090 18.4.5) */
        bus_set(TIM_SR(TIM5_BASE), bus_get(TIM_SR(TIM5_BASE)) & ~TIM_SR_CC3IF);
    }
    return content;
}

static uint32_t take(uint32_t address, uint32_t content, uint32_t value) {
    return address == TIM_SR(TIM5_BASE) || address == TIM_SR(TIM3_BASE) ? content & value : value;
}

static encoder_reading_t at(const encoder_timer_config_t *config, uint32_t count) {
    bus_set(TIM_CNT(config->timer), count);
    return encoder_timer_read(config, &encoder);
}

void setUp(void) {
    bus_reset();
    bus_on_read(answer);
    bus_on_write(take);
    encoder_timer_start(&wide, &encoder);
}
void tearDown(void) {}

void test_counts_every_edge_of_both_lines(void) {
    BUS_EXPECT_WRITES({RCC_APB1ENR, RCC_APB1ENR_TIM5EN}, {TIM_CR1(TIM5_BASE), 0},
                      {TIM_CCER(TIM5_BASE), 0}, {TIM_CCMR1(TIM5_BASE), 0x3131},
                      {TIM_CCMR2(TIM5_BASE), 0x0031}, {TIM_SMCR(TIM5_BASE), 3},
                      {TIM_PSC(TIM5_BASE), 0}, {TIM_ARR(TIM5_BASE), 0xFFFFFFFFU},
                      {TIM_CNT(TIM5_BASE), 0}, {TIM_SR(TIM5_BASE), 0},
                      {TIM_CCER(TIM5_BASE), TIM_CCER_CC3E}, {TIM_CR1(TIM5_BASE), TIM_CR1_CEN});
}

void test_the_other_way_round(void) {
    const encoder_timer_config_t config = {.timer = TIM5_BASE, .bits = 32, .reversed = true};
    encoder_timer_start(&config, &encoder);
    TEST_ASSERT_EQUAL_HEX32(TIM_CCER_CC3E | TIM_CCER_CC1P, bus_get(TIM_CCER(TIM5_BASE)));
}

void test_each_timer_has_its_clock(void) {
    const uint32_t timers[4] = {TIM2_BASE, TIM3_BASE, TIM4_BASE, TIM5_BASE};
    for (uint32_t i = 0; i < 4U; i++) {
        const encoder_timer_config_t config = {.timer = timers[i], .bits = 16};
        bus_set(RCC_APB1ENR, 0);
        encoder_timer_start(&config, &encoder);
        TEST_ASSERT_EQUAL_HEX32(1U << i, bus_get(RCC_APB1ENR));
    }
}

void test_follows_both_ways_through_zero(void) {
    TEST_ASSERT_EQUAL_INT32(1000, at(&wide, 1000).position_inc);
    TEST_ASSERT_EQUAL_INT32(-5, at(&wide, 0xFFFFFFFBU).position_inc);
    TEST_ASSERT_FALSE(at(&wide, 3).index_seen);
    TEST_ASSERT_EQUAL_INT32(3, encoder.position_inc);
}

void test_sixteen_bits_lose_no_count(void) {
    encoder_timer_start(&narrow, &encoder);
    int32_t position = 0;
    const int32_t ways[] = {32767, 32767, 32767, -32768, -32768, -32768, -32768, 1, -1, 20000};
    for (uint32_t i = 0; i < sizeof ways / sizeof ways[0]; i++) {
        position += ways[i];
        const encoder_reading_t reading = at(&narrow, (uint32_t)position & 0xFFFFU);
        TEST_ASSERT_EQUAL_INT32(position, reading.position_inc);
    }
}

void test_positions_wrap(void) {
    encoder.position_inc = INT32_MAX;
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, at(&wide, 1).position_inc);
}

void test_the_index_pulse_has_its_own_position(void) {
    bus_set(TIM_SR(TIM5_BASE), TIM_SR_CC3IF);
    bus_set(TIM_CCR3(TIM5_BASE), 990);
    encoder_reading_t reading = at(&wide, 1000);
    TEST_ASSERT_TRUE(reading.index_seen);
    TEST_ASSERT_EQUAL_INT32(990, reading.index_position_inc);
    reading = at(&wide, 1010);
    TEST_ASSERT_FALSE(reading.index_seen);
    TEST_ASSERT_EQUAL_INT32(0, reading.index_position_inc);
}

void test_a_pulse_across_the_ends_of_sixteen_bits(void) {
    encoder_timer_start(&narrow, &encoder);
    (void)at(&narrow, 30000);
    (void)at(&narrow, 60000);
    bus_set(TIM_SR(TIM3_BASE), TIM_SR_CC3IF);
    bus_set(TIM_CCR3(TIM3_BASE), 65530);
    const encoder_reading_t reading = at(&narrow, 10);
    TEST_ASSERT_EQUAL_INT32(65546, reading.position_inc);
    TEST_ASSERT_EQUAL_INT32(65530, reading.index_position_inc);
}

void test_a_pulse_that_was_overtaken_is_counted(void) {
    bus_set(TIM_SR(TIM5_BASE), TIM_SR_CC3IF | TIM_SR_CC3OF);
    bus_set(TIM_CCR3(TIM5_BASE), 40);
    TEST_ASSERT_EQUAL_INT32(40, at(&wide, 50).index_position_inc);
    TEST_ASSERT_EQUAL_UINT32(1, encoder.double_pulses);
    TEST_ASSERT_FALSE(at(&wide, 60).index_seen);
    TEST_ASSERT_EQUAL_UINT32(1, encoder.double_pulses);
    encoder.double_pulses = UINT32_MAX;
    bus_set(TIM_SR(TIM5_BASE), TIM_SR_CC3OF);
    (void)at(&wide, 60);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, encoder.double_pulses);
}
