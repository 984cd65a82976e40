"""Commands of click made of functions: the fields of a function's requests are its options (`app.requests`)."""

import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, replace
from enum import StrEnum
from inspect import cleandoc, get_annotations
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin

import click
from click.core import ParameterSource

from rarms_iac.app.requests import DEFAULT_MANIFEST, ManifestFile, ManifestSource, Option, Reader
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.completion import completer_of
from rarms_iac.cli.ending import ExitCode, WrongRequest
from rarms_iac.cli.group import COMMANDS
from rarms_iac.cli.session import Session, common_options, session_flag
from rarms_iac.model.commands import command, prose

T = TypeVar("T")


class RarmsCommand(click.Command):
    """A command whose usage errors always carry its context, so that they can name it."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the words of a command line.

        Raises:
            click.UsageError: the arguments are wrong; it has this context, which click leaves out of some errors.
        """
        words = list(args)
        try:
            return super().parse_args(ctx, args)
        except click.UsageError as error:
            error.ctx = error.ctx or ctx
            if (file := self._manifest_in_the_way(ctx, error, words)) is not None:
                advice = prose("Name the manifest with -f: ", command(ctx.info_name or "", f=file), ".")
                raise WrongRequest(RequestError(error.message, advice), ctx) from None
            raise

    def _manifest_in_the_way(self, context: click.Context, error: click.UsageError, words: list[str]) -> str | None:
        """Return the manifest that is an argument of a command that takes none, but `-f`; None: that is not wrong."""
        takes_arguments = any(isinstance(parameter, click.Argument) for parameter in self.params)
        takes_manifest = any("-f" in parameter.opts for parameter in self.params)
        if type(error) is not click.UsageError or takes_arguments or not takes_manifest:
            return None
        _, extra, _ = self.make_parser(context).parse_args(words)
        return next((word for word in extra if word.endswith((".yaml", ".yml")) or Path(word).is_dir()), None)


def rarms_command(name: str, *, json: bool = True) -> Callable[[Callable[..., ExitCode]], click.Command]:
    """Make a click command of a function that takes the session and its requests, and returns the exit code.

    Args:
        json: whether it takes `--json`, which the session then knows.
    """

    def make(function: Callable[..., ExitCode]) -> click.Command:
        requests = {key: kind for key, kind in get_annotations(function).items() if key not in {"session", "return"}}

        def run(**values: object) -> ExitCode:
            context = click.get_current_context()
            session = context.ensure_object(Session)
            session.command = name
            if session.as_json:
                session.terminal.require_output()  # before anything is done
            try:
                given: dict[str, Any] = {key: request_of(kind, values) for key, kind in requests.items()}
                if not any(values.get(name) for name in _NO_MANIFEST_NEEDED):
                    given = {key: _from_above(context, session, request) for key, request in given.items()}
                for source in given.values():
                    if isinstance(source, ManifestSource):
                        is_given = context.get_parameter_source("manifest") is ParameterSource.COMMANDLINE
                        name_manifest(session, source, in_advice=is_given)
                return function(session, **given)
            except RequestError as error:
                raise WrongRequest(error, context) from error

        parameters = [parameter for kind in requests.values() for parameter in parameters_of(kind)]
        if json:
            parameters.append(
                session_flag("--json", act=_answer_in_json, text="Write JSON for programs.", is_eager=True)
            )
        return RarmsCommand(
            name,
            callback=run,
            params=[*parameters, *common_options()],
            help=cleandoc(function.__doc__ or ""),
            short_help=COMMANDS[name],
            add_help_option=False,  # `common_options` has it
        )

    return make


_NO_MANIFEST_NEEDED = ("files", "plan_file", "boot")
"""Parameters that name what is read instead of the manifest."""


def _from_above(context: click.Context, session: Session, request: T) -> T:
    """Return the request; where it names no manifest and there is none here, take that of the repository, saying so."""
    if not isinstance(request, ManifestFile) or request.manifest != DEFAULT_MANIFEST:
        return request
    is_named = context.get_parameter_source("manifest") is not ParameterSource.DEFAULT
    if is_named or os.path.lexists(DEFAULT_MANIFEST):
        return request
    from rarms_iac.manifest.load import find_manifest_above

    found = find_manifest_above()
    if found is None:
        return request
    session.terminal.tell(f"The manifest is {found}.")
    return replace(request, manifest=found)


