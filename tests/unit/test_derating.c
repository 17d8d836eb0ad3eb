/* How much of the torque limit is left, and why. */
#include "unity.h"

#include "control/derating.h"

static derating_input_t input;
static bool accelerates;

void setUp(void) {
    input = (derating_input_t){.temperature_dC = 250,
                               .temperature_begin_dC = 1000,
                               .temperature_end_dC = 1200,
                               .speed_begin_ppm = 900000};
    accelerates = true;
}
void tearDown(void) {}

static void expect(int32_t share, uint16_t reasons) {
    const derating_output_t output = derating(&input, accelerates);
    TEST_ASSERT_EQUAL_INT32(share, output.share);
    TEST_ASSERT_EQUAL_HEX16(reasons, output.reasons);
}

void test_nothing_derates_a_cool_slow_motor(void) {
    expect(2048, 0);
}

void test_temperature(void) {
    input.temperature_dC = 1000;
    expect(2048, 0);
    input.temperature_dC = 1050;
    expect(1536, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = 1199;
    expect(10, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = 1200;
    expect(0, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = INT16_MAX;
    expect(0, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = INT16_MIN;
    expect(2048, 0);
}

void test_the_widest_range_of_temperature(void) {
    input.temperature_begin_dC = INT16_MIN;
    input.temperature_end_dC = INT16_MAX;
    input.temperature_dC = INT16_MIN + 1;
    expect(2047, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = 0;
    expect(1023, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = INT16_MAX - 1;
    expect(0, LIMIT_REASON_TEMPERATURE);
}

void test_crossed_temperatures_derate_to_nothing(void) {
    input.temperature_end_dC = 900;
    input.temperature_dC = 1001;
    expect(0, LIMIT_REASON_TEMPERATURE);
}

void test_current(void) {
    input.load_ppm = 1000000;
    expect(2048, 0);
    input.load_ppm = 1500000;
    expect(1024, LIMIT_REASON_CURRENT);
    input.load_ppm = 2000000;
    expect(0, LIMIT_REASON_CURRENT);
    input.load_ppm = UINT32_MAX;
    expect(0, LIMIT_REASON_CURRENT);
}

void test_speed_derates_what_accelerates(void) {
    input.speed_ppm = 900000;
    expect(2048, 0);
    input.speed_ppm = 950000;
    expect(1024, LIMIT_REASON_SPEED);
    accelerates = false;
    expect(2048, 0);
    accelerates = true;
    input.speed_ppm = UINT32_MAX;
    expect(0, LIMIT_REASON_SPEED);
    input.speed_begin_ppm = 0;
    input.speed_ppm = 1;
    expect(2047, LIMIT_REASON_SPEED);
}

void test_the_least_share_counts_and_all_reasons_show(void) {
    input.speed_ppm = 950000;
    input.temperature_dC = 1150;
    input.load_ppm = 1250000;
    expect(512, LIMIT_REASON_SPEED | LIMIT_REASON_TEMPERATURE | LIMIT_REASON_CURRENT);
}

void test_load_is_the_mean_square_by_that_of_the_rated_current(void) {
    TEST_ASSERT_EQUAL_UINT32(0, derating_load(0, 1000));
    TEST_ASSERT_EQUAL_UINT32(1500000, derating_load(1500000, 1000));
    TEST_ASSERT_EQUAL_UINT32(250000, derating_load(9, 6));
    TEST_ASSERT_EQUAL_UINT32(1000000, derating_load((uint64_t)4294967U * 4294967U, 4294967));
    TEST_ASSERT_UINT32_WITHIN(2, 1, derating_load((uint64_t)4294967U * 4294967U, UINT32_MAX));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, derating_load((uint64_t)4294967U * 4294967U, 1));
    TEST_ASSERT_EQUAL_UINT32(4294000000, derating_load(4294, 0)); /* 0 counts as 1 mA */
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, derating_load(4295, 1));
}

void test_mean_square_follows_the_current_in_its_time(void) {
    uint64_t mean = 0;
    for (int i = 0; i < 1000; i++) { /* one time constant: 1 - 1/e */
        mean = derating_mean_square(mean, 2000, 1000000, 1000);
    }
    TEST_ASSERT_INT_WITHIN(20000, 2528482, (int)mean);
    for (int i = 0; i < 10000; i++) {
        mean = derating_mean_square(mean, 0, 1000000, 1000);
    }
    TEST_ASSERT_TRUE(mean < 1000U);
    TEST_ASSERT_EQUAL_INT(4000000, (int)derating_mean_square(0, 2000, 1000, 5000));
    TEST_ASSERT_EQUAL_INT(7, (int)derating_mean_square(7, 2000, 1000, 0));
    TEST_ASSERT_TRUE(derating_mean_square(0, UINT32_MAX, 1, 1) == (uint64_t)4294967U * 4294967U);
}
