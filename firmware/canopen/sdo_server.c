#include "canopen/sdo_server.h"

#include <string.h>

#include "canopen/node_time.h"
#include "od/little_endian.h"

/* Command specifiers, bits 7..5 of the first byte. */
#define CLIENT_DOWNLOAD_SEGMENT 0U
#define CLIENT_DOWNLOAD_INITIATE 1U
#define CLIENT_UPLOAD_INITIATE 2U
#define CLIENT_UPLOAD_SEGMENT 3U
#define CLIENT_ABORT 4U
#define SERVER_DOWNLOAD_SEGMENT 0x20U
#define SERVER_UPLOAD_INITIATE 0x40U
#define SERVER_DOWNLOAD_INITIATE 0x60U
#define ABORT 0x80U

#define EXPEDITED 0x02U
#define SIZE_INDICATED 0x01U
#define TOGGLE 0x10U
#define LAST_SEGMENT 0x01U
#define SEGMENT_BYTES 7U

static void begin_response(const object_dictionary_t *od, uint8_t command, can_frame_t *response) {
    memset(response, 0, sizeof *response);
    response->id = (uint16_t)od->sdo_server_parameter_cob_id_server_to_client;
    response->len = 8;
    response->data[0] = command;
}

static void put_multiplexer(uint16_t index, uint8_t subindex, can_frame_t *response) {
    little_endian_put_u16(index, &response->data[1]);
    response->data[3] = subindex;
}

static void abort_transfer(const object_dictionary_t *od, uint16_t index, uint8_t subindex,
                           sdo_abort_t code, sdo_server_t *server, can_frame_t *response) {
    begin_response(od, ABORT, response);
    put_multiplexer(index, subindex, response);
    little_endian_put_u32((uint32_t)code, &response->data[4]);
    server->state = SDO_IDLE;
}

static void abort_segmented(const object_dictionary_t *od, sdo_abort_t code, sdo_server_t *server,
                            can_frame_t *response) {
    abort_transfer(od, server->entry->index, server->entry->subindex, code, server, response);
}

static sdo_abort_t check_size(const od_entry_t *entry, size_t size) {
    return size > od_size(entry)   ? SDO_ABORT_TOO_LONG
           : size < od_size(entry) ? SDO_ABORT_TOO_SHORT
                                   : SDO_ABORT_NONE;
}

static sdo_abort_t store(const sdo_target_t *target, const od_entry_t *entry, uint32_t value) {
    const sdo_abort_t code = od_check_range(entry, value);
    return code != SDO_ABORT_NONE ? code
                                  : target->device_functions->write(target->device, entry, value);
}

/** Low bytes of the value that belong to the entry. */
static uint32_t value_of(const od_entry_t *entry, const uint8_t *data) {
    const uint32_t value = little_endian_u32(data);
    const size_t size = od_size(entry);
    return size == 4U ? value : value & (((uint32_t)1U << (8U * size)) - 1U);
}

static sdo_abort_t download_initiate(const sdo_target_t *target, const can_frame_t *request,
                                     const od_entry_t *entry, sdo_server_t *server) {
    if (entry->access == OD_CONST || entry->access == OD_RO) {
        return SDO_ABORT_READ_ONLY;
    }
    const uint8_t command = request->data[0];
    const bool sized = (command & SIZE_INDICATED) != 0U;
    if ((command & EXPEDITED) != 0U) {
        const size_t size = sized ? 4U - ((command >> 2) & 3U) : od_size(entry);
        const sdo_abort_t code = check_size(entry, size);
        return code != SDO_ABORT_NONE ? code
                                      : store(target, entry, value_of(entry, &request->data[4]));
    }
    if (sized) {
        const sdo_abort_t code = check_size(entry, little_endian_u32(&request->data[4]));
        if (code != SDO_ABORT_NONE) {
            return code;
        }
    }
    server->state = SDO_DOWNLOAD;
    return SDO_ABORT_NONE;
}

static sdo_abort_t upload_initiate(const sdo_target_t *target, const od_entry_t *entry,
                                   sdo_server_t *server, can_frame_t *response) {
    if (entry->access == OD_WO) {
        return SDO_ABORT_WRITE_ONLY;
    }
    const sdo_abort_t code = target->device_functions->readable(target->device, entry);
    if (code != SDO_ABORT_NONE) {
        return code;
    }
    const size_t size = od_size(entry);
    if (size != 0U) {
        response->data[0] =
            (uint8_t)(SERVER_UPLOAD_INITIATE | ((4U - size) << 2) | EXPEDITED | SIZE_INDICATED);
        little_endian_put_u32(od_read(target->od, entry), &response->data[4]);
    } else {
        response->data[0] = SERVER_UPLOAD_INITIATE | SIZE_INDICATED;
        little_endian_put_u32((uint32_t)strlen(od_read_string(target->od, entry)),
                              &response->data[4]);
        server->state = SDO_UPLOAD;
    }
    return SDO_ABORT_NONE;
}

