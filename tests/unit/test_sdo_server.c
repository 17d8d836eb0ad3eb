/* SDO server: both ways, expedited and segmented, and every abort it can answer with. */
#include "unity.h"

#include <string.h>

#include "canopen/sdo_server.h"

static object_dictionary_t od;
static sdo_server_t server;
static can_frame_t response;
static sdo_abort_t verdict;

static sdo_abort_t readable(const void *device, const od_entry_t *entry) {
    (void)device;
    return entry->index == OD_PRE_DEFINED_ERROR_FIELD ? SDO_ABORT_NO_DATA : SDO_ABORT_NONE;
}

static sdo_abort_t write_value(void *device, const od_entry_t *entry, uint32_t value) {
    if (verdict == SDO_ABORT_NONE) {
        od_write(entry, value, device);
    }
    return verdict;
}

static const sdo_device_t device_functions = {.readable = readable, .write = write_value};

void setUp(void) {
    object_dictionary_init(2, &od);
    memset(&server, 0, sizeof server);
    memset(&response, 0xEE, sizeof response);
    verdict = SDO_ABORT_NONE;
}
void tearDown(void) {}

static bool request(uint8_t command, uint16_t index, uint8_t subindex, uint32_t value) {
    const sdo_target_t target = {&device_functions, &od, &od};
    const can_frame_t frame = {.id = 0x602,
                               .len = 8,
                               .data = {command, (uint8_t)index, (uint8_t)(index >> 8), subindex,
                                        (uint8_t)value, (uint8_t)(value >> 8),
                                        (uint8_t)(value >> 16), (uint8_t)(value >> 24)}};
    return sdo_server_receive(&target, &frame, &server, &response);
}

static bool segment(uint8_t command, const char *bytes) {
    const sdo_target_t target = {&device_functions, &od, &od};
    can_frame_t frame = {.id = 0x602, .len = 8, .data = {command}};
    memcpy(&frame.data[1], bytes, strlen(bytes));
    return sdo_server_receive(&target, &frame, &server, &response);
}

static uint32_t response_value(void) {
    return (uint32_t)response.data[4] | (uint32_t)response.data[5] << 8 |
           (uint32_t)response.data[6] << 16 | (uint32_t)response.data[7] << 24;
}

static void expect_abort(sdo_abort_t code) {
    TEST_ASSERT_EQUAL_HEX16(0x582, response.id);
    TEST_ASSERT_EQUAL_HEX8(0x80, response.data[0]);
    TEST_ASSERT_EQUAL_HEX32(code, response_value());
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}

void test_expedited_upload_of_each_size(void) {
    TEST_ASSERT_TRUE(request(0x40, 0x1000, 0, 0));
    const uint8_t device_type[8] = {0x43, 0x00, 0x10, 0x00, 0x92, 0x01, 0x02, 0x00};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(device_type, response.data, 8);
    (void)request(0x40, 0x1017, 0, 0);
    TEST_ASSERT_EQUAL_HEX8(0x4B, response.data[0]);
    TEST_ASSERT_EQUAL_UINT32(100, response_value());
    (void)request(0x40, 0x1001, 0, 0);
    TEST_ASSERT_EQUAL_HEX8(0x4F, response.data[0]);
}

void test_expedited_download(void) {
    TEST_ASSERT_TRUE(request(0x2B, 0x1017, 0, 250));
    const uint8_t expected[8] = {0x60, 0x17, 0x10, 0, 0, 0, 0, 0};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, response.data, 8);
    TEST_ASSERT_EQUAL_UINT16(250, od.producer_heartbeat_time);
}

void test_expedited_download_without_size(void) {
    (void)request(0x22, 0x1017, 0, 0xFFFF0123U);
    TEST_ASSERT_EQUAL_HEX8(0x60, response.data[0]);
    TEST_ASSERT_EQUAL_HEX16(0x0123, od.producer_heartbeat_time);
}

