/* The motor node behind a serial line: one node (id 2) and the port's loop around it. */
#include "unity.h"

#include "node_rig.h"
#include "port/slcan/slcan_node.h"

static slcan_node_t slcan;
static slcan_node_text_t text;
static char sent[4096]; /* since the last call of line() */
static size_t sent_length;
static unsigned steps_done;

static void keep(void) {
    TEST_ASSERT_TRUE(text.length <= SLCAN_NODE_TEXT_MAX);
    TEST_ASSERT_TRUE(sent_length + text.length < sizeof sent);
    memcpy(&sent[sent_length], text.text, text.length);
    sent_length += text.length;
    sent[sent_length] = '\0';
}

static void step(void) {
    slcan_node_input(&slcan, &rig.input);
    motor_node_step(&rig.config, &rig.node, &rig.input, &rig.output);
    if (rig.output.reset_requested) {
        motor_node_restart(&rig.config, &rig.node);
    }
    slcan_node_output(&rig.output, &slcan, &text);
    keep();
    steps_done++;
}

/* Gives characters to the node as its port does; returns what it sent. */
static const char *line(const char *characters) {
    sent_length = 0;
    sent[0] = '\0';
    for (size_t i = 0; characters[i] != '\0'; i++) {
        const bool due = slcan_node_receive(&rig.node, (uint8_t)characters[i], &slcan, &text);
        keep();
        if (due) {
            step();
        }
    }
    return sent;
}

/* The port's timer in the free-running time base. */
static const char *timer(void) {
    sent_length = 0;
    sent[0] = '\0';
    rig.input.elapsed_us = 1000;
    step();
    return sent;
}

static void open_stepped(void) {
    (void)line("O\r");
    (void)timer(); /* boot-up */
    rig.node.od.time_base = 1;
    steps_done = 0;
}

static void tick(uint8_t number) {
    char rpdo4[SLCAN_TEXT_MAX + 1U];
    const can_frame_t frame = {
        .id = 0x502, .len = 8, .data = {0x39, 0x30, 0, 0, number, 0, 0xFA, 0}};
    rpdo4[slcan_from_frame(&frame, rpdo4)] = '\0';
    (void)line(rpdo4);
}

void setUp(void) {
    rig_init();
    memset(&slcan, 0, sizeof slcan);
    steps_done = 0;
}
void tearDown(void) {}

/* --- commands */

void test_questions_are_answered_open_or_not(void) {
    TEST_ASSERT_EQUAL_STRING("V0100\r", line("V\r"));
    TEST_ASSERT_EQUAL_STRING("N5678\r", line("N\r"));
    TEST_ASSERT_EQUAL_STRING("F00\r", line("F\r"));
    TEST_ASSERT_EQUAL_STRING("\r", line("O\r"));
    TEST_ASSERT_EQUAL_STRING("V0100\r", line("V\r"));
}

void test_the_channel_opens_and_closes_once(void) {
    TEST_ASSERT_EQUAL_STRING("\a", line("C\r"));
    TEST_ASSERT_EQUAL_STRING("\r\r", line("S8\rO\r"));
    TEST_ASSERT_EQUAL_STRING("\a\a", line("S8\rO\r"));
    TEST_ASSERT_EQUAL_STRING("\r\a", line("C\rC\r"));
}

void test_bit_rates_are_0_to_8(void) {
    TEST_ASSERT_EQUAL_STRING("\r\r", line("S0\rS8\r"));
    TEST_ASSERT_EQUAL_STRING("\a\a\a\a", line("S9\rS/\rS\rS88\r"));
}

void test_a_cr_alone_is_no_command(void) {
    TEST_ASSERT_EQUAL_STRING("", line("\r\r\r"));
    TEST_ASSERT_EQUAL_STRING("F00\r", line("F\r"));
}

