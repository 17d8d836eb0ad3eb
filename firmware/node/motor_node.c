#include "node/motor_node.h"

#include <string.h>

#include "canopen/node_time.h"
#include "control/derating.h"
#include "node/node_drive.h"
#include "node/node_objects.h"
#include "od/little_endian.h"
#include "od/od_access.h"

#define FUNCTION_CODE 0x780U
#define NODE_ID 0x07FU
#define INJECTED_INDEX 0x01U

bool motor_node_accepts(uint8_t node_id, uint16_t cob_id) {
    if (node_id == LSS_UNCONFIGURED) {
        return cob_id == LSS_REQUEST_COB_ID;
    }
    switch (cob_id & FUNCTION_CODE) {
    case NMT_COB_ID:
        return cob_id == NMT_COB_ID;
    case SYNC_COB_ID: /* and emergencies */
        return true;
    case HEARTBEAT_COB_ID:
        return cob_id != HEARTBEAT_COB_ID;
    case OD_RPDO1_COB_ID:
    case OD_RPDO2_COB_ID:
    case OD_RPDO4_COB_ID:
    case OD_TPDO1_COB_ID:
    case OD_TPDO2_COB_ID:
    case SDO_REQUEST_COB_ID:
    case SDO_RESPONSE_COB_ID:
        return (cob_id & NODE_ID) == node_id;
    default:
        return cob_id == LSS_REQUEST_COB_ID;
    }
}

/** Stored values, else defaults. */
static void power_on_values(const motor_node_config_t *config, uint8_t node_id,
                            object_dictionary_t *od) {
    uint8_t ignored = 0;
    object_dictionary_init(node_id, od);
    if (config->memory != NULL && !parameter_store_load(config->memory, od, &ignored)) {
        object_dictionary_init(node_id, od); /* never a part of the set */
    }
    od->store_parameters_save_all_parameters = config->memory != NULL ? 1U : 0U;
    if (config->serial_number != 0U) {
        od->identity_object_serial_number = config->serial_number;
    }
    od->frame_link = config->frame_link;
    if (config->software_version != NULL) {
        od->manufacturer_software_version = config->software_version;
    }
}

static void reset_communication(const motor_node_config_t *config, motor_node_t *node) {
    node->node_id = node->lss.pending_node_id;
    power_on_values(config, node->node_id, &node->power_on);
    /* A fault and the history of errors outlast this reset. */
    node->power_on.error_register = node->od.error_register;
    node->power_on.pre_defined_error_field_number_of_errors =
        node->od.pre_defined_error_field_number_of_errors;
    memcpy(node->power_on.pre_defined_error_field, node->od.pre_defined_error_field,
           sizeof node->od.pre_defined_error_field);
    od_copy_communication(&node->power_on, &node->od);
    lss_init(node->node_id, &node->lss);

    node->nmt = NMT_PRE_OPERATIONAL;
    node->boot_up_sent = false;
    node->own_id_heard = false;
    memset(&node->sync, 0, sizeof node->sync);
    memset(&node->sdo, 0, sizeof node->sdo);
    memset(&node->heartbeat_producer, 0, sizeof node->heartbeat_producer);
    memset(&node->heartbeat_consumer, 0, sizeof node->heartbeat_consumer);
    memset(&node->to_send, 0, sizeof node->to_send);
}

static void show_crash(const crash_record_t *crash, object_dictionary_t *od) {
    od->crash_record_cause = (uint8_t)crash->cause;
    od->crash_record_program_counter = crash->program_counter;
    od->crash_record_link_register = crash->link_register;
    od->crash_record_program_status = crash->program_status;
    od->crash_record_fault_status = crash->fault_status;
    od->crash_record_hard_fault_status = crash->hard_fault_status;
    od->crash_record_fault_address = crash->fault_address;
    od->crash_record_resets = crash->count;
}

