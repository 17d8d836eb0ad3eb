#define _GNU_SOURCE
#include "port/posix/can_socket.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

enum { FILTER_MAX = 32, RECEIVE_BUFFER_BYTES = 4 << 20 };

static bool set_filters(int fd, const can_socket_filter_t *filters, size_t count) {
    struct can_filter raw[FILTER_MAX];
    if (count > FILTER_MAX) {
        errno = E2BIG;
        return false;
    }
    for (size_t i = 0; i < count; ++i) {
        raw[i].can_id = filters[i].match;
        raw[i].can_mask = (canid_t)filters[i].mask | CAN_EFF_FLAG | CAN_RTR_FLAG;
    }
    return setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, raw,
                      (socklen_t)(count * sizeof(struct can_filter))) == 0;
}

bool can_socket_open(can_socket_t *can, const char *interface, const can_socket_filter_t *filters,
                     size_t filter_count) {
    memset(can, 0, sizeof *can);
    can->fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    if (can->fd < 0) {
        return false;
    }
    struct sockaddr_can address = {.can_family = AF_CAN,
                                   .can_ifindex = (int)if_nametoindex(interface)};
    const int on = 1;
    const int buffer_bytes = RECEIVE_BUFFER_BYTES;
    const can_err_mask_t errors = CAN_ERR_MASK;
    (void)setsockopt(can->fd, SOL_SOCKET, SO_RCVBUF, &buffer_bytes, sizeof buffer_bytes);
    (void)setsockopt(can->fd, SOL_SOCKET, SO_RCVBUFFORCE, &buffer_bytes, sizeof buffer_bytes);
    const bool ok =
        address.can_ifindex != 0 &&
        setsockopt(can->fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on) == 0 &&
        setsockopt(can->fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0 &&
        (filters == NULL || set_filters(can->fd, filters, filter_count)) &&
        bind(can->fd, (const struct sockaddr *)&address, sizeof address) == 0;
    if (!ok) {
        const int reason = address.can_ifindex == 0 ? ENODEV : errno;
        can_socket_close(can);
        errno = reason;
    }
    return ok;
}

bool can_socket_set_filters(can_socket_t *can, const can_socket_filter_t *filters,
                            size_t filter_count) {
    return set_filters(can->fd, filters, filter_count);
}

void can_socket_close(can_socket_t *can) {
    if (can->fd >= 0) {
        (void)close(can->fd);
    }
    can->fd = -1;
}

bool can_socket_send(can_socket_t *can, const can_frame_t *frames, size_t count, int timeout_ms) {
    struct can_frame raw[CAN_SOCKET_BATCH];
    struct iovec parts[CAN_SOCKET_BATCH];
    struct mmsghdr messages[CAN_SOCKET_BATCH];
    if (count > CAN_SOCKET_BATCH) {
        errno = E2BIG;
        return false;
    }
    memset(raw, 0, count * sizeof raw[0]);
    memset(messages, 0, count * sizeof messages[0]);
    for (size_t i = 0; i < count; ++i) {
        raw[i].can_id = frames[i].id;
        raw[i].can_dlc = frames[i].len;
        memcpy(raw[i].data, frames[i].data, frames[i].len);
        parts[i] = (struct iovec){.iov_base = &raw[i], .iov_len = sizeof raw[i]};
        messages[i].msg_hdr.msg_iov = &parts[i];
        messages[i].msg_hdr.msg_iovlen = 1;
    }
    size_t sent = 0;
    while (sent < count) {
        const int n = sendmmsg(can->fd, messages + sent, (unsigned)(count - sent), 0);
        if (n > 0) {
            sent += (size_t)n;
        } else if (errno == ENOBUFS || errno == EAGAIN) {
            can->back_pressure++;
            struct pollfd room = {.fd = can->fd, .events = POLLOUT};
            if (poll(&room, 1, timeout_ms) <= 0) {
                errno = ETIMEDOUT;
                return false;
            }
        } else if (errno != EINTR) {
            return false;
        }
    }
    return true;
}

static void note_drops(can_socket_t *can, struct msghdr *header) {
    for (struct cmsghdr *c = CMSG_FIRSTHDR(header); c != NULL; c = CMSG_NXTHDR(header, c)) {
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
            memcpy(&can->dropped, CMSG_DATA(c), sizeof can->dropped);
        }
    }
}

size_t can_socket_receive(can_socket_t *can, can_frame_t *frames, size_t count, int timeout_ms) {
    struct can_frame raw[CAN_SOCKET_BATCH];
    struct iovec parts[CAN_SOCKET_BATCH];
    struct mmsghdr messages[CAN_SOCKET_BATCH];
    _Alignas(struct cmsghdr) uint8_t control[CAN_SOCKET_BATCH][CMSG_SPACE(sizeof(uint32_t))];
    size_t received = 0;
    while (received < count && received < CAN_SOCKET_BATCH) {
        const size_t wanted = count - received;
        memset(messages, 0, wanted * sizeof messages[0]);
        for (size_t i = 0; i < wanted; ++i) {
            parts[i] = (struct iovec){.iov_base = &raw[i], .iov_len = sizeof raw[i]};
            messages[i].msg_hdr = (struct msghdr){.msg_iov = &parts[i],
                                                  .msg_iovlen = 1,
                                                  .msg_control = control[i],
                                                  .msg_controllen = sizeof control[i]};
        }
        const int n = recvmmsg(can->fd, messages, (unsigned)wanted, MSG_DONTWAIT, NULL);
        if (n <= 0) {
            struct pollfd data = {.fd = can->fd, .events = POLLIN};
            if ((n < 0 && errno != EAGAIN) || poll(&data, 1, timeout_ms) <= 0) {
                break;
            }
            continue;
        }
        for (int i = 0; i < n; ++i) {
            /* cppcheck-suppress uninitvar ; recvmmsg has filled it through parts[i] */
            if ((raw[i].can_id & CAN_ERR_FLAG) != 0U) {
                can->error_frames++;
                can->bus_off = (raw[i].can_id & CAN_ERR_BUSOFF) != 0U ||
                               (can->bus_off && (raw[i].can_id & CAN_ERR_RESTARTED) == 0U);
                continue;
            }
            can_frame_t *frame = &frames[received++];
            frame->id = (uint16_t)(raw[i].can_id & CAN_SFF_MASK);
            frame->len = raw[i].can_dlc > 8U ? 8U : raw[i].can_dlc;
            memset(frame->data, 0, sizeof frame->data);
            memcpy(frame->data, raw[i].data, frame->len);
        }
        note_drops(can, &messages[n - 1].msg_hdr);
    }
    return received;
}
