#include "node/node_drive.h"

#include "canopen/node_time.h"
#include "control/derating.h"

#define WAY_UNIT 60000000U /* revolutions per minute x us */

/** Long enough to measure slow speeds with a coarse encoder, short enough to act. */
#define SPEED_INTERVAL_us 10000U
#define HOMING_START 0x0010U
#define INJECTED_ENCODER_FAULT 0x02U

/* Kinds of encoder fault, source of emergency 7305h. */
#define ENCODER_JUMP 1U
#define ENCODER_INDEX 2U
#define ENCODER_STUCK 3U
#define ENCODER_INJECTED 4U /* silent, or reported broken */

static drive_options_t options_of(const object_dictionary_t *od) {
    const drive_options_t options = {
        .quick_stop = od->quick_stop_option_code,
        .shutdown = od->shutdown_option_code,
        .disable_operation = od->disable_operation_option_code,
        .fault_reaction = od->fault_reaction_option_code,
    };
    return options;
}

static joint_controller_config_t control_of(const object_dictionary_t *od) {
    const uint32_t increments = od->position_encoder_resolution_encoder_increments;
    const angle_scale_t whole = angle_scale(increments, 1);
    const joint_controller_config_t config = {
        .fic =
            {
                .phase_rule = od->fic_phase_rule == 0U ? FIC_BODY_MOTION : FIC_ERROR_GROWTH,
                .delta_inc256 = od->fic_delta_inc256,
                .delta_rad = angle_part(whole.step_rad, od->fic_delta_inc256, 256),
                .stall_time_us = od->fic_stall_time_us,
            },
        .q_a_rad = angle_from_urad(od->fic_q_a_urad),
        .q_p_rad = angle_from_urad(od->fic_q_p_urad),
        .q_b_rad = angle_from_urad(od->fic_q_b_urad),
        .torque_limit_Nm = torque_from_mNm(od->fic_torque_limit_mNm, 1),
        .scale = angle_scale(increments, od->fic_joint_ticks_per_sync),
        .ticks_per_sync = od->fic_joint_ticks_per_sync,
    };
    return config;
}

/** The command that acts: the host's, or in mode 6 the search for the index pulse. */
static joint_command_t command_of(const motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    if (od->modes_of_operation_display == MODE_HOMING) {
        const joint_command_t search = {
            .position_inc = node->homing.target_inc,
            .torque_mNm = (int16_t)od->homing_torque_mNm,
            .torque_max_mNm = od->homing_torque_mNm,
        };
        return search;
    }
    const joint_command_t command = {
        .position_inc = od->target_position,
        .torque_mNm = od->target_torque,
        .torque_max_mNm = od->max_torque,
    };
    return command;
}

static homing_config_t homing_of(const object_dictionary_t *od) {
    const homing_config_t config = {
        .method = od->homing_method,
        .speed_inc_s = od->homing_speeds_speed_during_search_for_zero,
        .time_out_us = od->homing_time_out_ms * 1000U,
        .lead_inc = od->following_error_window,
    };
    return config;
}

int32_t node_drive_position(int64_t position_inc) {
    return position_inc > INT32_MAX   ? INT32_MAX
           : position_inc < INT32_MIN ? INT32_MIN
                                      : (int32_t)position_inc;
}

static uint64_t distance(int32_t a, int32_t b) {
    const int64_t difference = (int64_t)a - b;
    return (uint64_t)(difference < 0 ? -difference : difference);
}

static uint32_t deadline_us(const object_dictionary_t *od) {
    return od->rpdo1_communication_parameter_event_timer * 1000U;
}

static bool outside_window(const object_dictionary_t *od) {
    return distance(od->target_position, od->position_actual_value) > od->following_error_window;
}

static bool has_fresh_command(const motor_node_t *node) {
    const uint32_t deadline = deadline_us(&node->od);
    return node->command_acted && (deadline == 0U || node->since_command_us < deadline);
}

