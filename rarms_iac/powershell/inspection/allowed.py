"""Lists of all that scripts may be made of. Everything else is a finding, also what nobody thought of."""

from dataclasses import dataclass, field
from enum import StrEnum

from rarms_iac.powershell.templates import VM


class ScriptKind(StrEnum):
    """Purposes of a script; only the first three may change anything. The bootstrap runs the others over ssh."""

    APPLY = "apply"
    UNDO = "undo"
    MEASURE = "measure"
    OBSERVE = "observe"
    BOOTSTRAP = "bootstrap"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lists:
    """The lists of one kind of script; its own functions and variables come on top."""

    constructs: frozenset[str]
    qualified: frozenset[str]  # cmdlets of Hyper-V, with their module
    plain: frozenset[str]  # cmdlets of PowerShell itself, without
    types: frozenset[str]
    members: frozenset[str]
    operators: frozenset[str]
    given_variables: frozenset[str]  # those that nobody assigns
    pins: frozenset[str] = field(default_factory=frozenset)  # assignments to PowerShell's own variables, as written
    blocks: frozenset[str] = field(default_factory=frozenset)  # variables that may stand behind `&`


def words(text: str) -> frozenset[str]:
    """The words of a text, as a set that reads well and is easily compared."""
    return frozenset(text.split())


_LADDER = words(
    """
    additive_argument_expression additive_expression argument_expression argument_expression_list argument_list
    array_expression array_literal_expression array_type_name bitwise_argument_expression bitwise_expression
    cast_expression comparison_argument_expression comparison_expression comparison_operator element_access
    expression_with_unary_operator format_argument_expression format_expression format_operator
    invokation_expression logical_argument_expression logical_expression member_access member_name
    multiplicative_argument_expression multiplicative_expression parenthesized_expression
    range_argument_expression range_expression unary_expression
    """
)
_READING = _LADDER | words(
    """
    program statement_list statement_block script_block script_block_body script_block_expression pipeline
    pipeline_chain command command_name command_name_expr command_elements command_argument_sep command_parameter
    command_invokation_operator path_command_name generic_token comment
    assignment_expression assignement_operator left_assignment_expression variable simple_name
    string_literal verbatim_string_characters integer_literal decimal_integer_literal hexadecimal_integer_literal
    real_literal hash_literal_expression hash_literal_body hash_entry key_expression
    type_literal type_spec type_name type_identifier
    function_statement function_name param_block parameter_list script_parameter script_parameter_default
    attribute attribute_arguments attribute_argument attribute_list attribute_name
    if_statement else_clause elseif_clause elseif_clauses foreach_statement flow_control_statement
    try_statement catch_clause catch_clauses catch_type_list
    """
)
_CHANGING = _READING | words(
    "finally_clause for_statement for_initializer for_condition for_iterator while_statement while_condition "
    "post_increment_expression"
)

_READING_HYPERV = words(
    "Get-VM Get-VMHost Get-VMHostNumaNode Get-VMProcessor Get-VMMemory Get-VMHardDiskDrive Get-VMNetworkAdapter "
    "Get-VHD Get-VMFirmware Get-VMIntegrationService Get-VMSnapshot Get-VMSwitch"
)
_CHANGING_HYPERV = _READING_HYPERV | words(
    "New-VM Set-VM Set-VMFirmware Rename-VM Remove-VM Start-VM Stop-VM Set-VMProcessor Set-VMMemory New-VHD "
    "Add-VMHardDiskDrive Remove-VMNetworkAdapter"
)
_READING_PLAIN = words(
    "ConvertTo-Json Get-Acl Get-ChildItem Get-CimInstance Get-Content Get-ExecutionPolicy Get-Item Get-Module "
    "Get-WinEvent Join-Path Set-StrictMode Sort-Object Test-Path Where-Object"
)
_CHANGING_PLAIN = (_READING_PLAIN - words("Get-CimInstance Get-Content Get-ExecutionPolicy")) | words(
    "ConvertFrom-Json New-Item New-ItemProperty Receive-Job Remove-Item Remove-ItemProperty Set-Acl Start-Sleep "
    "Write-Information Write-Verbose"
)

