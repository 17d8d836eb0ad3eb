/* The kernel's filters pass what the node accepts, and nothing else but 700h. */
#include "unity.h"

#include "node/motor_node.h"
#include "port/posix/node_filters.h"

void setUp(void) {}
void tearDown(void) {}

static bool passes(const can_socket_filter_t *filters, uint16_t id) {
    for (size_t i = 0; i < NODE_FILTERS_COUNT; i++) {
        if ((id & filters[i].mask) == (filters[i].match & filters[i].mask)) {
            return true;
        }
    }
    return false;
}

void test_filters_agree_with_what_the_node_accepts(void) {
    for (uint16_t node_id = 1; node_id <= 255U; node_id = node_id == 127U ? 255U : node_id + 1U) {
        can_socket_filter_t filters[NODE_FILTERS_COUNT];
        node_filters((uint8_t)node_id, filters);
        for (uint16_t id = 0; id < 0x800U; id++) {
            if (id != 0x700U) {
                TEST_ASSERT_EQUAL_INT(motor_node_accepts((uint8_t)node_id, id),
                                      passes(filters, id));
            }
        }
    }
}
