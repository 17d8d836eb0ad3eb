/*
 * How many instructions the firmware takes: the library of the image, objects unchanged, on the
 * image's start-up and linker script, with this main in place of the image's. For QEMU with
 * -icount shift=0, where one instruction is one nanosecond and TIM2 counts nanoseconds.
 *
 * Reads vectors.bin (tests/vectors), writes counts.bin: records of three 32-bit numbers, what was
 * measured (measurement_t), instructions, and a value that shows that the work was done.
 * tools/hpmc/bench_firmware.py runs it and reads them. Exit status 0, or the line that failed.
 */
#include "node_rig.h"
#include "port/stm32f405/fault.h"
#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"
#include "semihosting.h"

#define REQUIRE(condition)                                                                         \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            semihosting_exit(__LINE__);                                                            \
        }                                                                                          \
    } while (0)

#define EVENT_COMMAND 1U
#define EVENT_RESET 2U
#define EVENT_HOLD 4U

#define OVERHEAD_ROUNDS 16
#define SYNC_ROUNDS 2000
#define SDO_ROUNDS 16
#define STEPS_READ 8U
#define RECORDS_KEPT 32U

void main_prepare(void); /* of startup.c, as main */
int main(void);

typedef enum {
    MEASURED_OVERHEAD,     /* nothing between the two readings */
    MEASURED_TICK,         /* a joint tick of the vectors */
    MEASURED_TICK_DERATED, /* the same, with the torque derated by temperature, load and speed at
                              once */
    MEASURED_SYNC_TURN,    /* RPDO1 and SYNC in, TPDO1 out */
    MEASURED_IDLE_STEP,    /* no frames in */
    MEASURED_SDO_UPLOAD,   /* expedited, of 4 bytes */
    MEASURED_SDO_DOWNLOAD, /* expedited, of 4 bytes */
    MEASURED_KNOWN         /* 1000 instructions, so that the measure is measured */
} measurement_t;

/* The layout of tests/vectors/joint_vectors.py. */
typedef struct {
    uint32_t increments_per_revolution;
    uint32_t ticks_per_sync;
    uint32_t error_growth;
    uint32_t q_a_urad;
    uint32_t q_p_urad;
    uint32_t q_b_urad;
    uint32_t torque_limit_mNm;
    uint32_t delta_inc256;
    uint32_t stall_time_us;
    uint32_t steep;
    int32_t position_min_inc;
    int32_t position_max_inc;
    uint32_t reference[2];
} lane_t;

typedef struct {
    uint32_t events;
    uint32_t elapsed_us;
    int32_t position_inc;
    uint32_t ramp_ppm;
    int32_t target_inc;
    int32_t torque_mNm;
    int32_t torque_max_mNm;
    uint32_t reference[19];
} step_t;

typedef struct {
    uint32_t what;
    uint32_t instructions;
    int32_t value;
} record_t;

static int32_t counts;
static record_t records[RECORDS_KEPT];
static size_t records_used;
static step_t steps[STEPS_READ];

static void write_records(void) {
    REQUIRE(semihosting_write(counts, records, records_used * sizeof records[0]) == 0);
    records_used = 0;
}

static void record(measurement_t what, uint32_t instructions, int32_t value) {
    const record_t one = {.what = what, .instructions = instructions, .value = value};
    records[records_used++] = one;
    if (records_used == RECORDS_KEPT) {
        write_records();
    }
}

/** Keeps the compiler from moving work across. */
static inline uint32_t now(void) {
    __asm__ volatile("" ::: "memory");
    const uint32_t ns = register_read(TIM_CNT(TIM2_BASE));
    __asm__ volatile("" ::: "memory");
    return ns;
}

static void measure_overhead(void) {
    for (int i = 0; i < OVERHEAD_ROUNDS; i++) {
        const uint32_t begin = now();
        const uint32_t end = now();
        record(MEASURED_OVERHEAD, end - begin, 0);
    }
}

static void measure_known(void) {
    for (int i = 0; i < OVERHEAD_ROUNDS; i++) {
        const uint32_t begin = now();
        __asm__ volatile(".rept 1000\n\tnop\n\t.endr");
        const uint32_t end = now();
        record(MEASURED_KNOWN, end - begin, 0);
    }
}

