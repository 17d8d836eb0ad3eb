/**
 * The parameter memory of a node as a file: two copies, one behind the other. It outlives the
 * process, also one that is killed while it writes.
 */
#ifndef PARAMETER_FILE_H
#define PARAMETER_FILE_H

#include <stdbool.h>

#include "node/parameter_store.h"

typedef struct {
    int fd;
} parameter_file_t;

/** Opens or makes the file. False: errno says why. */
bool parameter_file_open(const char *path, parameter_file_t *file);

/** file must outlive what is returned. */
parameter_memory_t parameter_file_memory(parameter_file_t *file);

#endif
