/*
 * The joint controller and the guard against the double-precision reference, tick by tick, over the
 * shared vectors (tests/vectors/README.md): torque within 1 mN m wherever the phases agree.
 *
 * A step is excused when it differs although the comparison that decided its phase or latch was
 * within one unit of a tie: 2^-29 rad, or the rounding of a float of that size. The controller then
 * takes over the state of the reference. Positions, directions and times must agree always.
 */
#include "unity.h"

#include <stdio.h>

#include "control/joint_controller.h"
#include "control/torque_guard.h"
#include "numbers.h"

#define EVENT_COMMAND 1U
#define EVENT_RESET 2U
#define EVENT_HOLD 4U

#define LEAST_STEPS 100000U
#define EXCUSED_LIMIT 0.001

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
    double tolerance_Nm;
} lane_t;

typedef struct {
    uint32_t events;
    uint32_t elapsed_us;
    int32_t position_inc;
    uint32_t ramp_ppm;
    int32_t target_inc;
    int32_t torque_mNm;
    int32_t torque_max_mNm;
    /* what the reference says, after the step */
    int32_t converging;
    int32_t direction;
    int32_t sign;
    int32_t extreme_inc;
    uint32_t age_us;
    int32_t guarded_mNm;
    int32_t unused;
    double error_rad;
    double torque_Nm;
    double f_max_Nm;
    double a_max_rad;
    double extreme_rad;
    double margin_rad;
} step_t;

typedef struct {
    uint32_t steps;
    uint32_t excused;
    uint32_t phases; /* excused steps whose phases differ */
    double largest_Nm;
    double largest_steep_Nm;
} tally_t;

static FILE *file;
static tally_t tally;

void setUp(void) {
    const tally_t none = {0};
    tally = none;
    file = fopen(JOINT_VECTORS, "rb");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, JOINT_VECTORS);
}

void tearDown(void) {
    (void)fclose(file);
}

static void read(void *record, size_t size) {
    TEST_ASSERT_EQUAL_MESSAGE(1, fread(record, size, 1, file), "the vectors end early");
}

static double size_of(double value) {
    return value < 0.0 ? -value : value;
}

static double larger(double a, double b) {
    return a > b ? a : b;
}

/** One unit of an angle of this size. */
static double unit_rad(double angle_rad) {
    const double fixed_rad = 1.0 / 536870912.0;
#ifdef CONTROL_FIXED_POINT
    (void)angle_rad;
    return fixed_rad;
#else
    return larger(fixed_rad, angle_rad / 4194304.0); /* step and product are rounded: 2^-22 */
#endif
}

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

static void apply_events(const step_t *step, joint_controller_t *controller) {
    const joint_command_t command = {.position_inc = step->target_inc,
                                     .torque_mNm = (int16_t)step->torque_mNm,
                                     .torque_max_mNm = (uint16_t)step->torque_max_mNm};
    if ((step->events & EVENT_COMMAND) != 0U) {
        joint_controller_command(&command, controller);
    }
    if ((step->events & EVENT_RESET) != 0U) {
        joint_controller_reset(step->position_inc, &command, controller);
    }
    if ((step->events & EVENT_HOLD) != 0U) {
        joint_controller_hold(step->position_inc, controller);
    }
}

static void take_over(const step_t *step, fic_t *fic) {
    fic->converging = step->converging != 0;
    fic->a_max_rad = angle_nearest(step->a_max_rad);
    fic->extreme_rad = angle_nearest(step->extreme_rad);
    fic->f_max_Nm = torque_nearest(step->f_max_Nm);
}

static void check_motion(const lane_t *lane, const step_t *step, const fic_t *fic) {
    TEST_ASSERT_EQUAL_INT8(step->sign, fic->sign);
    TEST_ASSERT_EQUAL_INT8(step->direction, fic->direction);
    TEST_ASSERT_EQUAL_INT32(step->extreme_inc, fic->extreme_inc);
    if (step->age_us <= lane->stall_time_us) {
        TEST_ASSERT_EQUAL_UINT32(step->age_us, fic->age_us);
    } else {
        TEST_ASSERT_TRUE(fic->age_us > lane->stall_time_us);
    }
}

