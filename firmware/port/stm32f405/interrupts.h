/**
 * Exceptions that the image handles, their priorities, and how code keeps them out.
 *
 * | handler | priority | does |
 * |---|---|---|
 * | faults | -1 .. 0 | torque off, record, reset (fault.h) |
 * | interrupt_time, SysTick | 0 | clock, supervisor; off the crystal it asks for the joint tick |
 * | interrupt_tick_timer, TIM2 | 1 | asks for the joint tick, in step with SYNC |
 * | interrupt_can_cyclic, _other | 1 | receive into a ring; SYNC disciplines TIM2 |
 * | interrupt_usart1 | 1 | receives into a ring |
 * | interrupt_node, PendSV | 15 | the node: frames, joint tick |
 * | main | | sends out bytes, feeds the watchdog |
 *
 * A smaller number goes first. The node is never entered from two of them.
 */
#ifndef INTERRUPTS_H
#define INTERRUPTS_H

#include <stdint.h>

#define PRIORITY_TIME 0U
#define PRIORITY_RECEIVE 1U
#define PRIORITY_NODE 15U

/** SysTick. */
void interrupt_time(void);
/** PendSV. */
void interrupt_node(void);
/** TIM2. */
void interrupt_tick_timer(void);
/** CAN1, FIFO 0. */
void interrupt_can_cyclic(void);
/** CAN1, FIFO 1. */
void interrupt_can_other(void);
/** USART1. */
void interrupt_usart1(void);

/** Sets the priorities of the core's own exceptions. */
void interrupts_init(void);

/** Enables a peripheral's interrupt at PRIORITY_RECEIVE. */
void interrupts_enable(uint32_t interrupt);

/** Lets interrupt_node run as soon as nothing more urgent does. */
void interrupts_request_node(void);

/** Keeps all interrupts but faults out until interrupts_restore; calls may nest. Returns the mask
 * to restore, PRIMASK. */
static inline uint32_t interrupts_block(void) {
    uint32_t primask; /* mask of the interrupts, 0 or 1 */
    __asm__ volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
}

/** Ends what the matching interrupts_block has begun. primask: what it returned, 0 or 1. */
static inline void interrupts_restore(uint32_t primask) {
    __asm__ volatile("msr primask, %0" ::"r"(primask) : "memory");
}

#endif
