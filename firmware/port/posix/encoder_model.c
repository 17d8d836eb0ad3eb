#include "port/posix/encoder_model.h"

#include <math.h>

static const double TWO_PI = 6.283185307179586;

int32_t encoder_model_increments(double angle_rad, uint32_t increments_per_revolution) {
    const double increments = round(angle_rad * ((double)increments_per_revolution / TWO_PI));
    if (isnan(increments)) {
        return 0;
    }
    if (increments >= (double)INT32_MAX) {
        return INT32_MAX;
    }
    return increments <= (double)INT32_MIN ? INT32_MIN : (int32_t)increments;
}
