"""Completion scripts: static text made from the shape of the commands, so that completing starts no Python."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import assert_never


class Shell(StrEnum):
    """The shells that scripts are made for."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"
    POWERSHELL = "powershell"


@dataclass(frozen=True, slots=True, kw_only=True)
class OptionShape:
    """An option: its spellings, what it is for, and what may follow it."""

    flags: tuple[str, ...]
    help: str
    takes_value: bool = False
    choices: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandShape:
    """A command with its options, and what its arguments are chosen from (nothing: files)."""

    name: str
    help: str
    options: tuple[OptionShape, ...] = ()
    words: tuple[str, ...] = ()
    takes_names: bool = False  # of components: read from the manifest when they are asked for


def completion_script(shell: Shell, top: Sequence[OptionShape], commands: Sequence[CommandShape]) -> str:
    """The script for that shell; it ends with a line end."""
    match shell:
        case Shell.BASH:
            lines = _bash(top, commands)
        case Shell.ZSH:
            lines = _zsh(top, commands)
        case Shell.FISH:
            lines = _fish(top, commands)
        case Shell.POWERSHELL:
            lines = _powershell(top, commands)
        case _:
            assert_never(shell)
    return "\n".join(lines) + "\n"


_BASH_COMPONENTS = r"""_rarms_components() {
    local file="${RARMS_MANIFEST:-rarms.yaml}" line inside="" indent="" index
    for ((index = 1; index < COMP_CWORD; index++)); do
        case "${COMP_WORDS[index]}" in -f|--manifest) file="${COMP_WORDS[index + 1]}" ;; esac
    done
    [[ -d "$file" ]] && file="$file/rarms.yaml"
    [[ -f "$file" && -r "$file" ]] || return
    while IFS= read -r line; do
        if [[ "$line" =~ ^[^[:space:]#] ]]; then
            indent="" inside=""
            [[ "$line" == components:* ]] && inside=1
        elif [[ -n "$inside" && "$line" =~ ^([[:space:]]+)([a-z0-9-]+): ]]; then
            indent="${indent:-${BASH_REMATCH[1]}}"
            [[ "${BASH_REMATCH[1]}" == "$indent" ]] && printf '%s ' "${BASH_REMATCH[2]}"
        fi
    done <"$file"
}"""

_AWK_COMPONENTS = (
    r'/^[^ \t#]/ { inside = /^components:/; indent = "" } '
    r"inside && /^[ \t]+[a-z0-9-]+:/ { match($0, /^[ \t]+/); "
    r'if (indent == "") indent = RLENGTH; '
    r'if (RLENGTH == indent) { name = substr($0, RLENGTH + 1); sub(/:.*/, "", name); print name } }'
)

_POWERSHELL_COMPONENTS = r"""        $file = if ($env:RARMS_MANIFEST) { $env:RARMS_MANIFEST } else { 'rarms.yaml' }
        if (Test-Path $file -PathType Container) { $file = Join-Path $file 'rarms.yaml' }
        $inside = $false
        $indent = ''
        foreach ($line in @(Get-Content $file -ErrorAction SilentlyContinue)) {
            if ($line -match '^[^\s#]') { $inside = $line.StartsWith('components:'); $indent = '' }
            elseif ($inside -and $line -match '^(\s+)([a-z0-9-]+):') {
                if (-not $indent) { $indent = $Matches[1] }
                if ($Matches[1] -eq $indent) { $found += $Matches[2] }
            }
        }"""


def flags_of(options: Sequence[OptionShape]) -> tuple[str, ...]:
    """All spellings of all the options, in their order."""
    return tuple(flag for option in options for flag in option.flags)


def choices_by_flag(commands: Sequence[CommandShape]) -> dict[str, tuple[str, ...]]:
    """What may follow an option that takes one of several words; an option means the same everywhere."""
    return {
        flag: option.choices
        for command in commands
        for option in command.options
        if option.choices
        for flag in option.flags
    }


