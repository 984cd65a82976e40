"""`interference`: named loads that a reservation must stand up to."""

from typing import Annotated, Literal

from pydantic import Field

from rarms_iac.manifest.document.base import Block, Maybe, needed, optional

Instances = Annotated[int, Field(ge=1, le=1000)]


class BusyLoopBlock(Block):
    """Threads that never wait (BLP)."""

    kind: Literal["busy_loop"] = needed("Threads that never wait.")
    threads: Maybe[Annotated[int, Field(ge=1, le=4096)]] = optional("How many; absent: one a logical processor.")


class BrowserBlock(Block):
    """Browsers that stream video: their interrupts run above every thread."""

    kind: Literal["browser"] = needed("Browsers that stream video.")
    instances: Instances = optional("How many at once.", 1)


class CommandLoadBlock(Block):
    """Any other program."""

    kind: Literal["command"] = needed("Any other program.")
    command: Annotated[list[str], Field(min_length=1)] = needed("The program and its arguments, word by word.")
    instances: Instances = optional("How many at once.", 1)


InterferenceBlock = Annotated[BusyLoopBlock | BrowserBlock | CommandLoadBlock, Field(discriminator="kind")]
