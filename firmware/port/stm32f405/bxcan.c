#include "port/stm32f405/bxcan.h"

#include <stdatomic.h>

#include "canopen/lss.h"
#include "canopen/sync.h"
#include "node/motor_node.h"
#include "od/object_dictionary.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

enum {
    WAIT_READS = 20000,
    PRESCALER = 2,
    QUANTA_BEFORE_SAMPLE = 16, /* beside the one of the synchronisation segment */
    QUANTA_AFTER_SAMPLE = 4,
    QUANTA_JUMP = 4,
    LEC_NONE = 0,
    LEC_SET_BY_SOFTWARE = 7,
    DATA_BYTES_MAX = 8
};

/* Layout of a 16-bit filter (RM0090 figure 342): STID 15..5, RTR 4, IDE 3. */
#define FILTER_ID_SHIFT 5U
#define FILTER_KIND 0x18U /* RTR and IDE: must be 0 */

#define ID_COUNT 0x800U
#define GROUP_SIZE 0x80U
/* From this many identifiers of one function code on, all of them are let through. */
#define GROUP_MIN 8U
#define LIST_SIZE 4U
#define MASK_SIZE 2U

static void count(uint32_t *counter) {
    if (*counter < UINT32_MAX) {
        (*counter)++;
    }
}

/* --- filters ------------------------------------------------------------------------------------
 */

/** Filters of one kind for one FIFO are gathered here until they fill a bank. */
typedef struct {
    uint32_t half[4]; /* list: four identifiers; mask: identifier, mask, identifier, mask */
    uint32_t used;
    uint32_t size;
    uint32_t fifo;
    bool list;
} bank_t;

static void write_bank(bank_t *bank, uint32_t *banks) {
    if (bank->used == 0U) {
        return;
    }
    for (uint32_t i = bank->used; i < 4U; i++) { /* the rest repeats the first one */
        bank->half[i] = bank->half[i % bank->size];
    }
    const uint32_t bit = 1U << *banks;
    register_write(CAN_FR1(*banks), bank->half[0] | (bank->half[1] << 16));
    register_write(CAN_FR2(*banks), bank->half[2] | (bank->half[3] << 16));
    register_modify(CAN_FM1R, bit, bank->list ? bit : 0U);
    register_modify(CAN_FFA1R, bit, bank->fifo != 0U ? bit : 0U);
    register_set(CAN_FA1R, bit);
    (*banks)++;
    bank->used = 0;
}

static void add_identifier(uint32_t id, bank_t *bank, uint32_t *banks) {
    bank->half[bank->used++] = id << FILTER_ID_SHIFT;
    if (bank->used == LIST_SIZE) {
        write_bank(bank, banks);
    }
}

static void add_group(uint32_t first, bank_t *bank, uint32_t *banks) {
    const uint32_t mask = (ID_COUNT - GROUP_SIZE) << FILTER_ID_SHIFT;
    bank->half[bank->used++] = first << FILTER_ID_SHIFT;
    bank->half[bank->used++] = mask | FILTER_KIND;
    if (bank->used == 2U * MASK_SIZE) {
        write_bank(bank, banks);
    }
}

static bool cyclic(uint8_t node_id, uint32_t id) {
    return id == SYNC_COB_ID || (node_id != LSS_UNCONFIGURED && (id == OD_RPDO1_COB_ID + node_id ||
                                                                 id == OD_RPDO4_COB_ID + node_id));
}