static int16_t guarded(const lane_t *lane, const step_t *step,
                       const joint_controller_config_t *config,
                       const joint_controller_output_t *output) {
    const torque_guard_input_t input = {
        .torque_Nm = output->torque_Nm,
        .torque_limit_Nm = config->torque_limit_Nm,
        .ramp_ppm = step->ramp_ppm,
        .torque_max_Nm = output->torque_max_Nm,
        .f_max_Nm = output->f_max_Nm,
        .position_inc = step->position_inc,
        .position_min_inc = lane->position_min_inc,
        .position_max_inc = lane->position_max_inc,
        .slope_mNm_s = TORQUE_GUARD_SLOPE_OFF,
        .motor = {.temperature_end_dC = 1},
    };
    return torque_guard(&input).torque_mNm;
}

static void compare(const lane_t *lane, const step_t *step, const joint_controller_output_t *output,
                    int16_t guarded_mNm, joint_controller_t *controller) {
    const double unit = unit_rad(size_of(step->error_rad));
    TEST_ASSERT_TRUE(size_of(exactly_rad(output->error_rad) - step->error_rad) <= unit);
    check_motion(lane, step, &controller->fic);

    const bool phases_differ = controller->fic.converging != (step->converging != 0);
    const double off_Nm = size_of(exactly_Nm(output->torque_Nm) - step->torque_Nm);
    const int32_t off_mNm = guarded_mNm - step->guarded_mNm;
    const double off_guarded_Nm = 0.001 * (size_of(off_mNm) - 1.0); /* each is rounded once */
    tally.steps++;
    if (phases_differ || off_Nm > lane->tolerance_Nm || off_guarded_Nm > lane->tolerance_Nm) {
        TEST_ASSERT_FALSE_MESSAGE(step->margin_rad > unit, phases_differ ? "phase" : "torque");
        tally.excused++;
        tally.phases += phases_differ ? 1U : 0U;
        take_over(step, &controller->fic);
    } else if (lane->steep != 0U) {
        tally.largest_steep_Nm = larger(tally.largest_steep_Nm, off_Nm);
    } else {
        TEST_ASSERT_TRUE(off_mNm >= -1 && off_mNm <= 1);
        tally.largest_Nm = larger(tally.largest_Nm, off_Nm);
    }
}

static void run_lane(uint32_t steps) {
    lane_t lane;
    joint_controller_t controller = {0};
    read(&lane, sizeof lane);
    const joint_controller_config_t config = config_of(&lane);
    for (uint32_t i = 0; i < steps; i++) {
        step_t step;
        joint_controller_output_t output;
        read(&step, sizeof step);
        if (i == 0U) {
            const joint_command_t command = {.position_inc = step.target_inc,
                                             .torque_mNm = (int16_t)step.torque_mNm,
                                             .torque_max_mNm = (uint16_t)step.torque_max_mNm};
            joint_controller_reset(step.position_inc, &command, &controller);
        }
        apply_events(&step, &controller);
        joint_controller_step(&config, step.position_inc, step.elapsed_us, &controller, &output);
        compare(&lane, &step, &output, guarded(&lane, &step, &config, &output), &controller);
    }
}

void test_torques_and_phases_are_those_of_the_reference(void) {
    int32_t lanes = 0;
    int32_t steps = 0;
    read(&lanes, sizeof lanes);
    read(&steps, sizeof steps);
    for (int32_t lane = 0; lane < lanes; lane++) {
        run_lane((uint32_t)steps);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(EOF, fgetc(file), "the vectors do not end here");
    TEST_ASSERT_TRUE(tally.steps >= LEAST_STEPS);
    (void)printf("%u steps, largest difference %.4f mN m (%.1f mN m for profiles that no 32-bit "
                 "number can follow), %u excused, %u of them with another phase\n",
                 tally.steps, 1000.0 * tally.largest_Nm, 1000.0 * tally.largest_steep_Nm,
                 tally.excused, tally.phases);
    TEST_ASSERT_TRUE((double)tally.excused <= EXCUSED_LIMIT * (double)tally.steps);
}
