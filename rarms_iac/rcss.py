"""RC SS for components: the calling thread joins a robotic task class (docs/task-classes.md).

    from rarms_iac.rcss import robotic_task

    with robotic_task("SpeechRecognition"):
        recognise()

Standard library only, and nothing else of rarms: a component may carry a copy of this file.
"""

import ctypes
import json
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

CLASSES_VARIABLE = "RARMS_TASK_CLASSES"
"""On Linux: a JSON object of each class's `priority` (SCHED_FIFO) and `affinity` (a bit for each processor; 0: all)."""

INVALID_TASK_NAME, INVALID_TASK_INDEX, THREAD_ALREADY_IN_TASK, PRIVILEGE_NOT_HELD = 1550, 1551, 1552, 1314
"""Error codes of Windows (winerror.h); on Linux the same causes have the same codes."""

_EXPLANATIONS = {
    INVALID_TASK_NAME: (
        "nothing here defines it. On Windows apply the plan's script in the Windows that this thread runs in, and "
        "restart that: MMCSS reads its classes when it starts. On Linux start the component with `rarms run`, or set "
        f"{CLASSES_VARIABLE}."
    ),
    INVALID_TASK_INDEX: (
        "MMCSS refused the task index 0, which asks for a new task. Restart Windows, and with it MMCSS."
    ),
    THREAD_ALREADY_IN_TASK: "the thread is already in a task class. Leave it first.",
    PRIVILEGE_NOT_HELD: (
        "the account lacks a privilege. On Windows give it the right to increase scheduling priority, or use another. "
        "On Linux it takes CAP_SYS_NICE or a limit `rtprio`, and in a control group of version 1 a budget above 0 in "
        "cpu.rt_runtime_us."
    ),
}

_AVRT = "avrt"
_thread = threading.local()


class CannotJoin(Exception):
    """The thread goes on without the task class.

    Attributes:
        task: the class that it asked for.
        code: why, as one of the numbers above; for another cause the system's own number, 0 where it has none.
    """

    def __init__(self, task: str, code: int, message: str = "") -> None:
        super().__init__(f'cannot join the task class "{task}" ({code}): {_EXPLANATIONS.get(code, message)}')
        self.task = task
        self.code = code


@contextmanager
def robotic_task(name: str) -> Iterator[None]:
    """Have the calling thread in a task class as long as the context lasts; on Linux also threads it starts meanwhile.

    Args:
        name: of the class, in any case.

    Raises:
        CannotJoin: the class is not there, the thread has one already, or it may not.
    """
    if getattr(_thread, "has_class", False):
        raise CannotJoin(name, THREAD_ALREADY_IN_TASK)
    leave = _join(name)
    _thread.has_class = True
    try:
        yield
    finally:
        _thread.has_class = False
        leave()


if sys.platform == "win32":

    def _join(name: str) -> Callable[[], object]:
        """Ask MMCSS for a task of the thread's own (index 0); return what leaves it."""
        avrt = ctypes.WinDLL(_AVRT, use_last_error=True)
        avrt.AvSetMmThreadCharacteristicsW.argtypes = (ctypes.c_wchar_p, ctypes.POINTER(ctypes.c_uint32))
        avrt.AvSetMmThreadCharacteristicsW.restype = ctypes.c_void_p
        avrt.AvRevertMmThreadCharacteristics.argtypes = (ctypes.c_void_p,)
        handle = avrt.AvSetMmThreadCharacteristicsW(name, ctypes.byref(ctypes.c_uint32(0)))
        if not handle:
            code = ctypes.get_last_error()
            raise CannotJoin(name, code, ctypes.FormatError(code))
        return lambda: avrt.AvRevertMmThreadCharacteristics(handle)

elif sys.platform == "linux":

    def _join(name: str) -> Callable[[], object]:
        """Set priority and processors of the thread; return what restores them."""
        priority, affinity = _values_of(name)
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        processors = os.sched_getaffinity(0)
        try:
            if affinity:
                os.sched_setaffinity(0, {at for at in range(affinity.bit_length()) if affinity >> at & 1})
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as problem:
            os.sched_setaffinity(0, processors)
            code = PRIVILEGE_NOT_HELD if isinstance(problem, PermissionError) else problem.errno or 0
            why = problem.strerror or type(problem).__name__
            message = f"the kernel refuses priority {priority} on the processors {affinity:#x}: {why}"
            raise CannotJoin(name, code, message) from problem

        def leave() -> None:
            os.sched_setscheduler(0, *before)
            os.sched_setaffinity(0, processors)

        return leave

    def _values_of(name: str) -> tuple[int, int]:
        """Return the priority and the processors of a class, from the environment."""
        try:
            classes = json.loads(os.environ.get(CLASSES_VARIABLE, "{}"))
            found = {key.lower(): value for key, value in classes.items()}.get(name.lower())
            if found is not None:
                return int(found["priority"]), int(found["affinity"])
        except (ValueError, KeyError, TypeError, AttributeError) as problem:
            raise CannotJoin(name, 0, f"{CLASSES_VARIABLE} cannot be read: {problem!r}") from problem
        raise CannotJoin(name, INVALID_TASK_NAME)

else:

    def _join(name: str) -> Callable[[], object]:
        raise CannotJoin(name, 0, f"task classes exist on Windows and Linux, not on {sys.platform}")
