"""The command line: options in, one call, one view, an exit code.

The words after `rarms` come in; text on standard output or standard error and an exit code go out. Begin with `main`,
then `entry.run_command_line` (all that happens becomes text and a code) and `group` (all commands). A module of
`commands` has the commands of a topic: parse, one call, one view, an exit code. `session` is what a command is given,
`ending` lists the exit codes.
"""
