"""Names of frames by their identifier, and statusword and emergency as one text."""

from hpmc import node_words

HOST_ID = 127
_STATUSWORD_FLAGS = ((7, "warning"), (11, "limit"), (14, "convergence"))
# Services of CiA 301 by the function code of the COB-ID.
SERVICES = {
    0x080: "EMCY", 0x180: "TPDO1", 0x200: "RPDO1", 0x280: "TPDO2", 0x300: "RPDO2", 0x380: "TPDO3",
    0x400: "RPDO3", 0x480: "TPDO4", 0x500: "RPDO4", 0x580: "SDO_reply", 0x600: "SDO_request",
    0x700: "heartbeat",
}  # fmt: skip
_WHOLE_BUS = {0x000: "NMT", 0x080: "SYNC", 0x100: "TIME", 0x7E4: "LSS_reply", 0x7E5: "LSS_request"}


def name_of(cob_id: int) -> tuple[str, int | None, str]:
    """Name, node and service by the identifier alone."""
    if cob_id in _WHOLE_BUS:
        return _WHOLE_BUS[cob_id], None, _WHOLE_BUS[cob_id]
    service, node = SERVICES.get(cob_id & 0x780), cob_id & 0x7F
    if service is None or node == 0 or cob_id > 0x7FF:
        return "unknown", None, "unknown"
    if node == HOST_ID and service == "heartbeat":
        return "HOST_heartbeat", node, service
    return f"N{node}_{service}", node, service


def names() -> list[str]:
    """What a name can be made of: of the whole bus, and of a node."""
    return [*_WHOLE_BUS.values(), *SERVICES.values()]


def emergency_text(data: bytes) -> str:
    """An emergency of 8 bytes."""
    code, register, source = int.from_bytes(data[:2], "little"), data[2], data[3]
    text = f"{code:04X}h {node_words.emergency(code)}"
    if register:
        text += f"; register {register:02X}h ({', '.join(node_words.error_register(register))})"
    if source:
        text += f"; source {source}"
    if detail := int.from_bytes(data[4:8], "little", signed=True):
        text += f"; detail {detail}"
    return text


def statusword_text(statusword: int) -> str:
    """State of the drive, and what the bits beside it say."""
    flags = [name for bit, name in _STATUSWORD_FLAGS if statusword >> bit & 1]
    return ", ".join([node_words.drive_state(statusword), *flags])
