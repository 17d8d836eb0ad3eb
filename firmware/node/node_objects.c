#include "node/node_objects.h"

#include "node/motor_node.h"
#include "node/node_drive.h"

#define SIGNATURE_SAVE 0x65766173U
#define SIGNATURE_LOAD 0x64616F6CU
#define EMCY_CONSUMER_OFF 0x80000000U

static sdo_abort_t readable(const void *device, const od_entry_t *entry) {
    const motor_node_t *node = device;
    if (entry->index == OD_PRE_DEFINED_ERROR_FIELD &&
        entry->subindex > node->od.pre_defined_error_field_number_of_errors) {
        return SDO_ABORT_NO_DATA;
    }
    return SDO_ABORT_NONE;
}

/** What must not change under a working controller. */
static bool needs_output_off(uint16_t index) {
    return index == OD_FIC || index == OD_SENSOR_SOURCE || index == OD_TIME_BASE ||
           index == OD_POSITION_ENCODER_RESOLUTION || index == OD_TARGET_POSITION ||
           index == OD_TARGET_TORQUE || index == OD_MAX_TORQUE || index == OD_STORE_PARAMETERS ||
           index == OD_RESTORE_DEFAULT_PARAMETERS; /* writing the memory may take long */
}

static bool is_configuration(uint16_t index) {
    return index != OD_PRE_DEFINED_ERROR_FIELD && index != OD_STORE_PARAMETERS &&
           index != OD_RESTORE_DEFAULT_PARAMETERS && index != OD_VERIFY_CONFIGURATION &&
           index != OD_INJECTED_SENSORS && index != OD_CONTROLWORD &&
           index != OD_MODES_OF_OPERATION && index != OD_TARGET_POSITION &&
           index != OD_TARGET_TORQUE && index != OD_MAX_TORQUE;
}

/** CiA 301, 7.5.2.16: no node may be watched twice. */
static bool is_watched_already(const object_dictionary_t *od, uint8_t subindex, uint32_t value) {
    for (uint8_t i = 0; i < HEARTBEAT_CONSUMERS; i++) {
        const uint32_t other = od->consumer_heartbeat_time[i];
        if (i + 1U != subindex && (other & 0xFFFFU) != 0U && (value & 0xFFFFU) != 0U &&
            (other >> 16) == (value >> 16)) {
            return true;
        }
    }
    return false;
}

static sdo_abort_t check_position_limit(const object_dictionary_t *od, uint8_t subindex,
                                        int32_t limit) {
    const bool crossed = subindex == 1U ? limit > od->software_position_limit_max_position_limit
                                        : limit < od->software_position_limit_min_position_limit;
    return crossed ? SDO_ABORT_RANGE : SDO_ABORT_NONE;
}

static sdo_abort_t check(const object_dictionary_t *od, const od_entry_t *entry, uint32_t value) {
    switch (entry->index) {
    case OD_PRE_DEFINED_ERROR_FIELD:
        return value != 0U ? SDO_ABORT_RANGE : SDO_ABORT_NONE;
    case OD_STORE_PARAMETERS:
        return value != SIGNATURE_SAVE ? SDO_ABORT_NOT_STORED : SDO_ABORT_NONE;
    case OD_RESTORE_DEFAULT_PARAMETERS:
        return value != SIGNATURE_LOAD ? SDO_ABORT_NOT_STORED : SDO_ABORT_NONE;
    case OD_CONSUMER_HEARTBEAT_TIME:
        return is_watched_already(od, entry->subindex, value) ? SDO_ABORT_INCOMPATIBLE
                                                              : SDO_ABORT_NONE;
    case OD_SYNCHRONOUS_COUNTER_OVERFLOW_VALUE:
        return value == 1U                            ? SDO_ABORT_RANGE
               : od->communication_cycle_period != 0U ? SDO_ABORT_DEVICE_STATE
                                                      : SDO_ABORT_NONE;
    case OD_EMERGENCY_CONSUMER_OBJECT:
        return (value & EMCY_CONSUMER_OFF) == 0U && (value <= EMCY_COB_ID || value > 0x0FFU)
                   ? SDO_ABORT_RANGE
                   : SDO_ABORT_NONE;
    case OD_QUICK_STOP_OPTION_CODE:
        return value == 3U || value == 4U ? SDO_ABORT_RANGE : SDO_ABORT_NONE;
    case OD_MODES_OF_OPERATION:
        return value != MODE_NONE && !node_drive_has_mode((int8_t)(uint8_t)value) ? SDO_ABORT_RANGE
                                                                                  : SDO_ABORT_NONE;
    case OD_HOMING_METHOD:
        return value == 35U || value == 36U ? SDO_ABORT_RANGE : SDO_ABORT_NONE;
    case OD_SOFTWARE_POSITION_LIMIT:
        return check_position_limit(od, entry->subindex, (int32_t)value);
    default:
        return SDO_ABORT_NONE;
    }
}

static sdo_abort_t store(parameter_source_t source, const motor_node_t *node) {
    if (node->memory == NULL) { /* nothing is stored: any reset brings the defaults */
        return source == PARAMETER_STORE_DEFAULTS ? SDO_ABORT_NONE : SDO_ABORT_NO_RESOURCE;
    }
    return parameter_store_save(node->memory, source, &node->od, node->stored_node_id)
               ? SDO_ABORT_NONE
               : SDO_ABORT_HARDWARE;
}

static sdo_abort_t write(void *device, const od_entry_t *entry, uint32_t value) {
    motor_node_t *node = device;
    object_dictionary_t *od = &node->od;
    if (needs_output_off(entry->index) && drive_has_output(&node->drive)) {
        return SDO_ABORT_DEVICE_STATE;
    }
    const sdo_abort_t code = check(od, entry, value);
    if (code != SDO_ABORT_NONE) {
        return code;
    }
    if (is_configuration(entry->index)) {
        od->verify_configuration_configuration_date = 0;
        od->verify_configuration_configuration_time = 0;
    }
    switch (entry->index) {
    case OD_STORE_PARAMETERS:
        return store(PARAMETER_STORE_VALUES, node);
    case OD_RESTORE_DEFAULT_PARAMETERS: /* they act from the next reset on */
        return store(PARAMETER_STORE_DEFAULTS, node);
    case OD_CONSUMER_HEARTBEAT_TIME:
        node->heartbeat_consumer.entries[entry->subindex - 1U].watching = false;
        break;
    case OD_SENSOR_SOURCE: /* an injected position is absolute; homing was for the encoder before */
        node->position_known = false;
        if (value != od->sensor_source) {
            node->referenced = value != 0U || node->encoder_referenced;
            node->index_referenced = false;
            node->offset_inc = 0;
            node->mean_square_mA2 = 0;
        }
        break;
    case OD_CONTROLWORD:
        node_drive_controlword((uint16_t)value, node);
        return SDO_ABORT_NONE;
    case OD_MODES_OF_OPERATION:
        if (value != MODE_NONE) {
            od_write(entry, value, od);
            node_drive_mode(od->modes_of_operation, node);
        }
        return SDO_ABORT_NONE;
    default:
        break;
    }
    od_write(entry, value, od);
    return SDO_ABORT_NONE;
}

const sdo_device_t node_objects = {.readable = readable, .write = write};
