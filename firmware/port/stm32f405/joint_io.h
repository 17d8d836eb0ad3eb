/**
 * The joint on this board: encoder, current, temperature, and the servo amplifier. One place that
 * knows how the peripherals make up the node's sensors and its output.
 */
#ifndef JOINT_IO_H
#define JOINT_IO_H

#include "node/motor_node.h"

/** Output off, then all peripherals of the joint but the encoder's counter. */
void joint_io_start(void);

/** The encoder counts from 0, in the direction of object 2106h:07. */
void joint_io_start_encoder(const object_dictionary_t *od);

/** Samples all sensors into the input of a step, the encoder first; scales: 2106h:03 to :06. */
void joint_io_sample(const object_dictionary_t *od, motor_node_input_t *input);

/** Carries out the output of a step; scale and offset: 2106h:01 and :02. torque_mNm: set value. */
void joint_io_write(const object_dictionary_t *od, int16_t torque_mNm, bool enabled);

#endif
