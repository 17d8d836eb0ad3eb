/**
 * The motor node: CANopen device (CiA 301), drive (CiA 402) and joint torque controller (FIC) as
 * one step function. Ports call it once per joint tick; the simulator links the very same object.
 *
 * It knows no clock, bus or sensor: time comes in as elapsed_us, frames as arrays. One step: node
 * time advances; all frames are processed in order; the position is sampled; at SYNC the last RPDO1
 * has become the acting command; one joint tick of the controller; TPDO1 with this tick's position,
 * torque and statusword if there was a SYNC; then TPDO2, heartbeat and EMCY as they are due.
 *
 * All state is in motor_node_t, so that several nodes run in one process. Reactions to errors:
 * docs/protocol.md, "What a node does when things go wrong".
 */
#ifndef MOTOR_NODE_H
#define MOTOR_NODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"
#include "canopen/emcy.h"
#include "canopen/frame_queue.h"
#include "canopen/heartbeat.h"
#include "canopen/lss.h"
#include "canopen/nmt.h"
#include "canopen/pdo.h"
#include "canopen/sdo_server.h"
#include "canopen/sync.h"
#include "cia402/drive_state.h"
#include "cia402/homing.h"
#include "control/joint_controller.h"
#include "control/torque_guard.h"
#include "node/crash_record.h"
#include "node/parameter_store.h"
#include "od/object_dictionary.h"

/** Most frames that one step takes in; a port hands over more in the next step. */
#define MOTOR_NODE_RX_MAX 32U
/** Most frames that one step gives out; the node keeps further ones for the next step. */
#define MOTOR_NODE_TX_MAX 8U

/** What distinguishes one device from another: set once by the port, before motor_node_init. */
typedef struct {
    uint8_t node_id;        /**< at power-on unless one is stored: 1..127, or LSS_UNCONFIGURED */
    bool node_id_by_switch; /**< node_id is not to be replaced by a stored one */
    uint32_t serial_number; /**< 1018h:04, unique; 0: the one that is stored */
    bool referenced;        /**< the encoder's zero is known (absolute or stored reference) */
    bool supervisor_reset;  /**< the watchdog or a failed self-check has brought this power-on */
    bool image_damaged;     /**< the image's checksum is wrong: enabling is refused */
    bool clock_fallback; /**< on the internal oscillator: enabling is refused while node time comes
                              from it (2F01h = 0) */
    const parameter_memory_t *memory; /**< NULL: 1010h and LSS store are refused */
    const crash_record_t *crash;      /**< of the reset before; NULL: none is kept */
    const char *software_version;     /**< 100Ah; NULL: version and protocol hash */
    uint8_t sensor_source;            /**< 2F00h at the begin: 0 at power-on */
    uint8_t time_base;                /**< 2F01h at the begin: 0 at power-on */
    uint8_t frame_link;               /**< 2107h: 0 CAN, 1 or 2 the serial line, and why */
} motor_node_config_t;

typedef struct {
    uint32_t elapsed_us;        /**< node time since the last step, 0..1000000 */
    int32_t position_inc;       /**< encoder, used unless 2F00h says injected */
    int16_t temperature_dC;     /**< 0.1 degree Celsius, used unless injected */
    bool index_seen;            /**< the encoder's index pulse has passed since the last step */
    uint32_t current_mA;        /**< of the motor, its size */
    bool bus_off;               /**< the CAN controller is off the bus; it recovers by itself */
    int32_t index_position_inc; /**< of the encoder, captured at the pulse */
    const can_frame_t *frames;  /**< in order of arrival; may be NULL when frame_count is 0 */
    size_t frame_count;         /**< 0..MOTOR_NODE_RX_MAX */
    uint32_t frames_lost;       /**< by the port since the last step; counted in 2201h:08 */
} motor_node_input_t;

typedef struct {
    int16_t torque_mNm;   /**< set value for the motor, 0 unless output_enabled */
    bool output_enabled;  /**< power stage on */
    bool reset_requested; /**< NMT reset node: the port calls motor_node_restart */
    size_t frame_count;
    can_frame_t frames[MOTOR_NODE_TX_MAX]; /**< to send, in this order */
} motor_node_output_t;