/* --- the joint tick */

static joint_controller_config_t config_of(const lane_t *lane) {
    const joint_controller_config_t config = {
        .fic =
            {
                .phase_rule = lane->error_growth != 0U ? FIC_ERROR_GROWTH : FIC_BODY_MOTION,
                .delta_inc256 = (uint16_t)lane->delta_inc256,
                .delta_rad = angle_part(angle_scale(lane->increments_per_revolution, 1).step_rad,
                                        (uint16_t)lane->delta_inc256, 256),
                .stall_time_us = lane->stall_time_us,
            },
        .q_a_rad = angle_from_urad(lane->q_a_urad),
        .q_p_rad = angle_from_urad(lane->q_p_urad),
        .q_b_rad = angle_from_urad(lane->q_b_urad),
        .torque_limit_Nm = torque_from_mNm((int32_t)lane->torque_limit_mNm, 1),
        .scale = angle_scale(lane->increments_per_revolution, lane->ticks_per_sync),
        .ticks_per_sync = (uint8_t)lane->ticks_per_sync,
    };
    return config;
}

static joint_command_t command_of(const step_t *step) {
    const joint_command_t command = {.position_inc = step->target_inc,
                                     .torque_mNm = (int16_t)step->torque_mNm,
                                     .torque_max_mNm = (uint16_t)step->torque_max_mNm};
    return command;
}

/** What is measured: from command and position to the set value in mN m, as node_drive.c goes. */
__attribute__((noinline)) static int16_t joint_tick(const joint_controller_config_t *config,
                                                    const lane_t *lane, const step_t *step,
                                                    const joint_command_t *command,
                                                    const derating_input_t *motor, int8_t moving,
                                                    joint_controller_t *controller) {
    if ((step->events & EVENT_COMMAND) != 0U) {
        joint_controller_command(command, controller);
    }
    if ((step->events & EVENT_RESET) != 0U) {
        joint_controller_reset(step->position_inc, command, controller);
    }
    if ((step->events & EVENT_HOLD) != 0U) {
        joint_controller_hold(step->position_inc, controller);
    }
    joint_controller_output_t asked;
    joint_controller_step(config, step->position_inc, step->elapsed_us, controller, &asked);
    const torque_guard_input_t input = {
        .torque_Nm = asked.torque_Nm,
        .torque_before_Nm = 0,
        .elapsed_us = step->elapsed_us,
        .slope_mNm_s = TORQUE_GUARD_SLOPE_OFF, /* as in mode -1 */
        .torque_limit_Nm = config->torque_limit_Nm,
        .ramp_ppm = step->ramp_ppm,
        .torque_max_Nm = asked.torque_max_Nm,
        .f_max_Nm = asked.f_max_Nm,
        .position_inc = step->position_inc,
        .position_min_inc = lane->position_min_inc,
        .position_max_inc = lane->position_max_inc,
        .moving = moving,
        .motor = *motor,
    };
    return torque_guard(&input).torque_mNm;
}

static void measure_tick(const joint_controller_config_t *config, const lane_t *lane,
                         const step_t *step, joint_controller_t *controller) {
    static const derating_input_t cool = {.temperature_end_dC = 1};
    static const derating_input_t derated = {.temperature_dC = 900,
                                             .temperature_begin_dC = 800,
                                             .temperature_end_dC = 1000,
                                             .load_ppm = 1300000,
                                             .speed_ppm = 950000,
                                             .speed_begin_ppm = 900000};
    const joint_command_t command = command_of(step);
    joint_controller_t twin = *controller;
    uint32_t begin = now();
    int16_t torque_mNm = joint_tick(config, lane, step, &command, &cool, 0, controller);
    uint32_t end = now();
    record(MEASURED_TICK, end - begin, torque_mNm);
    const int8_t moving = (int8_t)(torque_mNm < 0 ? -1 : 1); /* so that speed counts too */
    begin = now();
    torque_mNm = joint_tick(config, lane, step, &command, &derated, moving, &twin);
    end = now();
    record(MEASURED_TICK_DERATED, end - begin, torque_mNm);
}

