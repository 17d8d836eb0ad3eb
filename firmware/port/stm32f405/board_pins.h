/**
 * Which pin of the STM32F405RG (LQFP64) does what on this board: the pin table of
 * docs/hardware/wiring.md, which a test compares with this header. Alternate functions: DS8626
 * table 9.
 *
 * Left alone: PA13, PA14 (SWDIO, SWCLK), PB3 (SWO), PB2 (BOOT1), PA11, PA12 (USB, for DFU), PH0,
 * PH1 (crystal 8 MHz), PC14, PC15 (32 kHz crystal).
 */
#ifndef BOARD_PINS_H
#define BOARD_PINS_H

#include "port/stm32f405/gpio.h"
#include "port/stm32f405/registers.h"

/* bus: CAN1 */
#define PIN_CAN_RX ((gpio_pin_t){GPIOB_BASE, 8, GPIO_ALTERNATE, 9, GPIO_PULL_UP})
#define PIN_CAN_TX ((gpio_pin_t){GPIOB_BASE, 9, GPIO_ALTERNATE, 9, GPIO_NO_PULL})
/* SLCAN: USART1, 3.3 V */
#define PIN_USART_TX ((gpio_pin_t){GPIOA_BASE, 9, GPIO_ALTERNATE, 7, GPIO_NO_PULL})
#define PIN_USART_RX ((gpio_pin_t){GPIOA_BASE, 10, GPIO_ALTERNATE, 7, GPIO_PULL_UP})
/* encoder: TIM5 channels 1 to 3 */
#define PIN_ENCODER_A ((gpio_pin_t){GPIOA_BASE, 0, GPIO_ALTERNATE, 2, GPIO_PULL_UP})
#define PIN_ENCODER_B ((gpio_pin_t){GPIOA_BASE, 1, GPIO_ALTERNATE, 2, GPIO_PULL_UP})
#define PIN_ENCODER_INDEX ((gpio_pin_t){GPIOA_BASE, 2, GPIO_ALTERNATE, 2, GPIO_PULL_DOWN})
/* servo amplifier: TIM1 channel 1, and its enable input */
#define PIN_SERVO_PWM ((gpio_pin_t){GPIOA_BASE, 8, GPIO_ALTERNATE, 1, GPIO_NO_PULL})
#define PIN_SERVO_ENABLE ((gpio_pin_t){GPIOB_BASE, 13, GPIO_OUTPUT, 0, GPIO_NO_PULL})
/* sensors: ADC1 channels 10 and 11 */
#define PIN_MOTOR_CURRENT ((gpio_pin_t){GPIOC_BASE, 0, GPIO_ANALOG, 0, GPIO_NO_PULL})
#define PIN_MOTOR_TEMPERATURE ((gpio_pin_t){GPIOC_BASE, 1, GPIO_ANALOG, 0, GPIO_NO_PULL})
/* node-id: switches to ground, side by side from PC2 on */
#define PIN_NODE_ID_BIT0 ((gpio_pin_t){GPIOC_BASE, 2, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT1 ((gpio_pin_t){GPIOC_BASE, 3, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT2 ((gpio_pin_t){GPIOC_BASE, 4, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT3 ((gpio_pin_t){GPIOC_BASE, 5, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT4 ((gpio_pin_t){GPIOC_BASE, 6, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT5 ((gpio_pin_t){GPIOC_BASE, 7, GPIO_INPUT, 0, GPIO_PULL_UP})
#define PIN_NODE_ID_BIT6 ((gpio_pin_t){GPIOC_BASE, 8, GPIO_INPUT, 0, GPIO_PULL_UP})
/* light: lit while the motor may have torque */
#define PIN_TORQUE_LIGHT ((gpio_pin_t){GPIOB_BASE, 14, GPIO_OUTPUT, 0, GPIO_NO_PULL})

#endif
