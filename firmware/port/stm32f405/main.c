/*
 * motor_node on the STM32F405: puts the node, its bus and its joint together. What runs at which
 * priority is in interrupts.h; docs/firmware_image.md has the timing.
 *
 * Bus: CAN on the crystal's clock, or SLCAN over the serial line, whichever is first: opening the
 * SLCAN channel turns CAN away, and a frame on CAN turns the serial line away. Both fill the queue
 * of frames of slcan_node, which has the rule of the stepped time base.
 */
#include "node/motor_node.h"
#include "port/slcan/slcan_node.h"
#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/bxcan.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/dip_switch.h"
#include "port/stm32f405/fault.h"
#include "port/stm32f405/flash_pages.h"
#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/joint_io.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "port/stm32f405/tick_timer.h"
#include "port/stm32f405/time_base.h"
#include "port/stm32f405/unique_id.h"
#include "port/stm32f405/usart.h"
#include "port/stm32f405/version_block.h"
#include "port/stm32f405/watchdog.h"

#define ELAPSED_MAX_us 1000000U
/* Object 2107h. */
#define LINK_CAN 0U
#define LINK_SERIAL_OSCILLATOR 1U
#define LINK_SERIAL_NO_CONTROLLER 2U
/* SysTick's beat: the supervisor's, and on the internal oscillator, where no torque depends on it,
 * the joint tick's. */
#define BEAT_us 10000U
/* 200 ms, since a save on the slowest flash takes 60 (the watchdog bites before, after 20 to 56 ms,
 * and is fed by the save); on the internal oscillator, where the amplifier stays off, 2 s: an
 * emulator's clock may run ten times as fast as its core. */
#define SUPERVISOR_BEATS 20U
#define SUPERVISOR_BEATS_OFF 200U

void main_prepare(void); /* of startup.c, as main */

static clock_tree_t clock;
static crash_record_t crash;
static char software_version[VERSION_BLOCK_TEXT_MAX];
static motor_node_config_t config;
static motor_node_t node;
static motor_node_input_t input;   /* not on the stack, which is small; only of the node's */
static motor_node_output_t output; /* exception, as all that follows */
static slcan_node_t frames;
static slcan_node_text_t text;
static bxcan_t can;
static bool on_can;
static uint8_t filtered_id;
static tick_timer_t tick_timer;
static uint32_t last_step_us;
static volatile bool tick_due; /* set by the timers */

/* The supervisor's: written by main and by the node's exception, read by the time's. */
static volatile bool feed_due; /* of the watchdog, once a beat */
static volatile bool main_alive;
static volatile bool ticks_alive;
static uint32_t silent_beats;

/* --- the node */

static bool is_stepped(void) {
    return node.od.time_base != 0U;
}

/** Off the bench's clock, or without its sensors, the amplifier stays off: the torque is told over
 * the bus alone. */
static void act(void) {
    joint_io_write(&node.od, output.torque_mNm,
                   output.output_enabled && !is_stepped() && node.od.sensor_source == 0U &&
                       clock.crystal);
}

static void send_text(void) {
    if (text.length != 0U && !usart_send(text.text, text.length)) {
        frames.frames_lost++; /* 2201h:08 */
    }
}

/** The channel over the serial line is open, or nothing else is there. */
static bool is_serial(void) {
    return !on_can || frames.open;
}

static void send_frames(void) {
    if (!is_serial()) {
        (void)bxcan_send(output.frames, output.frame_count, &can); /* a loss is counted there */
        frames.answers_due = 0;
        if (filtered_id != node.node_id) {
            filtered_id = node.node_id;
            bxcan_filter(filtered_id);
        }
    } else {
        slcan_node_output(&output, &frames, &text);
        send_text();
    }
}

static void step(void) {
    const uint32_t now_us = time_base_now_us();
    const uint32_t elapsed_us = now_us - last_step_us;
    last_step_us = now_us;
    input.elapsed_us = elapsed_us < ELAPSED_MAX_us ? elapsed_us : ELAPSED_MAX_us;
    joint_io_sample(&node.od, &input);
    slcan_node_input(&frames, &input);
    if (on_can) {
        input.bus_off = bxcan_poll(&can) && !is_serial();
        input.frames_lost += bxcan_take_losses(&can);
    }
    motor_node_step(&config, &node, &input, &output);
    act();
    if (output.reset_requested) {
        motor_node_restart(&config, &node);
    }
    send_frames();
    ticks_alive = true;
}

static void receive_bytes(void) {
    usart_event_t event;
    uint8_t byte = 0;
    while ((event = usart_receive(&byte)) != USART_EMPTY) {
        if (event == USART_LOST) {
            slcan_node_lose(&frames);
        } else {
            const bool due = slcan_node_receive(&node, byte, &frames, &text);
            send_text();
            if (due) {
                step();
            }
        }
    }
}

