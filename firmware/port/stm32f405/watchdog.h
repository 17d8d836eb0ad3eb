/**
 * Independent watchdog (RM0090 section 21): resets the chip when it is not fed. It runs on the
 * chip's own low-speed oscillator, 17 to 47 kHz (DS8626 table 44: typically 32), whatever happens
 * to the other clocks; nothing but a reset stops it.
 *
 * A window is the time within which it must be fed for certain, whatever its oscillator does; it
 * bites after that time at 47 kHz, and at 17 kHz after 2.76 times it. 20 ms while joints move:
 * bites after 20 to 56 ms. Erasing a flash sector stops the core for up to 800 ms (DS8626 table
 * 40): the window is widened before, with the torque off, and narrowed again after.
 */
#ifndef WATCHDOG_H
#define WATCHDOG_H

#include <stdbool.h>
#include <stdint.h>

#define WATCHDOG_WINDOW_MOVING_us 20000U
#define WATCHDOG_WINDOW_FLASH_us 1000000U
/** Largest window: 4095 periods of 47 kHz / 256. */
#define WATCHDOG_WINDOW_MAX_us 22300000U

/** What its registers are to hold. */
typedef struct {
    uint8_t prescaler; /**< 0..6: divides by 4 << prescaler */
    uint16_t reload;   /**< counts, 0..4095 */
} watchdog_setting_t;

/** The shortest setting that does not bite within the window; pure. window_us: 0..
 * WATCHDOG_WINDOW_MAX_us, more is taken as that. */
watchdog_setting_t watchdog_setting(uint32_t window_us);

/** Starts it. False: the registers did not take the values within the bounded wait (20,000 reads,
 * about 5 ms); it runs then, with the reset values: bites after 348 to 964 ms. */
bool watchdog_start(uint32_t window_us);

/** Another window, and feeds it. False as for watchdog_start(); the window before holds then. */
bool watchdog_set_window(uint32_t window_us);

/** Feeds it. */
void watchdog_feed(void);

#endif
