"""Lists of all that scripts may be made of. Everything else is a problem, also what no author of a rule thought of."""


def words(text: str) -> frozenset[str]:
    """The words of a text, as a set that reads well and is easily compared."""
    return frozenset(text.split())


CONSTRUCTS = words(
    """
    additive_argument_expression additive_expression argument_expression argument_expression_list argument_list
    array_expression array_literal_expression array_type_name bitwise_argument_expression bitwise_expression
    cast_expression comparison_argument_expression comparison_expression comparison_operator element_access
    expression_with_unary_operator format_argument_expression format_expression format_operator
    invokation_expression logical_argument_expression logical_expression member_access member_name
    multiplicative_argument_expression multiplicative_expression parenthesized_expression
    range_argument_expression range_expression unary_expression
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
    finally_clause for_statement for_initializer for_condition for_iterator while_statement while_condition
    post_increment_expression
    """
)

READING_CMDLETS = words(
    r"""
    Hyper-V\Get-VM Hyper-V\Get-VMHost Hyper-V\Get-VMHostNumaNode Hyper-V\Get-VMProcessor Hyper-V\Get-VMMemory
    Hyper-V\Get-VMHardDiskDrive Hyper-V\Get-VHD Hyper-V\Get-VMFirmware Hyper-V\Get-VMSnapshot Hyper-V\Get-VMSwitch
    ConvertTo-Json Get-Acl Get-CimInstance Get-ExecutionPolicy Get-Module
    Get-WinEvent Join-Path Set-StrictMode Start-Sleep
    Microsoft.PowerShell.Core\Where-Object Microsoft.PowerShell.Management\Get-ChildItem
    Microsoft.PowerShell.Management\Get-Item
    """
)
CMDLETS = READING_CMDLETS | words(
    r"""
    Hyper-V\New-VM Hyper-V\Set-VM Hyper-V\Set-VMFirmware Hyper-V\Rename-VM Hyper-V\Remove-VM Hyper-V\Start-VM
    Hyper-V\Stop-VM Hyper-V\Set-VMProcessor Hyper-V\Set-VMMemory Hyper-V\New-VHD Hyper-V\Add-VMHardDiskDrive
    Hyper-V\Remove-VMNetworkAdapter Hyper-V\Move-VMStorage
    FailoverClusters\Update-ClusterVirtualMachineConfiguration
    ConvertFrom-Json Export-ModuleMember Import-Module New-Item New-ItemProperty
    New-Module Receive-Job Remove-Item Remove-ItemProperty Set-Acl
    Write-Information Write-Progress Write-Verbose
    Get-Command Microsoft.PowerShell.Core\Get-Command Microsoft.PowerShell.Utility\Get-Alias
    ConvertTo-SecureString Invoke-Command New-PSSession Remove-Job Remove-PSSession
    Hyper-V\Get-VMIntegrationService Hyper-V\Get-VMNetworkAdapter Hyper-V\Get-VMSecurity
    Microsoft.PowerShell.Management\Test-Path Microsoft.PowerShell.Utility\Sort-Object
    """
)

READING_TYPES = words(
    """
    CmdletBinding bool char int long ordered regex scriptblock string string[] switch void
    Environment IntPtr
    System.BitConverter System.IO.BinaryReader System.IO.File System.IO.FileStream System.IO.IOException
    System.Management.Automation.ItemNotFoundException System.UnauthorizedAccessException
    System.Security.Cryptography.SHA256 System.Text.Encoding
    System.Security.Principal.SecurityIdentifier System.Security.Principal.WindowsBuiltInRole
    System.Security.Principal.WindowsIdentity System.Security.Principal.WindowsPrincipal
    """
)
TYPES = READING_TYPES | words(
    """
    Array Console DateTime OutputType guid hashtable pscustomobject ref System.Collections.IDictionary System.Convert
    System.Diagnostics.EventLog
    System.Diagnostics.Process System.Diagnostics.ProcessStartInfo System.Diagnostics.Stopwatch
    System.IO.Directory System.IO.FileAttributes
    System.IO.Path System.IO.Stream System.Management.Automation.PSCredential
    System.StringComparer System.StringComparison WildcardPattern
    Diagnostics.CodeAnalysis.SuppressMessageAttribute Parameter byte[]
    """
)