void motor_node_init(const motor_node_config_t *config, motor_node_t *node) {
    memset(node, 0, sizeof *node);
    node->memory = config->memory;
    node->stored_node_id = config->node_id;
    if (config->memory != NULL && !config->node_id_by_switch) {
        (void)parameter_store_load(config->memory, &node->od, &node->stored_node_id);
    }
    power_on_values(config, node->stored_node_id, &node->od);
    node->od.sensor_source = config->sensor_source;
    node->od.time_base = config->time_base;
    emcy_init(&node->emcy);
    lss_init(node->stored_node_id, &node->lss);
    reset_communication(config, node);
    drive_init(&node->drive);
    node->encoder_referenced = config->referenced;
    node->referenced = config->referenced || config->sensor_source != 0U;
    node->clock_fallback = config->clock_fallback;
    node->image_damaged = config->image_damaged;
    if (config->crash != NULL) {
        show_crash(config->crash, &node->od);
    }
    if (config->supervisor_reset) {
        emcy_report(EMCY_SUPERVISOR_RESET, node->od.crash_record_cause,
                    (int32_t)node->od.crash_record_program_counter, &node->od, &node->emcy);
    }
    if (config->image_damaged) {
        emcy_raise(EMCY_SUPERVISOR_RESET, CRASH_IMAGE, 0, &node->od, &node->emcy);
    }
    if (config->memory != NULL && parameter_store_damaged(config->memory)) {
        emcy_report(EMCY_PARAMETERS_LOST, 0, 0, &node->od, &node->emcy);
    }
}

void motor_node_restart(motor_node_config_t *config, motor_node_t *node) {
    config->supervisor_reset = false; /* reported once */
    config->sensor_source = node->od.sensor_source;
    config->time_base = node->od.time_base;
    motor_node_init(config, node);
}

static void send(const can_frame_t *frame, motor_node_t *node) {
    if (!frame_queue_push(frame, &node->to_send)) {
        node_count(&node->od.counters_frames_not_sent, 1);
    }
}

static void follow_nmt(nmt_state_t before, motor_node_t *node) {
    if (before == node->nmt) {
        return;
    }
    if (node->nmt == NMT_OPERATIONAL) {
        sync_restart(&node->sync);
        node->command_acted = false;
        node->tpdo2.changed = true;
    }
    if (before == NMT_OPERATIONAL) {
        node->command_waiting = false;
        node_drive_connection_lost(node);
    }
    if (node->nmt == NMT_STOPPED) {
        node->sdo.state = SDO_IDLE;
    }
}

static void receive_nmt(const motor_node_config_t *config, const can_frame_t *frame,
                        motor_node_t *node) {
    const nmt_state_t before = node->nmt;
    const nmt_reset_t reset = nmt_receive(node->node_id, frame, &node->nmt);
    if (reset == NMT_RESET_NODE) {
        node->reset_requested = true;
    } else if (reset == NMT_RESET_COMMUNICATION) {
        node->nmt = NMT_PRE_OPERATIONAL;
        follow_nmt(before, node);
        reset_communication(config, node);
    } else {
        follow_nmt(before, node);
    }
}

static sync_config_t sync_config(const object_dictionary_t *od) {
    const sync_config_t config = {.overflow = od->synchronous_counter_overflow_value,
                                  .period_us = od->communication_cycle_period};
    return config;
}

static void count_missed(uint32_t missed, motor_node_t *node) {
    const uint8_t allowed = node->od.allowed_missed_sync;
    node_count(&node->od.counters_missed_sync, missed);
    if (missed != 0U && allowed != UINT8_MAX && node->sync.overdue > allowed &&
        drive_wants_output(&node->drive)) {
        node_drive_fault(EMCY_MISSED_SYNC, 0, (int32_t)node->sync.overdue, true, node);
    }
}

/** The RPDO1 that waits for SYNC becomes the acting command. */
static void act_on_command(motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    if (node->command_waiting) {
        node->command_waiting = false;
        if (object_dictionary_unpack_rpdo1(node->waiting_command.data, od)) {
            node->command_acted = true;
            node->since_command_us = 0;
        } else {
            node_count(&od->counters_rpdo_rejected, 1);
        }
    }
    if (!node->holding) {
        const joint_command_t command = {.position_inc = od->target_position,
                                         .torque_mNm = od->target_torque,
                                         .torque_max_mNm = od->max_torque};
        joint_controller_command(&command, &node->controller);
    }
}

