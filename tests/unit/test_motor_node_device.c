/* What the port tells a node about the device that it runs on: serial number, version, the reset
 * before, a damaged image or parameter memory, sensors and time base over a node reset. */
#include "unity.h"

#include "fake_memory.h"
#include "node_rig.h"

static fake_memory_t fake;
static parameter_memory_t memory;

void setUp(void) {
    memory = fake_memory(&fake);
    rig_init();
    rig.config.memory = &memory;
}
void tearDown(void) {}

static void power_on(void) {
    motor_node_init(&rig.config, &rig.node);
}

static void store(uint8_t node_id, uint32_t serial_number) {
    object_dictionary_t od;
    object_dictionary_init(node_id, &od);
    od.identity_object_serial_number = serial_number;
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_VALUES, &od, node_id));
}

void test_stored_serial_number_stands_in_for_a_missing_one(void) {
    store(NODE_ID, 1003);
    power_on();
    TEST_ASSERT_EQUAL_HEX32(0x12345678, rig.node.od.identity_object_serial_number);
    rig.config.serial_number = 0;
    power_on();
    TEST_ASSERT_EQUAL_UINT32(1003, rig.node.od.identity_object_serial_number);
}

void test_a_switch_goes_before_the_stored_node_id(void) {
    store(9, 1);
    power_on();
    TEST_ASSERT_EQUAL_UINT8(9, rig.node.node_id);
    rig.config.node_id_by_switch = true;
    power_on();
    TEST_ASSERT_EQUAL_UINT8(NODE_ID, rig.node.node_id);
}

void test_version_text_of_the_image(void) {
    power_on();
    TEST_ASSERT_EQUAL_STRING(OD_SOFTWARE_VERSION "+" OD_PROTOCOL_HASH_TEXT,
                             rig.node.od.manufacturer_software_version);
    rig.config.software_version = "0.1.0+12345678 gabc float 1A2B3C4D";
    power_on();
    rig_nmt(130); /* reset communication */
    rig_step();
    TEST_ASSERT_EQUAL_STRING("0.1.0+12345678 gabc float 1A2B3C4D",
                             rig.node.od.manufacturer_software_version);
}

void test_crash_record_is_told_once_and_read_again_and_again(void) {
    static const crash_record_t crash = {.cause = CRASH_STACK_OVERFLOW,
                                         .program_counter = 0x08001234,
                                         .link_register = 0x08005679,
                                         .program_status = 0x61000000,
                                         .fault_status = 0x92,
                                         .hard_fault_status = 0x40000000,
                                         .fault_address = 0x2000001C,
                                         .count = 3};
    rig.config.supervisor_reset = true;
    rig.config.crash = &crash;
    power_on();
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x6010, rig_emergency());
    const can_frame_t *frame = rig_sent(0x080 + NODE_ID);
    TEST_ASSERT_EQUAL_UINT8(CRASH_STACK_OVERFLOW, frame->data[3]);
    TEST_ASSERT_EQUAL_HEX32(0x08001234, rig_u32(&frame->data[4]));
    motor_node_restart(&rig.config, &rig.node);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
    const object_dictionary_t *od = &rig.node.od;
    TEST_ASSERT_EQUAL_UINT8(5, od->crash_record_cause);
    TEST_ASSERT_EQUAL_HEX32(0x08001234, od->crash_record_program_counter);
    TEST_ASSERT_EQUAL_HEX32(0x08005679, od->crash_record_link_register);
    TEST_ASSERT_EQUAL_HEX32(0x61000000, od->crash_record_program_status);
    TEST_ASSERT_EQUAL_HEX32(0x92, od->crash_record_fault_status);
    TEST_ASSERT_EQUAL_HEX32(0x40000000, od->crash_record_hard_fault_status);
    TEST_ASSERT_EQUAL_HEX32(0x2000001C, od->crash_record_fault_address);
    TEST_ASSERT_EQUAL_UINT16(3, od->crash_record_resets);
}

void test_a_damaged_image_never_enables(void) {
    rig.config.image_damaged = true;
    power_on();
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x6010, rig_emergency());
    TEST_ASSERT_EQUAL_UINT8(CRASH_IMAGE, rig_sent(0x080 + NODE_ID)->data[3]);
    rig_start();
    rig_enable();
    TEST_ASSERT_FALSE(rig.output.output_enabled);
    TEST_ASSERT_TRUE((rig.node.od.limit_reasons & LIMIT_REASON_IMAGE) != 0U);
    rig.config.image_damaged = false;
    power_on();
    rig_start();
    rig_enable();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_lost_parameters_are_told(void) {
    store(9, 1);
    fake.bytes[0][30] ^= 0x10U;
    power_on();
    TEST_ASSERT_EQUAL_UINT8(NODE_ID, rig.node.node_id);
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x5530, rig_emergency());
}

void test_injected_sensors_are_a_reference_and_the_encoder_is_none_after_them(void) {
    rig.config.referenced = false;
    power_on();
    rig_write(0x2F00, 0, 1, 1);
    rig_step();
    TEST_ASSERT_TRUE(rig.node.referenced);
    motor_node_restart(&rig.config, &rig.node);
    TEST_ASSERT_TRUE(rig.node.referenced);
    rig_write(0x2F00, 0, 1, 0);
    rig_step();
    TEST_ASSERT_FALSE(rig.node.referenced);
}

void test_an_absolute_encoder_is_a_reference_after_injected_sensors_too(void) {
    power_on();
    for (uint32_t source = 2; source-- > 0U;) {
        rig_write(0x2F00, 0, 1, source);
        rig_step();
        TEST_ASSERT_TRUE(rig.node.referenced);
    }
}

void test_injected_sensors_replace_the_current_too(void) {
    power_on();
    rig.input.current_mA = UINT32_MAX; /* a broken wire */
    rig_step();
    TEST_ASSERT_TRUE(rig.node.mean_square_mA2 != 0U);
    rig_write(0x2F00, 0, 1, 1);
    rig_inject(5000, 1, 0);
    rig_step();
    TEST_ASSERT_TRUE(rig.node.mean_square_mA2 == 0U);
    TEST_ASSERT_EQUAL_INT16(0, rig.node.od.current_actual_value);
    rig_nmt(1);
    rig_step();
    for (uint8_t tick = 0; tick < 3U; tick++) {
        rig_inject(5000, (uint8_t)(tick + 2U), 0);
        rig_cycle();
    }
    rig_enable();
    TEST_ASSERT_TRUE(rig.output.output_enabled);
}

void test_a_node_that_has_to_wait_for_its_node_id_tells_its_reset_then(void) {
    const uint8_t give[3][8] = {{0x04, 1}, {0x11, NODE_ID}, {0x04, 0}};
    rig.config.node_id = LSS_UNCONFIGURED;
    rig.config.supervisor_reset = true;
    power_on();
    for (size_t i = 0; i < 3U; i++) {
        rig_step();
        TEST_ASSERT_EQUAL_HEX16(0, rig_emergency());
        rig_send(0x7E5, 8, give[i]);
    }
    rig_step();
    TEST_ASSERT_EQUAL_HEX16(0x6010, rig_emergency()); /* with the new node-id */
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.pre_defined_error_field_number_of_errors);
    TEST_ASSERT_EQUAL_HEX32(0x6010, rig.node.od.pre_defined_error_field[0]);
}

void test_what_carries_the_frames_is_told_by_the_port(void) {
    rig.config.frame_link = 2;
    motor_node_init(&rig.config, &rig.node);
    rig_read(0x2107, 0);
    rig_step();
    TEST_ASSERT_EQUAL_UINT8(2, rig_sent(0x582)->data[4]);
}