_READING_TYPES = words(
    """
    CmdletBinding bool byte byte[] char int long ordered regex scriptblock string string[] switch void
    Environment IntPtr
    System.IO.File System.Security.Principal.SecurityIdentifier System.Security.Principal.WindowsBuiltInRole
    System.Security.Principal.WindowsIdentity System.Security.Principal.WindowsPrincipal
    """
)
_ONLY_READING_TYPES = words(
    """
    byte scriptblock System.Security.Principal.WindowsBuiltInRole System.Security.Principal.WindowsIdentity
    System.Security.Principal.WindowsPrincipal
    """
)
_CHANGING_TYPES = (_READING_TYPES - _ONLY_READING_TYPES) | words(
    """
    hashtable scriptblock
    Array DateTime System.BitConverter System.Collections.IDictionary
    System.IO.Directory System.IO.FileAccess System.IO.FileAttributes System.IO.FileMode System.IO.FileStream
    System.Security.Cryptography.SHA256 System.StringComparer System.StringComparison System.Text.Encoding
    System.Threading.AbandonedMutexException System.Threading.Mutex System.UnauthorizedAccessException
    """
)

_HYPERV_MEMBERS = words(
    """
    AutomaticStartAction AutomaticStopAction BootOrder BootType CheckpointType Count DynamicMemoryEnabled
    Generation Id LogicalProcessorCount Maximum MemoryStartup Name Notes ParentPath Path ProcessorCount
    RelativeWeight Reserve SecureBoot SecureBootTemplate Startup State VhdType VirtualHardDiskPath
    """
)
_READING_MEMBERS = _HYPERV_MEMBERS | words(
    """
    Administrator AutomaticStartDelay Category CategoryInfo CpuGroupId EnabledState Exception ExecutionPolicy
    FullName FullyQualifiedErrorId GetCurrent GetFolderPath GetOwner GetValue GetValueKind GetValueNames
    GuestIntrinsicExchangeItems HypervisorPresent InstanceID IsActive IsInRole LanguageMode MachineName
    MemoryAvailable MemoryCapacity MemoryTotal Message Minimum NodeId NumaSpanningEnabled NumberOfCores
    NumberOfLogicalProcessors OperationalStatus PSChildName PSEdition PSObject PSVersion Properties Replace
    Reservation Scope SessionState Size SwitchName SystemName ToLowerInvariant Value Version VirtualMachinePath new
    """
)
_CHANGING_MEMBERS = _HYPERV_MEMBERS | words(
    """
    ASCII AcceptScheduler Action AddMilliseconds Address After Application Before Clear ComputeHash Computer Contains
    Cores Create CreateDirectory Delete Detail Dispose Enabled Equals Exception Fits Flush FullyQualifiedErrorId
    GetAttributes GetBytes GetFolderPath GetOwner GetString GetValue GetValueKind GetValueNames Guard Guest
    InvocationInfo Keys Kind Length LogicalProcessors Lost MachineName Memory Message Move MyCommand Needs Number
    OpenOrCreate Ordinal PSChildName PSObject Percent Plan Position PrimaryOperationalStatus Processors Properties
    Read ReadAllBytes ReadAllText ReleaseMutex ReparsePoint Replace Run ScriptLineNumber Serial Set SetLength
    SetSecurityDescriptorSddlForm ShouldProcess Size Sort Step Substring ThreadsPerCore ToLowerInvariant ToString Undo
    UndoDigest Undoes UserName UtcNow Value WaitOne Write WriteAllText closing data kind new number plan record run
    application history serials set started_at started_by status touched
    """
)

_READING_OPERATORS = words(", = += -band -ccontains -ceq -clike -cne -eq -f -ne -not -or -and + - * . :: |")
_CHANGING_OPERATORS = _READING_OPERATORS | words(
    "-= / ++ -cmatch -cnotcontains -creplace -gt -join -le -lt -notcontains -replace -split"
)

_GIVEN = words("$_ $args $true $false $null $env:OS $env:ProgramData")

_PINS = frozenset({"$ErrorActionPreference = 'Stop'", "$PSDefaultParameterValues = @{}"})
_SILENT_PROGRESS = "$ProgressPreference = 'SilentlyContinue'"
_NO_PROMPT = "$ConfirmPreference = 'None'"

