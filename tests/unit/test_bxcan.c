/* CAN by bxCAN, on a controller that is acted by the register bus. */
#include "unity.h"

#include <string.h>

#include "canopen/lss.h"
#include "canopen/sync.h"
#include "node/motor_node.h"
#include "port/stm32f405/bxcan.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "register_bus_double.h"

enum { NODE = 5, BANKS = 14, ARRIVALS_MAX = 8 };

static bxcan_t can;
static bool bus_is_quiet; /* 11 recessive bits were seen */
static can_frame_t fifo[2]
                       [ARRIVALS_MAX]; /* what a receive FIFO holds; the first is at the output */
static uint32_t fifo_count[2];
static uint32_t overrun[2];
static can_frame_t arrives_late; /* comes while the FIFO is emptied, once */
static bool late_waits;

static uint32_t word(const can_frame_t *frame, uint32_t first) {
    return (uint32_t)frame->data[first] | ((uint32_t)frame->data[first + 1U] << 8) |
           ((uint32_t)frame->data[first + 2U] << 16) | ((uint32_t)frame->data[first + 3U] << 24);
}

static uint32_t answer(uint32_t address, uint32_t content) {
    if (address == CAN_MSR) {
        const uint32_t control = bus_get(CAN_MCR);
        const bool stays = (content & CAN_MSR_INAK) != 0U && !bus_is_quiet;
        const bool initialising = (control & CAN_MCR_INRQ) != 0U || stays;
        bus_set(CAN_MSR, initialising ? CAN_MSR_INAK : 0U);
        return (initialising ? CAN_MSR_INAK : 0U) |
               ((control & CAN_MCR_SLEEP) != 0U ? CAN_MSR_SLAK : 0U);
    }
    for (uint32_t i = 0; i < 2U; i++) {
        const can_frame_t *frame = &fifo[i][0];
        if (address == CAN_RFR(i)) {
            const uint32_t pending = fifo_count[i] < 3U ? fifo_count[i] : 3U;
            return pending | (overrun[i] != 0U ? CAN_RFR_FOVR : 0U);
        }
        if (address == CAN_RIR(i)) {
            return (uint32_t)frame->id << 21;
        }
        if (address == CAN_RDTR(i)) {
            return 0xABCD0000U | frame->len;
        }
        if (address == CAN_RDLR(i)) {
            return word(frame, 0);
        }
        if (address == CAN_RDHR(i)) {
            return word(frame, 4);
        }
    }
    return content;
}

static uint32_t take(uint32_t address, uint32_t content, uint32_t value) {
    for (uint32_t i = 0; i < 2U; i++) {
        if (address == CAN_RFR(i)) {
            if ((value & CAN_RFR_FOVR) != 0U) {
                overrun[i] = 0;
            }
            if ((value & CAN_RFR_RFOM) != 0U && fifo_count[i] > 0U) {
                fifo_count[i]--;
                memmove(&fifo[i][0], &fifo[i][1], fifo_count[i] * sizeof fifo[i][0]);
                if (late_waits) {
                    late_waits = false;
                    fifo[i][fifo_count[i]++] = arrives_late;
                }
            }
            return 0;
        }
    }
    for (uint32_t i = 0; i < BXCAN_MAILBOXES; i++) {
        if (address == CAN_TIR(i) && (value & CAN_TIR_TXRQ) != 0U) {
            const uint32_t state = bus_get(CAN_TSR);
            TEST_ASSERT_TRUE_MESSAGE((state & (CAN_TSR_TME0 << i)) != 0U, "mailbox in use");
            bus_set(CAN_TSR, state & ~((CAN_TSR_TME0 << i) | (0xFU << (8U * i))));
        }
    }
    if (address == CAN_TSR) { /* a request to abort stays for the test to answer */
        uint32_t state = content | (value & (CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2));
        for (uint32_t i = 0; i < BXCAN_MAILBOXES; i++) {
            if ((value & (CAN_TSR_RQCP0 << (8U * i))) != 0U) {
                state &= ~(0xFU << (8U * i));
            }
        }
        return state;
    }
    return value;
}

/** The controller is done with a mailbox: the frame is sent, or was called back. */
static void finish(uint32_t mailbox, bool sent) {
    const uint32_t state = bus_get(CAN_TSR) & ~(CAN_TSR_ABRQ0 << (8U * mailbox));
    bus_set(CAN_TSR, state | (CAN_TSR_TME0 << mailbox) |
                         ((CAN_TSR_RQCP0 | (sent ? CAN_TSR_TXOK0 : 0U)) << (8U * mailbox)));
}