void test_what_the_node_does_not_do_is_refused_and_counted(void) {
    (void)line("O\r");
    TEST_ASSERT_EQUAL_STRING("\a\a\a\a\a\a\a\a",
                             line("r5020\rT000005020\rR000005020\rL\rOO\rCC\rVV\rX\r"));
    TEST_ASSERT_EQUAL_STRING("F80\r", line("F\r"));
    TEST_ASSERT_EQUAL_STRING("F00\r", line("F\r"));
    (void)timer();
    TEST_ASSERT_EQUAL_UINT16(8, rig.node.od.counters_frames_not_read);
    (void)timer();
    TEST_ASSERT_EQUAL_UINT16(8, rig.node.od.counters_frames_not_read);
}

void test_a_closed_channel_takes_and_sends_no_frame(void) {
    TEST_ASSERT_EQUAL_STRING("\a", line("t0000\r"));
    TEST_ASSERT_EQUAL_STRING("", timer());
    TEST_ASSERT_EQUAL_UINT(1, rig.output.frame_count); /* boot-up */
}

void test_garbage_and_half_lines(void) {
    open_stepped();
    TEST_ASSERT_EQUAL_STRING("\a", line("t5028393000\r"));
    TEST_ASSERT_EQUAL_STRING("\a", line("t50283930t502839300000\xFF"
                                        "0FA00\r"));
    (void)line("t0801");
    slcan_node_lose(&slcan);
    TEST_ASSERT_EQUAL_STRING("\a", line("A5\r"));
    TEST_ASSERT_EQUAL_UINT(0, steps_done);
    tick(1); /* and the next whole line is taken */
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
    TEST_ASSERT_EQUAL_UINT16(3, rig.node.od.counters_frames_not_read);
}

/* --- frames and time */

void test_free_running_frames_wait_for_the_timer(void) {
    TEST_ASSERT_EQUAL_STRING("\r", line("O\r"));
    TEST_ASSERT_EQUAL_STRING("", line("t6028402F2F0000000000\rt0000\r"));
    TEST_ASSERT_EQUAL_UINT(0, steps_done);
    TEST_ASSERT_EQUAL_STRING("t702100\rt5828802F2F0000000206\r\r\r", timer());
    tick(1); /* RPDO4 closes nothing in this time base */
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
}

void test_rpdo4_closes_the_tick_and_answers_come_last(void) {
    open_stepped();
    TEST_ASSERT_EQUAL_STRING("", line("t6028401810010000"
                                      "0000\rt703105\r"));
    TEST_ASSERT_EQUAL_UINT(0, steps_done);
    tick(1); /* vendor-id, 1018h:01 */
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
    TEST_ASSERT_EQUAL_UINT(3, rig.input.frame_count);
    TEST_ASSERT_EQUAL_MEMORY("t5828431810010", sent, 14);
    TEST_ASSERT_EQUAL_STRING("\r\r\r\r", &sent[21]);
    tick(2);
    TEST_ASSERT_EQUAL_STRING("\r", sent);
}

void test_time_is_the_difference_of_the_tick_numbers(void) {
    open_stepped();
    tick(200); /* the first one counts as one tick */
    TEST_ASSERT_EQUAL_UINT32(1000, rig.input.elapsed_us);
    tick(201);
    TEST_ASSERT_EQUAL_UINT32(1000, rig.input.elapsed_us);
    rig.node.od.communication_cycle_period = 2500;
    tick(4);
    TEST_ASSERT_EQUAL_UINT32(59U * 2500U, rig.input.elapsed_us);
    rig.node.od.communication_cycle_period = 4000;
    tick(3); /* 255 ticks are more than a step may take */
    TEST_ASSERT_EQUAL_UINT32(1000000, rig.input.elapsed_us);
    TEST_ASSERT_EQUAL_UINT(4, steps_done);
}