READING = Lists(
    constructs=_READING,
    qualified=_READING_HYPERV,
    plain=_READING_PLAIN,
    types=_READING_TYPES,
    members=_READING_MEMBERS,
    operators=_READING_OPERATORS,
    given_variables=_GIVEN | {"$ExecutionContext", "$PSVersionTable"},
    pins=_PINS
    | {f"${stream}Preference = 'SilentlyContinue'" for stream in ("Debug", "Information", "Verbose", "Warning")}
    | {_SILENT_PROGRESS, _NO_PROMPT, "$WhatIfPreference = $false", "$PSModuleAutoLoadingPreference = 'All'"},
    blocks=frozenset({"$Read"}),
)
CHANGING = Lists(
    constructs=_CHANGING,
    qualified=_CHANGING_HYPERV,
    plain=_CHANGING_PLAIN,
    types=_CHANGING_TYPES,
    members=_CHANGING_MEMBERS,
    operators=_CHANGING_OPERATORS,
    given_variables=_GIVEN | words("$Matches $PID $PSCmdlet $PSCommandPath $PSScriptRoot $WhatIfPreference") | {VM},
    pins=_PINS | {_NO_PROMPT},
    blocks=words("$read $set $fits $guard $Steps"),
)
MEASURING = Lists(
    constructs=CHANGING.constructs,
    qualified=CHANGING.qualified,
    plain=CHANGING.plain
    | words("ConvertTo-SecureString Get-CimInstance Invoke-Command New-PSSession Remove-Job Remove-PSSession"),
    types=CHANGING.types
    | words(
        """
        System.Convert System.Diagnostics.Process System.Diagnostics.ProcessStartInfo System.Diagnostics.Stopwatch
        System.IO.Path System.Management.Automation.PSCredential
        """
    ),
    members=CHANGING.members
    | words(
        """
        CPUWaitTimePerDispatch CPUWaitTimePerDispatch_Base Combine Elapsed ElapsedMilliseconds EnvironmentVariables
        Exists ExitCode Folder FromBase64String GetDirectoryName GetTempPath HasExited Image Job Kill Limit Machine
        Partition PercentGuestRunTime PercentHypervisorRunTime PercentTotalRunTime
        ReadLineAsync RedirectStandardOutput Result StandardOutput Start StartNew
        Ticks Told Type UseShellExecute Values Wait WaitForExit Weight WorkingDirectory WriteAllBytes
        Credential Generation SecureBoot arguments child environment exists files folder instances period_ticks program
        timeout_ms used
        """
    ),
    operators=CHANGING.operators | words("-ge"),
    given_variables=CHANGING.given_variables,
    pins=CHANGING.pins,
    blocks=CHANGING.blocks,
)
"""A measuring script also reaches into guests, and reads what the hypervisor counts."""


BOOTSTRAP = Lists(
    constructs=_CHANGING,
    qualified=frozenset(),
    plain=words("Get-Acl Join-Path Set-Acl Set-StrictMode"),
    types=words(
        """
        Console byte[] guid int void System.BitConverter System.Diagnostics.Process System.Diagnostics.ProcessStartInfo
        System.IO.Directory System.IO.File System.IO.Path System.IO.Stream System.Security.Cryptography.SHA256
        System.Security.Principal.WindowsIdentity System.Text.Encoding
        """
    ),
    members=words(
        """
        ASCII Arguments Close ComputeHash Count Create CreateDirectory CreateTempSubdirectory Delete Error Exception
        ExitCode FileName FullName GetCurrent GetCurrentProcess GetString GetTempPath IsCompleted Length MainModule
        Message NewGuid OpenStandardInput Out Read ReadAsync RedirectStandardInput Replace Result
        SetSecurityDescriptorSddlForm StandardInput Start ToLowerInvariant ToString User UseShellExecute Value
        WaitForExit WriteAllBytes WriteAllText WriteLine new
        """
    ),
    operators=words(", = += ++ -and -ceq -cmatch -cne -cnotmatch -eq -f -lt -ne -not -or -replace -split + - . :: |"),
    given_variables=words("$_ $false $null $true $env:OS"),
    pins=_PINS | {_SILENT_PROGRESS},
)


def lists_of(kind: ScriptKind) -> Lists:
    """The lists of this kind of script."""
    match kind:
        case ScriptKind.OBSERVE:
            return READING
        case ScriptKind.BOOTSTRAP:
            return BOOTSTRAP
        case ScriptKind.APPLY | ScriptKind.UNDO:
            return CHANGING
        case ScriptKind.MEASURE:
            return MEASURING
