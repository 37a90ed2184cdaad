"""Memory of this process that is free."""

import ctypes
import sys

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3  # parameters of mallopt, malloc.h of glibc
KEPT_BYTES = 64 * 2**20
LARGEST_KEPT_BLOCK = 32 * 2**20


def keep_free_memory() -> None:
    """Keep some free memory for the next large message, where the C library is that of GNU.

    Otherwise memory of each large message can go back to the system, and come back page by page: thousands of page
    faults, which take more time than the model.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        change_option = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):  # another C library
        return
    change_option(TRIM_THRESHOLD, KEPT_BYTES)
    change_option(MMAP_THRESHOLD, LARGEST_KEPT_BLOCK)
