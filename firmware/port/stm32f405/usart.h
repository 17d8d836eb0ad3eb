/**
 * USART1 on PA9 (transmit) and PA10 (receive), 1 Mbit/s, 8N1 (RM0090, section 30).
 *
 * Received bytes go into a ring by interrupt; a byte that is lost (ring full, overrun, framing,
 * noise) is told once at its place. Bytes to send wait in a ring that main empties:
 * sending never blocks and needs no interrupt. What finds no room there is dropped whole, and
 * the caller is told.
 */
#ifndef USART_H
#define USART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define USART_BAUD 1000000U

/** Wakes the node; bytes before it wait in the ring. */
#define USART_LINE_END '\r'

typedef enum { USART_EMPTY, USART_BYTE, USART_LOST } usart_event_t;

/** After gpio_start(). */
void usart_init(uint32_t apb2_Hz);

/** Next received byte, or that some were lost before it. From one context only. */
usart_event_t usart_receive(uint8_t *byte);

/** False when there is no room for all of it. From one context only. */
bool usart_send(const char *text, size_t length);

/** Moves bytes to the transmitter as far as it takes them; true when none are left. From main. */
bool usart_transmit(void);

#endif
