#include "port/stm32f405/tick_timer.h"

#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

const tick_discipline_config_t tick_timer_config = {
    .nominal_counts = 200U * TICK_TIMER_COUNTS_PER_us,
    .min_counts = 100U * TICK_TIMER_COUNTS_PER_us,
    .max_counts = 10000U * TICK_TIMER_COUNTS_PER_us,
    .lead_counts = 10U * TICK_TIMER_COUNTS_PER_us,
    .step_max_counts = 2U * TICK_TIMER_COUNTS_PER_us,
    .hold_counts = 1000000U * TICK_TIMER_COUNTS_PER_us,
};

void tick_timer_start(tick_timer_t *timer) {
    *timer = (tick_timer_t){0};
    tick_discipline_start(&tick_timer_config, &timer->discipline);
    register_set(RCC_APB1ENR, RCC_APB1ENR_TIM2EN);
    (void)register_read(RCC_APB1ENR);
    register_write(TIM_CR1(TIM2_BASE), TIM_CR1_ARPE | TIM_CR1_URS);
    register_write(TIM_PSC(TIM2_BASE), 0);
    register_write(TIM_ARR(TIM2_BASE), timer->discipline.running_counts - 1U);
    register_write(TIM_CNT(TIM2_BASE), 0);
    register_write(TIM_EGR(TIM2_BASE), TIM_EGR_UG); /* loads ARR; URS: without an interrupt */
    register_write(TIM_SR(TIM2_BASE), 0);
    register_write(TIM_DIER(TIM2_BASE), TIM_DIER_UIE);
    register_set(TIM_CR1(TIM2_BASE), TIM_CR1_CEN);
}

void tick_timer_interrupt(tick_timer_t *timer) {
    register_write(TIM_SR(TIM2_BASE), ~TIM_SR_UIF);
    const uint32_t next_counts = tick_discipline_tick(&tick_timer_config, &timer->discipline);
    register_write(TIM_ARR(TIM2_BASE), next_counts - 1U);
    if (timer->sync_waits) {
        timer->sync_waits = false;
        tick_discipline_sync(&tick_timer_config, timer->sync_count, timer->sync_joint_ticks,
                             &timer->discipline);
    }
}

void tick_timer_sync(uint8_t joint_ticks, tick_timer_t *timer) {
    const uint32_t count = register_read(TIM_CNT(TIM2_BASE));
    const bool updated = (register_read(TIM_SR(TIM2_BASE)) & TIM_SR_UIF) != 0U;
    /* A high count was read before the update. */
    if (updated && count < timer->discipline.running_counts / 2U) {
        timer->sync_waits = true;
        timer->sync_count = count;
        timer->sync_joint_ticks = joint_ticks;
        return;
    }
    tick_discipline_sync(&tick_timer_config, count, joint_ticks, &timer->discipline);
}