/** Reasons not to enable operation in this mode; 0 = none. */
static uint16_t refusals(int8_t mode, const motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    uint16_t reasons = 0;
    if (mode == MODE_NONE) {
        reasons |= LIMIT_REASON_MODE;
    }
    if (!node->position_known) {
        reasons |= LIMIT_REASON_NO_POSITION;
    }
    if (node->image_damaged) {
        reasons |= LIMIT_REASON_IMAGE;
    }
    if (node->clock_fallback && od->time_base == 0U) {
        reasons |= LIMIT_REASON_CLOCK;
    }
    if (mode != MODE_HOMING && (node->nmt != NMT_OPERATIONAL || !has_fresh_command(node))) {
        reasons |= LIMIT_REASON_NO_COMMAND;
    }
    if (mode == MODE_FRACTAL_IMPEDANCE) {
        if (!node->referenced) {
            reasons |= LIMIT_REASON_NOT_REFERENCED;
        }
        if (outside_window(od)) {
            reasons |= LIMIT_REASON_OUTSIDE_WINDOW;
        }
        if (od->fic_q_a_urad > od->fic_q_p_urad || od->fic_q_p_urad > od->fic_q_b_urad) {
            reasons |= LIMIT_REASON_CONFIGURATION;
        }
    }
    return reasons;
}

static void start(motor_node_t *node) {
    node->control = control_of(&node->od);
    node->restart = true;
    node->hold = false;
    node->holding = node->od.modes_of_operation_display == MODE_HOMING; /* RPDO1 does not act */
    node->homing.phase = HOMING_NOT_STARTED;
    node->homing.target_inc = node->od.position_actual_value;
    node->halted = false;
    node->ramp_ppm = 0;
    node->following_error_us = 0;
    node->stuck_us = 0;
    node->speed_from_inc = node->od.position_actual_value;
    node->speed_since_us = 0;
}

bool node_drive_has_mode(int8_t mode) {
    return mode == MODE_FRACTAL_IMPEDANCE || mode == MODE_HOMING ||
           mode == MODE_CYCLIC_SYNCHRONOUS_TORQUE;
}

void node_drive_mode(int8_t mode, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    node->refusals = 0;
    if (!node_drive_has_mode(mode)) {
        node->refusals = LIMIT_REASON_MODE;
    } else if (mode == od->modes_of_operation_display) {
        /* no change */
    } else if (!drive_has_output(&node->drive)) {
        od->modes_of_operation_display = mode;
    } else {
        node->refusals = refusals(mode, node);
        if (node->refusals == 0U) {
            od->modes_of_operation_display = mode;
            start(node);
        }
    }
}

static void halt(motor_node_t *node) {
    node->halted = true;
    node->hold = true;
    if (node->od.halt_option_code == 0) {
        node->ramp_ppm = 0;
    }
}

/** That place of the encoder becomes 607Ch, and the position of this tick follows. */
static void set_home(int32_t encoder_inc, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const int64_t offset = (int64_t)od->home_offset - encoder_inc;
    const int64_t position = node->encoder_inc + offset;
    if (offset < INT32_MIN || offset > INT32_MAX || position < INT32_MIN || position > INT32_MAX) {
        node->homing.phase = HOMING_FAILED;
        return;
    }
    const int64_t shift = offset - node->offset_inc;
    node->offset_inc = (int32_t)offset;
    od->position_actual_value = (int32_t)position;
    node->speed_from_inc = node_drive_position(node->speed_from_inc + shift);
    node->referenced = true;
}

/** Bit 4 of the controlword in mode 6. */
static void command_homing(bool wants, bool wanted, motor_node_t *node) {
    const homing_config_t config = homing_of(&node->od);
    if (wants && !wanted && !node->halted) {
        homing_start(&config, node->od.position_actual_value, &node->homing);
        if (node->homing.phase == HOMING_ATTAINED) {
            set_home(node->encoder_inc, node);
        } else {
            node->referenced = false;
            node->index_referenced = false;
        }
    } else if (!wants && node->homing.phase == HOMING_SEARCHING) {
        node->homing.phase = HOMING_INTERRUPTED;
        node->hold = true;
    } else {
        /* nothing new */
    }
}

