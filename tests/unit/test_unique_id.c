/* Serial number from the chip's identifier. */
#include "unity.h"

#include "port/stm32f405/unique_id.h"

static uint32_t words[3];
static uint32_t faults_at; /* address whose read faults; 0 = none */

static bool read_word(uint32_t address, uint32_t *value) {
    if (address == faults_at) {
        return false;
    }
    TEST_ASSERT_TRUE(address >= 0x1FFF7A10U && address <= 0x1FFF7A18U && address % 4U == 0U);
    *value = words[(address - 0x1FFF7A10U) / 4U];
    return true;
}

static void set(uint32_t a, uint32_t b, uint32_t c) {
    words[0] = a;
    words[1] = b;
    words[2] = c;
}

void setUp(void) {
    faults_at = 0;
    set(0x00290042U, 0x33345118U, 0x38363431U);
}
void tearDown(void) {}

void test_is_fnv_1a_of_the_bytes(void) {
    set(0x64636261U, 0x68676665U, 0x6C6B6A69U); /* "abcdefghijkl" */
    TEST_ASSERT_EQUAL_HEX32(0xE8FB3E15U, unique_id_serial(read_word, 7));
}

void test_is_never_zero(void) {
    set(0x04030201U, 0xCA070605U, 0x00208E3DU); /* whose hash is 0 */
    TEST_ASSERT_EQUAL_HEX32(1, unique_id_serial(read_word, 7));
}

void test_neighbours_on_a_wafer_differ(void) {
    const uint32_t first = unique_id_serial(read_word, 7);
    words[0] ^= 1U;
    const uint32_t second = unique_id_serial(read_word, 7);
    words[2] ^= 0x80000000U;
    TEST_ASSERT_TRUE(first != second && second != unique_id_serial(read_word, 7));
}

void test_falls_back_when_a_word_faults(void) {
    for (uint32_t i = 0; i < 3U; i++) {
        faults_at = UNIQUE_ID_ADDRESS + 4U * i;
        TEST_ASSERT_EQUAL_UINT32(1234, unique_id_serial(read_word, 1234));
    }
}

void test_falls_back_when_nothing_is_programmed(void) {
    set(0, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(1234, unique_id_serial(read_word, 1234));
    set(UINT32_MAX, UINT32_MAX, UINT32_MAX);
    TEST_ASSERT_EQUAL_UINT32(1234, unique_id_serial(read_word, 1234));
}
