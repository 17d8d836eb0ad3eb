#include "od/od_access.h"

#include <stdbool.h>
#include <string.h>

static uint32_t key(uint16_t index, uint8_t subindex) {
    return ((uint32_t)index << 8) | subindex;
}

static bool index_exists(uint16_t index, size_t at) {
    return (at < OD_ENTRY_COUNT && object_dictionary_entries[at].index == index) ||
           (at > 0U && object_dictionary_entries[at - 1U].index == index);
}

sdo_abort_t od_find(uint16_t index, uint8_t subindex, const od_entry_t **entry) {
    size_t low = 0;
    size_t high = OD_ENTRY_COUNT;
    while (low < high) {
        const size_t middle = (low + high) / 2U;
        const od_entry_t *probe = &object_dictionary_entries[middle];
        if (key(probe->index, probe->subindex) < key(index, subindex)) {
            low = middle + 1U;
        } else {
            high = middle;
        }
    }
    if (low < OD_ENTRY_COUNT && object_dictionary_entries[low].index == index &&
        object_dictionary_entries[low].subindex == subindex) {
        *entry = &object_dictionary_entries[low];
        return SDO_ABORT_NONE;
    }
    return index_exists(index, low) ? SDO_ABORT_NO_SUBINDEX : SDO_ABORT_NO_OBJECT;
}

size_t od_size(const od_entry_t *entry) {
    switch (entry->type) {
    case OD_I8:
    case OD_U8:
        return 1;
    case OD_I16:
    case OD_U16:
        return 2;
    case OD_I32:
    case OD_U32:
        return 4;
    default:
        return 0;
    }
}

static bool is_constant_number(const od_entry_t *entry) {
    return entry->access == OD_CONST && entry->type != OD_STRING;
}

uint32_t od_read(const object_dictionary_t *od, const od_entry_t *entry) {
    if (is_constant_number(entry)) {
        return entry->min;
    }
    const uint8_t *at = (const uint8_t *)od + entry->offset;
    uint8_t value8 = 0;
    uint16_t value16 = 0;
    uint32_t value32 = 0;
    switch (od_size(entry)) {
    case 1:
        memcpy(&value8, at, sizeof value8);
        return value8;
    case 2:
        memcpy(&value16, at, sizeof value16);
        return value16;
    case 4:
        memcpy(&value32, at, sizeof value32);
        return value32;
    default:
        return 0;
    }
}

const char *od_read_string(const object_dictionary_t *od, const od_entry_t *entry) {
    const char *text = NULL;
    memcpy(&text, (const uint8_t *)od + entry->offset, sizeof text);
    return text;
}

static int32_t signed_value(const od_entry_t *entry, uint32_t value) {
    switch (entry->type) {
    case OD_I8:
        return (int8_t)(uint8_t)value;
    case OD_I16:
        return (int16_t)(uint16_t)value;
    default:
        return (int32_t)value;
    }
}

sdo_abort_t od_check_range(const od_entry_t *entry, uint32_t value) {
    bool low = value < entry->min;
    bool high = value > entry->max;
    if (entry->type == OD_I8 || entry->type == OD_I16 || entry->type == OD_I32) {
        low = signed_value(entry, value) < (int32_t)entry->min;
        high = signed_value(entry, value) > (int32_t)entry->max;
    }
    return low ? SDO_ABORT_TOO_LOW : high ? SDO_ABORT_TOO_HIGH : SDO_ABORT_NONE;
}

void od_write(const od_entry_t *entry, uint32_t value, object_dictionary_t *od) {
    uint8_t *at = (uint8_t *)od + entry->offset;
    const uint8_t value8 = (uint8_t)value;
    const uint16_t value16 = (uint16_t)value;
    switch (od_size(entry)) {
    case 1:
        memcpy(at, &value8, sizeof value8);
        break;
    case 2:
        memcpy(at, &value16, sizeof value16);
        break;
    case 4:
        memcpy(at, &value, sizeof value);
        break;
    default:
        break;
    }
}

void od_copy_communication(const object_dictionary_t *from, object_dictionary_t *to) {
    for (size_t i = 0; i < OD_ENTRY_COUNT && object_dictionary_entries[i].index < 0x2000U; i++) {
        const od_entry_t *entry = &object_dictionary_entries[i];
        if (!is_constant_number(entry) && entry->type != OD_STRING) {
            od_write(entry, od_read(from, entry), to);
        }
    }
}
