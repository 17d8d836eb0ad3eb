/* LSS slave: switch, inquire, configure, store, fastscan (CiA 305). */
#include "unity.h"

#include <string.h>

#include "canopen/lss.h"

static const uint32_t identity[LSS_IDENTITY_PARTS] = {0, 0x46494301, 0x00010000, 0x80000007};
static lss_t lss;
static can_frame_t response;
static uint8_t node_id;

void setUp(void) {
    node_id = LSS_UNCONFIGURED;
    lss_init(node_id, &lss);
}
void tearDown(void) {}

static lss_action_t request(uint8_t command, uint32_t number, uint8_t bit, uint8_t part,
                            uint8_t next) {
    const can_frame_t frame = {.id = 0x7E5,
                               .len = 8,
                               .data = {command, (uint8_t)number, (uint8_t)(number >> 8),
                                        (uint8_t)(number >> 16), (uint8_t)(number >> 24), bit, part,
                                        next}};
    memset(&response, 0xEE, sizeof response);
    return lss_receive(identity, node_id, &frame, &lss, &response);
}

static lss_action_t simple(uint8_t command, uint32_t number) {
    return request(command, number, 0, 0, 0);
}

static void expect_answer(uint8_t command, uint32_t value, lss_action_t action) {
    const uint8_t expected[8] = {command, (uint8_t)value, (uint8_t)(value >> 8),
                                 (uint8_t)(value >> 16), (uint8_t)(value >> 24)};
    TEST_ASSERT_EQUAL_INT(LSS_ANSWER, action);
    TEST_ASSERT_EQUAL_HEX16(0x7E4, response.id);
    TEST_ASSERT_EQUAL_UINT8(8, response.len);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected, response.data, 8);
}

void test_waiting_answers_no_inquiry(void) {
    const uint8_t commands[] = {0x11, 0x13, 0x17, 0x5A, 0x5E};
    for (size_t i = 0; i < sizeof commands; i++) {
        TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(commands[i], 5));
    }
}

void test_inquiries(void) {
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 1));
    for (uint8_t part = 0; part < 4U; part++) {
        expect_answer((uint8_t)(0x5A + part), identity[part], simple((uint8_t)(0x5A + part), 0));
    }
    node_id = 12;
    expect_answer(0x5E, 12, simple(0x5E, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x5F, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x5E, 0));
}

void test_configure_node_id(void) {
    (void)simple(0x04, 1);
    expect_answer(0x11, 0, simple(0x11, 1));
    expect_answer(0x11, 0, simple(0x11, 127));
    TEST_ASSERT_EQUAL_UINT8(127, lss.pending_node_id);
    expect_answer(0x11, 1, simple(0x11, 0));
    expect_answer(0x11, 1, simple(0x11, 128));
    expect_answer(0x11, 1, simple(0x11, 254));
    TEST_ASSERT_EQUAL_UINT8(127, lss.pending_node_id);
    expect_answer(0x11, 0, simple(0x11, 255));
}

void test_one_bit_timing(void) {
    (void)simple(0x04, 1);
    expect_answer(0x13, 0, simple(0x13, 0x0000));
    expect_answer(0x13, 1, simple(0x13, 0x0100)); /* 800 kbit/s */
    expect_answer(0x13, 1, simple(0x13, 0x0001)); /* another table */
}

void test_store(void) {
    (void)simple(0x04, 1);
    TEST_ASSERT_EQUAL_INT(LSS_STORE, simple(0x17, 0));
    response = lss_store_response(true);
    expect_answer(0x17, 0, LSS_ANSWER);
    response = lss_store_response(false);
    expect_answer(0x17, 2, LSS_ANSWER);
}

void test_an_unconfigured_node_begins_when_it_leaves_configuration(void) {
    (void)simple(0x04, 1);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 0)); /* still without a node-id */
    (void)simple(0x04, 1);
    (void)simple(0x11, 9);
    TEST_ASSERT_EQUAL_INT(LSS_ACTIVATE, simple(0x04, 0));
    node_id = 9;
    (void)simple(0x04, 1);
    (void)simple(0x11, 10);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 0)); /* waits for reset communication */
}

void test_switch_mode_selective(void) {
    for (uint8_t part = 0; part < 3U; part++) {
        TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple((uint8_t)(0x40 + part), identity[part]));
    }
    TEST_ASSERT_FALSE(lss.configuring);
    expect_answer(0x44, 0, simple(0x43, identity[3]));
    TEST_ASSERT_TRUE(lss.configuring);
}

void test_selective_switch_of_another_node(void) {
    for (uint8_t wrong = 0; wrong < 4U; wrong++) {
        for (uint8_t part = 0; part < 4U; part++) {
            const uint32_t number = identity[part] + (part == wrong ? 1U : 0U);
            TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple((uint8_t)(0x40 + part), number));
        }
        TEST_ASSERT_FALSE(lss.configuring);
    }
    (void)simple(0x41, identity[1]); /* out of order */
    (void)simple(0x40, identity[0]);
    (void)simple(0x42, identity[2]);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x43, identity[3]));
}

/* The master's side, as CiA 305 describes it; finds the lowest identity bit by bit. */
static void scan(uint32_t found[4]) {
    expect_answer(0x4F, 0, request(0x51, 0, 0x80, 0, 0));
    for (uint8_t part = 0; part < 4U; part++) {
        found[part] = 0;
        for (uint8_t bit = 32; bit-- > 0U;) {
            if (request(0x51, found[part], bit, part, part) != LSS_ANSWER) {
                found[part] |= (uint32_t)1U << bit;
            }
        }
        expect_answer(0x4F, 0, request(0x51, found[part], 0, part, (uint8_t)((part + 1U) % 4U)));
    }
}

void test_fastscan_finds_the_identity(void) {
    uint32_t found[4];
    scan(found);
    TEST_ASSERT_EQUAL_HEX32_ARRAY(identity, found, 4);
    TEST_ASSERT_TRUE(lss.configuring);
}

void test_fastscan_of_nonsense_is_silent(void) {
    (void)request(0x51, 0, 0x80, 0, 0);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, request(0x51, 0, 32, 0, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, request(0x51, 0, 31, 4, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, request(0x51, 0, 31, 0, 4));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, request(0x51, 0, 31, 1, 1)); /* not this part's turn */
}

void test_configured_nodes_are_not_scanned(void) {
    node_id = 5;
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, request(0x51, 0, 0x80, 0, 0));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x4C, 0));
    node_id = LSS_UNCONFIGURED;
    expect_answer(0x50, 0, simple(0x4C, 0));
}

void test_frames_of_other_lengths_and_commands_are_passed_over(void) {
    const can_frame_t shorter = {.id = 0x7E5, .len = 7, .data = {0x04, 1}};
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, lss_receive(identity, 255, &shorter, &lss, &response));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 2));
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x00, 0));
    TEST_ASSERT_FALSE(lss.configuring);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 0)); /* waits already */
    (void)simple(0x04, 1);
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x04, 1)); /* configures already */
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x59, 0)); /* beside the inquiries */
    TEST_ASSERT_EQUAL_INT(LSS_SILENT, simple(0x5F, 0));
    TEST_ASSERT_TRUE(lss.configuring);
}
