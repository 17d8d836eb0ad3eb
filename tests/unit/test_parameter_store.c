/* Parameters over power loss: old set or new set, never a mixture, at every byte. */
#include "unity.h"

#include "fake_memory.h"
#include "od/od_access.h"

static fake_memory_t fake;
static parameter_memory_t memory;
static object_dictionary_t od;
static object_dictionary_t loaded;
static uint8_t node_id;

void setUp(void) {
    memory = fake_memory(&fake);
    object_dictionary_init(2, &od);
    object_dictionary_init(2, &loaded);
    node_id = 0;
}
void tearDown(void) {}

static void set(uint16_t number) {
    od.producer_heartbeat_time = number;
    od.fic_torque_limit_mNm = number;
    od.home_offset = -(int32_t)number;
    od.homing_method = 37;
}

static bool save(uint16_t number) {
    set(number);
    return parameter_store_save(&memory, PARAMETER_STORE_VALUES, &od, (uint8_t)number);
}

/* What is stored, all of one set; 0 = nothing is. */
static uint16_t load(void) {
    object_dictionary_init(2, &loaded);
    if (!parameter_store_load(&memory, &loaded, &node_id)) {
        return 0;
    }
    const uint16_t number = loaded.producer_heartbeat_time;
    TEST_ASSERT_EQUAL_UINT16(number, loaded.fic_torque_limit_mNm);
    TEST_ASSERT_EQUAL_INT32(-(int32_t)number, loaded.home_offset);
    TEST_ASSERT_EQUAL_UINT8(number, node_id);
    return number;
}

void test_nothing_is_stored_at_first(void) {
    TEST_ASSERT_EQUAL_UINT16(0, load());
    memset(fake.bytes, 0, sizeof fake.bytes);
    TEST_ASSERT_EQUAL_UINT16(0, load());
}

void test_newest_set_is_loaded(void) {
    for (uint16_t number = 1; number < 8U; number++) {
        TEST_ASSERT_TRUE(save(number));
        TEST_ASSERT_EQUAL_UINT16(number, load());
    }
    TEST_ASSERT_FALSE(fake.written_twice);
}

void test_every_stored_value_comes_back(void) {
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *entry = &object_dictionary_entries[i];
        if (parameter_store_has(entry)) {
            od_write(entry, entry->max, &od);
        }
    }
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_VALUES, &od, 5));
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_MEMORY(&od, &loaded, sizeof od);
}

void test_state_and_commands_are_not_stored(void) {
    od.controlword = 0x0F;
    od.modes_of_operation = 10;
    od.target_torque = 3;
    od.sensor_source = 1;
    od.time_base = 1;
    od.error_register = 1;
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_VALUES, &od, 5));
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_HEX16(0, loaded.controlword);
    TEST_ASSERT_EQUAL_INT8(0, loaded.modes_of_operation);
    TEST_ASSERT_EQUAL_INT16(0, loaded.target_torque);
    TEST_ASSERT_EQUAL_UINT8(0, loaded.sensor_source);
    TEST_ASSERT_EQUAL_UINT8(0, loaded.time_base);
    TEST_ASSERT_EQUAL_HEX8(0, loaded.error_register);
}

void test_power_loss_at_every_byte_leaves_the_old_or_the_new_set(void) {
    static fake_memory_t before;
    size_t cuts = 0;
    int new_sets = 0;
    TEST_ASSERT_TRUE(save(1));
    TEST_ASSERT_TRUE(save(2));
    before = fake;
    for (bool whole = false; !whole; cuts++) {
        fake = before;
        fake.budget = cuts;
        whole = save(3);
        const uint16_t number = load();
        TEST_ASSERT_TRUE(number == 2U || number == 3U);
        TEST_ASSERT_TRUE(!whole || number == 3U);
        new_sets += number == 3U ? 1 : 0;
        fake.budget = SIZE_MAX; /* and the next save is none the worse for it */
        TEST_ASSERT_TRUE(save(4));
        TEST_ASSERT_EQUAL_UINT16(4, load());
    }
    TEST_ASSERT_TRUE(cuts > PARAMETER_STORE_COPY_BYTES + 300U);
    TEST_ASSERT_EQUAL_INT(1, new_sets);
}

void test_power_loss_at_every_byte_of_the_first_save(void) {
    size_t cuts = 0;
    for (bool whole = false; !whole; cuts++) {
        memory = fake_memory(&fake);
        fake.budget = cuts;
        whole = save(1);
        TEST_ASSERT_EQUAL_UINT16(whole ? 1 : 0, load());
    }
}

void test_a_flipped_bit_anywhere_falls_back_to_the_other_copy(void) {
    TEST_ASSERT_TRUE(save(1)); /* into the first copy */
    TEST_ASSERT_TRUE(save(2));
    for (size_t i = 0; fake.bytes[1][i] != 0xFFU || i < 300U; i++) {
        for (int bit = 0; bit < 8; bit++) {
            fake.bytes[1][i] ^= (uint8_t)(1 << bit);
            TEST_ASSERT_EQUAL_UINT16(1, load());
            fake.bytes[1][i] ^= (uint8_t)(1 << bit);
        }
    }
    TEST_ASSERT_EQUAL_UINT16(2, load());
}

