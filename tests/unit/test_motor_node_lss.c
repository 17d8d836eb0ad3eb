/* A node without a node-id, and what it keeps over power loss. */
#include "unity.h"

#include "fake_memory.h"
#include "node_rig.h"

static fake_memory_t fake;
static parameter_memory_t memory;

void setUp(void) {
    memory = fake_memory(&fake);
    rig_init();
    rig.config.memory = &memory;
    motor_node_init(&rig.config, &rig.node);
}
void tearDown(void) {}

static void power_on(uint8_t node_id) {
    rig.config.node_id = node_id;
    motor_node_init(&rig.config, &rig.node);
}

static void lss(uint8_t command, uint8_t value) {
    const uint8_t data[8] = {command, value};
    rig_send(0x7E5, 8, data);
    rig_step();
}

static void expect_lss(uint8_t command, uint8_t value) {
    const can_frame_t *frame = rig_sent(0x7E4);
    TEST_ASSERT_NOT_NULL(frame);
    TEST_ASSERT_EQUAL_HEX8(command, frame->data[0]);
    TEST_ASSERT_EQUAL_UINT8(value, frame->data[1]);
}

void test_without_a_node_id_there_is_nothing_but_lss(void) {
    const uint8_t overspeed[8] = {0x00, 0x84, 0x21};
    power_on(LSS_UNCONFIGURED);
    for (int i = 0; i < 300; i++) {
        rig_nmt(1);
        rig_read(0x1000, 0);
        rig_sync();
        rig_send(0x0FF, 8, overspeed); /* 080h + 255 would be no identifier */
        rig_step();
        TEST_ASSERT_EQUAL_UINT(0, rig.output.frame_count);
        TEST_ASSERT_FALSE(rig.output.output_enabled);
    }
    lss(0x4C, 0);
    expect_lss(0x50, 0);
}

void test_a_node_id_by_lss_acts_at_once_on_an_unconfigured_node(void) {
    power_on(LSS_UNCONFIGURED);
    lss(0x04, 1);
    lss(0x11, 9);
    expect_lss(0x11, 0);
    lss(0x04, 0);
    TEST_ASSERT_EQUAL_UINT8(9, rig.node.node_id);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x709, rig.output.frames[0].id);
    TEST_ASSERT_EQUAL_HEX32(0x189, rig.node.od.tpdo1_communication_parameter_cob_id);
}

void test_a_configured_node_changes_at_reset_communication(void) {
    rig_step();
    lss(0x04, 1);
    lss(0x5E, 0);
    expect_lss(0x5E, 2);
    lss(0x11, 77);
    lss(0x04, 0);
    rig_read(0x1000, 0);
    rig_step();
    TEST_ASSERT_NOT_NULL(rig_sent(0x582));
    rig_nmt(130);
    rig_step();
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x700 + 77, rig.output.frames[0].id);
    TEST_ASSERT_EQUAL_UINT8(77, rig.node.node_id);
    power_on(2); /* not stored */
    TEST_ASSERT_EQUAL_UINT8(2, rig.node.node_id);
}

void test_a_stored_node_id_is_there_at_power_on(void) {
    power_on(LSS_UNCONFIGURED);
    lss(0x04, 1);
    lss(0x11, 9);
    lss(0x17, 0);
    expect_lss(0x17, 0);
    power_on(LSS_UNCONFIGURED);
    TEST_ASSERT_EQUAL_UINT8(9, rig.node.node_id);
}

void test_store_without_a_memory_or_with_a_broken_one_fails(void) {
    rig_step();
    lss(0x04, 1);
    lss(0x11, 9);
    fake.budget = 0;
    lss(0x17, 0);
    expect_lss(0x17, 2);
    rig.config.memory = NULL;
    power_on(2);
    lss(0x04, 1);
    lss(0x17, 0);
    expect_lss(0x17, 2);
}

void test_no_lss_in_operational(void) {
    rig_start();
    lss(0x04, 1);
    lss(0x5E, 0);
    TEST_ASSERT_NULL(rig_sent(0x7E4));
}

static void expect_abort(uint32_t code, uint16_t index, uint32_t value) {
    rig_write(index, 1, 4, value);
    rig_step();
    TEST_ASSERT_EQUAL_HEX32(code, rig_abort());
}

void test_saved_parameters_outlive_power_loss_until_defaults_are_restored(void) {
    rig_step();
    rig_write(0x1017, 0, 2, 55);
    rig_write(0x2100, 4, 2, 1234);
    rig_step();
    expect_abort(SDO_ABORT_NOT_STORED, 0x1010, 0x65766174);
    expect_abort(0, 0x1010, 0x65766173);
    rig_read(0x1010, 1);
    rig_step();
    TEST_ASSERT_EQUAL_UINT32(1, rig_u32(&rig_sent(0x582)->data[4]));
    rig_write(0x1017, 0, 2, 66);
    rig_step();
    power_on(2);
    TEST_ASSERT_EQUAL_UINT16(55, rig.node.od.producer_heartbeat_time);
    TEST_ASSERT_EQUAL_UINT16(1234, rig.node.od.fic_torque_limit_mNm);
    rig_nmt(130);
    rig_step();
    TEST_ASSERT_EQUAL_UINT16(55, rig.node.od.producer_heartbeat_time);
    expect_abort(0, 0x1011, 0x64616F6C);
    TEST_ASSERT_EQUAL_UINT16(55, rig.node.od.producer_heartbeat_time); /* until the reset */
    power_on(2);
    TEST_ASSERT_EQUAL_UINT16(100, rig.node.od.producer_heartbeat_time);
    TEST_ASSERT_EQUAL_UINT16(5000, rig.node.od.fic_torque_limit_mNm);
}

void test_parameters_are_not_saved_under_a_working_controller(void) {
    rig_run();
    expect_abort(SDO_ABORT_DEVICE_STATE, 0x1010, 0x65766173);
    expect_abort(SDO_ABORT_DEVICE_STATE, 0x1011, 0x64616F6C);
}

void test_a_broken_memory_is_told(void) {
    rig_step();
    fake.budget = 100;
    expect_abort(SDO_ABORT_HARDWARE, 0x1010, 0x65766173);
}

void test_nothing_is_stored_under_torque(void) {
    rig_run();
    rig_nmt(0x80); /* the bound ramps down, LSS is there already */
    rig_step();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
    lss(0x04, 1);
    lss(0x17, 0);
    expect_lss(0x17, 2);
    for (int i = 0; i < 500; i++) {
        rig_step();
    }
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    lss(0x17, 0);
    expect_lss(0x17, 0);
}