READING_MEMBERS = words(
    """
    AutomaticStartAction AutomaticStopAction CheckpointType Count DynamicMemoryEnabled
    Generation Id LogicalProcessorCount Maximum Name Notes ParentPath Path
    RelativeWeight Reserve SecureBoot SecureBootTemplate Startup State
    VhdType VirtualHardDiskPath VMId
    ASCII Administrator ComputeHash Create Dispose Exists
    GetBytes GetEncoding GetString Length Substring ToString Trim
    Category CategoryInfo CpuGroupId EnabledState Exception ExecutionPolicy
    FullyQualifiedErrorId GetCurrent GetFolderPath GetOwner GetValue GetValueKind GetValueNames
    GuestIntrinsicExchangeItems HResult HypervisorPresent Keys InstanceID IsInRole LanguageMode MachineName
    MemoryAvailable MemoryCapacity MemoryTotal Message NumaSpanningEnabled NumberOfCores
    NumberOfLogicalProcessors OperationalStatus PSChildName PSEdition PSObject PSVersion Properties Replace
    ReadBytes Reservation Scope SessionState Size
    SystemName ToLowerInvariant Value Version new Equals
    """
)
MEMBERS = READING_MEMBERS | words(
    """
    ASCII AcceptScheduler Action AddMilliseconds Address After Application Before Clear ComputeHash Computer Contains
    Cores Create CreateDirectory Delete Detail Enabled Fits Flush
    GetAttributes GetBytes Guest
    CommandType InvocationInfo InvocationName Kind Length LogicalProcessors Lost Major Memory Move MyCommand Needs
    Number Ordinal Percent Plan Position PrimaryOperationalStatus Processors
    ContainsKey Detail Identity Read Remove ReadAllBytes ReparsePoint Run ScriptLineNumber Serial
    BoundParameters MyInvocation Purpose Robot Set SetLength
    SetSecurityDescriptorSddlForm ShouldProcess Sort Status Step Substring ThreadsPerCore ToString Undo
    Row UndoDigest Undoes UserName UtcNow Write closing data kind number plan run
    application history purpose robot serials started_at started_by status touched
    CPUWaitTimePerDispatch CPUWaitTimePerDispatch_Base Combine Elapsed ElapsedMilliseconds EnvironmentVariables
    ExitCode Folder FromBase64String GetDirectoryName GetTempPath HasExited Image Job Kill Limit Machine
    Partition PercentGuestRunTime PercentHypervisorRunTime PercentTotalRunTime
    ReadLineAsync RedirectStandardOutput Result StandardOutput Start StartNew
    Request Ticks Type UseShellExecute Values Wait WaitForExit Weight WorkingDirectory WriteAllBytes
    Logon arguments child environment exists files instances period_ticks program reserve timeout_ms used
    Arguments Close CreateTempSubdirectory Error FileName GetCurrentProcess GetDirectories IsCompleted MainModule
    NewGuid Abandon AsJson Caller Code Confirmation ExportedFunctions LockTimeout Module ModulePath NewBoundScriptBlock
    Preview ScriptPath Test WriteEntry InDesiredState module script undo
    Escape GetFileName GetProcessById UTF8 GetUnresolvedProviderPathFromPSPath OrdinalIgnoreCase
    OpenStandardInput Out ReadAsync RedirectStandardInput StandardInput User WriteLine
    BootOrder BootType FullName MemoryAssigned MemoryStartup ProcessorCount ProcessorsAvailability ReplicationMode
    Shielded
    """
)

OPERATORS = words(
    """
    , = += -= ++ + - * / . :: | -band -ccontains -ceq -clike -cmatch -cne -cnotcontains -cnotmatch -creplace -csplit -eq
    -f -ge -gt -join -le -lt -ne -not -or -and
    """
)
"""Those on patterns tell case: the others, `-match` or `-replace`, fold it by the culture of the user."""

