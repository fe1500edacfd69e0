"""Reads from a shared library's file the system and processor for which it was built. If they are wrong, systems report little more than that
the file cannot be loaded.
"""

from __future__ import annotations

import os
import re
import struct
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

_OTHER = "another processor"
_ELF = {3: "x86", 40: "arm", 62: "x86-64", 183: "arm64"}
_PE = {0x014C: "x86", 0x01C4: "arm", 0x8664: "x86-64", 0xAA64: "arm64"}
_MACH = {0x01000007: "x86-64", 0x0100000C: "arm64"}


@dataclass(frozen=True)
class Platform:
    """A system and a processor; `None` for the processor means any."""

    system: str
    processor: str | None

    def __str__(self) -> str:
        return f"{self.system} on {self.processor}" if self.processor else self.system

    def fits(self, process: Platform) -> bool:
        """Whether a process of that platform can load such a library."""
        return self.system == process.system and (self.processor is None or self.processor == process.processor)


def this_process() -> Platform:
    """The system and processor of this process, which may differ from the machine's."""
    system = {"win32": "Windows", "darwin": "macOS"}.get(sys.platform, "Linux")
    platform = sysconfig.get_platform().lower().replace("_", "-")
    narrow = struct.calcsize("P") == 4
    names = {
        "x86-64": "x86-64",
        "amd64": "x86-64",
        "arm64": "arm64",
        "aarch64": "arm64",
        "win32": "x86",
        "i686": "x86",
        "armv7l": "arm",
        # A universal Python binary: the machine type tells which processor runs it.
        "universal2": {"x86_64": "x86-64"}.get(os.uname().machine if hasattr(os, "uname") else "", "arm64"),
    }
    for name, processor in names.items():
        if platform.endswith(name):
            return Platform(system, "x86" if narrow and processor == "x86-64" else processor)
    return Platform(system, _OTHER)


def mismatch(path: Path) -> tuple[str, str] | None:
    """Why a file cannot be a library for this process, and the remedy; `None` if it seems to be one."""
    try:
        with path.open("rb") as file:
            head = file.read(1 << 12)
            length = os.fstat(file.fileno()).st_size
    except OSError as why:
        return f"cannot be read: {why.strerror or why}", "Make it a file that this user may read"
    built_for = _platform(head)
    if built_for is None:
        return "is no shared library", "Name the file that is Cairn's library, and whole"
    process = this_process()
    if not built_for.fits(process):
        remedy = f"Install the wheel for {process}, or use a Python for {built_for}"
        return f"is made for {built_for}, and this Python is {process}", remedy
    size = _minimum_size(head)
    if length < size:
        # The system's loader may crash on such a file.
        return f"is cut off: it has {length} bytes of {size} at least", "Install the wheel again, or copy the whole file again"
    return None


def _platform(head: bytes) -> Platform | None:
    """The platform of a library file; `None` if the file is not a library."""
    if head[:4] == b"\x7fELF" and len(head) >= 64:
        # Little-endian, as all supported processors.
        processor = _ELF.get(int.from_bytes(head[18:20], "little"), _OTHER) if head[5] == 1 else _OTHER
        # The x32 ABI has 32-bit ELF files.
        return Platform("Linux", "x32" if processor == "x86-64" and head[4] == 1 else processor)
    if head[:2] == b"MZ" and len(head) >= 64:
        at = int.from_bytes(head[60:64], "little")
        if head[at : at + 4] != b"PE\0\0":
            return None
        return Platform("Windows", _PE.get(int.from_bytes(head[at + 4 : at + 6], "little"), _OTHER))
    if head[:4] == b"\xcf\xfa\xed\xfe":
        return Platform("macOS", _MACH.get(int.from_bytes(head[4:8], "little"), _OTHER))
    # A universal binary for several processors.
    return Platform("macOS", None) if head[:4] == b"\xca\xfe\xba\xbe" else None