void bxcan_filter(uint8_t node_id) {
    bank_t lists[2] = {{.size = 1, .fifo = BXCAN_FIFO_CYCLIC, .list = true},
                       {.size = 1, .fifo = BXCAN_FIFO_OTHER, .list = true}};
    bank_t groups = {.size = 2, .fifo = BXCAN_FIFO_OTHER};
    uint32_t banks = 0;
    register_set(CAN_FMR, CAN_FMR_FINIT);
    register_write(CAN_FA1R, 0);
    register_write(CAN_FS1R, 0); /* 16 bits: a list goes before a mask (RM0090 32.7.4) */
    for (uint32_t first = 0; first < ID_COUNT; first += GROUP_SIZE) {
        uint32_t accepted = 0;
        for (uint32_t id = first; id < first + GROUP_SIZE; id++) {
            accepted += motor_node_accepts(node_id, (uint16_t)id) ? 1U : 0U;
        }
        const bool whole = accepted >= GROUP_MIN;
        if (whole) {
            add_group(first, &groups, &banks);
        }
        for (uint32_t id = first; id < first + GROUP_SIZE; id++) {
            const bool to_cyclic = cyclic(node_id, id);
            if ((to_cyclic || !whole) && motor_node_accepts(node_id, (uint16_t)id)) {
                add_identifier(id, &lists[to_cyclic ? 0 : 1], &banks);
            }
        }
    }
    write_bank(&lists[0], &banks);
    write_bank(&lists[1], &banks);
    write_bank(&groups, &banks);
    register_clear(CAN_FMR, CAN_FMR_FINIT);
}

/* --- start --------------------------------------------------------------------------------------
 */

bxcan_start_t bxcan_start(uint8_t node_id, bxcan_t *can) {
    *can = (bxcan_t){0};
    register_set(RCC_APB1ENR, RCC_APB1ENR_CAN1EN);
    register_set(RCC_APB1RSTR, RCC_APB1RSTR_CAN1RST);
    register_clear(RCC_APB1RSTR, RCC_APB1RSTR_CAN1RST);
    register_write(CAN_MCR, CAN_MCR_INRQ); /* and out of sleep */
    if (!register_wait(CAN_MSR, CAN_MSR_INAK | CAN_MSR_SLAK, CAN_MSR_INAK, WAIT_READS)) {
        return BXCAN_ABSENT;
    }
    register_write(CAN_BTR, register_field(CAN_BTR_BRP, PRESCALER - 1U) |
                                register_field(CAN_BTR_TS1, QUANTA_BEFORE_SAMPLE - 1U) |
                                register_field(CAN_BTR_TS2, QUANTA_AFTER_SAMPLE - 1U) |
                                register_field(CAN_BTR_SJW, QUANTA_JUMP - 1U));
    bxcan_filter(node_id);
    register_write(CAN_ESR, register_field(CAN_ESR_LEC, LEC_SET_BY_SOFTWARE));
    register_write(CAN_IER, CAN_IER_FMPIE0 | CAN_IER_FMPIE1);
    register_write(CAN_MCR, CAN_MCR_ABOM);
    return register_wait(CAN_MSR, CAN_MSR_INAK, 0, WAIT_READS) ? BXCAN_STARTED
                                                               : BXCAN_WAITS_FOR_BUS;
}

/* --- receiving ----------------------------------------------------------------------------------
 */

static void unpack(uint32_t low, uint32_t high, can_frame_t *frame) {
    for (uint32_t i = 0; i < frame->len; i++) {
        frame->data[i] = (uint8_t)((i < 4U ? low : high) >> (8U * (i % 4U)));
    }
}

static void put_into_ring(const can_frame_t *frame, bxcan_t *can) {
    const uint32_t head = can->ring_head;
    if (head - can->ring_tail >= BXCAN_RING_SIZE) {
        count(&can->counters.ring_overruns);
        return;
    }
    can->ring[head % BXCAN_RING_SIZE] = *frame;
    atomic_signal_fence(memory_order_release);
    can->ring_head = head + 1U; /* last: the tick sees a whole frame */
    count(&can->counters.received);
}

