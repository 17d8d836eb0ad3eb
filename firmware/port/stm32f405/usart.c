#include "port/stm32f405/usart.h"

#include "port/stm32f405/board_pins.h"
#include "port/stm32f405/interrupts.h"
#include "port/stm32f405/register_bus.h"
#include "port/stm32f405/registers.h"

/* Powers of two. Received: 32 frames of 22 characters; to send: twice what one step gives. */
#define RECEIVE_SIZE 512U
#define SEND_SIZE 512U
#define ERRORS (USART1_SR_PE | USART1_SR_FE | USART1_SR_NF | USART1_SR_ORE)

/* Each index is written by one side only, after the bytes. */
static volatile uint8_t received[RECEIVE_SIZE];
static volatile uint16_t receive_head;
static volatile uint16_t receive_tail;
static volatile uint8_t to_send[SEND_SIZE];
static volatile uint16_t send_head;
static volatile uint16_t send_tail;
static volatile bool lost;
static volatile uint16_t lost_at; /* place in the ring of the first loss that was not told yet */

void usart_init(uint32_t apb2_Hz) {
    register_set(RCC_APB2ENR, RCC_APB2ENR_USART1EN);
    gpio_configure(PIN_USART_TX);
    gpio_configure(PIN_USART_RX);
    register_write(USART1_BRR, apb2_Hz / USART_BAUD); /* oversampling by 16: both in 1/16 */
    register_write(USART1_CR1, USART1_CR1_UE | USART1_CR1_RXNEIE | USART1_CR1_TE | USART1_CR1_RE);
    interrupts_enable(IRQ_USART1);
}

static void lose(uint16_t head) {
    lost_at = lost ? lost_at : head;
    lost = true;
}

void interrupt_usart1(void) {
    const uint32_t status = register_read(USART1_SR);
    const uint8_t byte = (uint8_t)register_read(USART1_DR); /* clears errors too: RM0090, 30.6.1 */
    const uint16_t head = receive_head;
    const uint16_t next = (uint16_t)((head + 1U) % RECEIVE_SIZE);
    if ((status & ERRORS) != 0U) {
        lose(head);
    }
    if ((status & USART1_SR_RXNE) != 0U) {
        if (next == receive_tail) {
            lose(head);
        } else {
            received[head] = byte;
            receive_head = next;
        }
    }
    if (byte == USART_LINE_END || next == receive_tail) {
        interrupts_request_node();
    }
}

usart_event_t usart_receive(uint8_t *byte) {
    const uint16_t tail = receive_tail;
    const uint32_t before = interrupts_block(); /* the handler may lose the next one just now */
    const bool told = lost && tail == lost_at;
    if (told) {
        lost = false;
    }
    interrupts_restore(before);
    if (told) {
        return USART_LOST;
    }
    if (tail == receive_head) {
        return USART_EMPTY;
    }
    *byte = received[tail];
    receive_tail = (uint16_t)((tail + 1U) % RECEIVE_SIZE);
    return USART_BYTE;
}

bool usart_send(const char *text, size_t length) {
    uint16_t head = send_head;
    const size_t room = (send_tail + SEND_SIZE - head - 1U) % SEND_SIZE;
    if (length > room) {
        return false;
    }
    for (size_t i = 0; i < length; i++) {
        to_send[head] = (uint8_t)text[i];
        head = (uint16_t)((head + 1U) % SEND_SIZE);
    }
    send_head = head;
    return true;
}

bool usart_transmit(void) {
    uint16_t tail = send_tail;
    while (tail != send_head && (register_read(USART1_SR) & USART1_SR_TXE) != 0U) {
        register_write(USART1_DR, to_send[tail]);
        tail = (uint16_t)((tail + 1U) % SEND_SIZE);
        send_tail = tail;
    }
    return tail == send_head;
}
