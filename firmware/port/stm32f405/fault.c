#include "port/stm32f405/fault.h"

#include <stddef.h>
#include <string.h>

#include "node/crc32.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

#define RECORD_MAGIC 0x48435243U /* "CRCH" */
/* PIN_SERVO_ENABLE of board_pins.h, PB13: low by one store. The assembler wants plain numbers;
 * tests/image compares them with the pin. */
#define ENABLE_BSRR (GPIOB_BASE + 0x18U)
#define ENABLE_OFF (1U << (13U + 16U))
#define AIRCR_KEY 0x05FAU
#define EMERGENCY_STACK_BYTES 192U

/* Stacked at exception entry (DDI 0403E, B1.5.6). */
#define FRAME_LINK 5U
#define FRAME_PROGRAM_COUNTER 6U
#define FRAME_PROGRAM_STATUS 7U

#define EXCEPTION_HARD_FAULT 3U
#define EXCEPTION_MEMORY 4U
#define EXCEPTION_BUS 5U
#define EXCEPTION_USAGE 6U

typedef struct {
    uint32_t magic;
    uint32_t fresh; /* 1 until it was taken */
    crash_record_t record;
    uint32_t crc;
} kept_t;

__attribute__((section(".noinit"))) static kept_t kept;
__attribute__((section(".noinit"), aligned(8),
               used)) static uint8_t fault_stack[EMERGENCY_STACK_BYTES];

static volatile bool probing;
static volatile bool probe_failed;

extern uint8_t stack_guard[]; /* stm32f405.ld */
extern uint8_t stack_end[];
extern uint8_t stack_begin[];

void fault_init(void) {
    /* Region 0: no access; 32 bytes; what no region covers stays as it is. */
    register_write(MPU_RNR, 0);
    register_write(MPU_RBAR, (uint32_t)(uintptr_t)stack_guard);
    register_write(MPU_RASR, MPU_RASR_XN | register_field(MPU_RASR_SIZE, 4U) | MPU_RASR_ENABLE);
    register_write(MPU_CTRL, MPU_CTRL_PRIVDEFENA | MPU_CTRL_ENABLE);
    register_set(SCB_SHCSR, SCB_SHCSR_MEMFAULTENA | SCB_SHCSR_BUSFAULTENA | SCB_SHCSR_USGFAULTENA);
    register_set(SCB_CCR, SCB_CCR_DIV_0_TRP);
    __asm__ volatile("dsb\n\tisb" ::: "memory");
}

/* --- the record */

static uint32_t checksum(void) {
    return crc32((const uint8_t *)&kept, offsetof(kept_t, crc), 0);
}

static bool is_valid(void) {
    return kept.magic == RECORD_MAGIC && kept.crc == checksum();
}

static void begin_record(crash_cause_t cause) {
    const uint16_t before = is_valid() ? kept.record.count : 0U;
    memset(&kept, 0, sizeof kept);
    kept.magic = RECORD_MAGIC;
    kept.fresh = 1;
    kept.record.cause = cause;
    kept.record.count = before == UINT16_MAX ? UINT16_MAX : (uint16_t)(before + 1U);
}

void fault_keep(crash_cause_t cause) {
    begin_record(cause);
    kept.crc = checksum();
}

bool fault_take_record(crash_record_t *record) {
    memset(record, 0, sizeof *record);
    if (!is_valid()) {
        return false;
    }
    const bool fresh = kept.fresh != 0U;
    *record = kept.record;
    kept.fresh = 0;
    kept.crc = checksum();
    return fresh;
}

