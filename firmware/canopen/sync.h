/**
 * SYNC consumer (CiA 301, 7.2.5): recognises repeated, skipped and missed SYNCs.
 *
 * With a counter (1019h = 2..240) the same counter again is a duplicate and does not act; a jump
 * acts once. Missed SYNCs are counted in node time when the period 1006h is known, else by the
 * jump.
 */
#ifndef SYNC_H
#define SYNC_H

#include <stdbool.h>
#include <stdint.h>

#include "canopen/can_frame.h"

#define SYNC_COB_ID 0x080U

typedef struct {
    uint8_t overflow;   /**< 1019h; 0 = SYNC without counter */
    uint32_t period_us; /**< 1006h; 0 = unknown */
} sync_config_t;

typedef struct {
    bool running; /**< a SYNC was received since sync_restart */
    bool wrong_length;
    uint8_t counter; /**< of the last SYNC; 0 = none */
    uint32_t since_us;
    uint32_t overdue; /**< SYNCs missed since the last one */
} sync_t;

typedef struct {
    bool acts;
    bool duplicate;
    bool jump;
    bool report_length; /**< first SYNC of wrong length since sync_restart: error 8240h */
    uint32_t missed;    /**< newly counted */
} sync_result_t;

/** Forgets what came before: at boot-up and when the node becomes operational. */
void sync_restart(sync_t *sync);

/** Lets node time pass; returns the number of SYNCs that became overdue by more than half a period.
 */
uint32_t sync_elapse(const sync_config_t *config, uint32_t elapsed_us, sync_t *sync);

/** Takes in one frame with COB-ID 080h. */
sync_result_t sync_receive(const sync_config_t *config, const can_frame_t *frame, sync_t *sync);

#endif
