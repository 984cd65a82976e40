"""What the threads of robotic task classes run at, a table an operating system."""

from collections.abc import Iterator
from itertools import groupby

from rarms_iac.model.plan import HostPlan, ThreadClass
from rarms_iac.views.diagnostics.layout import visible, wrap


def threads_lines(part: HostPlan, width: int) -> Iterator[str]:
    """The tables, where the plan or one of its guests' scripts changes task classes; else nothing."""
    changes = any(change.address.task for change in part.changes) or any(".guest." in name for name in part.scripts)
    if not changes or not part.threads:
        return
    yield ""
    yield "  Thread priorities, once its Windows has started again:"
    widest = max(len(thread.task) for thread in part.threads)
    for inside, classes in groupby(part.threads, key=_inside):
        yield f"    {f'partition/{inside}' if inside else 'the host itself'}"
        for task_class in classes:
            head = f"      {task_class.thread_priority:>2}  {task_class.task:<{widest}}  {task_class.category}  "
            used = visible(", ".join(task_class.components), keep="")
            first, *rest = wrap(used, max(width, len(head) + 20), " " * len(head)) if used else ("",)
            yield (head + first.strip()).rstrip()
            yield from rest


def _inside(task_class: ThreadClass) -> str:
    return task_class.inside
