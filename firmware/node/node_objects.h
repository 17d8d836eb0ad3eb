/**
 * What the motor node has to say about SDO access to single objects: values that only it can judge,
 * and writes that have an effect.
 */
#ifndef NODE_OBJECTS_H
#define NODE_OBJECTS_H

#include "canopen/sdo_server.h"

/** For sdo_target_t; device is a motor_node_t. */
extern const sdo_device_t node_objects;

#endif
