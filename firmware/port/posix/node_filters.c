#include "port/posix/node_filters.h"

#include <string.h>

#include "canopen/lss.h"

void node_filters(uint8_t node_id, can_socket_filter_t filters[NODE_FILTERS_COUNT]) {
    const uint16_t exact = 0x7FF;
    const uint16_t function_code = 0x780;
    const uint16_t id = node_id;
    if (node_id == LSS_UNCONFIGURED) {
        for (size_t i = 0; i < NODE_FILTERS_COUNT; i++) {
            filters[i] = (can_socket_filter_t){.match = LSS_REQUEST_COB_ID, .mask = exact};
        }
        return;
    }
    const can_socket_filter_t accepted[NODE_FILTERS_COUNT] = {
        {.match = 0x000, .mask = exact},                   /* NMT */
        {.match = 0x080, .mask = function_code},           /* SYNC, EMCY of the peers */
        {.match = (uint16_t)(0x200U + id), .mask = exact}, /* RPDO1 */
        {.match = (uint16_t)(0x300U + id), .mask = exact}, /* RPDO2 */
        {.match = (uint16_t)(0x500U + id), .mask = exact}, /* RPDO4 */
        {.match = (uint16_t)(0x600U + id), .mask = exact}, /* SDO request */
        {.match = (uint16_t)(0x180U + id), .mask = exact}, /* from another device: TPDO1, */
        {.match = (uint16_t)(0x280U + id), .mask = exact}, /* TPDO2, */
        {.match = (uint16_t)(0x580U + id), .mask = exact}, /* SDO response */
        {.match = 0x700, .mask = function_code},           /* heartbeats */
        {.match = LSS_REQUEST_COB_ID, .mask = exact},
    };
    memcpy(filters, accepted, sizeof accepted);
}