static void initiate(const sdo_target_t *target, const can_frame_t *request, sdo_server_t *server,
                     can_frame_t *response) {
    const uint16_t index = little_endian_u16(&request->data[1]);
    const uint8_t subindex = request->data[3];
    const bool download = request->data[0] >> 5 == CLIENT_DOWNLOAD_INITIATE;
    const od_entry_t *entry = NULL;

    server->state = SDO_IDLE;
    server->toggle = false;
    server->since_us = 0;
    server->done = 0;
    begin_response(target->od, SERVER_DOWNLOAD_INITIATE, response);
    put_multiplexer(index, subindex, response);
    sdo_abort_t code = od_find(index, subindex, &entry);
    server->entry = entry;
    if (code == SDO_ABORT_NONE) {
        code = download ? download_initiate(target, request, entry, server)
                        : upload_initiate(target, entry, server, response);
    }
    if (code != SDO_ABORT_NONE) {
        abort_transfer(target->od, index, subindex, code, server, response);
    }
}

static void download_segment(const sdo_target_t *target, const can_frame_t *request,
                             sdo_server_t *server, can_frame_t *response) {
    const uint8_t command = request->data[0];
    const size_t bytes = SEGMENT_BYTES - ((command >> 1) & 7U);
    const bool last = (command & LAST_SEGMENT) != 0U;
    sdo_abort_t code = SDO_ABORT_NONE;
    if (server->done + bytes > od_size(server->entry)) {
        code = SDO_ABORT_TOO_LONG;
    } else {
        memcpy(&server->data[server->done], &request->data[1], bytes);
        server->done += bytes;
        if (last) {
            code = check_size(server->entry, server->done);
            if (code == SDO_ABORT_NONE) {
                code = store(target, server->entry, value_of(server->entry, server->data));
            }
        }
    }
    if (code != SDO_ABORT_NONE) {
        abort_segmented(target->od, code, server, response);
        return;
    }
    begin_response(target->od, (uint8_t)(SERVER_DOWNLOAD_SEGMENT | (command & TOGGLE)), response);
    if (last) {
        server->state = SDO_IDLE;
    }
}

static void upload_segment(const sdo_target_t *target, const can_frame_t *request,
                           sdo_server_t *server, can_frame_t *response) {
    const char *text = od_read_string(target->od, server->entry);
    const size_t rest = strlen(text) - server->done;
    const size_t bytes = rest < SEGMENT_BYTES ? rest : SEGMENT_BYTES;
    const bool last = rest <= SEGMENT_BYTES;
    begin_response(target->od,
                   (uint8_t)((request->data[0] & TOGGLE) | ((SEGMENT_BYTES - bytes) << 1) |
                             (last ? LAST_SEGMENT : 0U)),
                   response);
    memcpy(&response->data[1], &text[server->done], bytes);
    server->done += bytes;
    if (last) {
        server->state = SDO_IDLE;
    }
}

static void segment(const sdo_target_t *target, const can_frame_t *request, sdo_server_t *server,
                    can_frame_t *response) {
    const bool download = request->data[0] >> 5 == CLIENT_DOWNLOAD_SEGMENT;
    if (server->state != (download ? SDO_DOWNLOAD : SDO_UPLOAD)) {
        abort_transfer(target->od, 0, 0, SDO_ABORT_COMMAND_SPECIFIER, server, response);
        return;
    }
    if (((request->data[0] & TOGGLE) != 0U) != server->toggle) {
        abort_segmented(target->od, SDO_ABORT_TOGGLE_BIT, server, response);
        return;
    }
    server->toggle = !server->toggle;
    server->since_us = 0;
    if (download) {
        download_segment(target, request, server, response);
    } else {
        upload_segment(target, request, server, response);
    }
}

bool sdo_server_receive(const sdo_target_t *target, const can_frame_t *request,
                        sdo_server_t *server, can_frame_t *response) {
    if (request->len != 8U) {
        return false;
    }
    switch (request->data[0] >> 5) {
    case CLIENT_DOWNLOAD_INITIATE:
    case CLIENT_UPLOAD_INITIATE:
        initiate(target, request, server, response);
        return true;
    case CLIENT_DOWNLOAD_SEGMENT:
    case CLIENT_UPLOAD_SEGMENT:
        segment(target, request, server, response);
        return true;
    case CLIENT_ABORT:
        server->state = SDO_IDLE;
        return false;
    default:
        abort_transfer(target->od, little_endian_u16(&request->data[1]), request->data[3],
                       SDO_ABORT_COMMAND_SPECIFIER, server, response);
        return true;
    }
}

bool sdo_server_elapse(const object_dictionary_t *od, uint32_t elapsed_us, sdo_server_t *server,
                       can_frame_t *response) {
    if (server->state == SDO_IDLE) {
        return false;
    }
    server->since_us = node_time_add(server->since_us, elapsed_us);
    if (server->since_us < SDO_TIMEOUT_us) {
        return false;
    }
    abort_segmented(od, SDO_ABORT_TIMEOUT, server, response);
    return true;
}
