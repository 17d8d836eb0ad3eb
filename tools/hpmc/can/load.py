"""How many bits frames take on a classical CAN bus, stuffed bits and CRC included.

The same as can_bits_exact (sim_host/link/can_load.h), for many frames at once. Source: ISO 11898-1
(frame fields, CRC, stuffing from start of frame to the end of the CRC); three bits of intermission
are counted with each frame.
"""

import numpy as np

BIT_RATE = 1_000_000  # bit/s; the bus of the rig (docs/protocol.md)
_CRC_POLYNOMIAL = 0x4599
_HEAD_BITS = 19  # start of frame, identifier, RTR, IDE, r0, length
_TAIL_BITS = 13  # CRC delimiter, acknowledge, end of frame, intermission: never stuffed
_STUFF_AFTER = 5


def frame_bits(cob_ids: np.ndarray, lengths: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Bits of each data frame: identifiers (n), lengths (n), bytes (n, 8) with zeros behind."""
    bits = np.zeros(cob_ids.size, dtype=np.int64)
    for length in np.unique(lengths).tolist():
        rows = np.flatnonzero(lengths == length)
        bits[rows] = _bits(cob_ids[rows].astype(np.uint16), length, data[rows, :length])
    return bits


def _bits(cob_ids: np.ndarray, length: int, data: np.ndarray) -> np.ndarray:
    head = np.zeros((cob_ids.size, _HEAD_BITS), dtype=np.uint8)
    head[:, 1:12] = cob_ids[:, None] >> np.arange(10, -1, -1) & 1
    head[:, 15:19] = length >> np.arange(3, -1, -1) & 1
    fields = np.hstack([head, np.unpackbits(data.astype(np.uint8), axis=1)])
    crc = _crc(fields)
    stream = np.hstack([fields, (crc[:, None] >> np.arange(14, -1, -1) & 1).astype(np.uint8)])
    return stream.shape[1] + _stuffed(stream) + _TAIL_BITS


def _crc(bits: np.ndarray) -> np.ndarray:
    crc = np.zeros(bits.shape[0], dtype=np.uint16)
    for column in bits.T:
        feedback = column ^ (crc >> 14 & 1)
        crc = (crc << 1 & 0x7FFF) ^ np.where(feedback == 1, _CRC_POLYNOMIAL, 0).astype(np.uint16)
    return crc


def _stuffed(bits: np.ndarray) -> np.ndarray:
    """How many bits the sender inserts: one of the other kind after five alike."""
    count = np.zeros(bits.shape[0], dtype=np.int64)
    run = np.zeros(bits.shape[0], dtype=np.int64)
    last = np.full(bits.shape[0], 2, dtype=np.uint8)
    for column in bits.T:
        run = np.where(column == last, run + 1, 1)
        full = run == _STUFF_AFTER
        count += full
        last = np.where(full, 1 - column, column)
        run = np.where(full, 1, run)
    return count