/** True when the SYNC acts. */
static bool receive_sync(const can_frame_t *frame, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const sync_config_t config = sync_config(od);
    const sync_result_t result = sync_receive(&config, frame, &node->sync);
    if (result.report_length) {
        emcy_report(EMCY_SYNC_LENGTH, 0, frame->len, od, &node->emcy);
    }
    node_count(&od->counters_duplicate_sync, result.duplicate ? 1 : 0);
    node_count(&od->counters_sync_counter_jumps, result.jump ? 1 : 0);
    count_missed(result.missed, node);
    if (result.acts) {
        act_on_command(node);
    }
    return result.acts;
}

/** False when the frame is too short to be processed. */
static bool check_rpdo(uint8_t number, uint8_t length, const can_frame_t *frame, rpdo_t *rpdo,
                       motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const rpdo_result_t result = rpdo_receive(length, frame, rpdo);
    node_count(&od->counters_rpdo_rejected, result.length == PDO_TOO_SHORT ? 1 : 0);
    node_count(&od->counters_rpdo_too_long, result.length == PDO_TOO_LONG ? 1 : 0);
    if (result.report) {
        emcy_report(result.length == PDO_TOO_SHORT ? EMCY_PDO_TOO_SHORT : EMCY_PDO_TOO_LONG, number,
                    frame->len, od, &node->emcy);
    }
    return result.length != PDO_TOO_SHORT;
}

static void receive_rpdo1(const can_frame_t *frame, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    if (!check_rpdo(1, OD_RPDO1_LENGTH, frame, &node->rpdo1, node)) {
        return;
    }
    if (od->synchronous_window_length != 0U && node->sync.running &&
        node->sync.since_us > od->synchronous_window_length) {
        node_count(&od->counters_rpdo_rejected, 1);
        return;
    }
    node_count(&od->counters_rpdo1_overwritten, node->command_waiting ? 1 : 0);
    node->waiting_command = *frame;
    node->command_waiting = true;
}

static void receive_rpdo2(const can_frame_t *frame, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const int8_t mode_before = od->modes_of_operation;
    if (!check_rpdo(2, OD_RPDO2_LENGTH, frame, &node->rpdo2, node)) {
        return;
    }
    if (!object_dictionary_unpack_rpdo2(frame->data, od)) {
        node_count(&od->counters_rpdo_rejected, 1);
        return;
    }
    uint16_t refused_mode = 0;
    if (od->modes_of_operation == MODE_NONE) {
        od->modes_of_operation = mode_before;
    } else {
        node_drive_mode(od->modes_of_operation, node);
        refused_mode = node->refusals;
    }
    node_drive_controlword(od->controlword, node);
    node->refusals |= refused_mode;
}

static void receive_rpdo4(const can_frame_t *frame, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    if (od->sensor_source == 0U) {
        node_count(&od->counters_rpdo4_refused, 1);
        return;
    }
    if (check_rpdo(4, OD_RPDO4_LENGTH, frame, &node->rpdo4, node)) {
        (void)object_dictionary_unpack_rpdo4(frame->data, od); /* every value is in range */
        node->position_known = true;
        node->since_position_us = 0;
    }
}

static void receive_sdo(const can_frame_t *frame, motor_node_t *node) {
    const sdo_target_t target = {
        .device_functions = &node_objects, .device = node, .od = &node->od};
    can_frame_t response;
    if (sdo_server_receive(&target, frame, &node->sdo, &response)) {
        send(&response, node);
    }
}

static void receive_emergency(const can_frame_t *frame, motor_node_t *node) {
    const uint16_t code = little_endian_u16(frame->data);
    for (size_t i = 0; i < sizeof node->od.emergency_consumer_object / sizeof(uint32_t); i++) {
        if (node->od.emergency_consumer_object[i] == frame->id && frame->len >= 2U && code != 0U &&
            drive_has_output(&node->drive)) {
            node_drive_fault(EMCY_HEARTBEAT, (uint8_t)(frame->id & NODE_ID), code, true, node);
        }
    }
}

