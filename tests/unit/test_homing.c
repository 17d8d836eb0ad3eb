/* Homing: how the search moves and ends, and what the statusword says of it. */
#include "unity.h"

#include "cia402/homing.h"

static homing_config_t config;
static homing_t homing;

void setUp(void) {
    config = (homing_config_t){.method = HOMING_INDEX_POSITIVE,
                               .speed_inc_s = 6554,
                               .time_out_us = 1000000,
                               .lead_inc = 500};
    homing = (homing_t){0};
}
void tearDown(void) {}

void test_search_moves_at_the_speed_in_the_direction_of_the_method(void) {
    const int8_t methods[] = {HOMING_INDEX_POSITIVE, HOMING_INDEX_NEGATIVE};
    const int32_t ends[] = {1000 + 655, 1000 - 655};
    for (int i = 0; i < 2; i++) {
        config.method = methods[i];
        homing_start(&config, 1000, &homing);
        for (int tick = 0; tick < 500; tick++) { /* 0.1 s, less than an increment and a half each */
            homing_step(&config, homing.target_inc, 200, &homing);
        }
        TEST_ASSERT_EQUAL_INT32(ends[i], homing.target_inc);
        TEST_ASSERT_EQUAL_INT(HOMING_SEARCHING, homing.phase);
    }
}

void test_a_joint_held_up_is_not_left_behind(void) {
    homing_start(&config, 0, &homing);
    for (int tick = 0; tick < 999; tick++) {
        homing_step(&config, 0, 1000, &homing);
    }
    TEST_ASSERT_EQUAL_INT32(500, homing.target_inc);
    config.method = HOMING_INDEX_NEGATIVE;
    homing_start(&config, 0, &homing);
    for (int tick = 0; tick < 999; tick++) {
        homing_step(&config, 0, 1000, &homing);
    }
    TEST_ASSERT_EQUAL_INT32(-500, homing.target_inc);
    homing_step(&config, 0, 1000, &homing);
    TEST_ASSERT_EQUAL_INT(HOMING_FAILED, homing.phase);
    homing_step(&config, 7, 1000, &homing);
    TEST_ASSERT_EQUAL_INT32(-500, homing.target_inc);
}

void test_nothing_wraps_at_the_end_of_the_range(void) {
    homing_start(&config, INT32_MAX, &homing);
    homing_step(&config, INT32_MAX, 10000, &homing);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, homing.target_inc);
    config.method = HOMING_INDEX_NEGATIVE;
    homing_start(&config, INT32_MIN, &homing);
    homing_step(&config, INT32_MIN, 10000, &homing);
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, homing.target_inc);
}

void test_here_is_attained_at_once(void) {
    config.method = HOMING_HERE;
    homing_start(&config, 5, &homing);
    TEST_ASSERT_EQUAL_INT(HOMING_ATTAINED, homing.phase);
}

void test_statusword(void) {
    const struct {
        homing_phase_t phase;
        bool referenced;
        bool moving;
        uint16_t bits;
    } cases[] = {
        {HOMING_NOT_STARTED, false, false, 0x0400}, {HOMING_NOT_STARTED, true, false, 0x1400},
        {HOMING_SEARCHING, false, true, 0x0000},    {HOMING_SEARCHING, false, false, 0x0000},
        {HOMING_ATTAINED, true, true, 0x1000},      {HOMING_ATTAINED, true, false, 0x1400},
        {HOMING_INTERRUPTED, false, true, 0x0400},  {HOMING_FAILED, false, true, 0x2000},
        {HOMING_FAILED, false, false, 0x2400},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        homing.phase = cases[i].phase;
        TEST_ASSERT_EQUAL_HEX16(cases[i].bits,
                                homing_statusword(cases[i].referenced, cases[i].moving, &homing));
    }
}
