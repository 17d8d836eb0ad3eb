#include "canopen/emcy.h"

#include <string.h>

#include "canopen/node_time.h"
#include "od/little_endian.h"

#define QUEUE_SIZE 8U
#define HISTORY_SIZE 8U

void emcy_init(emcy_t *emcy) {
    memset(emcy, 0, sizeof *emcy);
    emcy->since_us = UINT32_MAX; /* the first one need not wait */
}

static uint8_t register_bits(emcy_code_t code) {
    switch ((uint32_t)code & 0xFF00U) {
    case 0x2300U:
        return ERROR_REGISTER_GENERIC | ERROR_REGISTER_CURRENT;
    case 0x4300U:
        return ERROR_REGISTER_GENERIC | ERROR_REGISTER_TEMPERATURE;
    case 0x5500U:
    case 0x6000U:
        return ERROR_REGISTER_GENERIC;
    case 0x8100U:
    case 0x8200U:
        return ERROR_REGISTER_GENERIC | ERROR_REGISTER_COMMUNICATION;
    default:
        return ERROR_REGISTER_GENERIC | ERROR_REGISTER_DRIVE;
    }
}

static void push(uint16_t code, uint8_t error_register, uint8_t source, int32_t detail,
                 emcy_t *emcy) {
    if (emcy->count == QUEUE_SIZE) {
        return; /* the history has it */
    }
    can_frame_t *frame = &emcy->frames[(emcy->first + emcy->count) % QUEUE_SIZE];
    frame->len = 8;
    little_endian_put_u16(code, &frame->data[0]);
    frame->data[2] = error_register;
    frame->data[3] = source;
    little_endian_put_u32((uint32_t)detail, &frame->data[4]);
    emcy->count++;
}

static void remember(uint32_t code, uint8_t source, object_dictionary_t *od) {
    memmove(&od->pre_defined_error_field[1], &od->pre_defined_error_field[0],
            sizeof od->pre_defined_error_field - sizeof od->pre_defined_error_field[0]);
    od->pre_defined_error_field[0] = code | ((uint32_t)source << 16);
    if (od->pre_defined_error_field_number_of_errors < HISTORY_SIZE) {
        od->pre_defined_error_field_number_of_errors++;
    }
}

void emcy_raise(emcy_code_t code, uint8_t source, int32_t detail, object_dictionary_t *od,
                emcy_t *emcy) {
    od->error_register |= register_bits(code);
    emcy_report(code, source, detail, od, emcy);
}

void emcy_report(emcy_code_t code, uint8_t source, int32_t detail, object_dictionary_t *od,
                 emcy_t *emcy) {
    remember((uint32_t)code, source, od);
    push((uint16_t)code, od->error_register | register_bits(code), source, detail, emcy);
}

void emcy_clear(object_dictionary_t *od, emcy_t *emcy) {
    if (od->error_register != 0U) {
        od->error_register = 0;
        push(EMCY_NO_ERROR, 0, 0, 0, emcy);
    }
}

bool emcy_next(const object_dictionary_t *od, uint32_t elapsed_us, bool may_send, emcy_t *emcy,
               can_frame_t *frame) {
    emcy->since_us = node_time_add(emcy->since_us, elapsed_us);
    if (!may_send || emcy->count == 0U || emcy->since_us < od->inhibit_time_emcy * 100U) {
        return false;
    }
    *frame = emcy->frames[emcy->first];
    frame->id = (uint16_t)od->cob_id_emcy; /* the node-id may be another than when it was queued */
    emcy->first = (uint8_t)((emcy->first + 1U) % QUEUE_SIZE);
    emcy->count--;
    emcy->since_us = 0;
    return true;
}
