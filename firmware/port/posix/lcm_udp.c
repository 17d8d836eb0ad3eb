#define _GNU_SOURCE
#include "port/posix/lcm_udp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/filter.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

enum {
    MAGIC_SHORT = 0x4c433032, /* "LC02" */
    HEADER_BYTES = 8,
    UDP_HEADER_BYTES = 8, /* a socket filter on UDP sees the packet from its UDP header on */
    FILTER_MAX = 2 * (LCM_UDP_CHANNEL_MAX + 1) + 2
};

static void put_u32(uint8_t *at, uint32_t value) {
    const uint32_t wire = htonl(value);
    memcpy(at, &wire, sizeof wire);
}

static uint32_t get_u32(const uint8_t *at) {
    uint32_t wire;
    memcpy(&wire, at, sizeof wire);
    return ntohl(wire);
}

bool lcm_udp_parse(const char *url, lcm_udp_address_t *address) {
    static const char prefix[] = "udpm://";
    static const char ttl_option[] = "?ttl=";
    char host[INET_ADDRSTRLEN];
    int used = 0;
    memset(address, 0, sizeof *address);
    if (strncmp(url, prefix, sizeof prefix - 1) != 0) {
        return false;
    }
    url += sizeof prefix - 1;
    if (sscanf(url, "%15[0-9.]:%n", host, &used) != 1 || used == 0) {
        return false;
    }
    char *end = NULL;
    long ttl = 0;
    const long port = strtol(url + used, &end, 10);
    if (strncmp(end, ttl_option, sizeof ttl_option - 1) == 0) {
        ttl = strtol(end + sizeof ttl_option - 1, &end, 10);
    }
    if (port < 1 || port > 65535 || ttl < 0 || ttl > 255 ||
        inet_pton(AF_INET, host, &address->group.sin_addr) != 1) {
        return false;
    }
    address->group.sin_family = AF_INET;
    address->group.sin_port = htons((uint16_t)port);
    address->ttl = (int)ttl;
    return true;
}

bool lcm_udp_sender_open(lcm_udp_sender_t *sender, const lcm_udp_address_t *address) {
    sender->address = *address;
    sender->next_sequence = 0;
    sender->queued = 0;
    sender->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const unsigned char ttl = (unsigned char)address->ttl;
    if (sender->fd < 0 ||
        setsockopt(sender->fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0 ||
        connect(sender->fd, (const struct sockaddr *)&address->group, sizeof address->group) != 0) {
        const int reason = errno;
        lcm_udp_sender_close(sender);
        errno = reason;
        return false;
    }
    return true;
}

void lcm_udp_sender_close(lcm_udp_sender_t *sender) {
    if (sender->fd >= 0) {
        (void)close(sender->fd);
    }
    sender->fd = -1;
}

uint8_t *lcm_udp_reserve(lcm_udp_sender_t *sender, const char *channel, size_t *capacity) {
    const size_t name_bytes = strlen(channel) + 1U;
    if (name_bytes > LCM_UDP_CHANNEL_MAX + 1U) {
        errno = ENAMETOOLONG;
        return NULL;
    }
    if (sender->queued == LCM_UDP_BATCH && !lcm_udp_flush(sender)) {
        return NULL;
    }
    uint8_t *datagram = sender->datagram[sender->queued];
    put_u32(datagram, MAGIC_SHORT);
    put_u32(datagram + 4, sender->next_sequence);
    memcpy(datagram + HEADER_BYTES, channel, name_bytes);
    sender->length[sender->queued] = HEADER_BYTES + name_bytes;
    *capacity = LCM_UDP_MESSAGE_MAX - HEADER_BYTES - name_bytes;
    return datagram + HEADER_BYTES + name_bytes;
}

void lcm_udp_commit(lcm_udp_sender_t *sender, size_t payload_length) {
    sender->length[sender->queued] += payload_length;
    sender->queued++;
    sender->next_sequence++;
}

bool lcm_udp_flush(lcm_udp_sender_t *sender) {
    struct iovec parts[LCM_UDP_BATCH];
    struct mmsghdr messages[LCM_UDP_BATCH];
    const size_t count = sender->queued;
    sender->queued = 0;
    memset(messages, 0, count * sizeof messages[0]);
    for (size_t i = 0; i < count; ++i) {
        parts[i] = (struct iovec){.iov_base = sender->datagram[i], .iov_len = sender->length[i]};
        messages[i].msg_hdr.msg_iov = &parts[i];
        messages[i].msg_hdr.msg_iovlen = 1;
    }
    size_t sent = 0;
    while (sent < count) {
        const int n = sendmmsg(sender->fd, messages + sent, (unsigned)(count - sent), 0);
        if (n > 0) {
            sent += (size_t)n;
        } else if (errno != EINTR) {
            return false;
        }
    }
    return true;
}

/* Accepts a datagram when the bytes behind the LCM header are the channel's name and its NUL. */
static bool attach_channel_filter(int fd, const char *channel) {
    struct sock_filter program[FILTER_MAX];
    unsigned short length = 0;
    const size_t name_bytes = strlen(channel) + 1U;
    if (name_bytes > LCM_UDP_CHANNEL_MAX + 1U) {
        errno = ENAMETOOLONG;
        return false;
    }
    for (size_t i = 0; i < name_bytes; ++i) {
        const uint32_t offset = (uint32_t)(UDP_HEADER_BYTES + HEADER_BYTES + i);
        const uint8_t to_reject = (uint8_t)(2U * (name_bytes - 1U - i) + 1U);
        program[length++] = (struct sock_filter)BPF_STMT(BPF_LD | BPF_B | BPF_ABS, offset);
        program[length++] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K,
                                                         (uint8_t)channel[i], 0, to_reject);
    }
    program[length++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFFU);
    program[length++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, 0);
    const struct sock_fprog filter = {.len = length, .filter = program};
    return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

static bool join_group(int fd, const lcm_udp_address_t *address) {
    const int on = 1;
    const int off = 0;
    const struct ip_mreq request = {.imr_multiaddr = address->group.sin_addr,
                                    .imr_interface.s_addr = htonl(INADDR_ANY)};
    return setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
           setsockopt(fd, IPPROTO_IP, IP_MULTICAST_ALL, &off, sizeof off) == 0 &&
           bind(fd, (const struct sockaddr *)&address->group, sizeof address->group) == 0 &&
           setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request) == 0;
}