/** The search goes on, or ends: then the joint is held where it is. */
static void search_home(uint32_t elapsed_us, motor_node_t *node) {
    const homing_config_t config = homing_of(&node->od);
    if (node->homing.phase != HOMING_SEARCHING) {
        return;
    }
    if (!drive_wants_output(&node->drive) || node->halted) {
        node->homing.phase = HOMING_INTERRUPTED;
    } else if (node->index_seen) {
        node->homing.phase = HOMING_ATTAINED;
        node->index_referenced = true;
        node->index_home_inc = node->index_encoder_inc;
        set_home(node->index_encoder_inc, node);
    } else {
        homing_step(&config, node->od.position_actual_value, elapsed_us, &node->homing);
    }
    if (node->homing.phase == HOMING_SEARCHING) {
        const joint_command_t command = command_of(node);
        joint_controller_command(&command, &node->controller);
    } else {
        node->hold = true;
    }
}

void node_drive_controlword(uint16_t controlword, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const int8_t mode = od->modes_of_operation_display;
    const drive_options_t options = options_of(od);
    const uint16_t reasons = refusals(mode, node);
    const uint16_t before = node->drive.controlword;
    const drive_result_t result = drive_command(&options, reasons == 0U, controlword, &node->drive);
    od->controlword = controlword;
    node->refusals = 0;
    switch (result) {
    case DRIVE_ENABLED:
        start(node);
        od->counters_missed_sync = 0;
        break;
    case DRIVE_ENABLE_REFUSED:
        node->refusals = reasons;
        break;
    case DRIVE_STOPPING:
        node->hold = true;
        break;
    case DRIVE_FAULT_RESET:
        od->error_code = 0;
        emcy_clear(od, &node->emcy);
        break;
    case DRIVE_DONE:
    default:
        break;
    }
    if (!drive_wants_output(&node->drive)) {
        return;
    }
    const bool wants_halt = (controlword & CONTROLWORD_HALT) != 0U;
    if (wants_halt && !node->halted) {
        halt(node);
    } else if (!wants_halt && node->halted) {
        node->refusals = reasons;
        if (reasons == 0U) {
            start(node);
        }
    }
    if (mode == MODE_HOMING) {
        command_homing((controlword & HOMING_START) != 0U, (before & HOMING_START) != 0U, node);
    }
}

void node_drive_fault(emcy_code_t code, uint8_t source, int32_t detail, bool ramp,
                      motor_node_t *node) {
    const drive_state_t state = node->drive.state;
    if (state == DRIVE_FAULT || (state == DRIVE_FAULT_REACTION_ACTIVE && ramp)) {
        return;
    }
    const drive_options_t options = options_of(&node->od);
    node->hold = drive_fault(&options, ramp, &node->drive) == DRIVE_STOPPING;
    node->od.error_code = (uint16_t)code;
    emcy_raise(code, source, detail, &node->od, &node->emcy);
}

void node_drive_connection_lost(motor_node_t *node) {
    const drive_options_t options = options_of(&node->od);
    if (!drive_wants_output(&node->drive)) {
        return;
    }
    switch (node->od.abort_connection_option_code) {
    case 1:
        node_drive_fault(EMCY_COMMAND_DEADLINE, 0, 0, true, node);
        break;
    case 2:
        (void)drive_command(&options, false, 0, &node->drive);
        break;
    case 3:
        node->hold = drive_quick_stop(&options, &node->drive) == DRIVE_STOPPING;
        break;
    default:
        break;
    }
}

static void supervise_command(uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const int8_t mode = od->modes_of_operation_display;
    if (!drive_wants_output(&node->drive) || mode == MODE_HOMING) {
        return;
    }
    if (!has_fresh_command(node)) {
        node_drive_fault(EMCY_COMMAND_DEADLINE, 1, (int32_t)(node->since_command_us / 1000U), true,
                         node);
    }
    const bool outside = mode == MODE_FRACTAL_IMPEDANCE && !node->halted && outside_window(od);
    node->following_error_us = outside ? node_time_add(node->following_error_us, elapsed_us) : 0U;
    if (od->following_error_time_out != 0U &&
        node->following_error_us >= od->following_error_time_out * 1000U) {
        node_drive_fault(EMCY_FOLLOWING_ERROR, 0, od->position_actual_value, true, node);
    }
}

