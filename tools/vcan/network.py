"""Brings up a network namespace's vcan0, loopback multicast and multicast route by rtnetlink.

The same as these commands of iproute2, in 1 ms instead of 150 ms inside user-mode Linux:
    ip link set dev lo up multicast on
    ip route add 224.0.0.0/4 dev lo
    ip link add dev vcan0 txqueuelen 1000 type vcan
    ip link set dev vcan0 up
"""

from __future__ import annotations

import errno
import os
import socket
import struct

RTM_NEWLINK, RTM_NEWROUTE = 16, 24
NLM_F_REQUEST, NLM_F_ACK, NLM_F_EXCL, NLM_F_CREATE = 0x1, 0x4, 0x200, 0x400
IFF_UP, IFF_MULTICAST = 0x1, 0x1000
IFLA_IFNAME, IFLA_TXQLEN, IFLA_LINKINFO, IFLA_INFO_KIND = 3, 13, 18, 1
RTA_DST, RTA_OIF = 1, 4
RT_TABLE_MAIN, RTPROT_BOOT, RT_SCOPE_LINK, RTN_UNICAST = 254, 3, 253, 1

HEADER = struct.Struct("=IHHII")
LINK = struct.Struct("=BxHiII")
ROUTE = struct.Struct("=8BI")


def attribute(kind: int, data: bytes) -> bytes:
    return struct.pack("=HH", 4 + len(data), kind) + data + bytes(-len(data) % 4)


def request(kind: int, flags: int, body: bytes) -> None:
    """Sends one request; OSError if the kernel refuses it."""
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as route:
        flags |= NLM_F_REQUEST | NLM_F_ACK
        route.send(HEADER.pack(HEADER.size + len(body), kind, flags, 1, 0) + body)
        (error,) = struct.unpack_from("=i", route.recv(4096), HEADER.size)
    if error:
        raise OSError(-error, os.strerror(-error))


def set_up() -> None:
    """OSError, with a text that says which step failed, if the kernel cannot do it."""
    up = IFF_UP | IFF_MULTICAST
    lo = socket.if_nametoindex("lo")
    request(RTM_NEWLINK, 0, LINK.pack(socket.AF_UNSPEC, 0, lo, up, up))
    route = ROUTE.pack(
        socket.AF_INET, 4, 0, 0, RT_TABLE_MAIN, RTPROT_BOOT, RT_SCOPE_LINK, RTN_UNICAST, 0
    )
    route += attribute(RTA_DST, socket.inet_aton("224.0.0.0"))
    route += attribute(RTA_OIF, struct.pack("=i", lo))
    request(RTM_NEWROUTE, NLM_F_CREATE | NLM_F_EXCL, route)
    vcan = LINK.pack(socket.AF_UNSPEC, 0, 0, IFF_UP, IFF_UP)
    vcan += attribute(IFLA_IFNAME, b"vcan0\0")
    vcan += attribute(IFLA_TXQLEN, struct.pack("=I", 1000))
    vcan += attribute(IFLA_LINKINFO, attribute(IFLA_INFO_KIND, b"vcan"))
    try:
        request(RTM_NEWLINK, NLM_F_CREATE | NLM_F_EXCL, vcan)
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        if error.errno in (errno.EOPNOTSUPP, errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
            raise OSError(error.errno, "the kernel has no CAN (modules can-raw and vcan)") from None
        raise