def _minimum_size(head: bytes) -> int:
    """The smallest size in bytes that the file must have by its headers, for 64-bit ELF and for PE; 0 if unknown."""
    end = 0
    if head[:5] == b"\x7fELF\x02":
        (table,) = struct.unpack_from("<Q", head, 32)
        size, count = struct.unpack_from("<HH", head, 54)
        for i in range(count if size >= 56 else 0):
            at = table + i * size
            if at + 56 <= len(head):
                offset, _, _, in_file = struct.unpack_from("<QQQQ", head, at + 8)
                end = max(end, offset + in_file)
    elif head[:2] == b"MZ":
        (at,) = struct.unpack_from("<I", head, 60)
        count, options = (int.from_bytes(head[at + place : at + place + 2], "little") for place in (6, 20))
        for i in range(count):
            section = at + 24 + options + 40 * i
            if section + 40 <= len(head):
                in_file, offset = struct.unpack_from("<II", head, section + 16)
                end = max(end, offset + in_file)
    return end


# ERROR_SYSTEM_INTEGRITY_POLICY_VIOLATION, also that of Smart App Control: an unsigned library is refused.
_BY_POLICY = 4551


def explain_failure(why: OSError) -> tuple[str, str] | None:
    """An explanation and a remedy for a known error with which a system refuses to load a library of the right platform."""
    message = str(why)
    if found := re.search(r"GLIBC_(\d+(?:\.\d+)+)[^\d.].*not found", message):
        cause = f"needs glibc {found[1]} or newer, and this system has {_c_library()}"
        remedy = "Use a newer Linux, such as Debian 10, Ubuntu 20.04, RHEL 8 or later for the wheel, or build the library on this one"
        return cause, remedy
    if sys.platform.startswith("linux") and not _glibc():
        remedy = "Use a Linux with glibc, or build the library on this one"
        return f"is made for glibc, and this system has {_c_library()}: {message}", remedy
    if sys.platform == "win32" and getattr(why, "winerror", None) == _BY_POLICY:
        remedy = "Ask whoever set the policy, or turn Smart App Control off: it lets no unsigned library of this name run"
        return f"is blocked by a policy of this Windows: {message}", remedy
    # ctypes gives no number for a library that needs another one.
    if sys.platform == "win32" and isinstance(why, FileNotFoundError):
        remedy = "Use Windows 10 or later, with all its updates"
        return f"needs a library that this system does not have: {message}", remedy
    return None


def _glibc() -> str | None:
    """The C library's name and version, such as "glibc 2.36", if this process uses glibc."""
    try:
        return os.confstr("CS_GNU_LIBC_VERSION") if sys.platform.startswith("linux") else None
    except (ValueError, OSError):
        return None


def _c_library() -> str:
    return _glibc() or "another C library"


def other_copies(name: str, ours: Path) -> list[Path]:
    """The other files of that name that are loaded in this process, if the system lists them."""
    found: set[Path] = set()
    if sys.platform.startswith("linux"):
        try:
            lines = Path("/proc/self/maps").read_bytes().splitlines()
        except OSError:
            return []
        words = (line.split(None, 5) for line in lines)
        found = {Path(os.fsdecode(word[5])) for word in words if len(word) == 6 and word[5].endswith(os.fsencode(f"/{name}"))}
    elif sys.platform == "win32":
        import ctypes

        kernel = ctypes.WinDLL("kernel32")
        kernel.GetModuleHandleW.restype = ctypes.c_void_p
        kernel.GetModuleFileNameW.argtypes = [ctypes.c_void_p, ctypes.c_wchar_p, ctypes.c_uint32]
        if handle := kernel.GetModuleHandleW(name):
            text = ctypes.create_unicode_buffer(1 << 15)
            if kernel.GetModuleFileNameW(handle, text, len(text)):
                found = {Path(text.value)}
    own = ours.resolve()
    return sorted(path for path in found if path.resolve() != own)