def _bash(top: Sequence[OptionShape], commands: Sequence[CommandShape]) -> Iterator[str]:
    names = [command.name for command in commands]
    yield "# Completion of rarms for bash, made by: rarms completion bash. It starts no Python."
    yield "# Use it with: source <(rarms completion bash), or save it among the completions of bash."
    yield _BASH_COMPONENTS
    yield "_rarms() {"
    yield '    local current="${COMP_WORDS[COMP_CWORD]}" previous="" command="" words="" flags="" names="" index'
    yield '    ((COMP_CWORD > 0)) && previous="${COMP_WORDS[COMP_CWORD - 1]}"'
    yield "    for ((index = 1; index < COMP_CWORD; index++)); do"
    yield '        case "${COMP_WORDS[index]}" in'
    yield f'            {"|".join(names)}) command="${{COMP_WORDS[index]}}"; break ;;'
    yield "        esac"
    yield "    done"
    yield '    case "$previous" in'
    for flag, choices in sorted(choices_by_flag(commands).items()):
        yield f'        {flag}) COMPREPLY=($(compgen -W "{" ".join(choices)}" -- "$current")); return ;;'
    valued = sorted({f for c in commands for o in c.options if o.takes_value and not o.choices for f in o.flags})
    if valued:
        yield f"        {'|'.join(valued)}) COMPREPLY=(); return ;;"
    yield "    esac"
    yield '    case "$command" in'
    yield f'        "") words="{" ".join(names)}"; flags="{" ".join(flags_of(top))}" ;;'
    for command in commands:
        yield (
            f'        {command.name}) words="{" ".join(command.words)}"; '
            f'flags="{" ".join(flags_of(command.options))}"{"; names=1" if command.takes_names else ""} ;;'
        )
    yield "    esac"
    yield '    [[ -n "$names" && "$current" != -* ]] && words+=" $(_rarms_components)"'
    yield '    [[ "$current" == -* ]] && words="$flags"'
    yield '    COMPREPLY=($(compgen -W "$words" -- "$current"))'
    yield "}"
    yield "complete -o default -F _rarms rarms"


def _zsh(top: Sequence[OptionShape], commands: Sequence[CommandShape]) -> Iterator[str]:
    yield "#compdef rarms"
    yield "# Completion of rarms for zsh, made by: rarms completion zsh. It starts no Python."
    yield "# Use it with: source <(rarms completion zsh), or save it as _rarms in a folder of $fpath."
    yield "_rarms_names() {"
    yield '    local file="${opt_args[-f]:-${opt_args[--manifest]:-${RARMS_MANIFEST:-rarms.yaml}}}"'
    yield '    [[ -d "$file" ]] && file="$file/rarms.yaml"'
    yield '    compadd -- "$@"'
    yield f"""    [[ -f "$file" ]] && compadd -- ${{(f)"$(awk {_zsh_quoted(_AWK_COMPONENTS)} "$file")"}}"""
    yield "}"
    yield "_rarms() {"
    yield "    local -a commands"
    yield "    local context state state_descr line"
    yield "    typeset -A opt_args"
    yield "    commands=("
    for command in commands:
        yield f"        {_zsh_quoted(f'{command.name}:{command.help}')}"
    yield "    )"
    yield "    _arguments -C \\"
    for option in top:
        for flag in option.flags:
            yield f"        {_zsh_quoted(_zsh_option(option, flag))} \\"
    yield "        '1: :->command' '*:: :->rest'"
    yield '    case "$state" in'
    yield "        command) _describe -t commands 'rarms command' commands ;;"
    yield "        rest)"
    yield '            case "$line[1]" in'
    for command in commands:
        yield f"                {command.name})"
        yield "                    _arguments \\"
        for option in command.options:
            for flag in option.flags:
                yield f"                        {_zsh_quoted(_zsh_option(option, flag))} \\"
        yield f"                        {_zsh_quoted(_zsh_words(command))} ;;"
    yield "            esac ;;"
    yield "    esac"
    yield "}"
    yield 'if [[ "$funcstack[1]" == _rarms ]]; then _rarms "$@"; else compdef _rarms rarms; fi'


