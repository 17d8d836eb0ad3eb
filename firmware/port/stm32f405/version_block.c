#include "port/stm32f405/version_block.h"

#include <stddef.h>
#include <string.h>

#include "node/crc32.h"
#include "od/object_dictionary.h"
#include "version.h"

#ifdef CONTROL_FIXED_POINT
#define BUILD_TYPE VERSION_BLOCK_FIXED
#define BUILD_TYPE_TEXT "fixed"
#else
#define BUILD_TYPE VERSION_BLOCK_FLOAT
#define BUILD_TYPE_TEXT "float"
#endif

#define CRC_DIGITS 8U

/* Read through sealed(): the last two fields are filled in behind the compiler's back. */
__attribute__((section(".version"), used)) const version_block_t version_block = {
    .magic = VERSION_BLOCK_MAGIC,
    .layout = VERSION_BLOCK_LAYOUT,
    .build_type = BUILD_TYPE,
    .dirty = HPMC_GIT_DIRTY,
    .version = OD_SOFTWARE_VERSION,
    .git_hash = HPMC_GIT_COMMIT,
    .protocol_hash = OD_PROTOCOL_HASH,
};

_Static_assert(sizeof(version_block_t) == 64U, "layout of the version block");
_Static_assert(offsetof(version_block_t, image_crc) == 60U, "the checksum stands last");

static const volatile version_block_t *sealed(void) {
    return &version_block;
}

bool version_block_image_is_whole(void) {
    extern const uint8_t image_begin[];
    extern const uint8_t image_limit[];
    const uint32_t bytes = sealed()->image_bytes;
    const uint8_t *after = (const uint8_t *)&version_block + sizeof version_block;
    const size_t before_crc = (size_t)((uintptr_t)&version_block - (uintptr_t)image_begin) +
                              offsetof(version_block_t, image_crc);
    if (bytes < before_crc + sizeof version_block.image_crc ||
        bytes > (size_t)((uintptr_t)image_limit - (uintptr_t)image_begin)) {
        return false;
    }
    const uint32_t crc = crc32(image_begin, before_crc, 0);
    return crc32(after, bytes - before_crc - sizeof version_block.image_crc, crc) ==
           sealed()->image_crc;
}

void version_block_text(char text[VERSION_BLOCK_TEXT_MAX]) {
    static const char known[] =
        OD_SOFTWARE_VERSION "+" OD_PROTOCOL_HASH_TEXT " g" HPMC_GIT_HASH " " BUILD_TYPE_TEXT " ";
    _Static_assert(sizeof known + CRC_DIGITS <= VERSION_BLOCK_TEXT_MAX, "length of 100Ah");
    const uint32_t crc = sealed()->image_crc;
    memcpy(text, known, sizeof known);
    char *at = &text[sizeof known - 1U];
    for (uint32_t i = 0; i < CRC_DIGITS; i++) {
        at[i] = "0123456789ABCDEF"[(crc >> (28U - 4U * i)) & 15U];
    }
    at[CRC_DIGITS] = '\0';
}
