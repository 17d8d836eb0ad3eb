/*
 * motor_node: the firmware on the POSIX port, on SocketCAN. In the stepped time base encoder and
 * motor are the simulated arm's over LCM: one joint tick per ARM_STATE, and the frames of a SYNC
 * period are complete when BUS_CLOSED says how many there are (docs/architecture.md). With
 * --free-running the node is alone on the bus and on the wall clock (free_running.h). With --slcan
 * it has a TCP port in place of a bus (slcan_server.h).
 */
#define _GNU_SOURCE
#include <errno.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hpmc_lcm_arm_state_t.h"
#include "hpmc_lcm_bus_closed_t.h"
#include "hpmc_lcm_joint_torque_t.h"
#include "node/motor_node.h"
#include "port/posix/can_socket.h"
#include "port/posix/encoder_model.h"
#include "port/posix/free_running.h"
#include "port/posix/lcm_udp.h"
#include "port/posix/node_filters.h"
#include "port/posix/slcan_server.h"
#include "port/posix/stop_signal.h"

enum {
    EXIT_USAGE = 2,
    EXIT_RUN_ENDED = 3,
    POLL_MS = 250,       /* a blocking receive looks at the stop flag this often */
    FRAME_WAIT_MS = 500, /* vcan delivers at once: a frame missing for so long is lost */
    BUFFER_BYTES = 1 << 20,
    JOINT_COUNT = 3,
    NODE_ID_MAX = 127,
    AMBIENT_dC = 250 /* the simulated winding does not heat up */
};

typedef struct {
    long node_id;
    const char *can;
    const char *plant_url;
    long joint_ticks;
    long increments_per_revolution;
    long stall_timeout_ms;
    bool free_running;
    bool slcan;
    long slcan_port;
    free_running_options_t alone;
} options_t;

typedef struct {
    options_t options;
    can_socket_t can;
    lcm_udp_receiver_t arm_state;
    lcm_udp_receiver_t bus_closed;
    lcm_udp_sender_t sender;
    char torque_channel[32];
    motor_node_config_t config;
    motor_node_t node;
    int64_t last_utime;
    int64_t arm_seq; /* of the next ARM_STATE */
    int64_t frames_received;
    int64_t frames_sent;
} rig_t;

static int fail(const options_t *options, const char *what, const char *why) {
    (void)fprintf(stderr, "motor_node %ld: %s: %s\n", options->node_id, what, why);
    return EXIT_RUN_ENDED;
}

static bool parse_long(const char *text, long low, long high, const char *name, long *value) {
    char *end = NULL;
    errno = 0;
    *value = strtol(text, &end, 10);
    if (errno != 0 || end == text || *end != '\0' || *value < low || *value > high) {
        (void)fprintf(stderr, "motor_node: --%s %s: must be a whole number, %ld to %ld\n", name,
                      text, low, high);
        return false;
    }
    return true;
}

static bool parse_double(const char *text, double low, const char *name, double *value) {
    char *end = NULL;
    *value = strtod(text, &end);
    if (end == text || *end != '\0' || !(*value >= low && *value <= 1e6)) {
        (void)fprintf(stderr, "motor_node: --%s %s: must be a number from %g to 1e6\n", name, text,
                      low);
        return false;
    }
    return true;
}

