"""The command line: options in, one call, one view, an exit code.

The words after `rarms` come in; text on standard output or standard error and an exit code go out. Begin with `main`,
then `entry.run_command_line` (all that happens becomes text and a code) and `table` (all commands). A command is a
module of `commands`: `options` reads its options, `session` is what it is given, `ending` lists the exit codes.
"""