static void hear_own_id(const can_frame_t *frame, motor_node_t *node) {
    if (!node->own_id_heard) {
        node_drive_fault(EMCY_OWN_NODE_ID, node->node_id, frame->id, true, node);
        node->own_id_heard = true;
    }
}

/** LSS is there while no process data are (CiA 305, 5). */
static void receive_lss(const motor_node_config_t *config, const can_frame_t *frame,
                        motor_node_t *node) {
    uint32_t identity[LSS_IDENTITY_PARTS] = {0};
    can_frame_t response;
    if (node->nmt == NMT_OPERATIONAL) {
        return;
    }
    for (uint8_t part = 0; part < LSS_IDENTITY_PARTS; part++) {
        const od_entry_t *entry = NULL;
        (void)od_find(OD_IDENTITY_OBJECT, (uint8_t)(part + 1U), &entry);
        identity[part] = od_read(&node->od, entry);
    }
    switch (lss_receive(identity, node->node_id, frame, &node->lss, &response)) {
    case LSS_ANSWER:
        send(&response, node);
        break;
    case LSS_STORE: {
        /* Not under torque, as 1010h: writing the memory may take long. */
        const bool stored = node->memory != NULL && !drive_has_output(&node->drive) &&
                            parameter_store_save(node->memory, PARAMETER_STORE_KEPT, &node->od,
                                                 node->lss.pending_node_id);
        node->stored_node_id = stored ? node->lss.pending_node_id : node->stored_node_id;
        response = lss_store_response(stored);
        send(&response, node);
        break;
    }
    case LSS_ACTIVATE:
        reset_communication(config, node);
        break;
    case LSS_SILENT:
    default:
        break;
    }
}

/** True when the frame is a SYNC that acts. */
static bool receive(const motor_node_config_t *config, const can_frame_t *frame,
                    motor_node_t *node) {
    const uint16_t sender = frame->id & NODE_ID;
    const bool own = sender == node->node_id;
    const bool operational = node->nmt == NMT_OPERATIONAL;
    if (frame->id == LSS_REQUEST_COB_ID) {
        receive_lss(config, frame, node);
        return false;
    }
    if (node->node_id == LSS_UNCONFIGURED) {
        return false;
    }
    if (frame->id == NMT_COB_ID) {
        receive_nmt(config, frame, node);
        return false;
    }
    if (frame->id == SYNC_COB_ID) {
        return operational && receive_sync(frame, node);
    }
    switch (frame->id & FUNCTION_CODE) {
    case EMCY_COB_ID:
        if (own) {
            hear_own_id(frame, node);
        } else if (node->nmt != NMT_STOPPED) {
            receive_emergency(frame, node);
        }
        break;
    case HEARTBEAT_COB_ID:
        if (own) {
            hear_own_id(frame, node);
        } else {
            heartbeat_receive(node->od.consumer_heartbeat_time, frame, &node->heartbeat_consumer);
        }
        break;
    case OD_TPDO1_COB_ID:
    case OD_TPDO2_COB_ID:
    case SDO_RESPONSE_COB_ID:
        if (own) {
            hear_own_id(frame, node);
        }
        break;
    case OD_RPDO1_COB_ID:
        if (own && operational) {
            receive_rpdo1(frame, node);
        }
        break;
    case OD_RPDO2_COB_ID:
        if (own && operational) {
            receive_rpdo2(frame, node);
        }
        break;
    case OD_RPDO4_COB_ID:
        if (own && operational) {
            receive_rpdo4(frame, node);
        }
        break;
    case SDO_REQUEST_COB_ID:
        if (own && node->nmt != NMT_STOPPED) {
            receive_sdo(frame, node);
        }
        break;
    default:
        break;
    }
    return false;
}

