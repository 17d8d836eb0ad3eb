/* Parameters in a memory whose reads fail at any moment: a whole set or none, never a mixture. */
#include "unity.h"

#include "fake_memory.h"
#include "node/motor_node.h"

typedef struct {
    fake_memory_t fake;
    size_t reads_left;
    size_t fails_at; /* number of the one read that fails, from 1; 0 = none */
} failing_memory_t;

static failing_memory_t failing;
static object_dictionary_t od;
static object_dictionary_t loaded;
static uint8_t node_id;

static bool read(void *context, uint8_t copy, size_t offset, uint8_t *data, size_t size) {
    failing_memory_t *memory = context;
    if (memory->reads_left == 0U) {
        return false;
    }
    memory->reads_left--;
    if (memory->fails_at != 0U) {
        memory->fails_at--;
        if (memory->fails_at == 0U) {
            return false;
        }
    }
    return fake_read(&memory->fake, copy, offset, data, size);
}

static bool erase(void *context, uint8_t copy) {
    failing_memory_t *memory = context;
    return fake_erase(&memory->fake, copy);
}

static bool write(void *context, uint8_t copy, size_t offset, const uint8_t *data, size_t size) {
    failing_memory_t *memory = context;
    return fake_write(&memory->fake, copy, offset, data, size);
}

static const parameter_memory_t memory = {
    .context = &failing, .read = read, .erase = erase, .write = write};

/* Makes the reads beyond the first ones fail; returns whether the stored set 7 was loaded. A load
 * that fails may leave a part of it: test_node_has_all_or_nothing. */
static bool load_after(size_t reads) {
    object_dictionary_init(2, &loaded);
    node_id = 0;
    failing.reads_left = reads;
    const bool stored = parameter_store_load(&memory, &loaded, &node_id);
    if (stored) {
        TEST_ASSERT_EQUAL_MEMORY(&od, &loaded, sizeof loaded);
    }
    TEST_ASSERT_EQUAL_UINT8(stored ? 7 : 0, node_id);
    return stored;
}

void setUp(void) {
    (void)fake_memory(&failing.fake);
    failing.reads_left = SIZE_MAX;
    object_dictionary_init(2, &od);
    od.producer_heartbeat_time = 7; /* among the first of the set */
    od.fic_q_a_urad = 7777;         /* in the middle */
    od.homing_method = 33;          /* among the last */
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_VALUES, &od, 7));
}
void tearDown(void) {}

/* Reads that a load takes: three for the ends of the copies, and two for each value. */
static size_t reads_of_a_load(void) {
    failing.reads_left = SIZE_MAX;
    (void)load_after(SIZE_MAX);
    return SIZE_MAX - failing.reads_left;
}

void test_load(void) {
    const size_t needed = reads_of_a_load();
    TEST_ASSERT_TRUE(needed > 100U);
    for (size_t reads = 0; reads < needed; reads++) {
        TEST_ASSERT_FALSE(load_after(reads));
    }
    TEST_ASSERT_TRUE(load_after(needed));
}

void test_node_has_all_or_nothing(void) {
    static motor_node_t node;
    static object_dictionary_t defaults; /* with zeros between its fields, as all are */
    const motor_node_config_t config = {.node_id = 2, .serial_number = 5, .memory = &memory};
    const uint32_t heartbeat = 7;
    size_t whole = 0;
    object_dictionary_init(2, &defaults);
    /* A start loads three times: the node-id, all values, and those of the communication. */
    for (size_t reads = 0; reads < 5U * reads_of_a_load(); reads++) {
        failing.reads_left = reads;
        motor_node_init(&config, &node);
        const bool first = node.od.producer_heartbeat_time == heartbeat;
        const bool last = node.od.homing_method == 33;
        TEST_ASSERT_TRUE(first ? last : true); /* communication is loaded last */
        TEST_ASSERT_TRUE(node.od.fic_q_a_urad == defaults.fic_q_a_urad || last);
        whole += first && last ? 1U : 0U;
    }
    TEST_ASSERT_TRUE(whole > 0U);
}

void test_save_of_another_node_id(void) {
    const size_t values = (reads_of_a_load() - 3U) / 2U;
    for (size_t copied = 0; copied < values; copied++) {
        setUp();
        failing.reads_left = values + 3U + copied;
        TEST_ASSERT_FALSE(parameter_store_save(&memory, PARAMETER_STORE_KEPT, &od, 9));
        TEST_ASSERT_TRUE(load_after(SIZE_MAX));
    }
    setUp();
    failing.reads_left = values + 3U + values;
    TEST_ASSERT_TRUE(parameter_store_save(&memory, PARAMETER_STORE_KEPT, &od, 9));
    failing.reads_left = SIZE_MAX;
    TEST_ASSERT_TRUE(parameter_store_load(&memory, &loaded, &node_id));
    TEST_ASSERT_EQUAL_UINT8(9, node_id);
    TEST_ASSERT_EQUAL_MEMORY(&od, &loaded, sizeof od);
}

/* The read with this number fails, the ones before and after it do not. */
static bool save_with_a_failing_read(size_t number, parameter_source_t source) {
    failing.fails_at = number;
    const bool saved = parameter_store_save(&memory, source, &od, 9);
    failing.fails_at = 0;
    return saved;
}

void test_an_unreadable_copy_is_not_written_over(void) {
    const size_t values = (reads_of_a_load() - 3U) / 2U;
    const size_t inspected = values + 3U;
    for (size_t number = 1; number <= inspected; number++) {
        const size_t budget = failing.fake.budget;
        TEST_ASSERT_FALSE(save_with_a_failing_read(number, PARAMETER_STORE_VALUES));
        TEST_ASSERT_FALSE(save_with_a_failing_read(number, PARAMETER_STORE_KEPT));
        TEST_ASSERT_FALSE(save_with_a_failing_read(number, PARAMETER_STORE_DEFAULTS));
        TEST_ASSERT_TRUE(failing.fake.budget == budget); /* nothing erased */
        TEST_ASSERT_TRUE(load_after(SIZE_MAX));
    }
    TEST_ASSERT_TRUE(save_with_a_failing_read(inspected + 1U, PARAMETER_STORE_VALUES));
}

void test_save_that_cannot_erase_keeps_the_set(void) {
    failing.fake.budget = 0;
    TEST_ASSERT_FALSE(parameter_store_save(&memory, PARAMETER_STORE_KEPT, &od, 9));
    TEST_ASSERT_TRUE(load_after(SIZE_MAX));
}