static uint32_t id_in(uint32_t mailbox) {
    return bus_get(CAN_TIR(mailbox)) >> 21;
}

static can_frame_t frame_of(uint16_t id, uint8_t first) {
    return (can_frame_t){.id = id, .len = 8, .data = {first, 2, 3, 4, 5, 6, 7, 8}};
}

static void send(uint16_t id, uint8_t first) {
    const can_frame_t frame = frame_of(id, first);
    TEST_ASSERT_TRUE(bxcan_send(&frame, 1, &can));
}

static void arrive(uint32_t in_fifo, uint16_t id, uint8_t first) {
    fifo[in_fifo][fifo_count[in_fifo]++] = frame_of(id, first);
}

void setUp(void) {
    bus_reset();
    memset(fifo, 0, sizeof fifo);
    memset(fifo_count, 0, sizeof fifo_count);
    memset(overrun, 0, sizeof overrun);
    late_waits = false;
    bus_is_quiet = true;
    bus_set(CAN_MCR, CAN_MCR_SLEEP | CAN_MCR_DBF); /* after reset */
    bus_set(CAN_TSR, CAN_TSR_TME0 | CAN_TSR_TME1 | CAN_TSR_TME2);
    bus_on_read(answer);
    bus_on_write(take);
    TEST_ASSERT_EQUAL(BXCAN_STARTED, bxcan_start(NODE, &can));
}
void tearDown(void) {}

/* --- start */

void test_one_megabit_with_the_sample_point_at_81_percent(void) {
    const uint32_t timing = bus_get(CAN_BTR);
    const uint32_t quanta_before = 2U + register_field_of(CAN_BTR_TS1, timing);
    const uint32_t quanta = quanta_before + 1U + register_field_of(CAN_BTR_TS2, timing);
    const uint32_t prescaler = register_field_of(CAN_BTR_BRP, timing) + 1U;
    TEST_ASSERT_EQUAL_UINT32(42, prescaler * quanta); /* of APB1's 42 MHz: 1 us */
    TEST_ASSERT_EQUAL_UINT32(810, 1000U * quanta_before / quanta + 1U);
    TEST_ASSERT_EQUAL_UINT32(3, register_field_of(CAN_BTR_SJW, timing));
    TEST_ASSERT_EQUAL_HEX32(0, timing & (CAN_BTR_LBKM | CAN_BTR_SILM));
}

void test_runs_with_automatic_recovery_and_priority_by_identifier(void) {
    TEST_ASSERT_EQUAL_HEX32(CAN_MCR_ABOM, bus_get(CAN_MCR));
    TEST_ASSERT_EQUAL_HEX32(CAN_IER_FMPIE0 | CAN_IER_FMPIE1, bus_get(CAN_IER));
    TEST_ASSERT_EQUAL_HEX32(RCC_APB1ENR_CAN1EN, bus_get(RCC_APB1ENR));
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(RCC_APB1RSTR));
}

void test_says_that_there_is_no_controller(void) {
    bus_set_absent();
    bus_forget();
    TEST_ASSERT_EQUAL(BXCAN_ABSENT, bxcan_start(NODE, &can));
    TEST_ASSERT_LESS_OR_EQUAL_UINT(20010, bus_reads()); /* bounded */
    TEST_ASSERT_LESS_OR_EQUAL_UINT(4, bus_writes());
}

void test_waits_for_a_quiet_bus_for_a_bounded_time(void) {
    bus_is_quiet = false;
    TEST_ASSERT_EQUAL(BXCAN_WAITS_FOR_BUS, bxcan_start(NODE, &can));
    TEST_ASSERT_EQUAL_HEX32(CAN_MCR_ABOM, bus_get(CAN_MCR)); /* joins as soon as it can */
}

/* --- filters */

/** Which FIFO a data frame goes to by the filters that are set: the first bank that matches, lists
 * before masks (RM0090 section 32.7.4); -1 = none. */
static int filtered(uint32_t id) {
    for (int want_list = 1; want_list >= 0; want_list--) {
        for (uint32_t bank = 0; bank < BANKS; bank++) {
            const uint32_t bit = 1U << bank;
            const bool list = (bus_get(CAN_FM1R) & bit) != 0U;
            if ((bus_get(CAN_FA1R) & bit) == 0U || list != (want_list == 1)) {
                continue;
            }
            const uint32_t words[2] = {bus_get(CAN_FR1(bank)), bus_get(CAN_FR2(bank))};
            const uint32_t received = id << 5;
            bool match = false;
            for (uint32_t i = 0; i < 2U; i++) {
                const uint32_t low = words[i] & 0xFFFFU;
                const uint32_t high = words[i] >> 16;
                match = match || (list ? low == received || high == received
                                       : ((low ^ received) & high) == 0U);
            }
            if (match) {
                return (bus_get(CAN_FFA1R) & bit) != 0U ? 1 : 0;
            }
        }
    }
    return -1;
}