/** In 1 / WAY_UNIT increments; below 2^62. */
static uint64_t way_at_max_speed(uint32_t elapsed_us, const object_dictionary_t *od) {
    return (uint64_t)od->max_motor_speed * od->position_encoder_resolution_encoder_increments *
           elapsed_us;
}

static void supervise_speed(uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    node->speed_since_us = node_time_add(node->speed_since_us, elapsed_us);
    if (node->speed_since_us < SPEED_INTERVAL_us) {
        return;
    }
    const int32_t position = od->position_actual_value;
    const uint64_t moved = distance(position, node->speed_from_inc);
    const uint64_t allowed = way_at_max_speed(node->speed_since_us, od);
    if (drive_has_output(&node->drive) && moved * WAY_UNIT > allowed) {
        node_drive_fault(EMCY_OVERSPEED, 0, position, true, node);
    }
    node->moving = 0;
    if (position > node->speed_from_inc) {
        node->moving = 1;
    } else if (position < node->speed_from_inc) {
        node->moving = -1;
    }
    const uint64_t speed_ppm = moved * WAY_UNIT / (allowed / DERATING_WHOLE_ppm + 1U);
    node->speed_ppm = speed_ppm > UINT32_MAX ? UINT32_MAX : (uint32_t)speed_ppm;
    node->load_ppm = derating_load(node->mean_square_mA2, od->motor_rated_current);
    node->speed_from_inc = od->position_actual_value;
    node->speed_since_us = 0;
}

/** Limits are places of the joint: without a reference they mean nothing. */
static void supervise_position(motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const int32_t position = od->position_actual_value;
    const bool outside =
        node->referenced && (position > od->software_position_limit_max_position_limit ||
                             position < od->software_position_limit_min_position_limit);
    if (outside && !node->outside_limits && drive_has_output(&node->drive)) {
        emcy_report(EMCY_POSITION_LIMIT, 0, position, od, &node->emcy);
    }
    node->outside_limits = outside && drive_has_output(&node->drive);
}

static void supervise_sensors(motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    if (od->sensor_source == 0U) {
        return;
    }
    const uint32_t deadline = deadline_us(od);
    const bool silent = deadline != 0U && node->since_position_us >= deadline;
    const bool broken = (od->injected_sensors_flags & INJECTED_ENCODER_FAULT) != 0U;
    if (drive_has_output(&node->drive) && (silent || broken)) {
        node_drive_fault(EMCY_ENCODER, ENCODER_INJECTED, od->position_actual_value, false, node);
    }
}

static void encoder_fault(uint8_t kind, int32_t encoder_inc, motor_node_t *node) {
    if (drive_has_output(&node->drive)) {
        node_drive_fault(EMCY_ENCODER, kind, encoder_inc, false, node);
    }
}

/** Twice the way at the highest speed since the count last changed, and the quantisation. */
static bool has_jumped(int32_t encoder_inc, const motor_node_t *node) {
    const uint64_t way = distance(encoder_inc, node->encoder_inc);
    return way > 2U + way_at_max_speed(node->since_encoder_us, &node->od) / (WAY_UNIT / 2U);
}

static bool is_stuck(bool changed, uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const int32_t torque_mNm = od->torque_actual_value;
    const int32_t size_mNm = torque_mNm < 0 ? -torque_mNm : torque_mNm;
    const int32_t percent = od->encoder_supervision_stuck_torque_percent;
    const bool pushes = percent != 0 && size_mNm != 0 &&
                        size_mNm * 100 >= (int32_t)od->fic_torque_limit_mNm * percent;
    node->stuck_us = pushes && !changed ? node_time_add(node->stuck_us, elapsed_us) : 0U;
    return node->stuck_us >= od->encoder_supervision_stuck_time_ms * 1000U;
}