void test_the_same_tick_again_is_refused(void) {
    open_stepped();
    tick(7);
    TEST_ASSERT_EQUAL_STRING("\r", sent);
    tick(7);
    TEST_ASSERT_EQUAL_STRING("\a", sent);
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
    TEST_ASSERT_EQUAL_STRING("F08\r", line("F\r"));
    tick(8);
    TEST_ASSERT_EQUAL_UINT(2, steps_done);
    TEST_ASSERT_EQUAL_UINT16(1, rig.node.od.counters_frames_not_read);
}

void test_setting_the_time_base_forgets_the_tick(void) {
    open_stepped();
    tick(7);
    rig.node.od.time_base = 0;
    (void)line("t0000\r");
    rig.node.od.time_base = 1;
    tick(7);
    TEST_ASSERT_EQUAL_UINT(2, steps_done);
    TEST_ASSERT_EQUAL_UINT32(1000, rig.input.elapsed_us);
}

void test_only_the_own_whole_rpdo4_closes(void) {
    open_stepped();
    (void)line("t5038393000000700FA00\rt502439300000\r");
    TEST_ASSERT_EQUAL_UINT(0, steps_done);
    (void)line("t502539300000"
               "07\r");
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
    TEST_ASSERT_EQUAL_UINT(3, rig.input.frame_count);
    rig.node.node_id = LSS_UNCONFIGURED;
    tick(9);
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
}

void test_a_full_buffer_refuses_and_the_tick_still_closes(void) {
    open_stepped();
    for (unsigned i = 0; i < MOTOR_NODE_RX_MAX; i++) {
        TEST_ASSERT_EQUAL_STRING("", line("t7030\r"));
    }
    TEST_ASSERT_EQUAL_STRING("\a", line("t7030\r"));
    tick(1);
    TEST_ASSERT_EQUAL_UINT(1, steps_done);
    TEST_ASSERT_EQUAL_UINT(1U + MOTOR_NODE_RX_MAX, sent_length);
    TEST_ASSERT_EQUAL_INT(SLCAN_BEL, sent[0]); /* RPDO4 itself */
    TEST_ASSERT_EQUAL_UINT16(2, rig.node.od.counters_frames_not_read);
    TEST_ASSERT_EQUAL_STRING("F01\r", line("F\r"));
}

void test_closing_the_channel_refuses_the_frames_that_wait(void) {
    open_stepped();
    (void)line("t0000\rt0000\r");
    TEST_ASSERT_EQUAL_STRING("\a\a\r", line("C\r"));
    TEST_ASSERT_EQUAL_STRING("\r", line("O\r"));
    tick(1);
    TEST_ASSERT_EQUAL_STRING("\r", sent);
    TEST_ASSERT_EQUAL_UINT(1, rig.input.frame_count);
    TEST_ASSERT_EQUAL_UINT16(2, rig.node.od.counters_frames_not_read);
}

void test_the_node_runs_on_the_line_through_a_reset(void) {
    open_stepped();
    rig.node.od.sensor_source = 1;
    (void)line("t000201"
               "02\r");
    tick(1);
    TEST_ASSERT_EQUAL_INT(NMT_OPERATIONAL, rig.node.nmt);
    (void)line("t0800\r");
    tick(2);
    TEST_ASSERT_EQUAL_UINT32(12345, (uint32_t)rig.node.od.position_actual_value);
    TEST_ASSERT_EQUAL_MEMORY("t182839300000", sent, 13); /* TPDO1, before both answers */
    TEST_ASSERT_EQUAL_STRING("\r\r\r", &sent[sent_length - 3U]);
    (void)line("t00028102\r");
    tick(3);
    TEST_ASSERT_EQUAL_STRING("\r\r", sent);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.time_base);
    TEST_ASSERT_EQUAL_UINT8(1, rig.node.od.sensor_source);
    TEST_ASSERT_EQUAL_INT(NMT_PRE_OPERATIONAL, rig.node.nmt);
    tick(4);
    TEST_ASSERT_EQUAL_STRING("t702100\r\r", sent);
    TEST_ASSERT_EQUAL_UINT32(1000, rig.input.elapsed_us);
}