void test_filters_are_the_rule_of_the_node(void) {
    for (uint32_t node = 1; node <= 127U; node++) {
        bxcan_filter((uint8_t)node);
        for (uint32_t id = 0; id < 0x800U; id++) {
            const bool accepts = motor_node_accepts((uint8_t)node, (uint16_t)id);
            const bool cyclic = id == 0x80U || id == 0x200U + node || id == 0x500U + node;
            /* 700h, which nobody sends, comes along with the heartbeats */
            const int expected = accepts || id == 0x700U ? (cyclic ? 0 : 1) : -1;
            TEST_ASSERT_EQUAL_INT_MESSAGE(expected, filtered(id), "FIFO");
        }
    }
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(CAN_FS1R));
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(CAN_FMR) & CAN_FMR_FINIT);
}

void test_without_a_node_id_lss_alone(void) {
    bxcan_filter(LSS_UNCONFIGURED);
    for (uint32_t id = 0; id < 0x800U; id++) {
        TEST_ASSERT_EQUAL_INT(id == LSS_REQUEST_COB_ID ? 1 : -1, filtered(id));
    }
}

void test_remote_and_extended_frames_stay_out(void) {
    for (uint32_t bank = 0; bank < BANKS; bank++) {
        if ((bus_get(CAN_FA1R) & (1U << bank)) != 0U && (bus_get(CAN_FM1R) & (1U << bank)) == 0U) {
            TEST_ASSERT_EQUAL_HEX32(0x00180000U, bus_get(CAN_FR1(bank)) & 0x00180018U);
            TEST_ASSERT_EQUAL_HEX32(0x00180000U, bus_get(CAN_FR2(bank)) & 0x00180018U);
        }
    }
}

/* --- receiving */

void test_frames_come_out_in_order(void) {
    can_frame_t frames[4];
    arrive(0, 0x205, 10);
    arrive(0, SYNC_COB_ID, 11);
    TEST_ASSERT_TRUE(bxcan_receive_interrupt(0, &can));
    arrive(1, 0x605, 12);
    TEST_ASSERT_FALSE(bxcan_receive_interrupt(1, &can));
    TEST_ASSERT_EQUAL_UINT(3, bxcan_receive(&can, frames, 4));
    for (uint8_t i = 0; i < 3U; i++) {
        const can_frame_t expected =
            frame_of(i == 0U ? 0x205 : (i == 1U ? 0x80 : 0x605), (uint8_t)(10U + i));
        TEST_ASSERT_EQUAL_MEMORY(&expected, &frames[i], sizeof expected);
    }
    TEST_ASSERT_EQUAL_UINT(0, bxcan_receive(&can, frames, 4));
    TEST_ASSERT_EQUAL_UINT32(3, can.counters.received);
}

void test_sync_before_other_frames_is_told(void) {
    arrive(0, SYNC_COB_ID, 1);
    arrive(0, 0x205, 2);
    TEST_ASSERT_TRUE(bxcan_receive_interrupt(0, &can));
}

void test_bytes_beyond_the_length_are_zero(void) {
    can_frame_t frame;
    fifo[1][fifo_count[1]++] = (can_frame_t){.id = 0x605, .len = 5, .data = {1, 2, 3, 4, 5, 6, 7}};
    (void)bxcan_receive_interrupt(1, &can);
    TEST_ASSERT_EQUAL_UINT(1, bxcan_receive(&can, &frame, 1));
    const uint8_t expected[8] = {1, 2, 3, 4, 5};
    TEST_ASSERT_EQUAL_UINT8_ARRAY(expected, frame.data, 8);
    fifo[1][fifo_count[1]++] = (can_frame_t){.id = 0x605, .len = 15, .data = {9}};
    (void)bxcan_receive_interrupt(1, &can);
    TEST_ASSERT_EQUAL_UINT(1, bxcan_receive(&can, &frame, 1));
    TEST_ASSERT_EQUAL_UINT8(8, frame.len); /* a length code above 8 means 8 (ISO 11898-1) */
}

void test_one_that_comes_meanwhile_is_taken_too(void) {
    can_frame_t frames[8];
    arrive(0, 0x205, 1);
    arrive(0, 0x205, 2);
    arrive(0, 0x205, 3);
    arrives_late = frame_of(SYNC_COB_ID, 4);
    late_waits = true;
    TEST_ASSERT_TRUE(bxcan_receive_interrupt(0, &can));
    TEST_ASSERT_EQUAL_UINT(4, bxcan_receive(&can, frames, 8));
}

