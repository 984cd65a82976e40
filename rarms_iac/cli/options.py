"""The requests of commands that no use case takes: how they answer, and what they may do without asking."""

from dataclasses import dataclass

from rarms_iac.app.requests import STOP_PARTITIONS, flag, option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.session import Session
from rarms_iac.views.finding_forms import BadOutput, OutputFormat, OutputTarget, parse_outputs


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputOptions:
    """In which forms a command answers; `--json` is short for one of them."""

    output: tuple[str, ...] = option(
        "--output",
        metavar="FORMAT[=FILE]",
        help="How: text, json, sarif, junit, github, markdown; repeatable, each to a place of its own.",
        default=(),
    )

    def targets(self, session: Session) -> tuple[OutputTarget, ...]:
        """Each form and where it goes; the session learns whether a program reads standard output.

        Raises:
            RequestError: an unknown form, or two go to one place.
        """
        try:
            outputs = parse_outputs((*self.output, "json") if session.as_json else self.output)
        except BadOutput as error:
            raise RequestError(f"--output: {error}") from error
        session.as_json = any(output.format is OutputFormat.JSON and output.path is None for output in outputs)
        return outputs


@dataclass(frozen=True, slots=True, kw_only=True)
class StopOptions:
    """Whether partitions may be stopped to measure."""

    stop_partitions: bool = flag(*STOP_PARTITIONS.flags, help=f"{STOP_PARTITIONS.help} [default: ask at a terminal]")

    def stops(self, *, on_busy_host: bool) -> bool:
        """Whether they are stopped without a question.

        Raises:
            RequestError: they are to be stopped and to go on.
        """
        if self.stop_partitions and on_busy_host:
            raise RequestError("Give one of --stop-partitions and --on-busy-host.")
        return self.stop_partitions