def _zsh_option(option: OptionShape, flag: str) -> str:
    description = option.help.replace("\\", "\\\\").replace("[", "\\[").replace("]", "\\]").replace(":", "\\:")
    value = f": :({' '.join(option.choices)})" if option.choices else ": :_files" if option.takes_value else ""
    return f"*{flag}[{description}]{value}"


def _zsh_words(command: CommandShape) -> str:
    if command.takes_names:
        return f"*: : _rarms_names {' '.join(command.words)}".rstrip()
    return f"*: :({' '.join(command.words)})" if command.words else "*: :_files"


def _zsh_quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def _fish(top: Sequence[OptionShape], commands: Sequence[CommandShape]) -> Iterator[str]:
    yield "# Completion of rarms for fish, made by: rarms completion fish. It starts no Python."
    yield "# Use it with: rarms completion fish | source, or save it as ~/.config/fish/completions/rarms.fish."
    yield "function __rarms_components"
    yield "    set -l file (set -q RARMS_MANIFEST; and echo $RARMS_MANIFEST; or echo rarms.yaml)"
    yield "    test -d $file; and set file $file/rarms.yaml"
    yield f"    test -f $file; and awk {_fish_quoted(_AWK_COMPONENTS)} $file"
    yield "end"
    for option in top:
        yield f"complete -c rarms -n __fish_use_subcommand{_fish_option(option)}"
    for command in commands:
        yield (
            f"complete -c rarms -n __fish_use_subcommand -f -a {_fish_quoted(command.name)} "
            f"-d {_fish_quoted(command.help)}"
        )
    for command in commands:
        here = f"complete -c rarms -n {_fish_quoted(f'__fish_seen_subcommand_from {command.name}')}"
        for option in command.options:
            yield here + _fish_option(option)
        if command.words:
            yield f"{here} -f -a {_fish_quoted(' '.join(command.words))}"
        if command.takes_names:
            yield f"{here} -f -a '(__rarms_components)'"


def _fish_option(option: OptionShape) -> str:
    flags = "".join(f" -l {flag[2:]}" if flag.startswith("--") else f" -s {flag[1:]}" for flag in option.flags)
    choices = _fish_quoted(" ".join(option.choices))
    value = f" -x -a {choices}" if option.choices else " -r" if option.takes_value else ""
    return f"{flags}{value} -d {_fish_quoted(option.help)}"


def _fish_quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


def _powershell(top: Sequence[OptionShape], commands: Sequence[CommandShape]) -> Iterator[str]:
    yield "# Completion of rarms for PowerShell, made by: rarms completion powershell. It starts no Python."
    yield "# Use it with: rarms completion powershell | Out-String | Invoke-Expression, or in your $PROFILE."
    yield "Register-ArgumentCompleter -Native -CommandName rarms -ScriptBlock {"
    yield "    param($wordToComplete, $commandAst, $cursorPosition)"
    yield "    $words = @{"
    names = [command.name for command in commands]
    yield f"        '' = {_powershell_list([*names, *flags_of(top)])}"
    for command in commands:
        yield f"        '{command.name}' = {_powershell_list([*command.words, *flags_of(command.options)])}"
    yield "    }"
    yield "    $given = @($commandAst.CommandElements | Select-Object -Skip 1 | ForEach-Object { $_.ToString() })"
    yield "    $command = @($given | Where-Object { $_ -ne $wordToComplete -and $words.ContainsKey($_) })"
    yield "    $name = if ($command.Count -gt 0) { $command[0] } else { '' }"
    yield f"    $names = {_powershell_list([command.name for command in commands if command.takes_names])}"
    yield "    $found = @()"
    yield "    if ($names -contains $name) {"
    yield from _POWERSHELL_COMPONENTS.splitlines()
    yield "    }"
    yield "    @($words[$name]) + $found | Where-Object { $_.StartsWith($wordToComplete) } | ForEach-Object {"
    yield "        [System.Management.Automation.CompletionResult]::new($_, $_, 'ParameterValue', $_)"
    yield "    }"
    yield "}"


def _powershell_list(words: Sequence[str]) -> str:
    return "@(" + ", ".join("'" + word.replace("'", "''") + "'" for word in words) + ")"
