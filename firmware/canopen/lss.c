#include "canopen/lss.h"

#include <string.h>

#include "od/little_endian.h"

/* Command specifiers, CiA 305, clause 6. */
#define SWITCH_GLOBAL 0x04U
#define CONFIGURE_NODE_ID 0x11U
#define CONFIGURE_BIT_TIMING 0x13U
#define STORE 0x17U
#define SWITCH_SELECTIVE_FIRST 0x40U
#define SWITCH_SELECTIVE_ANSWER 0x44U
#define IDENTIFY_UNCONFIGURED 0x4CU
#define IDENTIFY_ANSWER 0x4FU
#define IDENTIFY_UNCONFIGURED_ANSWER 0x50U
#define FASTSCAN 0x51U
#define INQUIRE_FIRST 0x5AU
#define INQUIRE_NODE_ID 0x5EU

#define FASTSCAN_RESET 0x80U
#define OK 0U
#define OUT_OF_RANGE 1U
#define STORE_FAILED 2U
#define NODE_ID_MAX 127U

static lss_action_t answer(uint8_t command, uint32_t value, can_frame_t *response) {
    const can_frame_t frame = {.id = LSS_RESPONSE_COB_ID, .len = 8, .data = {command}};
    *response = frame;
    little_endian_put_u32(value, &response->data[1]);
    return LSS_ANSWER;
}

void lss_init(uint8_t node_id, lss_t *lss) {
    memset(lss, 0, sizeof *lss);
    lss->pending_node_id = node_id;
}

static lss_action_t switch_global(uint8_t node_id, uint8_t mode, lss_t *lss) {
    const bool was_configuring = lss->configuring;
    lss->configuring = mode == 1U;
    lss->matched = 0;
    const bool begins = was_configuring && !lss->configuring && node_id == LSS_UNCONFIGURED &&
                        lss->pending_node_id != LSS_UNCONFIGURED;
    return begins ? LSS_ACTIVATE : LSS_SILENT;
}

/** Vendor, product, revision and serial number come one after the other; all must fit. */
static lss_action_t switch_selective(const uint32_t identity[LSS_IDENTITY_PARTS], uint8_t part,
                                     uint32_t number, lss_t *lss, can_frame_t *response) {
    const bool fits = part == lss->matched && number == identity[part];
    lss->matched = fits ? (uint8_t)(part + 1U) : 0U;
    if (lss->matched < LSS_IDENTITY_PARTS) {
        return LSS_SILENT;
    }
    lss->matched = 0;
    lss->configuring = true;
    return answer(SWITCH_SELECTIVE_ANSWER, 0, response);
}

/** The master learns the identity bit by bit from who still answers. */
static lss_action_t fastscan(const uint32_t identity[LSS_IDENTITY_PARTS], const uint8_t *data,
                             lss_t *lss, can_frame_t *response) {
    const uint8_t bit = data[5];
    const uint8_t part = data[6];
    const uint8_t next = data[7];
    if (bit == FASTSCAN_RESET) {
        lss->scanned = 0;
        return answer(IDENTIFY_ANSWER, 0, response);
    }
    if (bit > 31U || part >= LSS_IDENTITY_PARTS || next >= LSS_IDENTITY_PARTS ||
        part != lss->scanned || ((identity[part] ^ little_endian_u32(&data[1])) >> bit) != 0U) {
        return LSS_SILENT;
    }
    if (bit == 0U) {
        lss->scanned = next;
        lss->configuring = next < part;
    }
    return answer(IDENTIFY_ANSWER, 0, response);
}

static lss_action_t configure(const uint32_t identity[LSS_IDENTITY_PARTS], uint8_t node_id,
                              const uint8_t *data, lss_t *lss, can_frame_t *response) {
    switch (data[0]) {
    case CONFIGURE_NODE_ID: {
        const uint8_t id = data[1];
        const bool valid = (id >= 1U && id <= NODE_ID_MAX) || id == LSS_UNCONFIGURED;
        lss->pending_node_id = valid ? id : lss->pending_node_id;
        return answer(CONFIGURE_NODE_ID, valid ? OK : OUT_OF_RANGE, response);
    }
    case CONFIGURE_BIT_TIMING: /* entry 0 of table 0, 1 Mbit/s, is the only one */
        return answer(CONFIGURE_BIT_TIMING, data[1] == 0U && data[2] == 0U ? OK : OUT_OF_RANGE,
                      response);
    case STORE:
        return LSS_STORE;
    case INQUIRE_NODE_ID:
        return answer(INQUIRE_NODE_ID, node_id, response);
    default:
        if (data[0] >= INQUIRE_FIRST && data[0] < INQUIRE_FIRST + LSS_IDENTITY_PARTS) {
            return answer(data[0], identity[data[0] - INQUIRE_FIRST], response);
        }
        return LSS_SILENT;
    }
}

static lss_action_t wait(const uint32_t identity[LSS_IDENTITY_PARTS], uint8_t node_id,
                         const uint8_t *data, lss_t *lss, can_frame_t *response) {
    if (data[0] >= SWITCH_SELECTIVE_FIRST &&
        data[0] < SWITCH_SELECTIVE_FIRST + LSS_IDENTITY_PARTS) {
        return switch_selective(identity, (uint8_t)(data[0] - SWITCH_SELECTIVE_FIRST),
                                little_endian_u32(&data[1]), lss, response);
    }
    if (node_id == LSS_UNCONFIGURED && data[0] == FASTSCAN) {
        return fastscan(identity, data, lss, response);
    }
    return LSS_SILENT;
}

lss_action_t lss_receive(const uint32_t identity[LSS_IDENTITY_PARTS], uint8_t node_id,
                         const can_frame_t *request, lss_t *lss, can_frame_t *response) {
    const uint8_t *data = request->data;
    if (request->len != 8U) {
        return LSS_SILENT;
    }
    if (data[0] == SWITCH_GLOBAL) {
        return data[1] <= 1U ? switch_global(node_id, data[1], lss) : LSS_SILENT;
    }
    if (data[0] == IDENTIFY_UNCONFIGURED) {
        return node_id == LSS_UNCONFIGURED ? answer(IDENTIFY_UNCONFIGURED_ANSWER, 0, response)
                                           : LSS_SILENT;
    }
    return lss->configuring ? configure(identity, node_id, data, lss, response)
                            : wait(identity, node_id, data, lss, response);
}

can_frame_t lss_store_response(bool stored) {
    can_frame_t response;
    (void)answer(STORE, stored ? OK : STORE_FAILED, &response);
    return response;
}
