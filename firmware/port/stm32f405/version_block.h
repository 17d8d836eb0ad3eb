/**
 * What the image says about itself, at a fixed address of the flash: tools read it from a file or a
 * probe, the firmware tells it in 100Ah and checks its own checksum with it.
 *
 * Little endian, 64 bytes. image_bytes and image_crc are filled in after linking by
 * tools/seal_image.py, which names the files by this block too.
 */
#ifndef VERSION_BLOCK_H
#define VERSION_BLOCK_H

#include <stdbool.h>
#include <stdint.h>

#define VERSION_BLOCK_MAGIC 0x434D5048U /* "HPMC" */
#define VERSION_BLOCK_LAYOUT 1U
#define VERSION_BLOCK_FLOAT 0U
#define VERSION_BLOCK_FIXED 1U

typedef struct {
    uint32_t magic;     /**< VERSION_BLOCK_MAGIC: 4 bytes to know it by */
    uint16_t layout;    /**< VERSION_BLOCK_LAYOUT: counts changes of this struct */
    uint8_t build_type; /**< VERSION_BLOCK_FLOAT or VERSION_BLOCK_FIXED */
    uint8_t dirty;      /**< 1: built from sources that were not committed */
    char version[12];   /**< zero-terminated, as the two below */
    char git_hash[16];
    char reserved[16];
    uint32_t protocol_hash; /**< of the EDS, as in RUN_INFO */
    uint32_t image_bytes;   /**< from the beginning of the flash, a multiple of 4 */
    uint32_t image_crc;     /**< CRC-32 of these bytes without this field */
} version_block_t;

extern const version_block_t version_block;

#define VERSION_BLOCK_TEXT_MAX 64U

/** Is the image in flash the one that was sealed? */
bool version_block_image_is_whole(void);

/** Text of 100Ah, e.g. "0.1.0+332fb8a9 g7a1eaee1234c float 1A2B3C4D": version and protocol hash,
 * git hash, number type, checksum. */
void version_block_text(char text[VERSION_BLOCK_TEXT_MAX]);

#endif
