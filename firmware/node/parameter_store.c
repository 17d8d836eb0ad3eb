#include "node/parameter_store.h"

#include <string.h>

#include "node/crc32.h"
#include "od/little_endian.h"
#include "od/od_access.h"

/*
 * A copy, little endian: magic u32, sequence u32, count u16, node-id u8, 0; count records of
 * index u16, subindex u8, 0, value u32; CRC-32 (IEEE 802.3) of all before it.
 */
#define MAGIC 0x50434946U
#define HEADER_BYTES 12U
#define RECORD_BYTES 8U
#define CRC_BYTES 4U
#define RECORDS_MAX ((PARAMETER_STORE_COPY_BYTES - HEADER_BYTES - CRC_BYTES) / RECORD_BYTES)
#define COPIES 2U
#define ERASED 0xFFFFFFFFU
#define SERIAL_NUMBER 4U /* sub-index of 1018h */

typedef struct {
    bool unreadable; /* the memory failed: what it holds is not known */
    bool whole;
    uint8_t node_id;
    uint16_t count;
    uint32_t sequence;
} copy_t;

typedef struct {
    const parameter_memory_t *memory;
    uint8_t copy;
    size_t offset;
    uint32_t crc;
    bool ok;
} writer_t;

bool parameter_store_has(const od_entry_t *entry) {
    switch (entry->index) {
    case OD_PRE_DEFINED_ERROR_FIELD:
    case OD_STORE_PARAMETERS:
    case OD_RESTORE_DEFAULT_PARAMETERS:
    case OD_SENSOR_SOURCE: /* of a bench: power-on finds the real encoder and clock */
    case OD_TIME_BASE:
    case OD_INJECTED_SENSORS:
    case OD_CONTROLWORD:
    case OD_MODES_OF_OPERATION:
    case OD_TARGET_POSITION:
    case OD_TARGET_TORQUE:
    case OD_MAX_TORQUE:
        return false;
    case OD_IDENTITY_OBJECT: /* the serial number is the device's, not of its configuration */
        return entry->subindex == SERIAL_NUMBER;
    default:
        return entry->access == OD_RW;
    }
}

/* --- reading */

static copy_t inspect(const parameter_memory_t *memory, uint8_t number) {
    copy_t copy = {0};
    uint8_t data[HEADER_BYTES];
    copy.unreadable = !memory->read(memory->context, number, 0, data, HEADER_BYTES);
    if (copy.unreadable || little_endian_u32(data) != MAGIC) {
        return copy;
    }
    copy.sequence = little_endian_u32(&data[4]);
    copy.count = little_endian_u16(&data[8]);
    copy.node_id = data[10];
    if (copy.count > RECORDS_MAX) {
        return copy;
    }
    uint32_t crc = crc32(data, HEADER_BYTES, 0);
    size_t offset = HEADER_BYTES;
    for (uint16_t i = 0; i < copy.count; i++) {
        copy.unreadable = !memory->read(memory->context, number, offset, data, RECORD_BYTES);
        if (copy.unreadable) {
            return copy;
        }
        crc = crc32(data, RECORD_BYTES, crc);
        offset += RECORD_BYTES;
    }
    copy.unreadable = !memory->read(memory->context, number, offset, data, CRC_BYTES);
    copy.whole = !copy.unreadable && little_endian_u32(data) == crc;
    return copy;
}

bool parameter_store_damaged(const parameter_memory_t *memory) {
    bool blank = true;
    for (uint8_t number = 0; number < COPIES; number++) {
        uint8_t data[CRC_BYTES];
        if (inspect(memory, number).whole) {
            return false;
        }
        blank = blank && memory->read(memory->context, number, 0, data, CRC_BYTES) &&
                (little_endian_u32(data) == ERASED || little_endian_u32(data) == 0U);
    }
    return !blank;
}

/** Number of the newest whole copy; COPIES when there is none. *all_read: no copy is unreadable. */
static uint8_t newest(const parameter_memory_t *memory, copy_t *copy, bool *all_read) {
    const copy_t copies[COPIES] = {inspect(memory, 0), inspect(memory, 1)};
    *all_read = !copies[0].unreadable && !copies[1].unreadable;
    if (!copies[0].whole && !copies[1].whole) {
        memset(copy, 0, sizeof *copy);
        return COPIES;
    }
    const bool second_is_newer = (copies[1].sequence - copies[0].sequence) < 0x80000000U;
    const uint8_t number = copies[1].whole && (!copies[0].whole || second_is_newer) ? 1U : 0U;
    *copy = copies[number];
    return number;
}

