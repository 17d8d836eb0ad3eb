#include "port/slcan/slcan_node.h"

#include "od/od_access.h"

static void answer(char character, slcan_node_text_t *text) {
    text->text[text->length] = character;
    text->length++;
}

static void answer_hex(char command, uint32_t value, size_t digits, slcan_node_text_t *text) {
    static const char hex[] = "0123456789ABCDEF";
    answer(command, text);
    for (size_t i = digits; i > 0U; i--) {
        answer(hex[value >> (4U * (i - 1U)) & 0xFU], text);
    }
    answer(SLCAN_CR, text);
}

static void lose_frame(uint8_t flag, slcan_node_t *slcan, slcan_node_text_t *text) {
    slcan->flags |= flag;
    slcan->frames_lost++;
    answer(SLCAN_BEL, text);
}

static void receive_frame(const motor_node_t *node, const can_frame_t *frame, slcan_node_t *slcan,
                          slcan_node_text_t *text) {
    const tick_closing_event_t event =
        tick_closing_receive(node, frame, &slcan->closing, &slcan->elapsed_us);
    if (event == TICK_REPEATED) {
        lose_frame(SLCAN_NODE_TICK_REPEATED, slcan, text);
        return;
    }
    if (slcan->frame_count == MOTOR_NODE_RX_MAX) {
        lose_frame(SLCAN_NODE_BUFFER_FULL, slcan, text);
    } else {
        slcan->frames[slcan->frame_count] = *frame;
        slcan->frame_count++;
    }
    /* Also when it found the buffer full: a node that no longer steps never recovers. */
    slcan->step_due = slcan->step_due || event == TICK_CLOSED;
}

/** Frames that wait are lost with the channel. */
static void close_channel(slcan_node_t *slcan, slcan_node_text_t *text) {
    while (slcan->frame_count > 0U) {
        slcan->frame_count--;
        lose_frame(SLCAN_NODE_BUFFER_FULL, slcan, text);
    }
    slcan->open = false;
}

/** True when the line is a command with an answer of CR alone, which is carried out. */
static bool obey(const slcan_line_t *line, slcan_node_t *slcan, slcan_node_text_t *text) {
    switch (line->text[0]) {
    case 'S': /* no bit rate is set: behind the line is no bus but the node */
        return line->length == 2U && line->text[1] >= '0' && line->text[1] <= '8' && !slcan->open;
    case 'O':
        if (line->length != 1U || slcan->open) {
            return false;
        }
        slcan->open = true;
        return true;
    case 'C':
        if (line->length != 1U || !slcan->open) {
            return false;
        }
        close_channel(slcan, text);
        return true;
    default:
        return false;
    }
}

/** 1018h:03: two digits of the major number, two of the minor one. */
static uint32_t version(const motor_node_t *node) {
    const od_entry_t *entry = NULL;
    (void)od_find(OD_IDENTITY_OBJECT, 3, &entry);
    const uint32_t revision = od_read(&node->od, entry);
    return (revision >> 16U & 0xFFU) << 8U | (revision & 0xFFU);
}

/** False when the line is no question. */
static bool reply(const motor_node_t *node, const slcan_line_t *line, slcan_node_t *slcan,
                  slcan_node_text_t *text) {
    if (line->length != 1U) {
        return false;
    }
    switch (line->text[0]) {
    case 'V':
        answer_hex('V', version(node), 4, text);
        return true;
    case 'N': /* 1018h:04, its last four digits */
        answer_hex('N', node->od.identity_object_serial_number, 4, text);
        return true;
    case 'F':
        answer_hex('F', slcan->flags, 2, text);
        slcan->flags = 0;
        return true;
    default:
        return false;
    }
}

static void receive_line(const motor_node_t *node, slcan_node_t *slcan, slcan_node_text_t *text) {
    const slcan_line_t *line = &slcan->line;
    can_frame_t frame;
    if (line->length == 0U) {
        return;
    }
    if (slcan->open && slcan_to_frame(line->text, line->length, &frame)) {
        receive_frame(node, &frame, slcan, text);
    } else if (obey(line, slcan, text)) {
        answer(SLCAN_CR, text);
    } else if (!reply(node, line, slcan, text)) {
        lose_frame(SLCAN_NODE_GARBLED, slcan, text);
    } else {
        /* answered */
    }
}

bool slcan_node_receive(const motor_node_t *node, uint8_t byte, slcan_node_t *slcan,
                        slcan_node_text_t *text) {
    text->length = 0;
    switch (slcan_receive(byte, &slcan->line)) {
    case SLCAN_LINE:
        receive_line(node, slcan, text);
        break;
    case SLCAN_GARBLED:
        lose_frame(SLCAN_NODE_GARBLED, slcan, text);
        break;
    case SLCAN_PENDING:
    default:
        break;
    }
    return slcan->step_due;
}

bool slcan_node_take(const motor_node_t *node, const can_frame_t *frame, slcan_node_t *slcan,
                     slcan_node_text_t *text) {
    text->length = 0;
    receive_frame(node, frame, slcan, text);
    return slcan->step_due;
}

void slcan_node_lose(slcan_node_t *slcan) {
    slcan_lose(&slcan->line);
}

void slcan_node_input(slcan_node_t *slcan, motor_node_input_t *input) {
    if (slcan->step_due) {
        input->elapsed_us = slcan->elapsed_us;
        slcan->step_due = false;
    }
    input->frames = slcan->frames;
    input->frame_count = slcan->frame_count;
    input->frames_lost = slcan->frames_lost;
    slcan->answers_due = slcan->frame_count;
    slcan->frame_count = 0;
    slcan->frames_lost = 0;
}

void slcan_node_output(const motor_node_output_t *output, slcan_node_t *slcan,
                       slcan_node_text_t *text) {
    text->length = 0;
    for (size_t i = 0; slcan->open && i < output->frame_count; i++) {
        text->length += slcan_from_frame(&output->frames[i], &text->text[text->length]);
    }
    for (size_t i = 0; i < slcan->answers_due; i++) {
        answer(SLCAN_CR, text);
    }
    slcan->answers_due = 0;
}