static bool parse_options(int argc, char **argv, options_t *o) {
    static const struct option table[] = {
        {"id", required_argument, NULL, 'i'},
        {"can", required_argument, NULL, 'c'},
        {"plant-url", required_argument, NULL, 'p'},
        {"joint-ticks", required_argument, NULL, 'j'},
        {"increments-per-revolution", required_argument, NULL, 'r'},
        {"stall-timeout-ms", required_argument, NULL, 's'},
        {"free-running", no_argument, NULL, 'f'},
        {"slcan", required_argument, NULL, 'L'},
        {"serial", required_argument, NULL, 'S'},
        {"parameters", required_argument, NULL, 'P'},
        {"referenced", no_argument, NULL, 'R'},
        {"after-watchdog", no_argument, NULL, 'W'},
        {"internal-oscillator", no_argument, NULL, 'O'},
        {"temperature-dC", required_argument, NULL, 'T'},
        {"inertia", required_argument, NULL, 'I'},
        {"viscous-friction", required_argument, NULL, 'V'},
        {"coulomb-friction", required_argument, NULL, 'C'},
        {"torque-constant", required_argument, NULL, 'K'},
        {"index-rad", required_argument, NULL, 'X'},
        {"angle-rad", required_argument, NULL, 'A'},
        {"encoder-sign", required_argument, NULL, 'E'},
        {NULL, 0, NULL, 0},
    };
    *o = (options_t){.node_id = 0,
                     .can = "vcan0",
                     .plant_url = "udpm://239.255.76.67:7668?ttl=0",
                     .joint_ticks = 1,
                     .increments_per_revolution = 65536,
                     .stall_timeout_ms = 10000,
                     .alone = {.temperature_dC = AMBIENT_dC,
                               .joint = {.inertia_kg_m2 = 0.05,
                                         .viscous_Nm_s = 0.05,
                                         .coulomb_Nm = 0.05,
                                         .torque_constant_Nm_A = 5.0,
                                         .index_rad = 0.5,
                                         .encoder_sign = 1}}};
    simulated_joint_config_t *joint = &o->alone.joint;
    long serial = 0;
    long temperature_dC = AMBIENT_dC;
    long encoder_sign = 1;
    bool ok = true;
    int key;
    while (ok && (key = getopt_long(argc, argv, "", table, NULL)) != -1) {
        switch (key) {
        case 'i':
            ok = parse_long(optarg, 1, LSS_UNCONFIGURED, "id", &o->node_id);
            break;
        case 'c':
            o->can = optarg;
            break;
        case 'p':
            o->plant_url = optarg;
            break;
        case 'j':
            ok = parse_long(optarg, 1, 10, "joint-ticks", &o->joint_ticks);
            break;
        case 'r':
            ok = parse_long(optarg, 1024, 1 << 24, "increments-per-revolution",
                            &o->increments_per_revolution);
            break;
        case 's':
            ok = parse_long(optarg, 100, 600000, "stall-timeout-ms", &o->stall_timeout_ms);
            break;
        case 'f':
            o->free_running = true;
            break;
        case 'L':
            o->slcan = true;
            ok = parse_long(optarg, 0, UINT16_MAX, "slcan", &o->slcan_port);
            break;
        case 'S':
            ok = parse_long(optarg, 0, UINT32_MAX, "serial", &serial);
            break;
        case 'P':
            o->alone.parameters = optarg;
            break;
        case 'R':
            o->alone.referenced = true;
            break;
        case 'W':
            o->alone.supervisor_reset = true;
            break;
        case 'O':
            o->alone.clock_fallback = true;
            break;
        case 'T':
            ok = parse_long(optarg, -2730, 32767, "temperature-dC", &temperature_dC);
            break;
        case 'I':
            ok = parse_double(optarg, 1e-6, "inertia", &joint->inertia_kg_m2);
            break;
        case 'V':
            ok = parse_double(optarg, 0.0, "viscous-friction", &joint->viscous_Nm_s);
            break;
        case 'C':
            ok = parse_double(optarg, 0.0, "coulomb-friction", &joint->coulomb_Nm);
            break;
        case 'K':
            ok = parse_double(optarg, 1e-6, "torque-constant", &joint->torque_constant_Nm_A);
            break;
        case 'X':
            ok = parse_double(optarg, -1e6, "index-rad", &joint->index_rad);
            break;
        case 'A':
            ok = parse_double(optarg, -1e6, "angle-rad", &joint->angle_rad);
            break;
        case 'E':
            ok = parse_long(optarg, -1, 1, "encoder-sign", &encoder_sign);
            break;
        default:
            ok = false;
            break;
        }
    }
    const bool alone = o->free_running || o->slcan;
    const long highest_id = alone ? NODE_ID_MAX : JOINT_COUNT;
    const bool unconfigured = alone && o->node_id == LSS_UNCONFIGURED;
    if (ok && (o->node_id == 0 || (o->node_id > highest_id && !unconfigured) || optind != argc)) {
        (void)fprintf(stderr,
                      "usage: motor_node --id 1|2|3 [--can IF] [--plant-url URL] "
                      "[--joint-ticks N] [--increments-per-revolution N] "
                      "[--stall-timeout-ms N]\n"
                      "       motor_node --id 1..127|255 --free-running [--can IF] [--serial N] "
                      "[--parameters FILE] [--referenced] [--after-watchdog] "
                      "[--internal-oscillator] "
                      "[--temperature-dC N] [--inertia X] "
                      "[--viscous-friction X] [--coulomb-friction X] "
                      "[--torque-constant X] [--index-rad X] [--angle-rad X] "
                      "[--encoder-sign 1|-1]\n"
                      "       motor_node --id 1..127|255 --slcan PORT [--serial N] "
                      "[--referenced]\n");
        ok = false;
    }
    o->alone.node_id = (uint8_t)o->node_id;
    o->alone.serial_number = serial != 0 ? (uint32_t)serial : (uint32_t)o->node_id;
    o->alone.can = o->can;
    o->alone.temperature_dC = (int16_t)temperature_dC;
    joint->increments_per_revolution = (uint32_t)o->increments_per_revolution;
    joint->encoder_sign = encoder_sign < 0 ? -1 : 1;
    return ok;
}

