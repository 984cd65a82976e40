"""The entry point of the command: `--version` is a constant, everything else is imported only when it is needed."""

import os
import sys

from rarms_iac.model.version import __version__


def main(arguments: list[str] | None = None) -> int:
    """Run rarms with these arguments (default: those of the process) and return an exit code (`cli.ending`)."""
    words = sys.argv[1:] if arguments is None else arguments
    if words == ["--version"]:
        try:
            print(f"rarms {__version__}", flush=True)  # noqa: T201 - the one answer given before anything is imported
        except BrokenPipeError:  # the reader has seen enough; what Python flushes when it exits goes nowhere
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0

    try:
        import gc

        if asked := os.environ.get("_RARMS_COMPLETE"):
            from rarms_iac.cli.completion import answer_completion

            return answer_completion(asked)
        from rarms_iac.cli.entry import run_command_line

        # NOTE: what a command makes are trees of values, hardly ever circles: to look for those after every 700 new
        # values takes an eighth of a plan for 1,000 components.
        gc.set_threshold(50_000, 20, 20)
        return run_command_line(words)
    except KeyboardInterrupt:
        return _interrupted()


def _interrupted() -> int:
    """End at a Ctrl-C outside a command's work: during the imports before it, or while its last words are written."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a further Ctrl-C would only show a traceback
    print("rarms was interrupted.", file=sys.stderr)  # noqa: T201 - the command line may not be imported yet
    return 130


if __name__ == "__main__":
    sys.exit(main())
