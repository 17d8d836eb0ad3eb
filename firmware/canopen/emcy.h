/**
 * Emergency producer (CiA 301, 7.2.7): error register 1001h, history 1003h, inhibit time 1015h.
 *
 * A frame carries the error code (2 bytes), the error register, the source (node-id, PDO number or
 * kind of encoder fault, else 0) and a detail (i32, for instance the position). Little endian.
 */
#ifndef EMCY_H
#define EMCY_H

#include <stdbool.h>
#include <stdint.h>

#include "canopen/can_frame.h"
#include "canopen/frame_queue.h"
#include "od/object_dictionary.h"

#define EMCY_COB_ID 0x080U

/** Error codes (CiA 301, 7.2.7.1; CiA 402-2), in the words that tools show
 * (tools/hpmc/node_words.py). */
typedef enum {
    EMCY_NO_ERROR = 0x0000,         /**< no error */
    EMCY_OVER_CURRENT = 0x2310,     /**< over-current */
    EMCY_OVER_TEMPERATURE = 0x4310, /**< over-temperature */
    EMCY_PARAMETERS_LOST = 0x5530,  /**< stored parameters lost, defaults taken */
    EMCY_SUPERVISOR_RESET = 0x6010, /**< reset by watchdog or supervisor */
    EMCY_ENCODER = 0x7305,          /**< encoder implausible */
    EMCY_OWN_NODE_ID = 0x8100,      /**< own node-id heard from another device */
    EMCY_HEARTBEAT = 0x8130,        /**< heartbeat missing */
    EMCY_BUS_OFF = 0x8140,          /**< recovered from bus-off */
    EMCY_PDO_TOO_SHORT = 0x8210,    /**< PDO too short, not processed */
    EMCY_PDO_TOO_LONG = 0x8220,     /**< PDO too long */
    EMCY_SYNC_LENGTH = 0x8240,      /**< SYNC of unexpected length */
    EMCY_COMMAND_DEADLINE = 0x8250, /**< no command within the deadline */
    EMCY_OVERSPEED = 0x8400,        /**< overspeed */
    EMCY_FOLLOWING_ERROR = 0x8611,  /**< following error */
    EMCY_POSITION_LIMIT = 0x8612,   /**< position limit exceeded */
    EMCY_MISSED_SYNC = 0x8700       /**< SYNC missing */
} emcy_code_t;

/** Bits of the error register 1001h. */
#define ERROR_REGISTER_GENERIC 0x01U
#define ERROR_REGISTER_CURRENT 0x02U
#define ERROR_REGISTER_TEMPERATURE 0x08U
#define ERROR_REGISTER_COMMUNICATION 0x10U
#define ERROR_REGISTER_DRIVE 0x20U

typedef struct {
    can_frame_t frames[8];
    uint8_t first;
    uint8_t count;
    uint32_t since_us; /**< since the last frame went out */
} emcy_t;

/** Nothing to send; the first emergency need not wait for the inhibit time. */
void emcy_init(emcy_t *emcy);

/** Reports an error that lasts: its register bits stay until emcy_clear. */
void emcy_raise(emcy_code_t code, uint8_t source, int32_t detail, object_dictionary_t *od,
                emcy_t *emcy);

/** Reports an event that is over, or one that the drive goes on with. */
void emcy_report(emcy_code_t code, uint8_t source, int32_t detail, object_dictionary_t *od,
                 emcy_t *emcy);

/** All errors are gone: clears the error register and says so, if it was set. */
void emcy_clear(object_dictionary_t *od, emcy_t *emcy);

/** Lets node time pass and takes out the next frame that may be sent; false when there is none. */
bool emcy_next(const object_dictionary_t *od, uint32_t elapsed_us, bool may_send, emcy_t *emcy,
               can_frame_t *frame);

#endif