void test_lost_frames_are_counted(void) {
    can_frame_t frame;
    arrive(1, 0x705, 1);
    overrun[1] = 1;
    (void)bxcan_receive_interrupt(1, &can);
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.fifo_overruns[1]);
    TEST_ASSERT_EQUAL_UINT32(0, can.counters.fifo_overruns[0]);
    TEST_ASSERT_EQUAL_UINT32(0, overrun[1]);
    TEST_ASSERT_EQUAL_UINT(1, bxcan_receive(&can, &frame, 1));
    for (uint32_t i = 0; i < BXCAN_RING_SIZE + 2U; i++) {
        arrive(1, 0x705, (uint8_t)i);
        (void)bxcan_receive_interrupt(1, &can);
    }
    TEST_ASSERT_EQUAL_UINT32(2, can.counters.ring_overruns);
    TEST_ASSERT_EQUAL_UINT32(3, bxcan_take_losses(&can));
    TEST_ASSERT_EQUAL_UINT32(0, bxcan_take_losses(&can));
    for (uint32_t i = 0; i < BXCAN_RING_SIZE; i++) { /* the oldest are kept, in order */
        TEST_ASSERT_EQUAL_UINT(1, bxcan_receive(&can, &frame, 1));
        TEST_ASSERT_EQUAL_UINT8(i, frame.data[0]);
    }
}

/* --- sending */

void test_a_frame_goes_into_a_mailbox(void) {
    bus_forget();
    const can_frame_t frame = {.id = 0x185, .len = 6, .data = {1, 2, 3, 4, 5, 6}};
    TEST_ASSERT_TRUE(bxcan_send(&frame, 1, &can));
    BUS_EXPECT_WRITES({CAN_TDTR(0), 6}, {CAN_TDLR(0), 0x04030201}, {CAN_TDHR(0), 0x0605},
                      {CAN_TIR(0), (0x185U << 21) | CAN_TIR_TXRQ});
    finish(0, true);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.sent);
}

void test_equal_identifiers_keep_their_order(void) {
    send(0x585, 1);
    send(0x585, 2);
    send(0x585, 3);
    TEST_ASSERT_EQUAL_UINT(2, can.waiting_count); /* one at a time, whatever is free */
    for (uint8_t i = 1; i <= 3U; i++) {
        TEST_ASSERT_EQUAL_UINT8(i, bus_get(CAN_TDLR(0)) & 0xFFU);
        finish(0, true);
        bxcan_transmit(&can);
    }
    TEST_ASSERT_EQUAL_UINT32(3, can.counters.sent);
}

void test_the_most_urgent_goes_first(void) {
    send(0x705, 0);
    send(0x585, 0);
    send(0x285, 0);
    const can_frame_t more[2] = {frame_of(0x605, 0), frame_of(0x305, 0)};
    TEST_ASSERT_TRUE(bxcan_send(more, 2, &can));
    TEST_ASSERT_EQUAL_HEX32(CAN_TSR_ABRQ0, bus_get(CAN_TSR) & 0x00808080U); /* 705h comes back */
    finish(0, false);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x305, id_in(0));
    /* 605h waits and 705h behind it; all that is in a mailbox goes before them. */
    TEST_ASSERT_EQUAL_UINT(2, can.waiting_count);
    TEST_ASSERT_EQUAL_HEX16(0x605, can.waiting[0].id);
    TEST_ASSERT_EQUAL_HEX16(0x705, can.waiting[1].id);
    TEST_ASSERT_EQUAL_HEX32(0, bus_get(CAN_TSR) & 0x00808080U);
}

void test_a_frame_called_back_stays_before_later_ones_of_its_identifier(void) {
    send(0x585, 1);
    send(0x285, 0);
    send(0x385, 0);
    send(0x585, 2);
    send(0x185, 0);
    finish(0, false);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x185, id_in(0));
    finish(1, true);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x585, id_in(1));
    TEST_ASSERT_EQUAL_UINT8(1, bus_get(CAN_TDLR(1)) & 0xFFU);
}

void test_a_frame_on_the_wire_when_called_back_is_sent_once(void) {
    send(0x705, 0);
    send(0x585, 0);
    send(0x285, 0);
    send(0x185, 0);
    finish(0, true); /* too late to call it back */
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.sent);
    TEST_ASSERT_EQUAL_HEX32(0x185, id_in(0));
    TEST_ASSERT_EQUAL_UINT(0, can.waiting_count);
}