static bool open_rig(rig_t *rig) {
    const options_t *o = &rig->options;
    lcm_udp_address_t plant;
    can_socket_filter_t filters[NODE_FILTERS_COUNT];
    node_filters((uint8_t)o->node_id, filters);
    (void)snprintf(rig->torque_channel, sizeof rig->torque_channel, "JOINT_TORQUE_%ld", o->node_id);
    if (!lcm_udp_parse(o->plant_url, &plant)) {
        errno = EINVAL;
        return false;
    }
    return can_socket_open(&rig->can, o->can, filters, NODE_FILTERS_COUNT) &&
           lcm_udp_receiver_open(&rig->arm_state, &plant, "ARM_STATE", BUFFER_BYTES) &&
           lcm_udp_receiver_open(&rig->bus_closed, &plant, "BUS_CLOSED", BUFFER_BYTES) &&
           lcm_udp_set_timeout(&rig->arm_state, POLL_MS) &&
           lcm_udp_set_timeout(&rig->bus_closed, POLL_MS) &&
           lcm_udp_sender_open(&rig->sender, &plant);
}

/* Waits for one message of a channel, bounded by the stall time-out. 1: there; 0: asked to stop;
 * -1: nothing came. */
static int await(const rig_t *rig, lcm_udp_receiver_t *receiver, lcm_udp_message_t *message) {
    for (long waited_ms = 0; waited_ms < rig->options.stall_timeout_ms; waited_ms += POLL_MS) {
        const int got = lcm_udp_receive(receiver, message);
        if (got != 0) {
            return got;
        }
        if (stop_signal_raised()) {
            return 0;
        }
    }
    errno = ETIMEDOUT;
    return -1;
}

static bool publish_torque(rig_t *rig, const hpmc_lcm_joint_torque_t *torque) {
    size_t capacity = 0;
    uint8_t *payload = lcm_udp_reserve(&rig->sender, rig->torque_channel, &capacity);
    const int length =
        payload == NULL ? -1 : hpmc_lcm_joint_torque_t_encode(payload, 0, (int)capacity, torque);
    if (length < 0) {
        return false;
    }
    lcm_udp_commit(&rig->sender, (size_t)length);
    return lcm_udp_flush(&rig->sender);
}

/* One joint tick: the device steps, its frames go out, then its torque, which says how many. */
static bool step(rig_t *rig, const hpmc_lcm_arm_state_t *arm, const can_frame_t *frames,
                 size_t frame_count) {
    const size_t joint = (size_t)rig->options.node_id - 1U;
    const motor_node_input_t input = {
        .elapsed_us = (uint32_t)(arm->utime - rig->last_utime),
        .position_inc = encoder_model_increments(arm->q_rad[joint],
                                                 (uint32_t)rig->options.increments_per_revolution),
        .temperature_dC = AMBIENT_dC,
        .frames = frames,
        .frame_count = frame_count};
    motor_node_output_t output;
    rig->last_utime = arm->utime;
    motor_node_step(&rig->config, &rig->node, &input, &output);
    if (output.reset_requested) {
        motor_node_restart(&rig->config, &rig->node);
    }
    rig->frames_sent += (int64_t)output.frame_count;
    const hpmc_lcm_joint_torque_t torque = {.utime = arm->utime,
                                            .seq = arm->seq,
                                            .tau_Nm = (double)output.torque_mNm / 1000.0,
                                            .frames_sent = (int32_t)output.frame_count};
    return can_socket_send(&rig->can, output.frames, output.frame_count, FRAME_WAIT_MS) &&
           publish_torque(rig, &torque);
}

