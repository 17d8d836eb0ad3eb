#define _GNU_SOURCE
#include "port/posix/parameter_file.h"

#include <fcntl.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

static off_t position(uint8_t copy, size_t offset) {
    return (off_t)((size_t)copy * PARAMETER_STORE_COPY_BYTES + offset);
}

static bool read_bytes(void *context, uint8_t copy, size_t offset, uint8_t *data, size_t size) {
    const parameter_file_t *file = context;
    memset(data, 0xFF, size); /* beyond the end of the file: erased */
    return pread(file->fd, data, size, position(copy, offset)) >= 0;
}

static bool write_bytes(void *context, uint8_t copy, size_t offset, const uint8_t *data,
                        size_t size) {
    const parameter_file_t *file = context;
    return pwrite(file->fd, data, size, position(copy, offset)) == (ssize_t)size;
}

static bool erase(void *context, uint8_t copy) {
    uint8_t erased[PARAMETER_STORE_COPY_BYTES];
    memset(erased, 0xFF, sizeof erased);
    return write_bytes(context, copy, 0, erased, sizeof erased);
}

bool parameter_file_open(const char *path, parameter_file_t *file) {
    file->fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    return file->fd >= 0;
}

parameter_memory_t parameter_file_memory(parameter_file_t *file) {
    const parameter_memory_t memory = {
        .context = file, .read = read_bytes, .erase = erase, .write = write_bytes};
    return memory;
}
