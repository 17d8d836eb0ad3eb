/**
 * SDO server (CiA 301, 7.2.4): reads and writes the object dictionary, expedited and segmented.
 * Block transfer is refused with abort code 05040001h.
 *
 * A number may be written expedited or segmented; a string is read segmented. A segmented transfer
 * that stands still for SDO_TIMEOUT_us of node time is aborted by the server.
 */
#ifndef SDO_SERVER_H
#define SDO_SERVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "canopen/can_frame.h"
#include "od/od_access.h"

#define SDO_REQUEST_COB_ID 0x600U
#define SDO_RESPONSE_COB_ID 0x580U
#define SDO_TIMEOUT_us 1000000U

/** What the device has to say about an access; called with entries that exist. */
typedef struct {
    /** May this entry be read now? */
    sdo_abort_t (*readable)(const void *device, const od_entry_t *entry);
    /** Checks and stores a value that is within the entry's range, with all that follows from it.
     */
    sdo_abort_t (*write)(void *device, const od_entry_t *entry, uint32_t value);
} sdo_device_t;

typedef enum { SDO_IDLE, SDO_DOWNLOAD, SDO_UPLOAD } sdo_state_t;

typedef struct {
    sdo_state_t state;
    const od_entry_t *entry; /**< of the segmented transfer */
    bool toggle;             /**< expected in the next segment */
    uint32_t since_us;
    uint8_t data[4]; /**< downloaded so far */
    size_t done;     /**< bytes moved */
} sdo_server_t;

/** A request and where it acts. */
typedef struct {
    const sdo_device_t *device_functions;
    void *device;
    const object_dictionary_t *od;
} sdo_target_t;

/** Takes in one request; true when *response is to be sent. */
bool sdo_server_receive(const sdo_target_t *target, const can_frame_t *request,
                        sdo_server_t *server, can_frame_t *response);

/** Lets node time pass; true when *response, an abort for a timeout, is to be sent. */
bool sdo_server_elapse(const object_dictionary_t *od, uint32_t elapsed_us, sdo_server_t *server,
                       can_frame_t *response);

#endif