bool bxcan_receive_interrupt(uint32_t fifo, bxcan_t *can) {
    bool sync = false;
    /* Three are in the FIFO; one more may come while they are taken out. */
    for (uint32_t frames = 0; frames < 4U; frames++) {
        const uint32_t state = register_read(CAN_RFR(fifo));
        if ((state & CAN_RFR_FOVR) != 0U) {
            count(&can->counters.fifo_overruns[fifo]);
            register_write(CAN_RFR(fifo), CAN_RFR_FOVR);
        }
        if ((state & CAN_RFR_FMP) == 0U) {
            break;
        }
        const uint32_t length = register_field_of(CAN_RDTR_DLC, register_read(CAN_RDTR(fifo)));
        can_frame_t frame = {
            .id = (uint16_t)register_field_of(CAN_RIR_STID, register_read(CAN_RIR(fifo))),
            .len = (uint8_t)(length < DATA_BYTES_MAX ? length : DATA_BYTES_MAX),
        };
        const uint32_t low = register_read(CAN_RDLR(fifo));
        unpack(low, register_read(CAN_RDHR(fifo)), &frame);
        register_write(CAN_RFR(fifo), CAN_RFR_RFOM);
        put_into_ring(&frame, can);
        sync = sync || frame.id == SYNC_COB_ID;
        /* The FIFO needs two bus cycles before its state is read again; RFOM is 1 until then. */
        (void)register_wait(CAN_RFR(fifo), CAN_RFR_RFOM, 0, 8);
    }
    return sync;
}

size_t bxcan_receive(bxcan_t *can, can_frame_t *frames, size_t size) {
    size_t taken = 0;
    uint32_t tail = can->ring_tail;
    while (taken < size && tail != can->ring_head) {
        frames[taken++] = can->ring[tail % BXCAN_RING_SIZE];
        tail++;
    }
    atomic_signal_fence(
        memory_order_release); /* the copies are made before their places are free */
    can->ring_tail = tail;
    return taken;
}

uint32_t bxcan_take_losses(bxcan_t *can) {
    const bxcan_counters_t *counters = &can->counters;
    const uint32_t losses =
        counters->fifo_overruns[0] + counters->fifo_overruns[1] + counters->ring_overruns;
    const uint32_t new_losses = losses - can->losses_taken;
    can->losses_taken = losses;
    return new_losses;
}

/* --- sending ------------------------------------------------------------------------------------
 */

/** Puts a frame where it belongs by identifier: behind equal ones, or before them if it is older.
 */
static bool wait_in_line(const can_frame_t *frame, bool older, bxcan_t *can) {
    size_t place = 0;
    if (can->waiting_count == BXCAN_WAITING_MAX) {
        count(&can->counters.send_overruns);
        return false;
    }
    while (place < can->waiting_count && (can->waiting[place].id < frame->id ||
                                          (!older && can->waiting[place].id == frame->id))) {
        place++;
    }
    for (size_t i = can->waiting_count; i > place; i--) {
        can->waiting[i] = can->waiting[i - 1U];
    }
    can->waiting[place] = *frame;
    can->waiting_count++;
    return true;
}

static uint32_t of_mailbox(uint32_t bit_of_first, size_t mailbox) {
    return bit_of_first << (8U * mailbox);
}

/** Takes note of mailboxes that are done: sent, or called back. */
static void settle(bxcan_t *can) {
    const uint32_t state = register_read(CAN_TSR);
    for (size_t i = 0; i < BXCAN_MAILBOXES; i++) {
        if (!can->taken[i] || (state & of_mailbox(CAN_TSR_RQCP0, i)) == 0U) {
            continue;
        }
        register_write(CAN_TSR, of_mailbox(CAN_TSR_RQCP0, i)); /* clears the mailbox's other bits */
        can->taken[i] = false;
        if ((state & of_mailbox(CAN_TSR_TXOK0, i)) != 0U) {
            count(&can->counters.sent);
        } else {
            (void)wait_in_line(&can->in_mailbox[i], true, can);
        }
    }
}

static bool in_a_mailbox(uint16_t id, const bxcan_t *can) {
    for (size_t i = 0; i < BXCAN_MAILBOXES; i++) {
        if (can->taken[i] && can->in_mailbox[i].id == id) {
            return true;
        }
    }
    return false;
}