/* The joint ticks of a period. False when the run ends with them, and how: *status. */
static bool run_ticks(rig_t *rig, const can_frame_t *frames, size_t count, int *status) {
    static lcm_udp_message_t message;
    hpmc_lcm_arm_state_t arm;
    for (long tick = 0; tick < rig->options.joint_ticks; ++tick, ++rig->arm_seq) {
        const int got = await(rig, &rig->arm_state, &message);
        if (got <= 0) {
            *status = got == 0 ? EXIT_SUCCESS : fail(&rig->options, "ARM_STATE", strerror(errno));
            return false;
        }
        if (hpmc_lcm_arm_state_t_decode(message.payload, 0, message.payload_length, &arm) < 0 ||
            arm.seq != rig->arm_seq) {
            *status = fail(&rig->options, "ARM_STATE", "a message is damaged or was lost");
            return false;
        }
        if (!step(rig, &arm, frames, tick == 0 ? count : 0U)) {
            *status = fail(&rig->options, "sending", strerror(errno));
            return false;
        }
    }
    return true;
}

static int run(rig_t *rig) {
    static lcm_udp_message_t message;
    hpmc_lcm_bus_closed_t closed;
    can_frame_t frames[MOTOR_NODE_RX_MAX];
    int status = EXIT_SUCCESS;
    for (int64_t period = 0;; ++period) {
        const int got = await(rig, &rig->bus_closed, &message);
        if (got <= 0) {
            return got == 0 ? EXIT_SUCCESS : fail(&rig->options, "BUS_CLOSED", strerror(errno));
        }
        if (hpmc_lcm_bus_closed_t_decode(message.payload, 0, message.payload_length, &closed) < 0 ||
            closed.seq != period) {
            return fail(&rig->options, "BUS_CLOSED", "a message is damaged or was lost");
        }
        const int32_t expected = closed.node_frames[rig->options.node_id - 1];
        if (expected < 0 || expected > (int32_t)MOTOR_NODE_RX_MAX) {
            return fail(&rig->options, "BUS_CLOSED", "more frames than a node takes in a tick");
        }
        const size_t count = can_socket_receive(&rig->can, frames, (size_t)expected, FRAME_WAIT_MS);
        if (count != (size_t)expected) {
            return stop_signal_raised() ? EXIT_SUCCESS
                                        : fail(&rig->options, rig->options.can, "a frame was lost");
        }
        rig->frames_received += expected;
        if (!run_ticks(rig, frames, count, &status)) {
            return status;
        }
    }
}

int main(int argc, char **argv) {
    static rig_t rig;
    if (!parse_options(argc, argv, &rig.options)) {
        return EXIT_USAGE;
    }
    stop_signal_install(!rig.options.free_running);
    if (rig.options.slcan) {
        rig.config = (motor_node_config_t){.node_id = rig.options.alone.node_id,
                                           .serial_number = rig.options.alone.serial_number,
                                           .referenced = rig.options.alone.referenced};
        return slcan_server(&rig.config, (uint16_t)rig.options.slcan_port);
    }
    if (rig.options.free_running) {
        return free_running(&rig.options.alone);
    }
    rig.config = (motor_node_config_t){.node_id = (uint8_t)rig.options.node_id,
                                       .serial_number = (uint32_t)rig.options.node_id,
                                       .referenced = true};
    motor_node_init(&rig.config, &rig.node);
    if (!open_rig(&rig)) {
        return fail(&rig.options, rig.options.can, strerror(errno));
    }
    (void)puts("READY");
    (void)fflush(stdout);
    const int status = run(&rig);
    (void)printf("STATS {\"frames_received\": %lld, \"frames_sent\": %lld, \"frames_dropped\": %u, "
                 "\"back_pressure\": %u, \"error_frames\": %u}\n",
                 (long long)rig.frames_received, (long long)rig.frames_sent, rig.can.dropped,
                 rig.can.back_pressure, rig.can.error_frames);
    return status;
}
