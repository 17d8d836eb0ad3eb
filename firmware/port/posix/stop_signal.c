#define _GNU_SOURCE
#include "port/posix/stop_signal.h"

#include <signal.h>
#include <string.h>

static volatile sig_atomic_t raised;

static void on_signal(int number) {
    (void)number;
    raised = 1;
}

void stop_signal_install(bool ignore_interrupt) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal; /* no SA_RESTART: a blocking receive must return */
    (void)sigaction(SIGTERM, &action, NULL);
    if (ignore_interrupt) {
        action.sa_handler = SIG_IGN;
    }
    (void)sigaction(SIGINT, &action, NULL);
}

bool stop_signal_raised(void) {
    return raised != 0;
}
