"""What a whole block says when its keys do not go together; `manifest/errors.py` puts it into words."""

from typing import TypeVar

from pydantic import BaseModel
from pydantic_core import PydanticCustomError

B = TypeVar("B", bound=BaseModel)


def needs_exactly_one(block: B, *names: str) -> B:
    """The block itself, where exactly one of these keys was written.

    Raises:
        PydanticCustomError: none or several were.
    """
    written = tuple(name for name in names if name in block.model_fields_set)
    if len(written) == 1:
        return block
    raise PydanticCustomError("rarms_exactly_one", "exactly one", {"names": names, "written": written})


def together_error(key: str, needs: str, *, missing: bool) -> PydanticCustomError:
    """`key` belongs to `needs`: it is missing, or stands there without it."""
    return PydanticCustomError("rarms_together", "together", {"key": key, "needs": needs, "missing": missing})