/** An index pulse stands a whole number of revolutions from the one that the home is from. */
static bool index_is_out_of_place(const motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const uint64_t revolution = od->position_encoder_resolution_encoder_increments;
    const uint64_t rest = distance(node->index_encoder_inc, node->index_home_inc) % revolution;
    const uint64_t off = rest < revolution - rest ? rest : revolution - rest;
    const uint32_t tolerance = od->encoder_supervision_index_tolerance_inc;
    return node->index_seen && node->index_referenced && tolerance != 0U && off > tolerance;
}

void node_drive_supervise_encoder(int32_t encoder_inc, uint32_t elapsed_us, motor_node_t *node) {
    const bool changed = !node->encoder_known || encoder_inc != node->encoder_inc;
    node->since_encoder_us = node_time_add(node->since_encoder_us, elapsed_us);
    if (node->encoder_known && has_jumped(encoder_inc, node)) {
        encoder_fault(ENCODER_JUMP, encoder_inc, node);
    }
    if (is_stuck(changed, elapsed_us, node)) {
        encoder_fault(ENCODER_STUCK, encoder_inc, node);
    }
    if (index_is_out_of_place(node)) {
        encoder_fault(ENCODER_INDEX, node->index_encoder_inc, node);
    }
    node->since_encoder_us = changed ? 0U : node->since_encoder_us;
    node->encoder_known = true;
    node->encoder_inc = encoder_inc;
}

static void supervise_motor(motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    if (!drive_has_output(&node->drive)) {
        return;
    }
    if (node->current_mA > od->derating_current_fault_mA) {
        node_drive_fault(EMCY_OVER_CURRENT, 0, (int32_t)node->current_mA, false, node);
    }
    if (od->motor_temperature >= od->derating_temperature_fault_dC) {
        node_drive_fault(EMCY_OVER_TEMPERATURE, 0, od->motor_temperature, true, node);
    }
}

void node_drive_supervise(uint32_t elapsed_us, motor_node_t *node) {
    supervise_motor(node);
    supervise_sensors(node);
    supervise_command(elapsed_us, node);
    supervise_speed(elapsed_us, node);
    supervise_position(node);
}

static void ramp_bound(uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    if (!drive_has_output(&node->drive)) {
        node->ramp_ppm = 0;
    } else if (node->restart) {
        /* the first tick after enabling: still zero */
    } else if (drive_wants_output(&node->drive) && !node->halted) {
        if (node->ramp_ppm == TORQUE_GUARD_RAMP_FULL) {
            return;
        }
        const uint32_t step = elapsed_us * 1000U / od->output_bound_ramp_up_ms;
        const uint32_t rest = TORQUE_GUARD_RAMP_FULL - node->ramp_ppm;
        node->ramp_ppm += step < rest ? step : rest;
    } else {
        const uint32_t step = elapsed_us * 1000U / od->output_bound_ramp_down_ms;
        node->ramp_ppm -= step < node->ramp_ppm ? step : node->ramp_ppm;
    }
    if (node->ramp_ppm == 0U && !drive_wants_output(&node->drive)) {
        drive_bound_is_zero(&node->drive);
    }
}

static void start_or_hold(motor_node_t *node) {
    const int32_t position = node->od.position_actual_value;
    if (node->restart) {
        const joint_command_t command = command_of(node);
        joint_controller_reset(position, &command, &node->controller);
        node->restart = false;
    }
    if (node->hold) {
        joint_controller_hold(position, &node->controller);
        node->hold = false;
        node->holding = true;
    }
}

/** What the mode asks for. In mode 10 there is no FIC, no error and no latched torque. */
static joint_controller_output_t ask(uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    joint_controller_output_t asked = {0};
    const bool homing = od->modes_of_operation_display == MODE_HOMING &&
                        od->homing_method != HOMING_HERE &&
                        node->homing.phase != HOMING_NOT_STARTED;
    if (od->modes_of_operation_display == MODE_FRACTAL_IMPEDANCE || homing) {
        joint_controller_step(&node->control, od->position_actual_value, elapsed_us,
                              &node->controller, &asked);
    } else if (od->modes_of_operation_display == MODE_CYCLIC_SYNCHRONOUS_TORQUE) {
        asked.torque_Nm = torque_from_mNm(od->target_torque, 1);
        asked.torque_max_Nm = torque_from_mNm(od->max_torque, 1);
    }
    return asked;
}

