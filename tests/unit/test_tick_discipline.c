/* The joint loop's timer beside a SYNC producer whose clock runs a little differently. */
#include "unity.h"

#include "port/stm32f405/tick_discipline.h"

enum { NOMINAL = 16800, LEAD = 840, STEP = 168 };

static const tick_discipline_config_t config = {.nominal_counts = NOMINAL,
                                                .min_counts = 8400,
                                                .max_counts = 840000,
                                                .lead_counts = LEAD,
                                                .step_max_counts = STEP,
                                                .hold_counts = 84000000};
static tick_discipline_t discipline;

/* The simulated timer: when the tick that runs began, and what it and the next one last. */
static double begin;
static double length;
static double preloaded;
static double ticks;   /* so far */
static double longest; /* and shortest tick so far */
static double shortest;
static uint32_t noise_state;

static void next_tick(void) {
    begin += length;
    length = preloaded;
    preloaded = tick_discipline_tick(&config, &discipline);
    ticks += 1.0;
    longest = length > longest ? length : longest;
    shortest = length < shortest ? length : shortest;
}

/** Advances to a SYNC at this time; returns how much too late the tick after it will come. */
static double sync_at(double time, uint8_t joint_ticks) {
    while (begin + length <= time) {
        next_tick();
    }
    tick_discipline_sync(&config, (uint32_t)(time - begin), joint_ticks, &discipline);
    return begin + length - time - LEAD;
}

static double noise(double amplitude) {
    noise_state = noise_state * 1664525U + 1013904223U;
    return amplitude * ((double)(noise_state >> 8) / 8388608.0 - 1.0);
}

static void forget_extremes(void) {
    longest = 0.0;
    shortest = 1e9;
}

void setUp(void) {
    tick_discipline_start(&config, &discipline);
    begin = 0.0;
    length = NOMINAL;
    preloaded = NOMINAL;
    ticks = 0.0;
    noise_state = 1;
    forget_extremes();
}
void tearDown(void) {}

void test_nominal_without_sync(void) {
    for (int i = 0; i < 1000; i++) {
        TEST_ASSERT_EQUAL_UINT32(NOMINAL, tick_discipline_tick(&config, &discipline));
    }
    TEST_ASSERT_FALSE(discipline.locked);
}

void test_comes_into_step_from_any_phase(void) {
    for (uint32_t phase = 0; phase < NOMINAL; phase += 700U) {
        setUp();
        double late = 0.0;
        for (int k = 1; k <= 60; k++) {
            late = sync_at(84000.0 * k + phase, 5);
        }
        TEST_ASSERT_TRUE(discipline.locked);
        TEST_ASSERT_TRUE(late > -8.0 && late < 8.0); /* 0.1 us */
        TEST_ASSERT_TRUE(longest <= NOMINAL + STEP && shortest >= NOMINAL - STEP - 1);
    }
}

void test_the_right_number_of_ticks_at_any_rate(void) {
    const double periods[] = {84000.0, 168000.0, 420000.0, 840000.0}; /* 1 kHz to 100 Hz */
    const uint8_t joint_ticks[] = {1, 5, 10};
    for (uint32_t p = 0; p < 4U; p++) {
        for (uint32_t j = 0; j < 3U; j++) {
            setUp();
            for (int k = 1; k <= 200; k++) {
                (void)sync_at(periods[p] * k + 5000.0, joint_ticks[j]);
            }
            const double before = ticks;
            for (int k = 201; k <= 300; k++) {
                const double one_before = ticks;
                (void)sync_at(periods[p] * k + 5000.0, joint_ticks[j]);
                TEST_ASSERT_EQUAL_INT(joint_ticks[j], (int)(ticks - one_before));
            }
            TEST_ASSERT_EQUAL_INT(100 * joint_ticks[j], (int)(ticks - before));
        }
    }
}

void test_follows_a_clock_that_differs_by_300_ppm(void) {
    for (int sign = -1; sign <= 1; sign += 2) {
        setUp();
        const double period = 84000.0 * (1.0 + sign * 300e-6);
        double late = 0.0;
        for (int k = 1; k <= 500; k++) {
            late = sync_at(period * k, 5);
            if (k > 100) {
                TEST_ASSERT_TRUE(late > -17.0 && late < 17.0); /* 0.2 us */
            }
        }
    }
}

void test_smooths_a_sync_that_jitters(void) {
    double worst = 0.0;
    for (int k = 1; k <= 3000; k++) {
        const double late = sync_at(84000.0 * k + noise(1680.0), 5); /* +-20 us */
        const double distance =
            late > NOMINAL / 2 ? late - NOMINAL : late; /* SYNC after its tick */
        if (k > 200) {
            worst = distance > worst ? distance : (-distance > worst ? -distance : worst);
            TEST_ASSERT_TRUE(discipline.locked);
        } else {
            forget_extremes();
        }
    }
    /* The distance is that of the SYNC itself and of what the timer makes of it. */
    TEST_ASSERT_TRUE(worst < 2.0 * 1680.0);
    /* Two intervals differ by 6720 counts at most: a fifth of an eighth of half of that. */
    TEST_ASSERT_TRUE(longest <= NOMINAL + STEP + 84 && shortest >= NOMINAL - STEP - 85);
}