static void take(const uint8_t *record, object_dictionary_t *od) {
    const od_entry_t *entry = NULL;
    const uint32_t value = little_endian_u32(&record[4]);
    if (od_find(little_endian_u16(record), record[2], &entry) == SDO_ABORT_NONE &&
        parameter_store_has(entry) && od_check_range(entry, value) == SDO_ABORT_NONE) {
        od_write(entry, value, od);
    }
}

bool parameter_store_load(const parameter_memory_t *memory, object_dictionary_t *od,
                          uint8_t *node_id) {
    copy_t copy;
    uint8_t record[RECORD_BYTES];
    bool all_read = false;
    const uint8_t number = newest(memory, &copy, &all_read);
    if (number == COPIES) {
        return false;
    }
    for (uint16_t i = 0; i < copy.count; i++) {
        if (!memory->read(memory->context, number, HEADER_BYTES + i * RECORD_BYTES, record,
                          RECORD_BYTES)) {
            return false; /* a part of the set would be a mixture */
        }
        take(record, od);
    }
    *node_id = copy.node_id;
    return true;
}

/* --- writing */

static void put(const uint8_t *data, size_t size, writer_t *writer) {
    const parameter_memory_t *memory = writer->memory;
    writer->ok =
        writer->ok && memory->write(memory->context, writer->copy, writer->offset, data, size);
    writer->crc = crc32(data, size, writer->crc);
    writer->offset += size;
}

/** Does a save of this source write the entry? The serial number stays in any case. */
static bool writes(parameter_source_t source, const od_entry_t *entry) {
    return parameter_store_has(entry) &&
           (source == PARAMETER_STORE_VALUES || entry->index == OD_IDENTITY_OBJECT);
}

static void put_values(parameter_source_t source, const object_dictionary_t *od, writer_t *writer) {
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *entry = &object_dictionary_entries[i];
        if (writes(source, entry)) {
            uint8_t record[RECORD_BYTES] = {0};
            little_endian_put_u16(entry->index, record);
            record[2] = entry->subindex;
            little_endian_put_u32(od_read(od, entry), &record[4]);
            put(record, RECORD_BYTES, writer);
        }
    }
}

static void put_kept(uint8_t from, uint16_t count, writer_t *writer) {
    const parameter_memory_t *memory = writer->memory;
    uint8_t record[RECORD_BYTES];
    for (uint16_t i = 0; i < count; i++) {
        writer->ok =
            writer->ok && memory->read(memory->context, from, HEADER_BYTES + i * RECORD_BYTES,
                                       record, RECORD_BYTES);
        if (writer->ok) {
            put(record, RECORD_BYTES, writer);
        }
    }
}

static uint16_t values(parameter_source_t source) {
    uint16_t count = 0;
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        count = (uint16_t)(count + (writes(source, &object_dictionary_entries[i]) ? 1U : 0U));
    }
    return count;
}

bool parameter_store_save(const parameter_memory_t *memory, parameter_source_t source,
                          const object_dictionary_t *od, uint8_t node_id) {
    copy_t before;
    bool all_read = false;
    const uint8_t from = newest(memory, &before, &all_read);
    const uint16_t count = source == PARAMETER_STORE_KEPT ? before.count : values(source);
    writer_t writer = {.memory = memory, .copy = from == 0U ? 1U : 0U};
    uint8_t header[HEADER_BYTES] = {0};
    uint8_t crc[CRC_BYTES];
    little_endian_put_u32(MAGIC, header);
    little_endian_put_u32(before.sequence + 1U, &header[4]);
    little_endian_put_u16(count, &header[8]);
    header[10] = node_id;

    /* A copy that cannot be read may be the newest one, or the only one. */
    writer.ok = all_read && count <= RECORDS_MAX && memory->erase(memory->context, writer.copy);
    put(header, HEADER_BYTES, &writer);
    if (source == PARAMETER_STORE_KEPT) {
        put_kept(from, count, &writer);
    } else {
        put_values(source, od, &writer);
    }
    little_endian_put_u32(writer.crc, crc);
    put(crc, CRC_BYTES, &writer);
    return writer.ok;
}
