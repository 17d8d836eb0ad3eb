/* The independent watchdog's register sequence, and its windows. */
#include "unity.h"

#include "port/stm32f405/registers.h"
#include "port/stm32f405/watchdog.h"
#include "register_bus_double.h"

static uint32_t busy_reads; /* SR says so often that a value is on its way */
static bool unlocked;

static uint32_t answer(uint32_t address, uint32_t content) {
    if (address == IWDG_SR && busy_reads > 0U) {
        busy_reads--;
        return IWDG_SR_RVU | IWDG_SR_PVU;
    }
    return content;
}

static uint32_t take(uint32_t address, uint32_t content, uint32_t value) {
    if (address == IWDG_KR) {
        unlocked = value == 0x5555U;
    }
    if (address == IWDG_PR || address == IWDG_RLR) {
        TEST_ASSERT_TRUE_MESSAGE(unlocked, "written without its key");
        busy_reads = 12;
        return value;
    }
    return address == IWDG_KR ? value : content;
}

void setUp(void) {
    bus_reset();
    bus_on_read(answer);
    bus_on_write(take);
    busy_reads = 0;
    unlocked = false;
}
void tearDown(void) {}

void test_start_sequence(void) {
    TEST_ASSERT_TRUE(watchdog_start(WATCHDOG_WINDOW_MOVING_us));
    BUS_EXPECT_WRITES({IWDG_KR, 0xCCCC}, {IWDG_KR, 0x5555}, {IWDG_PR, 0}, {IWDG_RLR, 235},
                      {IWDG_KR, 0xAAAA});
    TEST_ASSERT_FALSE(unlocked);
    TEST_ASSERT_EQUAL_UINT32(0, busy_reads); /* it has waited */
}

void test_feeding_is_one_write(void) {
    watchdog_feed();
    BUS_EXPECT_WRITES({IWDG_KR, 0xAAAA});
}

void test_another_window(void) {
    busy_reads = 5; /* the one before is still on its way */
    TEST_ASSERT_TRUE(watchdog_set_window(WATCHDOG_WINDOW_FLASH_us));
    BUS_EXPECT_WRITES({IWDG_KR, 0x5555}, {IWDG_PR, 2}, {IWDG_RLR, 2938}, {IWDG_KR, 0xAAAA});
}

void test_waits_are_bounded(void) {
    busy_reads = UINT32_MAX;
    TEST_ASSERT_FALSE(watchdog_start(WATCHDOG_WINDOW_MOVING_us));
    TEST_ASSERT_EQUAL_UINT(20000, bus_reads());
    BUS_EXPECT_WRITES({IWDG_KR, 0xCCCC});
}

static uint32_t never_done(uint32_t address, uint32_t content) {
    return address == IWDG_SR && bus_writes() > 1U ? IWDG_SR_RVU : content;
}

void test_values_that_are_not_taken(void) {
    bus_on_read(never_done);
    TEST_ASSERT_FALSE(watchdog_set_window(WATCHDOG_WINDOW_MOVING_us));
    TEST_ASSERT_LESS_OR_EQUAL_UINT(20001, bus_reads());
    TEST_ASSERT_EQUAL_HEX32(0xAAAA, bus_get(IWDG_KR)); /* locked again, and fed */
}

void test_no_window_is_ever_shorter_than_asked(void) {
    for (uint32_t window_us = 0; window_us <= WATCHDOG_WINDOW_MAX_us; window_us += 977U) {
        const watchdog_setting_t setting = watchdog_setting(window_us);
        const int64_t divider = 4LL << setting.prescaler;
        const int64_t window = 47LL * window_us;
        TEST_ASSERT_LESS_OR_EQUAL_UINT32(4095, setting.reload);
        TEST_ASSERT_LESS_OR_EQUAL_UINT32(6, setting.prescaler);
        /* at 47 kHz, the first count cut short */
        TEST_ASSERT_TRUE(setting.reload * divider * 1000 >= window);
        /* nor longer than one count more, at the same rate */
        TEST_ASSERT_TRUE((setting.reload - 1) * divider * 1000 < window + 1000);
        if (setting.prescaler > 0U) { /* the finest that can */
            TEST_ASSERT_TRUE(4095 * (divider / 2) * 1000 < window + 1000);
        }
    }
    TEST_ASSERT_EQUAL_UINT16(4095, watchdog_setting(UINT32_MAX).reload);
    TEST_ASSERT_EQUAL_UINT8(6, watchdog_setting(UINT32_MAX).prescaler);
}
