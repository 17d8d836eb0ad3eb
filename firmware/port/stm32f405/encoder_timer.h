/**
 * Incremental encoder on TIM5 in encoder mode: every edge of both lines counts (x4; RM0090 section
 * 18.3.12), 32 bits wide, so that no count is lost however long the joint loop stands still. A
 * timer of 16 bits does as well, read at least once per 32767 counts.
 *
 * The index pulse's rising edge captures the counter in hardware (channel 3). Two pulses between
 * two reads leave the second one's position and are counted. What the positions must fulfil to be
 * believed (jump, place of the index, standstill under torque) is the node's matter: objects 2103h
 * and error 7305h.
 *
 * Filter: a level counts after 8 periods of 84 MHz, 95 ns; so up to 5 million edges a second of one
 * line, 20 million counts.
 */
#ifndef ENCODER_TIMER_H
#define ENCODER_TIMER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    uint32_t timer; /**< TIMx_BASE; x = 2 or 5: 32 bits, 3 or 4: 16 bits */
    uint8_t bits;   /**< of the counter: 16 or 32 */
    bool reversed;  /**< counts the other way round */
} encoder_timer_config_t;

typedef struct {
    uint32_t last_count; /**< of the counter */
    int32_t position_inc;
    uint32_t double_pulses; /**< times that an index pulse was overtaken by the next; saturates */
} encoder_timer_t;

typedef struct {
    int32_t position_inc;
    bool index_seen;            /**< since the last read */
    int32_t index_position_inc; /**< at the pulse; 0 unless index_seen */
} encoder_reading_t;

/** Clock on, counts from 0. The pins are the caller's matter. */
void encoder_timer_start(const encoder_timer_config_t *config, encoder_timer_t *encoder);

/** Once a joint tick. Positions wrap at the ends of 32 bits. */
encoder_reading_t encoder_timer_read(const encoder_timer_config_t *config,
                                     encoder_timer_t *encoder);

#endif
