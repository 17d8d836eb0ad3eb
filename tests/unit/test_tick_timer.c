/* The joint loop's timer. */
#include "unity.h"

#include "port/stm32f405/registers.h"
#include "port/stm32f405/tick_timer.h"
#include "register_bus_double.h"

static tick_timer_t timer;

static uint32_t take(uint32_t address, uint32_t content, uint32_t value) {
    return address == TIM_SR(TIM2_BASE) ? content & value : value; /* flags are cleared by 0 */
}

static void update_at(uint32_t count) {
    bus_set(TIM_SR(TIM2_BASE), TIM_SR_UIF);
    bus_set(TIM_CNT(TIM2_BASE), count);
}

void setUp(void) {
    bus_reset();
    bus_on_write(take);
    tick_timer_start(&timer);
}
void tearDown(void) {}

void test_start_sequence(void) {
    BUS_EXPECT_WRITES({RCC_APB1ENR, RCC_APB1ENR_TIM2EN},
                      {TIM_CR1(TIM2_BASE), TIM_CR1_ARPE | TIM_CR1_URS}, {TIM_PSC(TIM2_BASE), 0},
                      {TIM_ARR(TIM2_BASE), 16799}, {TIM_CNT(TIM2_BASE), 0},
                      {TIM_EGR(TIM2_BASE), TIM_EGR_UG}, {TIM_SR(TIM2_BASE), 0},
                      {TIM_DIER(TIM2_BASE), TIM_DIER_UIE},
                      {TIM_CR1(TIM2_BASE), TIM_CR1_ARPE | TIM_CR1_URS | TIM_CR1_CEN});
}

void test_a_tick_clears_its_flag_and_preloads_the_next_length(void) {
    update_at(20);
    bus_forget();
    tick_timer_interrupt(&timer);
    BUS_EXPECT_WRITES({TIM_SR(TIM2_BASE), ~TIM_SR_UIF}, {TIM_ARR(TIM2_BASE), 16799});
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(TIM_SR(TIM2_BASE)));
}

void test_a_sync_within_the_tick(void) {
    bus_set(TIM_CNT(TIM2_BASE), 5000);
    tick_timer_sync(5, &timer);
    TEST_ASSERT_EQUAL_INT32(-5000, timer.discipline.since_counts);
    TEST_ASSERT_FALSE(timer.sync_waits);
}

void test_a_sync_after_an_update_not_served_yet(void) {
    update_at(30); /* the tick's interrupt is pending behind the one that brought the SYNC */
    tick_timer_sync(5, &timer);
    TEST_ASSERT_TRUE(timer.sync_waits);
    tick_timer_interrupt(&timer);
    TEST_ASSERT_FALSE(timer.sync_waits);
    TEST_ASSERT_EQUAL_INT32(-30, timer.discipline.since_counts);
}

void test_a_sync_read_just_before_the_update(void) {
    update_at(16795); /* the flag came between the two reads */
    tick_timer_sync(5, &timer);
    TEST_ASSERT_FALSE(timer.sync_waits);
    tick_timer_interrupt(&timer);
    TEST_ASSERT_EQUAL_INT32(5, timer.discipline.since_counts);
}

void test_follows_sync(void) {
    /* 84 MHz / 1.05 kHz: 80000 counts, five ticks of 16000 */
    uint32_t time = 0;
    uint32_t begin = 0;
    uint32_t running = 16800;
    uint32_t preload = 16800;
    for (uint32_t k = 1; k <= 200U; k++) {
        time += 80000U;
        while (begin + running <= time) {
            begin += running;
            running = preload;
            update_at(10);
            tick_timer_interrupt(&timer);
            preload = bus_get(TIM_ARR(TIM2_BASE)) + 1U;
        }
        bus_set(TIM_CNT(TIM2_BASE), time - begin);
        tick_timer_sync(5, &timer);
    }
    TEST_ASSERT_UINT32_WITHIN(2, 16000, running);
    TEST_ASSERT_UINT32_WITHIN(8, 840, begin + running - time); /* 10 us after SYNC */
}