/** What of this torque goes to the motor. In mode -1 the law itself jumps: no slope. */
static torque_guard_output_t guard(const joint_controller_output_t *asked, uint32_t elapsed_us,
                                   const motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const bool fractal = od->modes_of_operation_display == MODE_FRACTAL_IMPEDANCE;
    const torque_guard_input_t input = {
        .torque_Nm = asked->torque_Nm,
        .torque_before_Nm = node->torque_Nm,
        .elapsed_us = elapsed_us,
        .slope_mNm_s = fractal ? TORQUE_GUARD_SLOPE_OFF : od->torque_slope,
        .torque_limit_Nm = node->control.torque_limit_Nm,
        .ramp_ppm = node->ramp_ppm,
        .torque_max_Nm = asked->torque_max_Nm,
        .f_max_Nm = asked->f_max_Nm,
        .position_inc = od->position_actual_value,
        .position_min_inc =
            node->referenced ? od->software_position_limit_min_position_limit : INT32_MIN,
        .position_max_inc =
            node->referenced ? od->software_position_limit_max_position_limit : INT32_MAX,
        .moving = node->moving,
        .motor =
            {
                .temperature_dC = od->motor_temperature,
                .temperature_begin_dC = od->derating_temperature_begin_dC,
                .temperature_end_dC = od->derating_temperature_fault_dC,
                .load_ppm = node->load_ppm,
                .speed_ppm = node->speed_ppm,
                .speed_begin_ppm = od->derating_speed_begin_percent * 10000U,
            },
    };
    return torque_guard(&input);
}

static uint16_t status_of(bool close, const motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const bool follows = drive_wants_output(&node->drive) && !node->halted;
    const bool fractal = od->modes_of_operation_display == MODE_FRACTAL_IMPEDANCE;
    const bool homing = od->modes_of_operation_display == MODE_HOMING;
    uint16_t status = drive_statusword(&node->drive) | STATUSWORD_VOLTAGE_ENABLED;
    status |= node->nmt == NMT_STOPPED ? 0U : STATUSWORD_REMOTE;
    status |= node->outside_limits ? STATUSWORD_WARNING : 0U;
    status |= close ? STATUSWORD_TARGET_REACHED : 0U;
    status |= od->limit_reasons != 0U ? STATUSWORD_INTERNAL_LIMIT : 0U;
    status |= homing ? homing_statusword(node->referenced, node->moving != 0, &node->homing) : 0U;
    status |= follows && !homing ? STATUSWORD_FOLLOWS : 0U;
    status |= drive_has_output(&node->drive) && fractal && node->controller.fic.converging
                  ? STATUSWORD_CONVERGENCE
                  : 0U;
    status |= node->referenced ? STATUSWORD_REFERENCED : 0U;
    return status;
}

void node_drive_tick(uint32_t elapsed_us, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    torque_guard_output_t guarded = {0};
    bool close = false;
    ramp_bound(elapsed_us, node);
    search_home(elapsed_us, node);
    start_or_hold(node);
    if (drive_has_output(&node->drive)) {
        const joint_controller_output_t asked = ask(elapsed_us, node);
        guarded = guard(&asked, elapsed_us, node);
        guarded.reasons |= asked.limited ? LIMIT_REASON_TORQUE_LIMIT : 0U;
        guarded.reasons |= node->halted ? LIMIT_REASON_HALT : 0U;
        close = od->modes_of_operation_display == MODE_FRACTAL_IMPEDANCE &&
                angle_abs(asked.error_rad) <= node->control.q_a_rad;
    }
    node->torque_Nm = guarded.torque_Nm;
    od->torque_actual_value = guarded.torque_mNm;
    od->limit_reasons = guarded.reasons | node->refusals;
    od->statusword = status_of(close, node);
}