bool lcm_udp_receiver_open(lcm_udp_receiver_t *receiver, const lcm_udp_address_t *address,
                           const char *channel, int buffer_bytes) {
    receiver->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (receiver->fd < 0) {
        return false;
    }
    (void)setsockopt(receiver->fd, SOL_SOCKET, SO_RCVBUF, &buffer_bytes, sizeof buffer_bytes);
    (void)setsockopt(receiver->fd, SOL_SOCKET, SO_RCVBUFFORCE, &buffer_bytes, sizeof buffer_bytes);
    if ((channel != NULL && !attach_channel_filter(receiver->fd, channel)) ||
        !join_group(receiver->fd, address)) {
        const int reason = errno;
        lcm_udp_receiver_close(receiver);
        errno = reason;
        return false;
    }
    return true;
}

void lcm_udp_receiver_close(lcm_udp_receiver_t *receiver) {
    if (receiver->fd >= 0) {
        (void)close(receiver->fd);
    }
    receiver->fd = -1;
}

bool lcm_udp_set_timeout(lcm_udp_receiver_t *receiver, int timeout_ms) {
    const struct timeval timeout = {.tv_sec = timeout_ms / 1000,
                                    .tv_usec = (timeout_ms % 1000) * 1000L};
    return setsockopt(receiver->fd, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout) == 0;
}

bool lcm_udp_take_apart(lcm_udp_message_t *message, size_t length) {
    if (length < HEADER_BYTES + 1U || get_u32(message->datagram) != (uint32_t)MAGIC_SHORT) {
        return false;
    }
    const uint8_t *name = message->datagram + HEADER_BYTES;
    const uint8_t *end = memchr(name, 0, length - HEADER_BYTES);
    if (end == NULL) {
        return false;
    }
    message->channel = (const char *)name;
    message->payload = end + 1;
    message->payload_length = (int)(message->datagram + length - message->payload);
    return true;
}

int lcm_udp_receive(lcm_udp_receiver_t *receiver, lcm_udp_message_t *message) {
    const ssize_t n = recv(receiver->fd, message->datagram, sizeof message->datagram, 0);
    if (n < 0) {
        return errno == EAGAIN || errno == EINTR ? 0 : -1;
    }
    return lcm_udp_take_apart(message, (size_t)n) ? 1 : 0;
}
