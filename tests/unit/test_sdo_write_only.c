/*
 * SDO server with an object that may be written but not read, which the motor node itself does not
 * have: this test brings an object dictionary of its own.
 */
#include "unity.h"

#include "canopen/sdo_server.h"

#define INDEX 0x2000U

const od_entry_t object_dictionary_entries[OD_ENTRY_COUNT] = {
    [OD_ENTRY_COUNT - 1U] = {.index = INDEX,
                             .type = OD_U32,
                             .access = OD_WO,
                             .offset = offsetof(object_dictionary_t, cob_id_sync_message),
                             .max = UINT32_MAX}};

static object_dictionary_t od;
static sdo_server_t server;
static can_frame_t response;

static sdo_abort_t readable(const void *device, const od_entry_t *entry) {
    (void)device;
    (void)entry;
    return SDO_ABORT_NONE;
}

static sdo_abort_t write_value(void *device, const od_entry_t *entry, uint32_t value) {
    od_write(entry, value, device);
    return SDO_ABORT_NONE;
}

static const sdo_device_t device_functions = {.readable = readable, .write = write_value};

static void request(uint8_t command, uint8_t value) {
    const sdo_target_t target = {&device_functions, &od, &od};
    const can_frame_t frame = {
        .id = 0x602, .len = 8, .data = {command, INDEX & 0xFFU, INDEX >> 8, 0, value}};
    TEST_ASSERT_TRUE(sdo_server_receive(&target, &frame, &server, &response));
}

void setUp(void) {
    const sdo_server_t idle = {0};
    server = idle;
}
void tearDown(void) {}

void test_write_only_object_is_written(void) {
    request(0x23, 77);
    TEST_ASSERT_EQUAL_HEX8(0x60, response.data[0]);
    TEST_ASSERT_EQUAL_UINT32(77, od.cob_id_sync_message);
}

void test_write_only_object_is_not_read(void) {
    const uint8_t abort_write_only[8] = {0x80, 0x00, 0x20, 0x00, 0x01, 0x00, 0x01, 0x06};
    request(0x40, 0);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(abort_write_only, response.data, 8);
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}