static void fill(size_t mailbox, const can_frame_t *frame, bxcan_t *can) {
    uint32_t words[2] = {0, 0};
    for (uint32_t i = 0; i < DATA_BYTES_MAX; i++) {
        words[i / 4U] |= (uint32_t)frame->data[i] << (8U * (i % 4U));
    }
    can->in_mailbox[mailbox] = *frame;
    can->taken[mailbox] = true;
    register_write(CAN_TDTR((uint32_t)mailbox), register_field(CAN_TDTR_DLC, frame->len));
    register_write(CAN_TDLR((uint32_t)mailbox), words[0]);
    register_write(CAN_TDHR((uint32_t)mailbox), words[1]);
    register_write(CAN_TIR((uint32_t)mailbox),
                   register_field(CAN_TIR_STID, frame->id) | CAN_TIR_TXRQ);
}

static void remove_waiting(size_t place, bxcan_t *can) {
    can->waiting_count--;
    for (size_t i = place; i < can->waiting_count; i++) {
        can->waiting[i] = can->waiting[i + 1U];
    }
}

/** Calls back the least urgent mailbox for a more urgent frame; asked for again, it changes
 * nothing.
 */
static void call_back(uint16_t id, bxcan_t *can) {
    size_t least = 0;
    for (size_t i = 0; i < BXCAN_MAILBOXES; i++) {
        if (!can->taken[i]) {
            return; /* flushed: it will be free without that */
        }
        least = can->in_mailbox[i].id > can->in_mailbox[least].id ? i : least;
    }
    if (can->in_mailbox[least].id > id) {
        register_write(CAN_TSR, of_mailbox(CAN_TSR_ABRQ0, least));
    }
}

void bxcan_transmit(bxcan_t *can) {
    settle(can);
    const uint32_t empty = register_read(CAN_TSR); /* a flushed mailbox may not be done yet */
    size_t place = 0;
    while (place < can->waiting_count) {
        const can_frame_t frame = can->waiting[place];
        size_t mailbox = 0;
        if (in_a_mailbox(frame.id, can)) {
            place++;
            continue;
        }
        while (mailbox < BXCAN_MAILBOXES &&
               (can->taken[mailbox] || (empty & (CAN_TSR_TME0 << mailbox)) == 0U)) {
            mailbox++;
        }
        if (mailbox == BXCAN_MAILBOXES) {
            call_back(frame.id, can);
            return;
        }
        remove_waiting(place, can);
        fill(mailbox, &frame, can);
    }
}

bool bxcan_send(const can_frame_t *frames, size_t frame_count, bxcan_t *can) {
    bool all = true;
    for (size_t i = 0; i < frame_count; i++) {
        if (!wait_in_line(&frames[i], false, can)) {
            all = false;
        }
    }
    bxcan_transmit(can);
    return all;
}

/* --- errors -------------------------------------------------------------------------------------
 */

static void flush(bxcan_t *can) {
    register_write(CAN_TSR, CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2);
    for (size_t i = 0; i < BXCAN_MAILBOXES; i++) {
        if (can->taken[i]) {
            count(&can->counters.flushed);
        }
        can->taken[i] = false;
    }
    for (; can->waiting_count > 0U; can->waiting_count--) {
        count(&can->counters.flushed);
    }
}

bool bxcan_poll(bxcan_t *can) {
    const uint32_t state = register_read(CAN_ESR);
    const uint32_t error = register_field_of(CAN_ESR_LEC, state);
    const bool bus_off = (state & CAN_ESR_BOFF) != 0U;
    can->counters.transmit_errors = (uint8_t)register_field_of(CAN_ESR_TEC, state);
    can->counters.receive_errors = (uint8_t)register_field_of(CAN_ESR_REC, state);
    if (error != LEC_NONE && error != LEC_SET_BY_SOFTWARE) {
        count(&can->counters.bus_errors);
        can->counters.last_error = (uint8_t)error;
        register_write(CAN_ESR, register_field(CAN_ESR_LEC, LEC_SET_BY_SOFTWARE));
    }
    if (bus_off && !can->bus_off) {
        count(&can->counters.bus_off_entries);
    }
    if (bus_off) {
        flush(can);
    }
    can->bus_off = bus_off;
    return bus_off;
}
