/**
 * LSS slave (CiA 305): a master finds a node by its identity and gives it a node-id over the bus.
 *
 * Requests come with COB-ID 7E5h, answers go with 7E4h, 8 bytes each. A node without a node-id
 * (LSS_UNCONFIGURED) takes part in nothing else. A new node-id acts at the next reset
 * communication; a node that had none begins with it when LSS leaves the configuration state.
 */
#ifndef LSS_H
#define LSS_H

#include <stdbool.h>
#include <stdint.h>

#include "canopen/can_frame.h"

#define LSS_REQUEST_COB_ID 0x7E5U
#define LSS_RESPONSE_COB_ID 0x7E4U
#define LSS_UNCONFIGURED 255U
#define LSS_IDENTITY_PARTS 4U

typedef struct {
    bool configuring;        /**< state configuration, else waiting */
    uint8_t pending_node_id; /**< 1..127 or LSS_UNCONFIGURED */
    uint8_t matched;         /**< parts of a selective switch that fitted so far */
    uint8_t scanned;         /**< part that fastscan looks at */
} lss_t;

/** What a request asks of the node. */
typedef enum {
    LSS_SILENT,
    LSS_ANSWER,  /**< *response is to be sent */
    LSS_STORE,   /**< pending_node_id is to be stored; then lss_store_response says how it went */
    LSS_ACTIVATE /**< the node begins with pending_node_id, as after reset communication */
} lss_action_t;

/** After a reset: state waiting. */
void lss_init(uint8_t node_id, lss_t *lss);

/** Takes in one request. identity: 1018h:01 to :04; node_id: the one in use. */
lss_action_t lss_receive(const uint32_t identity[LSS_IDENTITY_PARTS], uint8_t node_id,
                         const can_frame_t *request, lss_t *lss, can_frame_t *response);

/** Answer to LSS_STORE. stored = false: error 2, the medium cannot be accessed. */
can_frame_t lss_store_response(bool stored);

#endif
