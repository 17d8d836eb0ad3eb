#include "node/derating.h"

#define CURRENT_MAX_mA 4294967U

/** 1 up to begin, 0 from end on, linear between; value - begin is below 2^43. */
static uint32_t share(int64_t value, int64_t begin, int64_t end) {
    if (value <= begin) {
        return DERATING_FULL_ppm;
    }
    if (value >= end) {
        return 0;
    }
    return (uint32_t)((end - value) * (int64_t)DERATING_FULL_ppm / (end - begin));
}

static void apply(uint32_t share_ppm, uint16_t reason, derating_output_t *output) {
    if (share_ppm < DERATING_FULL_ppm) {
        output->reasons |= reason;
    }
    if (share_ppm < output->share_ppm) {
        output->share_ppm = share_ppm;
    }
}

derating_output_t derating(const derating_input_t *input) {
    derating_output_t output = {.share_ppm = DERATING_FULL_ppm};
    const uint32_t rated_mA =
        input->rated_current_mA < CURRENT_MAX_mA ? input->rated_current_mA : CURRENT_MAX_mA;
    const int64_t rated_mA2 = (int64_t)rated_mA * (int64_t)rated_mA;
    apply(share(input->temperature_dC, input->temperature_begin_dC, input->temperature_end_dC),
          LIMIT_REASON_TEMPERATURE, &output);
    /* In 1/1024 mA^2 where it would not fit else. */
    apply(share((int64_t)(input->mean_square_mA2 / 1024U), rated_mA2 / 1024, rated_mA2 / 512),
          LIMIT_REASON_CURRENT, &output);
    if (input->torque_accelerates) {
        apply(share(input->speed_ppm, input->speed_begin_ppm, DERATING_FULL_ppm),
              LIMIT_REASON_SPEED, &output);
    }
    return output;
}

uint64_t derating_mean_square(uint64_t mean_square_mA2, uint32_t current_mA, uint32_t time_us,
                              uint32_t elapsed_us) {
    const uint32_t kept_mA = current_mA < CURRENT_MAX_mA ? current_mA : CURRENT_MAX_mA;
    const uint64_t square = (uint64_t)kept_mA * kept_mA; /* below 2^45 */
    const uint32_t part = elapsed_us < time_us ? elapsed_us : time_us;
    if (part == 0U) {
        return mean_square_mA2;
    }
    const uint32_t parts = time_us / part;
    return square >= mean_square_mA2 ? mean_square_mA2 + (square - mean_square_mA2) / parts
                                     : mean_square_mA2 - (mean_square_mA2 - square) / parts;
}
