/* How much of the torque limit is left, and why. */
#include "unity.h"

#include "node/derating.h"

static derating_input_t input;

void setUp(void) {
    input = (derating_input_t){.temperature_dC = 250,
                               .temperature_begin_dC = 1000,
                               .temperature_end_dC = 1200,
                               .mean_square_mA2 = 0,
                               .rated_current_mA = 1000,
                               .speed_ppm = 0,
                               .speed_begin_ppm = 900000,
                               .torque_accelerates = true};
}
void tearDown(void) {}

static void expect(uint32_t share_ppm, uint16_t reasons) {
    const derating_output_t output = derating(&input);
    TEST_ASSERT_UINT32_WITHIN(10, share_ppm, output.share_ppm);
    TEST_ASSERT_EQUAL_HEX16(reasons, output.reasons);
}

void test_nothing_derates_a_cool_slow_motor(void) {
    expect(1000000, 0);
}

void test_temperature(void) {
    input.temperature_dC = 1000;
    expect(1000000, 0);
    input.temperature_dC = 1050;
    expect(750000, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = 1200;
    expect(0, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = INT16_MAX;
    expect(0, LIMIT_REASON_TEMPERATURE);
    input.temperature_dC = INT16_MIN;
    expect(1000000, 0);
}

void test_crossed_temperatures_derate_to_nothing(void) {
    input.temperature_end_dC = 900;
    input.temperature_dC = 1001;
    expect(0, LIMIT_REASON_TEMPERATURE);
}

void test_current(void) {
    input.mean_square_mA2 = 1000000;
    expect(1000000, 0);
    input.mean_square_mA2 = 1500000;
    TEST_ASSERT_UINT32_WITHIN(2000, 500000, derating(&input).share_ppm);
    TEST_ASSERT_EQUAL_HEX16(LIMIT_REASON_CURRENT, derating(&input).reasons);
    input.mean_square_mA2 = 2000000;
    expect(0, LIMIT_REASON_CURRENT);
    input.rated_current_mA = UINT32_MAX;
    expect(1000000, 0);
}

void test_speed_derates_what_accelerates(void) {
    input.speed_ppm = 950000;
    expect(500000, LIMIT_REASON_SPEED);
    input.torque_accelerates = false;
    expect(1000000, 0);
    input.torque_accelerates = true;
    input.speed_ppm = 5000000;
    expect(0, LIMIT_REASON_SPEED);
}

void test_the_least_share_counts_and_all_reasons_show(void) {
    input.speed_ppm = 950000;
    input.temperature_dC = 1150;
    expect(250000, LIMIT_REASON_SPEED | LIMIT_REASON_TEMPERATURE);
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
