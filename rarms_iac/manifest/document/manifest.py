"""The whole document."""

from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, ModelWrapValidatorHandler, ValidationError, model_validator

from rarms_iac.manifest.document.base import Block, KeysLike, Maybe, needed, optional
from rarms_iac.manifest.document.components import ComponentBlock
from rarms_iac.manifest.document.hosts import HostBlock
from rarms_iac.manifest.document.interference import InterferenceBlock
from rarms_iac.manifest.document.partitions import PartitionBlock
from rarms_iac.manifest.document.policy import PolicyBlock, TaskBlock
from rarms_iac.manifest.document.rules import TOO_MANY_TO_LIST, broken_rules, with_rules
from rarms_iac.manifest.document.texts import Name, TaskName, by_name
from rarms_iac.model.names import TASK_PATTERN


class ApplicationBlock(Block):
    """What all of it is for."""

    name: Name = needed("The application's name; it is in the mark of everything that rarms makes.")
    description: str = optional("What it does, for people.", "")


class ManifestDocument(Block):
    """A manifest: the components of an application, what they must achieve, and the hosts they run on."""

    model_config = ConfigDict(defer_build=False, title="rarms manifest")

    schema_name: Literal["rarms/v1"] = needed("The version of this format.", alias="schema")
    application: ApplicationBlock = needed("What all of it is for.")
    hosts: Annotated[dict[Name, HostBlock], by_name, Field(min_length=1)] = needed(
        "The machines that partitions are made on, by name."
    )
    components: Annotated[dict[Name, ComponentBlock], by_name] = needed(
        "The components of interest (CoIs), and those that are merely there, by name."
    )
    partitions: Maybe[Annotated[dict[Name, PartitionBlock], by_name]] = optional(
        "What is fixed of partitions; without an entry each component has one of its own name."
    )
    interference: Maybe[Annotated[dict[Name, InterferenceBlock], by_name]] = optional(
        "Loads that reservations must stand up to; `busy-loop` is there without being named."
    )
    tasks: Maybe[Annotated[dict[TaskName, TaskBlock], KeysLike(TASK_PATTERN)]] = optional(
        "What is fixed of robotic task classes, by name."
    )
    policy: Maybe[PolicyBlock] = optional("What rarms may do and prefers.")
    moved: Maybe[Annotated[dict[Name, Name], by_name]] = optional(
        "Partitions that got another name: old name to new name, so that they are renamed and not replaced."
    )

    @model_validator(mode="wrap")
    @classmethod
    def _keeps_the_rules(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        broken = broken_rules(value)
        try:
            made = handler(value)
        except ValidationError as problem:
            if not broken or problem.error_count() > TOO_MANY_TO_LIST:
                raise
            raise with_rules(problem, broken) from None
        if broken:
            raise ValidationError.from_exception_data(cls.__name__, broken)
        return made
