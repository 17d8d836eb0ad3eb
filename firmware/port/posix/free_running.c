#define _GNU_SOURCE
#include "port/posix/free_running.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "node/motor_node.h"
#include "node/tick_closing.h"
#include "port/posix/can_socket.h"
#include "port/posix/node_filters.h"
#include "port/posix/parameter_file.h"
#include "port/posix/stop_signal.h"
#include "port/posix/tick_schedule.h"

enum { EXIT_RUN_ENDED = 3, ELAPSED_MAX_us = 1000000, STEPPED_WAIT_ns = 250000000 };

typedef struct {
    const free_running_options_t *options;
    can_socket_t can;
    parameter_file_t file;
    parameter_memory_t memory;
    motor_node_config_t config;
    motor_node_t node;
    uint8_t filtered_id; /* that the socket's filters are made for */
    simulated_joint_t joint;
    double torque_Nm; /* held since the last tick */
    tick_schedule_t schedule;
    int64_t last_tick_us;
    can_frame_t frames[MOTOR_NODE_RX_MAX]; /* for the next tick */
    size_t frame_count;
    uint32_t frames_lost; /* since the last tick */
    tick_closing_t closing;
} device_t;

static int64_t now_ns(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/** Time since the last tick in whole us; what is left over stays for the next one. */
static uint32_t elapse(int64_t now, device_t *device) {
    const int64_t elapsed_us = now / 1000 - device->last_tick_us;
    device->last_tick_us += elapsed_us;
    return elapsed_us < ELAPSED_MAX_us ? (uint32_t)elapsed_us : ELAPSED_MAX_us;
}

static bool follow_node_id(device_t *device) {
    can_socket_filter_t filters[NODE_FILTERS_COUNT];
    if (device->filtered_id == device->node.node_id) {
        return true;
    }
    device->filtered_id = device->node.node_id;
    node_filters(device->filtered_id, filters);
    return can_socket_set_filters(&device->can, filters, NODE_FILTERS_COUNT);
}

static bool tick(uint32_t elapsed_us, device_t *device) {
    const free_running_options_t *options = device->options;
    motor_node_output_t output;
    simulated_joint_advance(&options->joint, device->torque_Nm, elapsed_us, &device->joint);
    const motor_node_input_t input = {
        .elapsed_us = elapsed_us,
        .position_inc = simulated_joint_position_inc(&options->joint, &device->joint),
        .temperature_dC = options->temperature_dC,
        .current_mA = simulated_joint_current_mA(&options->joint, device->torque_Nm),
        .bus_off = device->can.bus_off,
        .index_seen = device->joint.index_seen,
        .index_position_inc = device->joint.index_position_inc,
        .frames = device->frames,
        .frame_count = device->frame_count,
        .frames_lost = device->frames_lost,
    };
    motor_node_step(&device->config, &device->node, &input, &output);
    device->frame_count = 0;
    device->frames_lost = 0;
    device->torque_Nm = output.output_enabled ? (double)output.torque_mNm / 1000.0 : 0.0;
    if (output.reset_requested) {
        motor_node_restart(&device->config, &device->node);
    }
    /* A bus that takes no frames loses them, as a controller does whose mailboxes stay full. */
    return follow_node_id(device) &&
           (can_socket_send(&device->can, output.frames, output.frame_count, 0) ||
            errno == ETIMEDOUT);
}

/** A frame waits for the next tick, which it may be the one to close. */
static bool take_in(const can_frame_t *frame, device_t *device) {
    uint32_t elapsed_us = 0;
    const tick_closing_event_t event =
        tick_closing_receive(&device->node, frame, &device->closing, &elapsed_us);
    if (event == TICK_REPEATED ||
        (device->frame_count == MOTOR_NODE_RX_MAX && event != TICK_CLOSED)) {
        device->frames_lost++;
        return true;
    }
    if (device->frame_count == MOTOR_NODE_RX_MAX) {
        device->frames_lost++;
    } else {
        device->frames[device->frame_count++] = *frame;
    }
    if (event == TICK_CLOSED) {
        (void)elapse(now_ns(), device); /* does not count in this time base */
        return tick(elapsed_us, device);
    }
    if (device->node.od.time_base != 0U) {
        return true;
    }
    const bool sync = frame->id == SYNC_COB_ID;
    if (sync) {
        tick_schedule_sync(now_ns(), device->node.od.fic_joint_ticks_per_sync, &device->schedule);
    }
    return !(sync || device->frame_count == MOTOR_NODE_RX_MAX) ||
           tick(elapse(now_ns(), device), device);
}

/** Takes in what the bus has; each SYNC is a tick of its own, or in the stepped time base each
 * RPDO4. */
static bool receive(device_t *device) {
    can_frame_t received[MOTOR_NODE_RX_MAX];
    const size_t count = can_socket_receive(&device->can, received, MOTOR_NODE_RX_MAX, 0);
    for (size_t i = 0; i < count; i++) {
        if (!take_in(&received[i], device)) {
            return false;
        }
    }
    return true;
}

static bool run(device_t *device) {
    struct pollfd data = {.fd = device->can.fd, .events = POLLIN};
    while (!stop_signal_raised()) {
        const bool stepped = device->node.od.time_base != 0U;
        const int64_t rest_ns = stepped ? STEPPED_WAIT_ns : device->schedule.next_ns - now_ns();
        const struct timespec wait = {.tv_sec = rest_ns / 1000000000,
                                      .tv_nsec = rest_ns % 1000000000};
        if (rest_ns > 0 && ppoll(&data, 1, &wait, NULL) > 0) {
            if ((data.revents & POLLIN) == 0) {
                errno = ENETDOWN;
                return false;
            }
            if (!receive(device)) {
                return false;
            }
            continue;
        }
        const int64_t now = now_ns();
        if (!stepped && now >= device->schedule.next_ns) {
            tick_schedule_tick(now, device->node.od.fic_joint_ticks_per_sync, &device->schedule);
            if (!receive(device) || !tick(elapse(now_ns(), device), device)) {
                return false;
            }
        }
    }
    return true;
}

static int fail(const device_t *device, const char *what) {
    (void)fprintf(stderr, "motor_node %u: %s: %s\n", (unsigned)device->options->node_id, what,
                  strerror(errno));
    return EXIT_RUN_ENDED;
}

int free_running(const free_running_options_t *options) {
    static device_t device;
    can_socket_filter_t filters[NODE_FILTERS_COUNT];
    device = (device_t){
        .options = options,
        .config = {.node_id = options->node_id,
                   .serial_number = options->serial_number,
                   .referenced = options->referenced,
                   .supervisor_reset = options->supervisor_reset,
                   .clock_fallback = options->clock_fallback},
        .last_tick_us = now_ns() / 1000,
    };
    if (options->parameters != NULL) {
        if (!parameter_file_open(options->parameters, &device.file)) {
            return fail(&device, options->parameters);
        }
        device.memory = parameter_file_memory(&device.file);
        device.config.memory = &device.memory;
    }
    motor_node_init(&device.config, &device.node);
    device.filtered_id = device.node.node_id;
    node_filters(device.filtered_id, filters);
    if (!can_socket_open(&device.can, options->can, filters, NODE_FILTERS_COUNT)) {
        return fail(&device, options->can);
    }
    tick_schedule_start(now_ns(), &device.schedule);
    (void)puts("READY");
    (void)fflush(stdout);
    return run(&device) ? 0 : fail(&device, options->can);
}
