/**
 * The chip's unique identifier (RM0090, section 39.1) as a serial number.
 */
#ifndef UNIQUE_ID_H
#define UNIQUE_ID_H

#include <stdint.h>

/** CRC-32 of the 96 bits, never 0; 0 when the words cannot be read. */
uint32_t unique_id_serial_number(void);

#endif
