"""What a browser that streams video asks of a machine: one set of numbers for every experiment."""

FRAME_MS = 40.0
"""25 frames a second, as web video of the time had."""

DECODE_MS = 4.0
"""Decoding and scaling one frame in software, on the browser's own thread."""

PAINT_MS = 2.0
"""Drawing it where the graphics driver is the machine's own."""

INTERRUPT_MS = 0.2
"""ISRs and DPCs of a frame's network packets and its screen update."""

INTERCEPT_MS = 10.0
"""The same in a partition: every access to an emulated device traps into the hypervisor, above every VP."""

PARENT_MS = 16.0
"""Drawing it in a partition: the parent emulates the screen and encodes it, above every VP."""

PIECE_MS = 1.0
"""The longest piece in which interrupts and the parent take an LP."""

SYSTEM_MIB = 150.0
"""What the guest's operating system needs of its memory."""

BROWSER_MIB = 130.0
"""What a browser that plays video works on."""

PAGE_IN_MS = 4.0
"""What a frame waits for the disk if nothing of what it touches is in memory; the screen is locked meanwhile."""


def absent(instances: int, memory_mib: float | None) -> float:
    """The part of the browsers' working sets that is not in memory, 0..1."""
    if memory_mib is None or not instances:
        return 0.0
    return max(0.0, 1.0 - max(0.0, memory_mib - SYSTEM_MIB) / (instances * BROWSER_MIB))
