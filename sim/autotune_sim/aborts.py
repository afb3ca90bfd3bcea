"""SDO abort codes (CiA 301, 7.2.4.3.17) and the exception that carries one to the master."""

from __future__ import annotations

from enum import IntEnum


class AbortCode(IntEnum):
    """Why a transfer is refused."""

    TOGGLE = 0x05030000
    COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    SEQUENCE = 0x05040003
    CRC = 0x05040004
    ACCESS = 0x06010000
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_LENGTH = 0x06040042
    PARAMETERS = 0x06040043
    HARDWARE = 0x06060000
    LENGTH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    RANGE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    GENERAL = 0x08000000
    STORE = 0x08000020
    STATE = 0x08000022
    NO_DATA = 0x08000024


class Abort(Exception):
    """An SDO transfer is refused; `code` is what the master is told."""

    def __init__(self, code: int) -> None:
        super().__init__(f"SDO abort {int(code):08X}h")
        self.code = int(code)
