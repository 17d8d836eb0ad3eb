/* NMT slave: every command, addressed and to all. */
#include "unity.h"

#include "canopen/nmt.h"

static nmt_state_t state;

void setUp(void) {
    state = NMT_PRE_OPERATIONAL;
}
void tearDown(void) {}

static nmt_reset_t command(uint8_t specifier, uint8_t node_id) {
    const can_frame_t frame = {.id = 0, .len = 2, .data = {specifier, node_id}};
    return nmt_receive(5, &frame, &state);
}

void test_states(void) {
    TEST_ASSERT_EQUAL_INT(NMT_NO_RESET, command(1, 5));
    TEST_ASSERT_EQUAL_INT(NMT_OPERATIONAL, state);
    TEST_ASSERT_EQUAL_INT(NMT_NO_RESET, command(2, 0));
    TEST_ASSERT_EQUAL_INT(NMT_STOPPED, state);
    TEST_ASSERT_EQUAL_INT(NMT_NO_RESET, command(128, 5));
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, state);
}

void test_resets_leave_the_state_to_the_node(void) {
    TEST_ASSERT_EQUAL_INT(NMT_RESET_NODE, command(129, 0));
    TEST_ASSERT_EQUAL_INT(NMT_RESET_COMMUNICATION, command(130, 5));
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, state);
}

void test_other_nodes_and_unknown_commands(void) {
    TEST_ASSERT_EQUAL_INT(NMT_NO_RESET, command(129, 4));
    (void)command(1, 4);
    (void)command(3, 5);
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, state);
}

void test_wrong_length(void) {
    const can_frame_t frame = {.id = 0, .len = 1, .data = {1}};
    (void)nmt_receive(5, &frame, &state);
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, state);
}
