/**
 * The drive part of the motor node: controlword, mode, faults, and the joint tick with its torque.
 *
 * All functions act on motor_node_t; motor_node.c calls them in the order of a step.
 */
#ifndef NODE_DRIVE_H
#define NODE_DRIVE_H

#include "node/motor_node.h"

/** Carries out a controlword (6040h); a refusal shows in 2200h. */
void node_drive_controlword(uint16_t controlword, motor_node_t *node);

/** Asks for a mode (6060h); a refusal shows in 2200h. */
void node_drive_mode(int8_t mode, motor_node_t *node);

/** Whether the drive has a mode (6060h): -1, 6 or 10. */
bool node_drive_has_mode(int8_t mode);

/** Enters the fault reaction; ramp = false: torque off at once. Only the first fault counts. */
void node_drive_fault(emcy_code_t code, uint8_t source, int32_t detail, bool ramp,
                      motor_node_t *node);

/** NMT has left operational: what 6007h says. */
void node_drive_connection_lost(motor_node_t *node);

/** A position, saturated at the ends of its range. */
int32_t node_drive_position(int64_t position_inc);

/** Takes in the encoder's count of this step; a jump, a stuck encoder or an index pulse out of its
 * place switches the torque off. */
void node_drive_supervise_encoder(int32_t encoder_inc, uint32_t elapsed_us, motor_node_t *node);

/** Monitors of the drive: temperature, current, command deadline, sensors, speed, following error,
 * position limits. */
void node_drive_supervise(uint32_t elapsed_us, motor_node_t *node);

/** One joint tick: torque, statusword and limit reasons into the object dictionary. */
void node_drive_tick(uint32_t elapsed_us, motor_node_t *node);

#endif