def _answer_in_json(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    """Have every result and error of the command written as JSON; eager, so errors of later options are, too."""
    if value:
        context.find_root().obj.as_json = True


def name_manifest(session: Session, source: ManifestSource, *, in_advice: bool) -> None:
    """Say which overlays count, and have the commands that messages recommend name the same files.

    Args:
        source: the manifest and its overlays; hosts have the same names on each robot.
        in_advice: whether recommended commands name the manifest, too.
    """
    words = ["-f", source.manifest] if in_advice else []
    words += overlay_words(source.overlays)
    session.terminal.manifest_options = f" {shlex.join(words)}" if words else ""
    if source.overlays and all(os.path.lexists(overlay) for overlay in source.overlays):
        noun = "Overlay" if len(source.overlays) == 1 else "Overlays"
        session.terminal.tell(f"{noun}: {', '.join(source.overlays)}")


def overlay_words(overlays: Sequence[str]) -> list[str]:
    """Return the options that name these overlays: `--overlay laptop.yaml`."""
    return [word for overlay in overlays for word in ("--overlay", overlay)]


def parameters_of(request: type) -> list[click.Parameter]:
    """Return the parameters for a request's fields, in their order; fields without an `Option` have none."""
    return [_parameter(field, field.metadata["option"]) for field in fields(request) if "option" in field.metadata]


def request_of(request: type[T], values: Mapping[str, Any]) -> T:
    """Make the request from the values that click has read; a field without a value keeps its default."""
    names = (field.name for field in fields(request) if "option" in field.metadata)  # type: ignore[arg-type]  # T is a dataclass
    return request(**{name: values[name] for name in names if values[name] not in (None, ())})


def _parameter(field: "Field[Any]", option: Option) -> click.Parameter:
    members = get_args(field.type)
    several = get_origin(field.type) is tuple
    kind = members[0] if several or isinstance(field.type, UnionType) else field.type
    required = field.default is MISSING and field.default_factory is MISSING
    complete = completer_of(field.name, option.metavar)
    if not option.flags:
        return click.Argument(
            [field.name],
            metavar=option.metavar,
            nargs=-1 if several else 1,
            required=required,
            type=_type(kind, option),
            shell_complete=complete,
        )
    default: dict[str, Any] = {} if required else {"default": None}  # click takes a default, None too, for an answer
    return click.Option(
        [field.name, *option.flags],
        help=option.help,
        metavar=option.metavar,
        multiple=several,
        required=required,
        is_flag=kind is bool,
        **default,
        type=None if kind is bool else _type(kind, option),
        envvar=option.environment,
        shell_complete=complete,
    )


def _type(kind: Any, option: Option) -> "click.ParamType[Any]":
    if option.read is not None:
        return _ReadValue(option.read)
    if get_origin(kind) is Literal:
        return _WordChoice(get_args(kind))
    if issubclass(kind, StrEnum):
        return _EnumChoice(kind)
    if kind is int:
        return _NumberRange(option.least, option.most)
    return click.STRING


class _NumberRange(click.IntRange):
    """A whole number; a usage error has the bound in words."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number."""
        number = int(click.INT.convert(value, param, ctx))
        if self.min is not None and number < self.min:
            self.fail(f"{number} is too small: it must be at least {self.min}.", param, ctx)
        if self.max is not None and number > self.max:
            self.fail(f"{number} is too large: it must be at most {self.max}.", param, ctx)
        return number


class _WordChoice(click.Choice[Any]):
    """One of several words; a usage error lists them in a line."""

    def get_missing_message(
        self,
        param: click.Parameter,  # noqa: ARG002 - click's
        ctx: click.Context | None,  # noqa: ARG002 - likewise
    ) -> str:
        """Return the choices, for the message about a missing argument."""
        return f"Choose from: {', '.join(self.choices)}."


class _EnumChoice(_WordChoice):
    """A word that is the value of an enumeration's member."""

    def __init__(self, kind: type[StrEnum]) -> None:
        super().__init__([member.value for member in kind])
        self.kind = kind

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> object:
        """Return the member."""
        return self.kind(super().convert(value, param, ctx))


class _ReadValue(click.ParamType[object]):
    """A word that `Option.read` turns into a value."""

    name = "value"

    def __init__(self, read: Reader) -> None:
        self.read = read

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> object:
        """Return the value that the reader makes of the word.

        Raises:
            click.BadParameter: the reader refuses the word.
        """
        if not isinstance(value, str):
            return value
        try:
            return self.read(value)
        except ValueError as error:
            self.fail(str(error), param, ctx)
