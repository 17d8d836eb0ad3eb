/* Object dictionary: lookup, every entry written and read back, ranges, reset of the communication
 * area. */
#include "unity.h"

#include <string.h>

#include "od/od_access.h"

static object_dictionary_t od;

void setUp(void) {
    object_dictionary_init(3, &od);
}
void tearDown(void) {}

void test_table_is_ordered(void) {
    for (size_t i = 1; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *before = &object_dictionary_entries[i - 1U];
        const od_entry_t *now = &object_dictionary_entries[i];
        TEST_ASSERT_TRUE(before->index < now->index ||
                         (before->index == now->index && before->subindex < now->subindex));
    }
}

void test_every_entry_is_found(void) {
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *found = NULL;
        const od_entry_t *entry = &object_dictionary_entries[i];
        TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NONE, od_find(entry->index, entry->subindex, &found));
        TEST_ASSERT_EQUAL_PTR(entry, found);
    }
}

void test_unknown_object_and_subindex(void) {
    const od_entry_t *found = NULL;
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_OBJECT, od_find(0x0000, 0, &found));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_OBJECT, od_find(0x1002, 0, &found));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_OBJECT, od_find(0xFFFF, 255, &found));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_SUBINDEX, od_find(OD_DEVICE_TYPE, 1, &found));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_SUBINDEX, od_find(OD_IDENTITY_OBJECT, 5, &found));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NO_SUBINDEX,
                            od_find(OD_RPDO1_COMMUNICATION_PARAMETER, 3, &found));
    TEST_ASSERT_NULL(found);
}

void test_every_number_is_written_and_read_back(void) {
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *entry = &object_dictionary_entries[i];
        if (entry->access == OD_CONST) {
            continue;
        }
        const uint32_t pattern = 0xA5C3961EU + (uint32_t)i;
        const uint32_t mask =
            od_size(entry) == 4U ? UINT32_MAX : (1U << (8U * od_size(entry))) - 1U;
        od_write(entry, pattern, &od);
        TEST_ASSERT_EQUAL_HEX32(pattern & mask, od_read(&od, entry));
    }
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) { /* no two entries share memory */
        const od_entry_t *entry = &object_dictionary_entries[i];
        const uint32_t mask =
            od_size(entry) == 4U ? UINT32_MAX : (1U << (8U * od_size(entry))) - 1U;
        if (entry->access != OD_CONST) {
            TEST_ASSERT_EQUAL_HEX32((0xA5C3961EU + (uint32_t)i) & mask, od_read(&od, entry));
        }
    }
}

void test_defaults_are_in_range(void) {
    for (size_t i = 0; i < OD_ENTRY_COUNT; i++) {
        const od_entry_t *entry = &object_dictionary_entries[i];
        if (entry->type != OD_STRING) {
            TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NONE, od_check_range(entry, od_read(&od, entry)));
        }
    }
}

void test_ranges_of_signed_and_unsigned(void) {
    const od_entry_t *entry = NULL;
    (void)od_find(OD_TARGET_TORQUE, 0, &entry);
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NONE, od_check_range(entry, 0x8001U)); /* -32767 */
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TOO_LOW, od_check_range(entry, 0x8000U));
    (void)od_find(OD_MODES_OF_OPERATION, 0, &entry);
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NONE, od_check_range(entry, 0xFFU)); /* -1 */
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TOO_LOW, od_check_range(entry, 0xFEU));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TOO_HIGH, od_check_range(entry, 11U));
    (void)od_find(OD_MAX_TORQUE, 0, &entry);
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_TOO_HIGH, od_check_range(entry, 32768U));
    (void)od_find(OD_SOFTWARE_POSITION_LIMIT, 1, &entry);
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_NONE, od_check_range(entry, 0x80000000U));
}

void test_values_that_hold_the_node_id(void) {
    TEST_ASSERT_EQUAL_HEX32(0x203, od.rpdo1_communication_parameter_cob_id);
    TEST_ASSERT_EQUAL_HEX32(0x183, od.tpdo1_communication_parameter_cob_id);
    TEST_ASSERT_EQUAL_HEX32(0x583, od.sdo_server_parameter_cob_id_server_to_client);
    TEST_ASSERT_EQUAL_HEX32(0x083, od.cob_id_emcy);
}