VARIABLES = words(
    "$_ $args $true $false $null $env:OS $env:ProgramData $env:RARMS_RECEIVER $ExecutionContext $PSVersionTable "
    "$Matches $PID $PSCmdlet "
    "$MyInvocation $PSBoundParameters $PSCommandPath $PSScriptRoot $WhatIfPreference $script:Vm"
)
"""Variables that PowerShell assigns, and no script."""

PINS = frozenset(
    {
        "$ErrorActionPreference = 'Stop'",
        "$PSDefaultParameterValues = @{}",
        "$ConfirmPreference = 'None'",
        "$ConfirmPreference = 'High'",
        "$ConfirmPreference = $script:Run.Confirmation",
        "$script:WhatIfPreference = $script:Preview",
        "$ProgressPreference = 'SilentlyContinue'",
        "$ProgressPreference = 'Continue'",
        "$WhatIfPreference = $false",
        "$PSModuleAutoLoadingPreference = 'All'",
        *(f"${stream}Preference = 'SilentlyContinue'" for stream in ("Debug", "Information", "Verbose", "Warning")),
    }
)
"""Assignments to PowerShell's own variables, as written."""

BLOCKS = words("$Do $Read $read $look $set $fits $bound $invoke $Path")
"""Variables that may stand behind `&`."""

SPECIAL = words(
    """
    $_ $args $consolefilename $error $event $executioncontext $false $foreach $home $host $input $iscoreclr $islinux
    $ismacos $iswindows $lastexitcode $matches $myinvocation $nestedpromptlevel $null $pid $profile
    $psboundparameters $pscmdlet $pscommandpath $psculture $psdefaultparametervalues $psedition $pshome $psitem
    $psscriptroot $pssenderinfo $psuiculture $psversiontable $pwd $sender $shellid $stacktrace $switch $this $true
    """
)
"""Variables that PowerShell itself keeps or heeds, in lower case."""

_PLAN_CALLS = r"""
Use-Target Address Read
Add-Step Action Before After Same Set Fits Undoes Lost
Test-Open Name
Test-Capacity Processors Reserve Memory
Get-PartitionReading Machine Clustered Name Disk
Get-ClusterReading
Get-TaskClassReading Task
Get-GuestTaskClassReading Task Application Replace
Get-DiskReading Path Parent Everywhere
Get-FolderReading From To
Hyper-V\Get-VMHardDiskDrive VM
Hyper-V\New-VM Name Generation MemoryStartupBytes NoVHD SwitchName Path
Hyper-V\Add-VMHardDiskDrive VM Path
Hyper-V\New-VHD Path ParentPath Differencing
Hyper-V\Remove-VM VM Force
Hyper-V\Remove-VMNetworkAdapter VM
Hyper-V\Rename-VM VM NewName
Hyper-V\Set-VM VM AutomaticStartAction AutomaticStopAction CheckpointType
Hyper-V\Set-VMFirmware VM EnableSecureBoot SecureBootTemplate FirstBootDevice
Hyper-V\Set-VMMemory VM DynamicMemoryEnabled StartupBytes
Hyper-V\Set-VMProcessor VM Count Reserve Maximum RelativeWeight
Hyper-V\Start-VM VM
FailoverClusters\Update-ClusterVirtualMachineConfiguration VMId
Write-Mark
Stop-Partition GraceMs
Wait-Start Milliseconds
Write-TaskValue Task Name Type Value
Remove-TaskValue Task Name Keep
Remove-TaskClass Task
Write-TaskRecord Task Application Robot Digest Before
Remove-TaskRecord Task Application
Save-TaskRecord Task Application Digest
Restore-TaskClass Task Application
Remove-Item LiteralPath
Add-Folder Path
Move-NewPartition From To
Remove-PartitionFolder From To
Add-TestPartition Name Processors Memory Limit Weight Generation Image Type Folder SecureBoot
Add-GuestWork Partition Logon Name Kind Program Arguments Environment Files PeriodTicks TimeoutMs Instances
"""
PLAN_CALLS = {name: set(parameters) for name, *parameters in map(str.split, _PLAN_CALLS.strip().splitlines())}
"""What plans call, by name with the parameters that they give: all that scripts do to a machine."""
