/**
 * The joint on this board: encoder, current, temperature, and the servo amplifier. One place that
 * knows how the peripherals make up the node's sensors and its output.
 */
#ifndef JOINT_IO_H
#define JOINT_IO_H

#include "node/motor_node.h"

/** Output off, then all peripherals of the joint. */
void joint_io_start(void);

/** Samples all sensors into the input of a step; the encoder first. */
void joint_io_sample(motor_node_input_t *input);

/** Carries out the output of a step. */
void joint_io_write(int16_t torque_mNm, bool enabled);

#endif