static void measure_lane(int32_t vectors, uint32_t count) {
    lane_t lane;
    joint_controller_t controller = {0};
    REQUIRE(semihosting_read(vectors, &lane, sizeof lane) == 0);
    const joint_controller_config_t config = config_of(&lane);
    REQUIRE(count % STEPS_READ == 0U);
    for (uint32_t i = 0; i < count; i++) {
        const step_t *step = &steps[i % STEPS_READ];
        if (i % STEPS_READ == 0U) {
            REQUIRE(semihosting_read(vectors, steps, sizeof steps) == 0);
        }
        if (i == 0U) {
            const joint_command_t command = command_of(step);
            joint_controller_reset(step->position_inc, &command, &controller);
        }
        measure_tick(&config, &lane, step, &controller);
    }
}

static void measure_ticks(void) {
    static const char name[] = "vectors.bin";
    const int32_t vectors = semihosting_open(name, sizeof name - 1U, SEMIHOSTING_READ_BINARY);
    uint32_t sizes[2]; /* lanes, steps of each */
    REQUIRE(vectors >= 0);
    REQUIRE(semihosting_read(vectors, sizes, sizeof sizes) == 0);
    for (uint32_t lane = 0; lane < sizes[0]; lane++) {
        measure_lane(vectors, sizes[1]);
    }
}

/* --- the node */

__attribute__((noinline)) static void measure_step(measurement_t what) {
    const uint32_t begin = now();
    rig_step();
    const uint32_t end = now();
    record(what, end - begin, rig.output.torque_mNm);
}

/** The joint swings about the desired position, so that it diverges and converges. */
static void measure_sync_turns(void) {
    for (int i = 0; i < SYNC_ROUNDS; i++) {
        const int phase = i % 160;
        rig.input.position_inc = rig.desired_inc - 200 + 5 * (phase < 80 ? phase : 160 - phase);
        rig_command(rig.desired_inc, 3000, 4000);
        rig_sync();
        measure_step(MEASURED_SYNC_TURN);
        REQUIRE(rig_sent(0x180 + NODE_ID) != NULL && rig.output.output_enabled);
    }
}

/** Between two SYNCs, so that the step alone can be subtracted. */
static void measure_sdo(void) {
    for (int i = 0; i < SDO_ROUNDS; i++) {
        rig_cycle();
        rig.input.elapsed_us = 200;
        measure_step(MEASURED_IDLE_STEP);
        rig_read(0x6064, 0);
        measure_step(MEASURED_SDO_UPLOAD);
        REQUIRE(rig_abort() == 0U);
        rig_write(0x6065, 0, 4, 20000U + (uint32_t)i);
        measure_step(MEASURED_SDO_DOWNLOAD);
        REQUIRE(rig_abort() == 0U);
        rig.input.elapsed_us = 400;
    }
}

static void measure_node(void) {
    rig_init();
    rig.input.current_mA = 1500;
    rig_run();
    measure_sync_turns();
    measure_sdo();
}

void main_prepare(void) {}

int main(void) {
    static const char name[] = "counts.bin";
    counts = semihosting_open(name, sizeof name - 1U, SEMIHOSTING_WRITE_BINARY);
    REQUIRE(counts >= 0);
    register_set(RCC_APB1ENR, RCC_APB1ENR_TIM2EN);
    register_write(TIM_PSC(TIM2_BASE), 0);
    register_write(TIM_ARR(TIM2_BASE), UINT32_MAX);
    register_write(TIM_CR1(TIM2_BASE), TIM_CR1_CEN);
    measure_overhead();
    measure_known();
    measure_ticks();
    measure_node();
    write_records();
    semihosting_exit(0);
}

/* Of the vector table. No interrupt is enabled; a fault ends the run. */

void fault_entry(void) {
    semihosting_exit(1);
}

void interrupt_time(void) {
    fault_entry();
}

void interrupt_node(void) {
    fault_entry();
}

void interrupt_tick_timer(void) {
    fault_entry();
}

void interrupt_can_cyclic(void) {
    fault_entry();
}

void interrupt_can_other(void) {
    fault_entry();
}

void interrupt_usart1(void) {
    fault_entry();
}
