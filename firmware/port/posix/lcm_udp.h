/**
 * LCM messages over UDP multicast, for loops that cannot afford a general receiver: one socket a
 * channel, filtered in the kernel, read with a blocking call; sending in batches.
 *
 * Wire compatible with liblcm's short messages (magic LC02, sequence number, channel, payload):
 * everything stock (lcm-spy, lcm-logger, liblcm subscribers) sees these messages. liblcm itself
 * filters channels in user space and wakes each process for each datagram, which costs a lockstep
 * loop most of its speed. Messages are at most LCM_UDP_MESSAGE_MAX bytes; fragments are not read.
 */
#ifndef LCM_UDP_H
#define LCM_UDP_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#ifdef __cplusplus
extern "C" {
#endif

#define LCM_UDP_MESSAGE_MAX 8192
#define LCM_UDP_CHANNEL_MAX 63
#define LCM_UDP_BATCH 16

typedef struct {
    struct sockaddr_in group;
    int ttl;
} lcm_udp_address_t;

typedef struct {
    int fd;
    lcm_udp_address_t address;
    uint32_t next_sequence;
    size_t queued;
    size_t length[LCM_UDP_BATCH];
    uint8_t datagram[LCM_UDP_BATCH][LCM_UDP_MESSAGE_MAX];
} lcm_udp_sender_t;

/** Losses show as gaps in the messages' own sequence numbers: the kernel's count of drops
 * (SO_RXQ_OVFL) also counts what the channel filter rejects. */
typedef struct {
    int fd;
} lcm_udp_receiver_t;

/** A received datagram, taken apart; channel and payload point into `datagram`. */
typedef struct {
    uint8_t datagram[LCM_UDP_MESSAGE_MAX];
    const char *channel;
    const uint8_t *payload;
    int payload_length;
} lcm_udp_message_t;

/** Reads "udpm://A.B.C.D:PORT?ttl=N". False when it is not of that form. */
bool lcm_udp_parse(const char *url, lcm_udp_address_t *address);

/** Opens the socket. False: errno says why. */
bool lcm_udp_sender_open(lcm_udp_sender_t *sender, const lcm_udp_address_t *address);
/** Closes it; what is queued is dropped. */
void lcm_udp_sender_close(lcm_udp_sender_t *sender);

/** Room for the payload of the next message, and its capacity in bytes; NULL when the batch is full
 * and could not be sent or the channel name is too long. */
uint8_t *lcm_udp_reserve(lcm_udp_sender_t *sender, const char *channel, size_t *capacity);
/** Completes the message that lcm_udp_reserve began. */
void lcm_udp_commit(lcm_udp_sender_t *sender, size_t payload_length);
/** Sends what is queued. False: errno says why, and the batch is dropped. */
bool lcm_udp_flush(lcm_udp_sender_t *sender);

/** Joins the group for one channel, or for all when channel is NULL. */
bool lcm_udp_receiver_open(lcm_udp_receiver_t *receiver, const lcm_udp_address_t *address,
                           const char *channel, int buffer_bytes);
void lcm_udp_receiver_close(lcm_udp_receiver_t *receiver);

/** Waits up to about timeout_ms (set once per receiver, 0 = no waiting) for one message.
 * 1: a message; 0: none in time, or a signal came; -1: error (errno). */
int lcm_udp_receive(lcm_udp_receiver_t *receiver, lcm_udp_message_t *message);
bool lcm_udp_set_timeout(lcm_udp_receiver_t *receiver, int timeout_ms);

/** Takes a datagram of `length` bytes in message->datagram apart. False when it is not LCM. */
bool lcm_udp_take_apart(lcm_udp_message_t *message, size_t length);

#ifdef __cplusplus
}
#endif

#endif