/** Why enabling was refused: bits of object 2200h, beside those of torque_guard.h. */
#define LIMIT_REASON_NOT_REFERENCED 0x0100U
#define LIMIT_REASON_NO_COMMAND 0x0200U     /**< no RPDO1 acted within the deadline */
#define LIMIT_REASON_OUTSIDE_WINDOW 0x0400U /**< |Q_d - q| above 6065h */
#define LIMIT_REASON_NO_POSITION 0x0800U    /**< injected sensors without an RPDO4 */
#define LIMIT_REASON_MODE 0x1000U           /**< no mode, or one that the drive does not have */
#define LIMIT_REASON_CONFIGURATION 0x2000U  /**< q_a <= q_p <= q_b does not hold */
#define LIMIT_REASON_CLOCK 0x8000U          /**< internal oscillator, free-running */
/** The 16 bits are taken; emergency 6010h tells a damaged image from the oscillator. */
#define LIMIT_REASON_IMAGE LIMIT_REASON_CLOCK

/** Modes of operation (6060h). */
#define MODE_FRACTAL_IMPEDANCE (-1)
#define MODE_NONE 0
#define MODE_HOMING 6
#define MODE_CYCLIC_SYNCHRONOUS_TORQUE 10

/** Read it in tests and simulators; only the functions below change it. */
typedef struct {
    object_dictionary_t od;
    object_dictionary_t power_on; /**< workspace of a reset: too large for the stack */
    const parameter_memory_t *memory;

    uint8_t node_id;        /**< in use: 1..127, or LSS_UNCONFIGURED */
    uint8_t stored_node_id; /**< of the next power-on */
    lss_t lss;
    nmt_state_t nmt;
    bool boot_up_sent;
    bool reset_requested;
    bool own_id_heard; /**< stops once the emergency is out */
    sync_t sync;
    sdo_server_t sdo;
    emcy_t emcy;
    heartbeat_producer_t heartbeat_producer;
    heartbeat_consumer_t heartbeat_consumer;
    rpdo_t rpdo1;
    rpdo_t rpdo2;
    rpdo_t rpdo4;
    tpdo_event_t tpdo2;
    uint32_t tpdo2_content; /**< mode and limit reasons of the step before; a change is an event */
    frame_queue_t to_send;

    can_frame_t waiting_command; /**< newest RPDO1, acts at the next SYNC */
    bool command_waiting;
    bool command_acted; /**< a command has acted since the node became operational */
    uint32_t since_command_us;

    bool referenced;
    bool encoder_referenced; /**< without homing: an absolute encoder */
    bool position_known;
    uint32_t since_position_us; /**< since the newest RPDO4 */
    int32_t offset_inc;         /**< position = encoder + offset, from homing */
    bool encoder_known;         /**< encoder_inc is of the step before */
    int32_t encoder_inc;
    uint32_t since_encoder_us; /**< since it last changed */
    uint32_t stuck_us;
    bool index_referenced; /**< index_home_inc is a place of the index pulse */
    int32_t index_home_inc;
    bool index_seen; /**< in this step */
    int32_t index_encoder_inc;
    homing_t homing;
    int8_t moving;      /**< direction of motion in the last interval of the speed, 0 = at rest */
    uint32_t speed_ppm; /**< of 6080h, in that interval */
    bool bus_off;
    bool clock_fallback;
    bool image_damaged;
    uint32_t current_mA;
    uint64_t mean_square_mA2;
    uint32_t load_ppm; /**< of it, in the last interval of the speed; see derating.h */
    bool outside_limits;
    int32_t speed_from_inc; /**< begin of the interval over which speed is measured */
    uint32_t speed_since_us;
    uint32_t following_error_us;

    drive_t drive;
    bool halted;
    bool restart; /**< the controller is to start afresh at this tick's position */
    bool hold;    /**< Q_d is to be held at this tick's position */
    bool holding;
    uint16_t refusals;
    uint32_t ramp_ppm;  /**< output bound / TA */
    torque_t torque_Nm; /**< output of the step before, not rounded */
    joint_controller_config_t control;
    joint_controller_t controller;
} motor_node_t;

/** Power-on: defaults, boot-up message with the first step, pre-operational, switch on disabled. */
void motor_node_init(const motor_node_config_t *config, motor_node_t *node);

/** NMT reset node: as a power cycle, but for what belongs to the bench and not to the device, which
 * it keeps: the sensor source and the time base in which the rig steps it. */
void motor_node_restart(motor_node_config_t *config, motor_node_t *node);

/** One joint tick. */
void motor_node_step(const motor_node_config_t *config, motor_node_t *node,
                     const motor_node_input_t *input, motor_node_output_t *output);

/**
 * Which COB-IDs a node takes in: NMT, SYNC, its own RPDO1, 2, 4 and SDO request, heartbeats and
 * emergencies, LSS, and those that it sends itself: from another device they mean that two have the
 * same node-id. Without a node-id LSS alone. Hardware filters are made from it (a controller does
 * not receive its own frames), and the host counts with it.
 */
bool motor_node_accepts(uint8_t node_id, uint16_t cob_id);

#endif
