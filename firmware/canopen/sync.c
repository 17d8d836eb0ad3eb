#include "canopen/sync.h"

#include "canopen/node_time.h"

void sync_restart(sync_t *sync) {
    const sync_t fresh = {.wrong_length = sync->wrong_length};
    *sync = fresh;
}

uint32_t sync_elapse(const sync_config_t *config, uint32_t elapsed_us, sync_t *sync) {
    sync->since_us = node_time_add(sync->since_us, elapsed_us);
    if (!sync->running || config->period_us == 0U || sync->since_us < config->period_us) {
        return 0;
    }
    const uint32_t overdue = (sync->since_us - config->period_us / 2U) / config->period_us;
    const uint32_t missed = overdue > sync->overdue ? overdue - sync->overdue : 0U;
    sync->overdue += missed;
    return missed;
}

static void follow_counter(const sync_config_t *config, uint8_t counter, sync_t *sync,
                           sync_result_t *result) {
    if (sync->counter != 0U) {
        if (counter == sync->counter) {
            result->acts = false;
            result->duplicate = true;
            return;
        }
        const uint8_t expected =
            sync->counter >= config->overflow ? 1U : (uint8_t)(sync->counter + 1U);
        if (counter != expected) {
            result->jump = true;
            if (config->period_us == 0U) {
                const uint32_t skipped = (uint32_t)counter + config->overflow - expected;
                result->missed = skipped % config->overflow;
            }
        }
    }
    sync->counter = counter;
}

sync_result_t sync_receive(const sync_config_t *config, const can_frame_t *frame, sync_t *sync) {
    sync_result_t result = {.acts = true};
    const bool counts = config->overflow != 0U;
    if (frame->len != (counts ? 1U : 0U) && !sync->wrong_length) {
        sync->wrong_length = true;
        result.report_length = true;
    }
    if (counts && frame->len >= 1U) {
        follow_counter(config, frame->data[0], sync, &result);
    }
    if (result.acts) {
        sync->running = true;
        sync->since_us = 0;
        sync->overdue = result.missed;
    }
    return result;
}