void test_sequence_number_wraps(void) {
    TEST_ASSERT_TRUE(save(1));
    TEST_ASSERT_TRUE(save(2));
    for (int i = 0; i < 2; i++) { /* as after 2^32 - 2 saves: both copies made anew by hand */
        fake.bytes[i][4] = (uint8_t)(0xFE + i);
        memset(&fake.bytes[i][5], 0xFF, 3);
        const size_t end = 12U + 8U * fake.bytes[i][8];
        uint32_t crc = UINT32_MAX;
        for (size_t at = 0; at < end; at++) {
            crc ^= fake.bytes[i][at];
            for (int bit = 0; bit < 8; bit++) {
                crc = (crc >> 1) ^ ((crc & 1U) != 0U ? 0xEDB88320U : 0U);
            }
        }
        crc = ~crc;
        for (size_t byte = 0; byte < 4U; byte++) {
            fake.bytes[i][end + byte] = (uint8_t)(crc >> (8U * byte));
        }
    }
    TEST_ASSERT_EQUAL_UINT16(2, load());
    TEST_ASSERT_TRUE(save(3)); /* sequence 0 */
    TEST_ASSERT_EQUAL_UINT16(3, load());
    TEST_ASSERT_TRUE(save(4));
    TEST_ASSERT_EQUAL_UINT16(4, load());
}

void test_defaults_keep_the_node_id(void) {
    TEST_ASSERT_TRUE(save(7));
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_DEFAULTS, &od, 7));
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_UINT8(7, node_id);
    TEST_ASSERT_EQUAL_UINT16(100, loaded.producer_heartbeat_time);
}

void test_a_new_node_id_keeps_the_values(void) {
    TEST_ASSERT_TRUE(save(7));
    set(9);
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_KEPT, &od, 33));
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_UINT8(33, node_id);
    TEST_ASSERT_EQUAL_UINT16(7, loaded.producer_heartbeat_time);
    memory = fake_memory(&fake); /* nothing to keep */
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_KEPT, &od, 34));
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_UINT8(34, node_id);
}

/* Changes one record of the only copy and mends its CRC. */
static void forge(size_t record, const uint8_t data[8]) {
    memcpy(&fake.bytes[0][12U + 8U * record], data, 8);
    const size_t end = 12U + 8U * fake.bytes[0][8];
    uint32_t crc = UINT32_MAX;
    for (size_t at = 0; at < end; at++) {
        crc ^= fake.bytes[0][at];
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ ((crc & 1U) != 0U ? 0xEDB88320U : 0U);
        }
    }
    crc = ~crc;
    for (size_t byte = 0; byte < 4U; byte++) {
        fake.bytes[0][end + byte] = (uint8_t)(crc >> (8U * byte));
    }
}

void test_what_this_firmware_does_not_have_is_skipped(void) {
    const uint8_t unknown[8] = {0x99, 0x2E, 1, 0, 1, 0, 0, 0};
    const uint8_t state[8] = {0x01, 0x10, 0, 0, 1, 0, 0, 0}; /* 1001h */
    const uint8_t too_high[8] = {0x19, 0x10, 0, 0, 0xFF, 0, 0, 0};
    TEST_ASSERT_TRUE(save(7));
    forge(0, unknown);
    forge(1, state);
    forge(2, too_high);
    TEST_ASSERT_EQUAL_UINT16(7, load());
    TEST_ASSERT_EQUAL_HEX8(0, loaded.error_register);
    TEST_ASSERT_EQUAL_UINT8(0, loaded.synchronous_counter_overflow_value);
}

void test_a_count_beyond_the_copy_is_no_set(void) {
    TEST_ASSERT_TRUE(save(7));
    fake.bytes[0][9] = 0x7F;
    TEST_ASSERT_EQUAL_UINT16(0, load());
}

void test_memory_that_fails(void) {
    TEST_ASSERT_TRUE(save(7));
    fake.unreadable = true;
    TEST_ASSERT_EQUAL_UINT16(0, load());
    fake.unreadable = false;
    fake.budget = 0;
    TEST_ASSERT_FALSE(save(8));
    fake.budget = SIZE_MAX;
    TEST_ASSERT_EQUAL_UINT16(7, load());
}

void test_damaged_is_what_is_neither_whole_nor_blank(void) {
    TEST_ASSERT_FALSE(parameter_store_damaged(&memory)); /* erased */
    memset(fake.bytes, 0, sizeof fake.bytes);
    TEST_ASSERT_FALSE(parameter_store_damaged(&memory)); /* an emulator's empty flash */
    memset(fake.bytes, 0xFF, sizeof fake.bytes);
    TEST_ASSERT_TRUE(save(7));
    TEST_ASSERT_FALSE(parameter_store_damaged(&memory));
    fake.bytes[0][20] ^= 1U;
    TEST_ASSERT_TRUE(parameter_store_damaged(&memory));
    TEST_ASSERT_TRUE(save(8)); /* into copy 0: nothing is lost any more */
    TEST_ASSERT_FALSE(parameter_store_damaged(&memory));
    fake.bytes[1][0] = 0x55;
    TEST_ASSERT_FALSE(parameter_store_damaged(&memory)); /* one copy is whole */
}

void test_the_serial_number_outlives_every_kind_of_save(void) {
    static const parameter_source_t sources[] = {PARAMETER_STORE_VALUES, PARAMETER_STORE_KEPT,
                                                 PARAMETER_STORE_DEFAULTS};
    od.identity_object_serial_number = 0xCAFE1234U;
    for (size_t i = 0; i < sizeof sources / sizeof sources[0]; i++) {
        set(7);
        TEST_ASSERT_TRUE(parameter_store_save(&memory, sources[i], &od, 7));
        object_dictionary_init(2, &loaded);
        TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
        TEST_ASSERT_EQUAL_HEX32(0xCAFE1234U, loaded.identity_object_serial_number);
    }
    TEST_ASSERT_NOT_EQUAL(7, loaded.producer_heartbeat_time); /* the last kind: defaults */
}