void test_download_of_a_wrong_size(void) {
    (void)request(0x23, 0x1017, 0, 1);
    expect_abort(SDO_ABORT_TOO_LONG);
    (void)request(0x2F, 0x1017, 0, 1);
    expect_abort(SDO_ABORT_TOO_SHORT);
    (void)request(0x21, 0x1017, 0, 3);
    expect_abort(SDO_ABORT_TOO_LONG);
    (void)request(0x21, 0x1017, 0, 1);
    expect_abort(SDO_ABORT_TOO_SHORT);
}

void test_access_errors(void) {
    (void)request(0x40, 0x1002, 0, 0);
    expect_abort(SDO_ABORT_NO_OBJECT);
    TEST_ASSERT_EQUAL_HEX8(0x02, response.data[1]);
    TEST_ASSERT_EQUAL_HEX8(0x10, response.data[2]);
    (void)request(0x40, 0x1018, 9, 0);
    expect_abort(SDO_ABORT_NO_SUBINDEX);
    TEST_ASSERT_EQUAL_HEX8(9, response.data[3]);
    (void)request(0x23, 0x1000, 0, 0);
    expect_abort(SDO_ABORT_READ_ONLY);
    (void)request(0x2F, 0x1001, 0, 0);
    expect_abort(SDO_ABORT_READ_ONLY);
    (void)request(0x40, 0x1003, 1, 0);
    expect_abort(SDO_ABORT_NO_DATA);
}

void test_range_errors(void) {
    (void)request(0x2F, 0x2100, 8, 11);
    expect_abort(SDO_ABORT_TOO_HIGH);
    (void)request(0x2F, 0x2100, 8, 0);
    expect_abort(SDO_ABORT_TOO_LOW);
    (void)request(0x2F, 0x6060, 0, 0xFE);
    expect_abort(SDO_ABORT_TOO_LOW);
    (void)request(0x2F, 0x6060, 0, 0xFF);
    TEST_ASSERT_EQUAL_HEX8(0x60, response.data[0]);
    TEST_ASSERT_EQUAL_INT8(-1, od.modes_of_operation);
}

void test_refusal_of_the_device(void) {
    verdict = SDO_ABORT_DEVICE_STATE;
    (void)request(0x2B, 0x1017, 0, 250);
    expect_abort(SDO_ABORT_DEVICE_STATE);
    TEST_ASSERT_EQUAL_UINT16(100, od.producer_heartbeat_time);
}

void test_segmented_upload(void) {
    char text[32] = {0};
    size_t length = 0;
    od.manufacturer_device_name = "FIC motor node, long"; /* 20 bytes: 7 + 7 + 6 */
    TEST_ASSERT_TRUE(request(0x40, 0x1008, 0, 0));
    TEST_ASSERT_EQUAL_HEX8(0x41, response.data[0]);
    TEST_ASSERT_EQUAL_UINT32(20, response_value());
    const uint8_t answers[3] = {0x00, 0x10, 0x03};
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_TRUE(segment(i % 2 == 0 ? 0x60 : 0x70, ""));
        TEST_ASSERT_EQUAL_HEX8(answers[i], response.data[0]);
        const size_t bytes = 7U - ((response.data[0] >> 1) & 7U);
        memcpy(&text[length], &response.data[1], bytes);
        length += bytes;
    }
    TEST_ASSERT_EQUAL_STRING(od.manufacturer_device_name, text);
    (void)segment(0x70, "");
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
}

void test_segmented_upload_of_whole_segments(void) {
    od.manufacturer_device_name = "seven b";
    (void)request(0x40, 0x1008, 0, 0);
    (void)segment(0x60, "");
    TEST_ASSERT_EQUAL_HEX8(0x01, response.data[0]);
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}

void test_segmented_download(void) {
    TEST_ASSERT_TRUE(request(0x21, 0x1006, 0, 4));
    TEST_ASSERT_EQUAL_HEX8(0x60, response.data[0]);
    TEST_ASSERT_TRUE(segment(0x00 | (5 << 1), "\x10\x27")); /* 2 bytes */
    TEST_ASSERT_EQUAL_HEX8(0x20, response.data[0]);
    TEST_ASSERT_EQUAL_UINT32(0, od.communication_cycle_period);
    TEST_ASSERT_TRUE(segment(0x10 | (5 << 1) | 1, "")); /* 2 more, both 0 */
    TEST_ASSERT_EQUAL_HEX8(0x30, response.data[0]);
    TEST_ASSERT_EQUAL_UINT32(10000, od.communication_cycle_period);
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}

