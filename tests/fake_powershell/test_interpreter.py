"""What the fake takes PowerShell to do: each line is a rule of the language that rarms' scripts need."""

import pytest

from rarms_iac.powershell.templates import ENTRY, MEASURING_ENTRY, ScriptForm, module_text
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.run import put, run
from tests.fake_powershell.values import Unsupported


def told(*statements: str, what_if: bool = False) -> list[str]:
    """The lines that a script of these statements writes with `Out`, then its exit code."""
    head = "param([switch] $AsJson, [switch] $Abandon)\nSet-StrictMode -Version 3.0\n"
    head += "$ErrorActionPreference = 'Stop'\n"
    head += "function Out {\nparam($V)\n'{0}' -f [string] $V\n}\n"
    script = head + "\n".join(statements)
    host = WindowsHost()
    put(host, {"s.ps1": script.encode("ascii")})
    ran = run(host, "s.ps1", what_if=what_if)
    return [*ran.lines, f"exit {ran.code}"]


@pytest.mark.parametrize(
    ("says", "expected"),
    [
        ("Out -V @($null).Count", "1"),
        ("function None { }\nOut -V @(None).Count", "0"),
        ("function None { }\n$x = None\nOut -V @($x).Count", "0"),
        ("function One { @('a') }\nOut -V (One)", "a"),
        ("function Two { @('a', 'b') }\nOut -V (Two)", "a b"),
        ("$x = @('a')\nOut -V $x.Count", "1"),
        ("$n = @{ 1 = 'one' }\nOut -V ($n.Contains([long] 1))", "False"),
        ("$n = @{ Name = 'one' }\nOut -V $n['Name']", "one"),
        ("Out -V ([long] 5 -ceq 5)", "True"),
        ("Out -V ('A' -ceq 'a')", "False"),
        ("Out -V ('A' -eq 'a')", "True"),
        ("Out -V (@('b', 'a', 'b') -ceq 'b')", "b b"),
        ("Out -V ('TurnOff' -creplace '(?<=[a-z])(?=[A-Z])', '_')", "Turn_Off"),
        ("Out -V ('a/b/c' -creplace '^([^/]+/[^/]+)/.*$', '$1')", "a/b"),
        ("Out -V ('{0},{1,-3}|{{{2:x4}}}' -f 'a', 'b', 255)", "a,b  |{00ff}"),
        ("Out -V ('' + 'it' + [char]0x2019 + 's')", "it\u2019s"),
        ("Out -V (@(100) * 3)", "100 100 100"),
        ("$x = @('a')\n$x += @{ K = 1 }\nOut -V $x.Count", "2"),
        ("$a, $b = 'dword:5:6' -split ':', 2\nOut -V $b", "5:6"),
        ("Out -V (([long] 0 - 1) -band 4294967295)", "4294967295"),
        ("foreach ($x in @(1, 2, 3)) { if ($x -eq 2) { continue }; Out -V $x }", "1\n3"),
        ("function Late { try { exit 3 } finally { Out -V 'last' } }\ntry { Late } catch { Out -V 'no' }", "last"),
        ("try { throw 'why' } catch { Out -V $_.Exception.Message }", "why"),
        (
            "try { $x = ConvertFrom-Json -InputObject '{\"psbase\":1}' } catch { Out -V $_.FullyQualifiedErrorId }",
            "ReservedMemberName",
        ),
        ("$x = if ($true) { 'yes' } else { 'no' }\nOut -V $x", "yes"),
        ("$v = 1\n$b = { $v }\nfunction Run {\nparam($B)\n$v = 2\n& $B\n}\nOut -V (Run -B $b)", "2"),
        ("Out -V (@(3, 10, 2) | Sort-Object -Descending)", "10 3 2"),
        ("Out -V (@('a', 'b') | Where-Object -FilterScript { $_ -cne 'a' })", "b"),
        ("Out -V ([regex]::Replace('a b', ' ', { '<' + $args[0].Value + '>' }))", "a< >b"),
        (
            "Out -V (ConvertTo-Json -InputObject ([ordered] @{ b = @('x'); a = 1 }) -Depth 20 -Compress)",
            '{"b":["x"],"a":1}',
        ),
    ],
)
def test_a_rule_of_the_language(says: str, expected: str) -> None:
    *lines, code = told(says)

    assert "\n".join(lines) == expected
    assert code in ("exit 0", "exit 3")


@pytest.mark.parametrize(
    "says",
    [
        "$x = 5\nOut -V $x.Count",
        "$x = @{}\nOut -V $x.Missing",
        "Out -V $never",
        "$x = @(1)\nOut -V $x[1]",
        "Out -V $null.Length",
        "Out -V (Get-Item -LiteralPath 'HKLM:\\SOFTWARE\\nowhere')",
        "Out -V (Hyper-V\\Get-VM -Name 'a' -Id 'b')",
        "Out -V ([int] 4294967295)",
    ],
)
def test_strict_mode_and_strict_binding_stop_a_script(says: str) -> None:
    assert told(says) == ["exit 1"]


BY_CULTURE = ("$x = @{ a = 1; A = 2 }", "Out -V (@('b', 'a') | Sort-Object)", "Out -V (('a' + [char] 0x00ad) -ceq 'a')")


@pytest.mark.parametrize("says", ["Out -W 1", "Out 1", "Invoke-Expression -Command 'x'", "Get-VM", "1..3", *BY_CULTURE])
def test_unsupported_is_told_and_never_guessed(says: str) -> None:
    with pytest.raises(Unsupported):
        told(says)


@pytest.mark.parametrize("entry", [ENTRY, MEASURING_ENTRY])
def test_every_function_of_the_module_is_understood(entry: str) -> None:
    runs = f"Set-StrictMode -Version 3.0\n{module_text(ScriptForm.SINGLE, entry)}\nexit 0\n"
    host = WindowsHost()
    put(host, {"s.ps1": runs.encode("ascii")})

    assert run(host, "s.ps1").code == 0
