#include "control/derating.h"

#define CURRENT_MAX_mA 4294967U

/** Takes the share into account that is 1 up to begin, 0 from end on, and linear between. The three
 * differ by at most 1000000. */
static void apply(int32_t value, int32_t begin, int32_t end, uint16_t reason,
                  derating_output_t *output) {
    if (value <= begin) {
        return;
    }
    output->reasons |= reason;
    if (value >= end) {
        output->share = 0;
        return;
    }
    const int32_t share = (end - value) * DERATING_FULL / (end - begin);
    if (share < output->share) {
        output->share = share;
    }
}

/** Beyond it a share is zero anyway. */
static int32_t kept(uint32_t part_ppm) {
    return (int32_t)(part_ppm < 2U * DERATING_WHOLE_ppm ? part_ppm : 2U * DERATING_WHOLE_ppm);
}

derating_output_t derating(const derating_input_t *input, bool accelerates) {
    derating_output_t output = {.share = DERATING_FULL};
    apply(input->temperature_dC, input->temperature_begin_dC, input->temperature_end_dC,
          LIMIT_REASON_TEMPERATURE, &output);
    apply(kept(input->load_ppm), (int32_t)DERATING_WHOLE_ppm, 2 * (int32_t)DERATING_WHOLE_ppm,
          LIMIT_REASON_CURRENT, &output);
    if (accelerates) {
        apply(kept(input->speed_ppm), (int32_t)input->speed_begin_ppm, (int32_t)DERATING_WHOLE_ppm,
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

uint32_t derating_load(uint64_t mean_square_mA2, uint32_t rated_current_mA) {
    uint64_t rated_mA = rated_current_mA;
    if (rated_mA == 0U) {
        rated_mA = 1U;
    }
    const uint64_t by_rated = mean_square_mA2 * 1000U / rated_mA; /* the product below 2^55 */
    if (by_rated >= rated_mA * 4294967U) {
        return UINT32_MAX;
    }
    return (uint32_t)(by_rated * 1000U / rated_mA);
}