void test_one_late_sync_moves_the_ticks_by_a_quarter(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    (void)sync_at(84000.0 * 101 + 400.0, 5);
    const double from = begin + length;
    for (int i = 0; i < 6; i++) {
        next_tick();
    }
    /* a quarter of 400, and what an eighth of 400 / 5 makes of four or five ticks */
    TEST_ASSERT_TRUE(begin - from - 5.0 * NOMINAL > 90.0 && begin - from - 5.0 * NOMINAL < 155.0);
}

void test_missing_syncs_do_not_lose_step(void) {
    double late = 0.0;
    for (int k = 1; k <= 600; k++) {
        if (k < 100 || k % 15 == 0) {
            late = sync_at(84000.3 * k, 5);
        }
    }
    TEST_ASSERT_TRUE(discipline.locked);
    TEST_ASSERT_TRUE(late > -17.0 && late < 17.0);
}

void test_a_doubled_sync_is_passed_over(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    forget_extremes();
    (void)sync_at(84000.0 * 101, 5);
    (void)sync_at(84000.0 * 101 + 5000.0, 5); /* an interval that is no tick's length */
    for (int k = 102; k <= 200; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    TEST_ASSERT_TRUE(discipline.locked);
    TEST_ASSERT_EQUAL_INT32(0, discipline.pending_counts);
    /* 5000 counts too soon: an eighth of a fifth of them, and a phase correction */
    TEST_ASSERT_TRUE(longest <= NOMINAL + STEP + 1 && shortest >= NOMINAL - STEP - 126);
}

void test_a_jump_of_the_sync_is_followed_after_a_while(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    double late = 0.0;
    double time = 84000.0 * 100;
    for (int k = 1; k <= 100; k++) { /* 10 % slower, then 20 % faster */
        time += k <= 50 ? 92400.0 : 67200.0;
        late = sync_at(time, 5);
    }
    TEST_ASSERT_TRUE(discipline.locked);
    TEST_ASSERT_UINT32_WITHIN(1, 13440, discipline.base_256 / 256U);
    TEST_ASSERT_TRUE(late > -17.0 && late < 17.0);
}

void test_too_many_missing_are_a_new_begin(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    (void)sync_at(84000.0 * 120, 5);
    TEST_ASSERT_EQUAL_UINT8(1, discipline.strange);
    TEST_ASSERT_TRUE(discipline.locked);
    (void)sync_at(84000.0 * 121, 5);
    TEST_ASSERT_EQUAL_UINT8(0, discipline.strange);
}

void test_two_syncs_at_one_count(void) {
    tick_discipline_sync(&config, 100, 5, &discipline);
    tick_discipline_sync(&config, 100, 5, &discipline);
    TEST_ASSERT_FALSE(discipline.locked);
    TEST_ASSERT_EQUAL_UINT32(NOMINAL, tick_discipline_tick(&config, &discipline));
}

void test_goes_on_alone_and_back_to_nominal(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(88200.0 * k, 5); /* 5 % slow */
    }
    const double end = begin + 83000000.0;
    forget_extremes();
    while (begin < end) { /* it keeps the rate for almost a second */
        next_tick();
    }
    TEST_ASSERT_TRUE(discipline.locked);
    TEST_ASSERT_TRUE(shortest > 17640.0 - 5.0 && longest < 17640.0 + 5.0);
    for (int i = 0; i < 100; i++) {
        next_tick();
    }
    TEST_ASSERT_FALSE(discipline.locked);
    TEST_ASSERT_EQUAL_INT(NOMINAL, (int)length);
    for (int i = 0; i < 200000; i++) { /* 40 s: nothing overflows */
        next_tick();
    }
    TEST_ASSERT_EQUAL_INT(NOMINAL, (int)length);
    const double from = begin + 1000.0; /* and it comes into step again */
    for (int k = 0; k < 100; k++) {
        (void)sync_at(from + 84000.0 * k, 5);
    }
    TEST_ASSERT_TRUE(discipline.locked);
}

void test_another_multiple_is_taken_over(void) {
    for (int k = 1; k <= 100; k++) {
        (void)sync_at(84000.0 * k, 5);
    }
    for (int k = 101; k <= 160; k++) {
        (void)sync_at(84000.0 * k, 2);
    }
    const double before = ticks;
    (void)sync_at(84000.0 * 161, 2);
    TEST_ASSERT_EQUAL_INT(2, (int)(ticks - before));
    TEST_ASSERT_EQUAL_UINT32(42000, discipline.base_256 / 256U);
}

void test_a_sync_outside_the_limits_is_not_followed(void) {
    const double periods[] = {4200000.0, 42000.0}; /* ticks of 50 ms, and of 50 us */
    const uint8_t joint_ticks[] = {1, 10};
    for (uint32_t i = 0; i < 2U; i++) {
        setUp();
        for (int k = 1; k <= 50; k++) {
            (void)sync_at(periods[i] * k, joint_ticks[i]);
        }
        TEST_ASSERT_FALSE(discipline.locked);
        TEST_ASSERT_EQUAL_INT(NOMINAL, (int)length);
    }
}