void test_string_carries_the_protocol_hash(void) {
    const od_entry_t *entry = NULL;
    (void)od_find(OD_MANUFACTURER_SOFTWARE_VERSION, 0, &entry);
    TEST_ASSERT_EQUAL_UINT(0, od_size(entry));
    TEST_ASSERT_NOT_NULL(strstr(od_read_string(&od, entry), "+" OD_PROTOCOL_HASH_TEXT));
}

void test_pdo_lengths_fit_their_mapping_objects(void) {
    const struct {
        uint16_t index;
        uint32_t length;
    } pdos[] = {{OD_RPDO1_MAPPING_PARAMETER, OD_RPDO1_LENGTH},
                {OD_RPDO2_MAPPING_PARAMETER, OD_RPDO2_LENGTH},
                {OD_RPDO4_MAPPING_PARAMETER, OD_RPDO4_LENGTH},
                {OD_TPDO1_MAPPING_PARAMETER, OD_TPDO1_LENGTH},
                {OD_TPDO2_MAPPING_PARAMETER, OD_TPDO2_LENGTH}};
    for (size_t i = 0; i < sizeof pdos / sizeof pdos[0]; i++) {
        const od_entry_t *entry = NULL;
        (void)od_find(pdos[i].index, 0, &entry);
        const uint32_t count = od_read(&od, entry);
        uint32_t bits = 0;
        for (uint32_t sub = 1; sub <= count; sub++) {
            (void)od_find(pdos[i].index, (uint8_t)sub, &entry);
            const uint32_t mapped = od_read(&od, entry);
            const od_entry_t *target = NULL;
            TEST_ASSERT_EQUAL_HEX32(
                SDO_ABORT_NONE, od_find((uint16_t)(mapped >> 16), (uint8_t)(mapped >> 8), &target));
            TEST_ASSERT_EQUAL_UINT(8U * od_size(target), mapped & 0xFFU);
            bits += mapped & 0xFFU;
        }
        TEST_ASSERT_EQUAL_UINT(8U * pdos[i].length, bits);
    }
}

void test_pdo_packing(void) {
    uint8_t data[8] = {0};
    od.position_actual_value = -2;
    od.torque_actual_value = -300;
    od.statusword = 0x1234;
    object_dictionary_pack_tpdo1(&od, data);
    const uint8_t expected[8] = {0xFE, 0xFF, 0xFF, 0xFF, 0xD4, 0xFE, 0x34, 0x12};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, data, 8);
}

void test_pdo_out_of_range_is_rejected_as_a_whole(void) {
    const uint8_t too_much[8] = {1, 0, 0, 0, 1, 0, 0x00, 0x80};
    const uint8_t lowest[8] = {1, 0, 0, 0, 0x00, 0x80, 1, 0};
    const uint8_t good[8] = {0xFF, 0xFF, 0xFF, 0xFF, 0x01, 0x80, 0xFF, 0x7F};
    TEST_ASSERT_FALSE(object_dictionary_unpack_rpdo1(too_much, &od));
    TEST_ASSERT_FALSE(object_dictionary_unpack_rpdo1(lowest, &od));
    TEST_ASSERT_EQUAL_INT32(0, od.target_position);
    TEST_ASSERT_TRUE(object_dictionary_unpack_rpdo1(good, &od));
    TEST_ASSERT_EQUAL_INT32(-1, od.target_position);
    TEST_ASSERT_EQUAL_INT16(-32767, od.target_torque);
    TEST_ASSERT_EQUAL_UINT16(32767, od.max_torque);
}

void test_copy_of_the_communication_area(void) {
    object_dictionary_t defaults = od;
    od.producer_heartbeat_time = 7;
    od.consumer_heartbeat_time[3] = 9;
    od.fic_q_a_urad = 1234;
    od_copy_communication(&defaults, &od);
    TEST_ASSERT_EQUAL_UINT16(100, od.producer_heartbeat_time);
    TEST_ASSERT_EQUAL_UINT32(0, od.consumer_heartbeat_time[3]);
    TEST_ASSERT_EQUAL_UINT32(1234, od.fic_q_a_urad);
}
