/**
 * The parameter memory of a node in flash: one 16 KiB sector a copy (RM0090, section 3).
 *
 * The core stands still while the flash is erased, up to 0.8 s, and for 16 us a byte while it is
 * written: the node saves with its output off only. Every wait is bounded and every operation is
 * read back, so that a flash that does not obey is a failed save and nothing else.
 */
#ifndef FLASH_PAGES_H
#define FLASH_PAGES_H

#include "node/parameter_store.h"

/** Sectors 2 and 3: tools/hpmc/parameter_page.py and stm32f405.ld know them too. */
#define FLASH_PAGES_ADDRESS 0x08008000U
#define FLASH_PAGES_SECTOR_BYTES 0x4000U
#define FLASH_PAGES_FIRST_SECTOR 2U

extern const parameter_memory_t flash_pages;

#endif