void test_only_one_is_called_back_at_a_time(void) {
    send(0x705, 0);
    send(0x585, 0);
    send(0x285, 0);
    send(0x185, 0);
    send(0x085, 0);
    TEST_ASSERT_EQUAL_HEX32(CAN_TSR_ABRQ0, bus_get(CAN_TSR) & 0x00808080U);
    finish(0, false);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x085, id_in(0));
    TEST_ASSERT_EQUAL_HEX32(CAN_TSR_ABRQ1, bus_get(CAN_TSR) & 0x00808080U); /* now 585h */
}

void test_what_finds_no_place_is_counted(void) {
    for (uint32_t i = 0; i < BXCAN_WAITING_MAX + 1U; i++) {
        send(0x585, (uint8_t)i);
    }
    const can_frame_t frame = frame_of(0x585, 0);
    TEST_ASSERT_FALSE(bxcan_send(&frame, 1, &can));
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.send_overruns);
}

void test_all_that_find_no_place_are_told(void) {
    for (uint32_t i = 0; i < BXCAN_WAITING_MAX; i++) {
        send(0x585, (uint8_t)i);
    }
    const can_frame_t frames[3] = {frame_of(0x585, 0), frame_of(0x585, 0), frame_of(0x585, 0)};
    TEST_ASSERT_FALSE(bxcan_send(frames, 3, &can)); /* one mailbox is taken, one place is left */
    TEST_ASSERT_EQUAL_UINT32(2, can.counters.send_overruns);
}

void test_counters_saturate(void) {
    can.counters.received = UINT32_MAX;
    arrive(0, 0x205, 1);
    (void)bxcan_receive_interrupt(0, &can);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, can.counters.received);
}

/* --- errors */

void test_error_counters(void) {
    bus_set(CAN_ESR, (12U << 24) | (130U << 16) | (3U << 4) | CAN_ESR_EPVF);
    bus_forget();
    TEST_ASSERT_FALSE(bxcan_poll(&can));
    TEST_ASSERT_EQUAL_UINT8(130, can.counters.transmit_errors);
    TEST_ASSERT_EQUAL_UINT8(12, can.counters.receive_errors);
    TEST_ASSERT_EQUAL_UINT8(3, can.counters.last_error);
    BUS_EXPECT_WRITES({CAN_ESR, 7U << 4}); /* so that the next error is seen as new */
    TEST_ASSERT_FALSE(bxcan_poll(&can));
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.bus_errors);
}

void test_bus_off_throws_away_what_was_to_be_sent(void) {
    send(0x185, 0);
    send(0x585, 1);
    send(0x585, 2);
    bus_set(CAN_ESR, CAN_ESR_BOFF | (255U << 16));
    TEST_ASSERT_TRUE(bxcan_poll(&can));
    TEST_ASSERT_EQUAL_HEX32(0x00808080U, bus_get(CAN_TSR) & 0x00808080U);
    TEST_ASSERT_EQUAL_UINT32(3, can.counters.flushed);
    send(0x285, 0); /* stays in a mailbox that is free, if any; thrown away as well */
    TEST_ASSERT_TRUE(bxcan_poll(&can));
    TEST_ASSERT_EQUAL_UINT32(4, can.counters.flushed);
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.bus_off_entries);
}

void test_sends_again_after_bus_off(void) {
    send(0x185, 0);
    bus_set(CAN_ESR, CAN_ESR_BOFF);
    TEST_ASSERT_TRUE(bxcan_poll(&can));
    finish(0, false); /* the abort, long after it was asked for */
    bus_set(CAN_ESR, 0);
    TEST_ASSERT_FALSE(bxcan_poll(&can));
    send(0x585, 7);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x585, id_in(0));
    TEST_ASSERT_EQUAL_UINT(0, can.waiting_count);
    finish(0, true);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_UINT32(1, can.counters.sent);
}

void test_a_flushed_mailbox_is_not_filled_before_it_is_empty(void) {
    send(0x185, 0);
    send(0x285, 0);
    send(0x385, 0);
    bus_set(CAN_ESR, CAN_ESR_BOFF);
    TEST_ASSERT_TRUE(bxcan_poll(&can));
    bus_set(CAN_ESR, 0);
    TEST_ASSERT_FALSE(bxcan_poll(&can));
    bus_forget();
    send(0x085, 0);
    TEST_ASSERT_EQUAL_UINT(0, bus_writes());
    TEST_ASSERT_EQUAL_UINT(1, can.waiting_count);
    finish(2, false);
    bxcan_transmit(&can);
    TEST_ASSERT_EQUAL_HEX32(0x085, id_in(2));
}
