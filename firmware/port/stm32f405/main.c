/*
 * motor_node on the STM32F405: puts the node, its bus and its joint together. Which exception runs
 * what, and why, is in interrupts.h; docs/firmware_image.md has the timing.
 */
#include <string.h>

#include "node/motor_node.h"
#include "port/slcan/slcan_node.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/fault.h"
#include "port/stm32f405/flash_pages.h"
#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "port/stm32f405/time_base.h"
#include "port/stm32f405/unique_id.h"
#include "port/stm32f405/usart.h"
#include "port/stm32f405/version_block.h"
#include "port/timing/tick_schedule.h"

#define SUPERVISOR_ns 50000000
#define ELAPSED_MAX_us 1000000

void main_prepare(void); /* of startup.c, as main */

static clock_tree_t clock;
static crash_record_t crash;
static char software_version[VERSION_BLOCK_TEXT_MAX];
static motor_node_config_t config;
static motor_node_t node;
static motor_node_input_t input;   /* not on the stack, which is small; only of the node's */
static motor_node_output_t output; /* exception, as all below */
static slcan_node_t slcan;
static slcan_node_text_t text;
static tick_schedule_t schedule;
static int64_t last_step_us;

/* The supervisor's: written by main and by the node's exception, read by the time's. */
static volatile bool main_alive;
static volatile bool ticks_alive;
static int64_t alive_ns;

/* --- the node */

static bool is_stepped(void) {
    return node.od.time_base != 0U;
}

static void send_text(void) {
    if (text.length != 0U && !usart_send(text.text, text.length)) {
        input.frames_lost++;
    }
}

static uint32_t since_last_step_us(void) {
    const int64_t elapsed_us = time_base_now_ns() / 1000 - last_step_us;
    last_step_us += elapsed_us;
    return elapsed_us < ELAPSED_MAX_us ? (uint32_t)elapsed_us : ELAPSED_MAX_us;
}

static void step(void) {
    input.elapsed_us = since_last_step_us();
    slcan_node_input(&slcan, &input);
    motor_node_step(&config, &node, &input, &output);
    ticks_alive = true;
    if (output.reset_requested) {
        motor_node_restart(&config, &node);
    }
    slcan_node_output(&output, &slcan, &text);
    send_text();
}

static void receive_bytes(void) {
    usart_event_t event;
    uint8_t byte = 0;
    while ((event = usart_receive(&byte)) != USART_EMPTY) {
        if (event == USART_LOST) {
            slcan_node_lose(&slcan);
        } else {
            const bool due = slcan_node_receive(&node, byte, &slcan, &text);
            send_text();
            if (due) {
                step();
            }
        }
    }
}

/** Free-running: the joint tick, if it is due. Stepped: none is due by time. */
static void keep_time(void) {
    if (is_stepped()) {
        return;
    }
    int64_t now_ns = time_base_now_ns();
    if (now_ns >= schedule.next_ns) {
        tick_schedule_tick(now_ns, node.od.fic_joint_ticks_per_sync, &schedule);
        step();
    }
    time_base_alarm(schedule.next_ns);
}

void interrupt_node(void) {
    receive_bytes();
    keep_time();
}

/* --- time and supervisor */

/** Main goes round at least at every expiry; joint ticks come at least each period. */
static bool is_alive(void) {
    return main_alive && (ticks_alive || is_stepped());
}

__attribute__((used)) static void expire(const uint32_t *frame) {
    time_base_expired();
    const int64_t now_ns = time_base_now_ns();
    if (is_alive()) {
        main_alive = false;
        ticks_alive = false;
        alive_ns = now_ns;
    } else if (now_ns - alive_ns > SUPERVISOR_ns) {
        fault_end(CRASH_SUPERVISOR, frame);
    } else {
        /* still within its time */
    }
    interrupts_request_node();
}

/* A shim for the place that was interrupted, which the crash record tells. */
__attribute__((naked)) void interrupt_time(void) {
    __asm__ volatile("mrs r0, msp\n\tb expire");
}

/* --- power-on */

static void configure(void) {
    const bool after_fault = fault_take_record(&crash);
    version_block_text(software_version);
    config = (motor_node_config_t){
        .node_id = LSS_UNCONFIGURED,
        .serial_number = unique_id_serial_number(),
        .supervisor_reset = after_fault,
        .image_damaged = !version_block_image_is_whole(),
        .clock_fallback = !clock.crystal,
        .memory = &flash_pages,
        .crash = &crash,
        .software_version = software_version,
    };
    motor_node_init(&config, &node);
}

/* With no interrupt enabled yet: its stack does not add to theirs. */
void main_prepare(void) {
    fault_init();
    interrupts_init();
    clock = clock_init();
    configure();
}

int main(void) {
    usart_init(clock.apb2_Hz);
    tick_schedule_start(0, &schedule);
    time_base_init(clock.core_MHz);
    for (;;) {
        main_alive = true;
        const bool sent = usart_transmit();
        const uint32_t before = interrupts_block();
        if (sent && usart_transmit()) { /* nothing has come in between: sleep until it does */
            __asm__ volatile("dsb\n\twfi" ::: "memory");
        }
        interrupts_restore(before);
    }
}
