/**
 * Finds, reads and writes entries of the object dictionary by index and subindex.
 *
 * Numbers travel as bit patterns of 32 bits; od_size says how many bytes of one belong to the
 * entry. Errors are abort codes of the SDO protocol (CiA 301, 7.2.4.3.17); 0 = none.
 */
#ifndef OD_ACCESS_H
#define OD_ACCESS_H

#include <stddef.h>
#include <stdint.h>

#include "od/object_dictionary.h"

typedef enum {
    SDO_ABORT_NONE = 0x00000000,
    SDO_ABORT_TOGGLE_BIT = 0x05030000,
    SDO_ABORT_TIMEOUT = 0x05040000,
    SDO_ABORT_COMMAND_SPECIFIER = 0x05040001,
    SDO_ABORT_WRITE_ONLY = 0x06010001,
    SDO_ABORT_READ_ONLY = 0x06010002,
    SDO_ABORT_NO_OBJECT = 0x06020000,
    SDO_ABORT_INCOMPATIBLE = 0x06040043,
    SDO_ABORT_HARDWARE = 0x06060000,
    SDO_ABORT_TOO_LONG = 0x06070012,
    SDO_ABORT_TOO_SHORT = 0x06070013,
    SDO_ABORT_NO_SUBINDEX = 0x06090011,
    SDO_ABORT_RANGE = 0x06090030,
    SDO_ABORT_TOO_HIGH = 0x06090031,
    SDO_ABORT_TOO_LOW = 0x06090032,
    SDO_ABORT_NO_RESOURCE = 0x060A0023,
    SDO_ABORT_NOT_STORED = 0x08000020,
    SDO_ABORT_DEVICE_STATE = 0x08000022,
    SDO_ABORT_NO_DATA = 0x08000024
} sdo_abort_t;

/** Sets *entry, or returns SDO_ABORT_NO_OBJECT or SDO_ABORT_NO_SUBINDEX. */
sdo_abort_t od_find(uint16_t index, uint8_t subindex, const od_entry_t **entry);

/** Bytes of a number; 0 for a string. */
size_t od_size(const od_entry_t *entry);

/** Value of a number. */
uint32_t od_read(const object_dictionary_t *od, const od_entry_t *entry);

/** Text of a string. */
const char *od_read_string(const object_dictionary_t *od, const od_entry_t *entry);

/** SDO_ABORT_TOO_HIGH or SDO_ABORT_TOO_LOW when value is outside the entry's range. */
sdo_abort_t od_check_range(const od_entry_t *entry, uint32_t value);

/** Stores a number, unchecked. The entry must not be constant. */
void od_write(const od_entry_t *entry, uint32_t value, object_dictionary_t *od);

/** Copies all values of the communication profile area (1000h to 1FFFh). */
void od_copy_communication(const object_dictionary_t *from, object_dictionary_t *to);

#endif