static void receive_frames(void) {
    can_frame_t frame;
    while (bxcan_receive(&can, &frame, 1) != 0U) {
        if (!is_serial() && slcan_node_take(&node, &frame, &frames, &text)) {
            step();
        }
    }
}

void interrupt_node(void) {
    if (on_can) {
        receive_frames();
        bxcan_transmit(&can); /* mailboxes that have become free */
    }
    if (is_serial() || can.counters.received == 0U) {
        receive_bytes();
    }
    if (tick_due) {
        tick_due = false;
        if (!is_stepped()) {
            step();
        }
    }
}

static void request_tick(void) {
    tick_due = true;
    interrupts_request_node();
}

/* --- peripherals' interrupts */

void interrupt_tick_timer(void) {
    tick_timer_interrupt(&tick_timer);
    request_tick();
}

static void receive_fifo(uint32_t fifo) {
    if (bxcan_receive_interrupt(fifo, &can)) {
        tick_timer_sync(node.od.fic_joint_ticks_per_sync, &tick_timer);
    }
    if (is_stepped()) {
        interrupts_request_node();
    }
}

void interrupt_can_cyclic(void) {
    receive_fifo(BXCAN_FIFO_CYCLIC);
}

void interrupt_can_other(void) {
    receive_fifo(BXCAN_FIFO_OTHER);
}

/* --- time and supervisor */

/** Main goes round at least at every beat; joint ticks come at least as often. */
static bool is_alive(void) {
    return main_alive && (ticks_alive || is_stepped());
}

/* cppcheck-suppress unusedFunction ; interrupt_time branches to it */
__attribute__((used)) static void beat(const uint32_t *frame) {
    time_base_expired();
    feed_due = true;
    if (is_alive()) {
        main_alive = false;
        ticks_alive = false;
        silent_beats = 0;
    } else if (silent_beats == (clock.crystal ? SUPERVISOR_BEATS : SUPERVISOR_BEATS_OFF)) {
        fault_end(CRASH_SUPERVISOR, frame);
    } else {
        silent_beats++;
    }
    if (!clock.crystal) {
        request_tick();
    }
}

/* A shim for the place that was interrupted, which the crash record tells. */
__attribute__((naked)) void interrupt_time(void) {
    __asm__ volatile("mrs r0, msp\n\tb beat");
}

/* --- power-on */

static void configure(void) {
    const bool by_watchdog = (register_read(RCC_CSR) & RCC_CSR_WDGRSTF) != 0U;
    register_set(RCC_CSR, RCC_CSR_RMVF);
    if (by_watchdog) {
        fault_keep(CRASH_WATCHDOG);
    }
    const bool after_fault = fault_take_record(&crash);
    const uint8_t switched = dip_switch_read();
    version_block_text(software_version);
    config = (motor_node_config_t){
        .node_id = switched,
        .node_id_by_switch = switched != LSS_UNCONFIGURED,
        .serial_number = unique_id_serial(fault_probe, 0),
        .supervisor_reset = after_fault,
        .image_damaged = !version_block_image_is_whole(),
        .clock_fallback = !clock.crystal,
        .frame_link = clock.crystal ? LINK_CAN : LINK_SERIAL_OSCILLATOR,
        .memory = &flash_pages,
        .crash = &crash,
        .software_version = software_version,
    };
    motor_node_init(&config, &node);
    joint_io_start_encoder(&node.od);
}

/* With no interrupt enabled yet: its stack does not add to theirs. */
void main_prepare(void) {
    joint_io_start();
    fault_init();
    interrupts_init();
    clock = clock_init();
    configure();
    filtered_id = node.node_id;
    if (clock.crystal) {
        on_can = bxcan_start(filtered_id, &can) != BXCAN_ABSENT;
        config.frame_link = on_can ? LINK_CAN : LINK_SERIAL_NO_CONTROLLER;
        node.od.frame_link = config.frame_link;
    }
    (void)watchdog_start(WATCHDOG_WINDOW_MOVING_us);
}

static void start_ticks(void) {
    time_base_start(clock.core_MHz, BEAT_us);
    usart_init(clock.apb2_Hz);
    if (clock.crystal) {
        tick_timer_start(&tick_timer);
        interrupts_enable(IRQ_TIM2);
    }
    if (on_can) {
        interrupts_enable(IRQ_CAN1_RX0);
        interrupts_enable(IRQ_CAN1_RX1);
    }
}

int main(void) {
    start_ticks();
    for (;;) {
        main_alive = true;
        if (feed_due) { /* not each time round: it takes main and the beat to keep it fed */
            feed_due = false;
            watchdog_feed();
        }
        const bool sent = usart_transmit();
        const uint32_t before = interrupts_block();
        if (sent && usart_transmit()) { /* nothing has come in between: sleep until it does */
            __asm__ volatile("dsb\n\twfi" ::: "memory");
        }
        interrupts_restore(before);
    }
}
