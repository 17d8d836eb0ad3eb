#include "control/derating.h"

#define CURRENT_MAX_mA 4294967U

/** 1 up to begin, 0 from end on, and linear between. The three differ by at most 1000000; value is
 * above begin. */
static int32_t share_of(int32_t value, int32_t begin, int32_t end) {
    return value < end ? (end - value) * DERATING_FULL / (end - begin) : 0;
}

static int32_t lesser(int32_t a, int32_t b) {
    return a < b ? a : b;
}

/** Beyond it a share is zero anyway. */
static int32_t kept(uint32_t part_ppm) {
    return (int32_t)(part_ppm < 2U * DERATING_WHOLE_ppm ? part_ppm : 2U * DERATING_WHOLE_ppm);
}

derating_output_t derating(const derating_input_t *input, bool accelerates) {
    int32_t share = DERATING_FULL;
    uint16_t reasons = 0;
    if (input->temperature_dC > input->temperature_begin_dC) {
        reasons |= LIMIT_REASON_TEMPERATURE;
        share = lesser(share, share_of(input->temperature_dC, input->temperature_begin_dC,
                                       input->temperature_end_dC));
    }
    if (input->load_ppm > DERATING_WHOLE_ppm) {
        reasons |= LIMIT_REASON_CURRENT;
        share = lesser(share, share_of(kept(input->load_ppm), (int32_t)DERATING_WHOLE_ppm,
                                       2 * (int32_t)DERATING_WHOLE_ppm));
    }
    if (accelerates && input->speed_ppm > input->speed_begin_ppm) {
        reasons |= LIMIT_REASON_SPEED;
        share = lesser(share, share_of(kept(input->speed_ppm), (int32_t)input->speed_begin_ppm,
                                       (int32_t)DERATING_WHOLE_ppm));
    }
    const derating_output_t output = {.share = (int16_t)share, .reasons = reasons};
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
