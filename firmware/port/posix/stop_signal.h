/**
 * SIGINT and SIGTERM as a flag: blocking calls return with EINTR and the caller looks here.
 */
#ifndef STOP_SIGNAL_H
#define STOP_SIGNAL_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/** From now on SIGTERM sets the flag; SIGINT too, or is ignored when ignore_interrupt is set (a
 * Ctrl-C reaches every process of a terminal; only one of them ends the run in order). */
void stop_signal_install(bool ignore_interrupt);
bool stop_signal_raised(void);

#ifdef __cplusplus
}
#endif

#endif