static void lose_heartbeat(uint8_t lost_node, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    if (drive_has_output(&node->drive)) {
        node_drive_fault(EMCY_HEARTBEAT, lost_node, 0, true, node);
    } else {
        emcy_report(EMCY_HEARTBEAT, lost_node, 0, od, &node->emcy);
    }
    const nmt_state_t before = node->nmt;
    if (od->error_behaviour_communication_error == 0U && before == NMT_OPERATIONAL) {
        node->nmt = NMT_PRE_OPERATIONAL;
    } else if (od->error_behaviour_communication_error == 2U) {
        node->nmt = NMT_STOPPED;
    }
    follow_nmt(before, node);
}

static void let_time_pass(uint32_t elapsed_us, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const sync_config_t config = sync_config(od);
    can_frame_t response;
    node->since_command_us = node_time_add(node->since_command_us, elapsed_us);
    node->since_position_us = node_time_add(node->since_position_us, elapsed_us);
    heartbeat_elapse(elapsed_us, &node->heartbeat_consumer);
    const uint32_t missed = sync_elapse(&config, elapsed_us, &node->sync);
    if (node->nmt == NMT_OPERATIONAL) {
        count_missed(missed, node);
    }
    if (sdo_server_elapse(od, elapsed_us, &node->sdo, &response)) {
        send(&response, node);
    }
}

static bool receive_all(const motor_node_config_t *config, const motor_node_input_t *input,
                        motor_node_t *node) {
    bool sync = false;
    const size_t count =
        input->frame_count < MOTOR_NODE_RX_MAX ? input->frame_count : MOTOR_NODE_RX_MAX;
    node_count(&node->od.counters_frames_not_read, (uint32_t)(input->frame_count - count));
    node_count(&node->od.counters_frames_not_read, input->frames_lost);
    /* cppcheck-suppress knownConditionTrueFalse ; it takes a count of 0 for the only one */
    for (size_t i = 0; i < count && !node->reset_requested; i++) {
        sync = receive(config, &input->frames[i], node) || sync;
    }
    return sync;
}

/** While the controller is off the bus nothing is sent; the emergency goes out when it is back. */
static void follow_bus(bool bus_off, motor_node_t *node) {
    if (bus_off && !node->bus_off) {
        if (drive_has_output(&node->drive)) {
            node_drive_fault(EMCY_BUS_OFF, 0, 0, true, node);
        } else {
            emcy_report(EMCY_BUS_OFF, 0, 0, &node->od, &node->emcy);
        }
    }
    node->bus_off = bus_off;
}

/** Injected sensors have no motor, so no current either. */
static void sample_current(const motor_node_input_t *input, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const uint32_t current_mA = od->sensor_source != 0U ? 0U : input->current_mA;
    const uint64_t rated_mA = od->motor_rated_current == 0U ? 1U : od->motor_rated_current;
    uint64_t thousandths = (uint64_t)current_mA * 1000U / rated_mA;
    node->current_mA = current_mA;
    node->mean_square_mA2 = derating_mean_square(
        node->mean_square_mA2, current_mA, od->derating_current_time_ms * 1000U, input->elapsed_us);
    if (thousandths > (uint64_t)INT16_MAX) {
        thousandths = (uint64_t)INT16_MAX;
    }
    od->current_actual_value = (int16_t)thousandths;
}

static void sample_sensors(const motor_node_input_t *input, motor_node_t *node) {
    object_dictionary_t *od = &node->od;
    const bool injected = od->sensor_source != 0U;
    if (!injected) {
        node->position_known = true;
    } else if (!node->position_known) {
        return;
    }
    const int32_t encoder = injected ? od->injected_sensors_position : input->position_inc;
    node->index_seen =
        injected ? (od->injected_sensors_flags & INJECTED_INDEX) != 0U : input->index_seen;
    node->index_encoder_inc = injected ? encoder : input->index_position_inc;
    node_drive_supervise_encoder(encoder, input->elapsed_us, node);
    const int64_t position = (int64_t)encoder + node->offset_inc;
    od->position_actual_value = node_drive_position(position);
    od->motor_temperature = input->temperature_dC;
    if (injected) {
        od->motor_temperature = od->injected_sensors_temperature;
    }
}