_Noreturn void fault_end(crash_cause_t cause, const uint32_t *frame) {
    register_write(ENABLE_BSRR, ENABLE_OFF);
    begin_record(cause);
    if (frame != NULL) {
        kept.record.program_counter = frame[FRAME_PROGRAM_COUNTER];
        kept.record.link_register = frame[FRAME_LINK];
        kept.record.program_status = frame[FRAME_PROGRAM_STATUS];
    }
    kept.record.fault_status = register_read(SCB_CFSR);
    kept.record.hard_fault_status = register_read(SCB_HFSR);
    kept.record.fault_address =
        (kept.record.fault_status & SCB_CFSR_MMARVALID) != 0U   ? register_read(SCB_MMFAR)
        : (kept.record.fault_status & SCB_CFSR_BFARVALID) != 0U ? register_read(SCB_BFAR)
                                                                : 0U;
    kept.crc = checksum();
    __asm__ volatile("dsb" ::: "memory");
    register_write(SCB_AIRCR, register_field(SCB_AIRCR_VECTKEY, AIRCR_KEY) |
                                  (register_read(SCB_AIRCR) & SCB_AIRCR_PRIGROUP) |
                                  SCB_AIRCR_SYSRESETREQ);
    for (;;) { /* the reset takes some cycles */
    }
}

/* --- exceptions */

static bool is_guard(uint32_t status, uint32_t stack_pointer) {
    const bool at_guard = (status & SCB_CFSR_MMARVALID) != 0U &&
                          register_read(SCB_MMFAR) - (uint32_t)(uintptr_t)stack_guard <
                              (uint32_t)((uintptr_t)stack_end - (uintptr_t)stack_guard);
    const bool stacking = (status & (SCB_CFSR_MSTKERR | SCB_CFSR_STKERR | SCB_CFSR_MLSPERR)) != 0U;
    return at_guard || stacking || stack_pointer < (uint32_t)(uintptr_t)stack_end;
}

static crash_cause_t cause_of(uint32_t exception, const uint32_t *frame) {
    if (is_guard(register_read(SCB_CFSR), (uint32_t)(uintptr_t)frame)) {
        return CRASH_STACK_OVERFLOW;
    }
    switch (exception) {
    case EXCEPTION_HARD_FAULT:
        return CRASH_HARD_FAULT;
    case EXCEPTION_MEMORY:
        return CRASH_MEMORY_FAULT;
    case EXCEPTION_BUS:
        return CRASH_BUS_FAULT;
    case EXCEPTION_USAGE:
        return CRASH_USAGE_FAULT;
    default:
        return CRASH_UNEXPECTED;
    }
}

/* Returns only from a probe, behind the load that has failed. */
/* cppcheck-suppress unusedFunction ; fault_entry calls it */
__attribute__((used)) static void fault_handle(uint32_t *frame) {
    const uint32_t exception = register_field_of(SCB_ICSR_VECTACTIVE, register_read(SCB_ICSR));
    if (probing && exception == EXCEPTION_BUS) {
        probing = false;
        probe_failed = true;
        register_write(SCB_CFSR, register_read(SCB_CFSR)); /* written ones are cleared */
        frame[FRAME_PROGRAM_COUNTER] += 4U;
        return;
    }
    const crash_cause_t cause = cause_of(exception, frame);
    const uintptr_t at = (uintptr_t)frame;
    const bool stacked = at >= (uintptr_t)stack_end && at < (uintptr_t)stack_begin;
    fault_end(cause, stacked ? frame : NULL);
}

/* The first three instructions take the torque off, whatever else is broken. */
__attribute__((naked)) void fault_entry(void) {
    __asm__ volatile("ldr r0, =%c0\n\t"
                     "ldr r1, =%c1\n\t"
                     "str r1, [r0]\n\t"
                     "mrs r0, msp\n\t"
                     "ldr r1, =fault_stack + %c2\n\t"
                     "mov sp, r1\n\t"
                     "push {r0, lr}\n\t"
                     "bl fault_handle\n\t"
                     "pop {r0, lr}\n\t"
                     "mov sp, r0\n\t"
                     "bx lr\n\t"
                     ".ltorg" ::"i"(ENABLE_BSRR),
                     "i"(ENABLE_OFF), "i"(EMERGENCY_STACK_BYTES));
}

bool fault_probe(uint32_t address, uint32_t *value) {
    /* cppcheck-suppress variableScope ; the assembler sets it */
    uint32_t found = 0;
    probe_failed = false;
    probing = true;
    __asm__ volatile("ldr.w %0, [%1]\n\tdsb" : "=&r"(found) : "r"(address) : "memory");
    probing = false;
    if (!probe_failed) {
        *value = found;
    }
    return !probe_failed;
}