void test_segmented_download_without_size(void) {
    (void)request(0x20, 0x1017, 0, 0);
    (void)segment(0x00 | (5 << 1) | 1, "\x2C\x01");
    TEST_ASSERT_EQUAL_HEX8(0x20, response.data[0]);
    TEST_ASSERT_EQUAL_UINT16(300, od.producer_heartbeat_time);
}

void test_segmented_download_of_a_wrong_size(void) {
    (void)request(0x20, 0x1017, 0, 0);
    (void)segment(0x01, "1234567");
    expect_abort(SDO_ABORT_TOO_LONG);
    (void)request(0x20, 0x1017, 0, 0);
    (void)segment(0x00 | (6 << 1) | 1, "1");
    expect_abort(SDO_ABORT_TOO_SHORT);
    (void)request(0x20, 0x2100, 8, 0);
    (void)segment(0x00 | (6 << 1) | 1, "\x63");
    expect_abort(SDO_ABORT_TOO_HIGH);
}

void test_toggle_bit(void) {
    (void)request(0x40, 0x1008, 0, 0);
    (void)segment(0x70, "");
    expect_abort(SDO_ABORT_TOGGLE_BIT);
    (void)request(0x21, 0x1006, 0, 4);
    (void)segment(0x00 | (5 << 1), "\x10\x27");
    (void)segment(0x00 | (5 << 1) | 1, "");
    expect_abort(SDO_ABORT_TOGGLE_BIT);
    TEST_ASSERT_EQUAL_UINT32(0, od.communication_cycle_period);
}

void test_segment_without_a_transfer(void) {
    (void)segment(0x60, "");
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
    (void)segment(0x00, "");
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
    (void)request(0x40, 0x1008, 0, 0);
    (void)segment(0x00, "");
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
}

void test_block_transfer_is_refused(void) {
    (void)request(0xA0, 0x1008, 0, 0);
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
    (void)request(0xC0, 0x1008, 0, 0);
    expect_abort(SDO_ABORT_COMMAND_SPECIFIER);
}

void test_abort_from_the_client_has_no_answer(void) {
    (void)request(0x40, 0x1008, 0, 0);
    TEST_ASSERT_FALSE(request(0x80, 0x1008, 0, SDO_ABORT_TIMEOUT));
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}

void test_new_request_replaces_a_transfer(void) {
    (void)request(0x40, 0x1008, 0, 0);
    (void)request(0x40, 0x1000, 0, 0);
    TEST_ASSERT_EQUAL_HEX8(0x43, response.data[0]);
    TEST_ASSERT_EQUAL_INT(SDO_IDLE, server.state);
}

void test_timeout_in_node_time(void) {
    (void)request(0x40, 0x1008, 0, 0);
    TEST_ASSERT_FALSE(sdo_server_elapse(&od, SDO_TIMEOUT_us - 1U, &server, &response));
    (void)segment(0x60, "");
    TEST_ASSERT_FALSE(sdo_server_elapse(&od, SDO_TIMEOUT_us - 1U, &server, &response));
    TEST_ASSERT_TRUE(sdo_server_elapse(&od, 1, &server, &response));
    expect_abort(SDO_ABORT_TIMEOUT);
    TEST_ASSERT_EQUAL_HEX8(0x08, response.data[1]);
    TEST_ASSERT_FALSE(sdo_server_elapse(&od, UINT32_MAX, &server, &response));
}

void test_short_request_is_ignored(void) {
    const sdo_target_t target = {&device_functions, &od, &od};
    const can_frame_t frame = {.id = 0x602, .len = 4, .data = {0x40, 0x00, 0x10, 0x00}};
    TEST_ASSERT_FALSE(sdo_server_receive(&target, &frame, &server, &response));
}