static void send_tpdo2(uint32_t elapsed_us, motor_node_t *node) {
    const object_dictionary_t *od = &node->od;
    const uint32_t content =
        (uint32_t)(uint8_t)od->modes_of_operation_display << 16 | (uint32_t)od->limit_reasons;
    const bool changed = content != node->tpdo2_content;
    node->tpdo2_content = content;
    if (node->nmt == NMT_OPERATIONAL &&
        tpdo_event_due(od->tpdo2_communication_parameter_inhibit_time * 100U,
                       od->tpdo2_communication_parameter_event_timer * 1000U, elapsed_us, changed,
                       &node->tpdo2)) {
        can_frame_t frame = {.id = (uint16_t)od->tpdo2_communication_parameter_cob_id,
                             .len = OD_TPDO2_LENGTH};
        object_dictionary_pack_tpdo2(od, frame.data);
        send(&frame, node);
    }
}

/** What is due in this step, beside the answers that wait already. */
static void produce(bool sync, uint32_t elapsed_us, motor_node_t *node,
                    motor_node_output_t *output) {
    const object_dictionary_t *od = &node->od;
    can_frame_t frame;
    if (sync && node->nmt == NMT_OPERATIONAL) { /* never behind the queue: the host waits for it */
        can_frame_t *tpdo1 = &output->frames[output->frame_count];
        tpdo1->id = (uint16_t)od->tpdo1_communication_parameter_cob_id;
        tpdo1->len = OD_TPDO1_LENGTH;
        object_dictionary_pack_tpdo1(od, tpdo1->data);
        output->frame_count++;
    }
    send_tpdo2(elapsed_us, node);
    if (heartbeat_due(od->producer_heartbeat_time, elapsed_us, &node->heartbeat_producer)) {
        frame = heartbeat_frame(node->node_id, node->nmt);
        send(&frame, node);
    }
    if (emcy_next(od, elapsed_us, node->nmt != NMT_STOPPED, &node->emcy, &frame)) {
        send(&frame, node);
    }
}

static void transmit(bool sync, uint32_t elapsed_us, motor_node_t *node,
                     motor_node_output_t *output) {
    if (node->bus_off) {
        return;
    }
    if (node->node_id != LSS_UNCONFIGURED) {
        produce(sync, elapsed_us, node, output);
    }
    while (output->frame_count < MOTOR_NODE_TX_MAX &&
           frame_queue_pop(&node->to_send, &output->frames[output->frame_count])) {
        output->frame_count++;
    }
}

void motor_node_step(const motor_node_config_t *config, motor_node_t *node,
                     const motor_node_input_t *input, motor_node_output_t *output) {
    output->torque_mNm = 0;
    output->output_enabled = false;
    output->frame_count = 0;

    if (!node->boot_up_sent && node->node_id != LSS_UNCONFIGURED) {
        const can_frame_t boot_up = heartbeat_frame(node->node_id, NMT_BOOT_UP);
        send(&boot_up, node);
        node->boot_up_sent = true;
    }
    let_time_pass(input->elapsed_us, node);
    const bool sync = receive_all(config, input, node);
    output->reset_requested = node->reset_requested;
    if (node->reset_requested) {
        return;
    }
    const uint8_t lost =
        heartbeat_lost(node->od.consumer_heartbeat_time, &node->heartbeat_consumer);
    if (lost != 0U) {
        lose_heartbeat(lost, node);
    }
    follow_bus(input->bus_off, node);
    sample_current(input, node);
    sample_sensors(input, node);
    node_drive_supervise(input->elapsed_us, node);
    node_drive_tick(input->elapsed_us, node);
    transmit(sync, input->elapsed_us, node, output);
    if (node->own_id_heard && node->emcy.count == 0U && node->nmt != NMT_STOPPED) {
        const nmt_state_t before = node->nmt;
        node->own_id_heard = false; /* the master may bring the node back; it will stop again */
        node->nmt = NMT_STOPPED;
        follow_nmt(before, node);
    }
    output->torque_mNm = node->od.torque_actual_value;
    output->output_enabled = drive_has_output(&node->drive);
}
