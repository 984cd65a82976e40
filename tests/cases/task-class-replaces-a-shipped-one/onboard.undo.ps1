#Requires -Version 5.1
#Requires -Modules Hyper-V
#Requires -RunAsAdministrator
# rarms undo script: it takes back what the apply script of the same plan did. Read the steps at its end; everything between the two runtime lines is the same in every script.
# Application  robot, host onboard: the host itself
# Plan         369034ed8833, manifest a9326d298f28, rarms 0.1.0
# Steps        2
# --- runtime: the same bytes in every script --------------------------------------------------
# Contents: telling - lock - journal - guards - machines - disks - registry - guests - steps - the run.
# Read the last two first: what a step does, and what a run does with its steps. The rest serves them.
[CmdletBinding(SupportsShouldProcess, ConfirmImpact = 'Medium')]
param(
    # One JSON object a line on standard output, for a program to read.
    [switch] $AsJson,
    # Seconds to wait for another run to end.
    [int] $LockTimeout = 0,
    # Close this plan's unfinished run and change nothing else.
    [switch] $Abandon
)


Set-StrictMode -Version 3.0
$ErrorActionPreference = 'Stop'

$script:Cmdlet = $PSCmdlet
$script:Json = [bool] $AsJson
# A service or a logon may come without the variable; Windows knows the folder all the same.
$common = if ($env:ProgramData) { $env:ProgramData } else { [Environment]::GetFolderPath('CommonApplicationData') }
$script:Folder = Join-Path -Path $common -ChildPath 'rarms'
$script:Journal = Join-Path -Path $script:Folder -ChildPath 'journal.jsonl'
$script:ProfileRoot = 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile'
$script:RecordRoot = 'HKLM:\SOFTWARE\rarms'
$name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
$form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12})\r*$'
$script:MarkForm = $form.Replace('NAME', $name)
$script:Definition = @{ Plan = ''; Total = 0 }
$script:Mutex = $null
$script:Sound = [long] 0        # bytes of the journal that are whole records
$script:Serials = $null         # what the first record of a fresh run is to say; none where an earlier one goes on
$script:Steps = @()
$script:Done = @{}              # numbers of steps that an earlier run of this plan did
$script:Begun = @{}             # numbers of steps that it began
$script:Touched = @{}           # of an undo: numbers of the steps of the apply that may have changed something
$script:Ended = $false          # that run came to its end: now only look
$script:Skipped = @{}           # addresses of steps that -WhatIf or a declined -Confirm left out
$script:Expected = @{}          # by address: what is to be read after what was done so far
$script:Reader = @{}            # by address: how it is read

# Telling ----------------------------------------------------------------------------------------

function ConvertTo-AsciiJson {
    # One line of JSON in pure ASCII; 5.1 and 7 leave different characters as they are.
    param($Value)
    $text = ConvertTo-Json -InputObject $Value -Depth 20 -Compress
    [regex]::Replace($text, '[^\x20-\x7e]', { '\u{0:x4}' -f [int] [char] $args[0].Value })
}

function Write-RunEvent {
    param([string] $Kind, [string] $Address, [string] $Status, [string] $Detail = '', [int] $Number = 0)
    if ($script:Json) {
        $line = [ordered] @{
            format = 'rarms-event/1'; kind = $Kind; plan = $script:Definition.Plan; number = $Number
            total = $script:Definition.Total; address = $Address; status = $Status; detail = $Detail
        }
        [Console]::Out.WriteLine((ConvertTo-AsciiJson -Value $line))
    } else {
        $text = '{0,-10} {1}  {2}' -f $Status, $Address, $Detail
        Write-Information -MessageData $text -InformationAction Continue
    }
}

function Write-StepEvent {
    param([System.Collections.IDictionary] $Step, [string] $Status, [string] $Detail = '')
    Write-RunEvent -Kind 'step' -Address $Step.Address -Number $Step.Number -Status $Status -Detail $Detail
}

function Exit-Refused {
    # The host is not as planned, busy or used: exit code 3.
    param([string] $Address, [string] $Detail, [int] $Number = 0, [string] $Kind = 'refused')
    Write-RunEvent -Kind $Kind -Address $Address -Status 'refused' -Detail $Detail -Number $Number
    exit 3
}

# Lock -------------------------------------------------------------------------------------------

function Enter-Host {
    # One run at a time on this computer. Windows hands over what a dead process held.
    $owner = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
    $before = 'it is held by somebody'
    if (Test-Path -LiteralPath $owner) { $before = 'it is held by ' + [System.IO.File]::ReadAllText($owner) }
    $held = $false
    try {
        $script:Mutex = [System.Threading.Mutex]::new($false, 'Global\rarms')
    } catch [System.UnauthorizedAccessException] {
        # Made by an account that lets nobody else open it, so it is alive.
        Exit-Refused -Kind 'lock' -Address 'host' -Detail $before
    }
    try {
        $held = $script:Mutex.WaitOne(1000 * $LockTimeout)
    } catch [System.Threading.AbandonedMutexException] {
        $held = $true
        Write-RunEvent -Kind 'lock' -Address 'host' -Status 'taken over' -Detail ($before -creplace '^it is', 'it was')
    }
    if (-not $held) {
        $script:Mutex.Dispose()
        $script:Mutex = $null
        Exit-Refused -Kind 'lock' -Address 'host' -Detail $before
    }
    if (-not $WhatIfPreference) {
        Protect-Folder
        [System.IO.File]::WriteAllText($owner, (Get-Operator))
    }
}

function Exit-Host {
    if ($null -ne $script:Mutex) {
        $script:Mutex.ReleaseMutex()
        $script:Mutex.Dispose()
    }
}

function Get-Operator {
    '{0}@{1}, process {2}' -f [Environment]::UserName, [Environment]::MachineName, $PID
}

function Protect-Folder {
    # Only Administrators and SYSTEM may write what a later run trusts.
    if (Test-Path -LiteralPath $script:Folder) { Assert-Owner -Path $script:Folder }
    else { [void] [System.IO.Directory]::CreateDirectory($script:Folder) }
    # Also where it was there: a run that was killed right here left it open to everybody.
    Protect-Path -Path $script:Folder -Descriptor 'O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)'
}

function Protect-Path {
    # The owner is said, not left to the account: what a policy or an ssh logon makes of new files differs.
    param([string] $Path, [string] $Descriptor)
    # -Confirm asks for steps, not for what rarms keeps for itself.
    $ConfirmPreference = 'None'
    if ($env:OS -cne 'Windows_NT') { return }
    $acl = Get-Acl -LiteralPath $Path
    $acl.SetSecurityDescriptorSddlForm($Descriptor)
    Set-Acl -LiteralPath $Path -AclObject $acl
}

function Assert-Owner {
    # A journal or folder that somebody planted must not tell an administrator what to do.
    param([string] $Path)
    if ($env:OS -cne 'Windows_NT') { return }
    $owner = (Get-Acl -LiteralPath $Path).GetOwner([System.Security.Principal.SecurityIdentifier]).Value
    if ($owner -cne 'S-1-5-32-544' -and $owner -cne 'S-1-5-18') {
        throw ('{0} belongs to {1}, not to Administrators or SYSTEM: look at it, then remove it' -f $Path, $owner)
    }
}

# Journal ----------------------------------------------------------------------------------------

function Get-Sha256 {
    param([byte[]] $Data)
    $hash = [System.Security.Cryptography.SHA256]::Create()
    ([System.BitConverter]::ToString($hash.ComputeHash($Data)) -replace '-', '').ToLowerInvariant()
}

function Read-Journal {
    # The whole records. A torn last one is dropped; a damaged earlier one is an error.
    if (-not (Test-Path -LiteralPath $script:Journal)) { return }
    Assert-Owner -Path $script:Folder
    Assert-Owner -Path $script:Journal
    $torn = $false
    $lines = @([System.IO.File]::ReadAllText($script:Journal) -split '\n')
    for ($at = 0; $at -lt $lines.Count - 1; $at++) {
        $line = $lines[$at]
        if ($torn) { throw ('a record of {0} is damaged: see what the last run did, then remove it' -f $script:Journal) }
        $torn = $true
        if ($line -cmatch '^(?<open>\{.*),"length":(?<length>[0-9]+),"checksum":"(?<checksum>[0-9a-f]{64})"\}$') {
            $text = $Matches['open'] + '}'
            $digest = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($text))
            if ($digest -ceq $Matches['checksum'] -and $text.Length -eq [long] $Matches['length']) {
                $torn = $false
                $script:Sound += $line.Length + 1
                ConvertFrom-Json -InputObject $text
            }
        }
    }
}

function Add-Record {
    # A line of JSON, sealed by length and checksum, on the disk when this returns. A torn end is cut off first.
    param([System.Collections.IDictionary] $Record, [string] $Path = $script:Journal)
    $text = ConvertTo-AsciiJson -Value $Record
    $digest = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($text))
    $open = $text.Substring(0, $text.Length - 1)
    $line = '{0},"length":{1},"checksum":"{2}"}}{3}' -f $open, $text.Length, $digest, [char] 10
    [byte[]] $data = [System.Text.Encoding]::ASCII.GetBytes($line)
    $mode = [System.IO.FileMode]::OpenOrCreate
    $stream = [System.IO.FileStream]::new($Path, $mode, [System.IO.FileAccess]::Write)
    try {
        $stream.SetLength($script:Sound)
        $stream.Position = $script:Sound
        $stream.Write($data, 0, $data.Length)
        $stream.Flush($true)
    } finally {
        $stream.Dispose()
    }
    $script:Sound += $data.Length
}

function Write-FirstRecord {
    # Starts the run in one write: uses the plan, raises the serial, and holds the run whole.
    $undo = ''
    if ($script:Definition.Undo) {
        $path = Join-Path -Path $PSScriptRoot -ChildPath $script:Definition.Undo
        if (-not (Test-Path -LiteralPath $path)) { throw ('the undo script {0} must lie beside this one' -f $path) }
        $data = [System.IO.File]::ReadAllBytes($path)
        if ((Get-Sha256 -Data $data) -cne $script:Definition.UndoDigest) { throw ('{0} was edited' -f $path) }
        $undo = [System.Text.Encoding]::ASCII.GetString($data)
    }
    $record = [ordered] @{
        run = $script:Definition.Run; plan = $script:Definition.Plan; application = $script:Definition.Application
        started_by = Get-Operator; script = [System.IO.File]::ReadAllText($PSCommandPath); undo = $undo
        serials = $script:Serials; touched = @($script:Touched.Keys | Sort-Object); kind = 'run_started'
    }
    $fresh = $script:Journal + '.new'
    $script:Sound = [long] 0
    Add-Record -Record $record -Path $fresh
    Protect-Path -Path $fresh -Descriptor 'O:BAG:SYD:P(A;;FA;;;BA)(A;;FA;;;SY)'
    if (Test-Path -LiteralPath $script:Journal) { [System.IO.File]::Replace($fresh, $script:Journal, $script:Journal + '.old') }
    else { [System.IO.File]::Move($fresh, $script:Journal) }
}

# Guards -----------------------------------------------------------------------------------------

function Assert-Host {
    # Is it this host, may we, and does a reserve have any effect here? A guest's script must not run on the host.
    $plan = $script:Definition
    if ($plan.Guest) {
        if ([Environment]::MachineName -ne $plan.Computer) { return }
        Exit-Refused -Address 'host' -Detail 'this script is for a guest, and this is its host'
    }
    $vmHost = Hyper-V\Get-VMHost
    if ($vmHost.Name -ne $plan.Computer) {
        Exit-Refused -Address 'host' -Detail ('this is {0}, the plan is for {1}' -f $vmHost.Name, $plan.Computer)
    }
    if ($vmHost.LogicalProcessorCount -ne $plan.LogicalProcessors) {
        Exit-Refused -Address 'host' -Detail ('it has {0} logical processors now' -f $vmHost.LogicalProcessorCount)
    }
    if ($plan.AcceptScheduler) { return }
    $scheduler = Get-SchedulerType
    if ($scheduler -ceq 'root') {
        throw 'the hypervisor runs its root scheduler, under which reserve, limit and weight have no effect'
    }
    if ($scheduler -ceq 'unknown') {
        throw 'the scheduler type is not known (its event has left the log): restart the host, or accept the finding'
    }
}

function Get-SchedulerType {
    # Event 2 of the hypervisor: 1 and 2 classic, 3 core, 4 root. A client Windows always has root.
    $types = @{ 1 = 'classic'; 2 = 'classic'; 3 = 'core'; 4 = 'root' }
    try {
        $filter = @{ ProviderName = 'Microsoft-Windows-Hyper-V-Hypervisor'; ID = 2 }
        $found = @(Get-WinEvent -FilterHashtable $filter -MaxEvents 1)
        $type = [int] $found[0].Properties[0].Value
        if ($types.Contains($type)) { return $types[$type] }
    } catch {
        Write-Verbose -Message $_.Exception.Message
    }
    $windows = Get-Item -LiteralPath 'HKLM:\SOFTWARE\Microsoft\Windows NT\CurrentVersion'
    if ([string] $windows.GetValue('InstallationType') -ceq 'Client') { return 'root' }
    'unknown'
}

function Test-Capacity {
    # Whether all promises fit with this machine's new one: in sum, in memory, and each processor onto a logical one.
    param([string] $Machine, [System.Collections.IDictionary] $Claim)
    $claims = @($Claim)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if (([string] $vm.Id).ToLowerInvariant() -ceq $Machine) { continue }
        $ours = (Get-Mark -Vm $vm).Application -ceq $script:Definition.Application
        $active = @('off', 'saved') -cnotcontains (ConvertTo-RunState -State $vm.State)
        $itself = -not $ours -and [string] $vm.AutomaticStartAction -cne 'Nothing'
        if (-not ($active -or $itself)) { continue }
        $cpu = Hyper-V\Get-VMProcessor -VM $vm
        $memory = [long] (Hyper-V\Get-VMMemory -VM $vm).Startup
        $claims += @{ Processors = [long] $cpu.Count; Reserve = [long] $cpu.Reserve; Memory = $memory }
    }
    $percent = [long] 0
    $memory = [long] 0
    $free = @(100) * $script:Definition.LogicalProcessors
    foreach ($one in $claims) {
        $percent += $one.Processors * $one.Reserve
        $memory += $one.Memory
        if ($one.Reserve -gt 0 -and $one.Processors -gt $free.Count) { return $false }
    }
    if ($percent -gt $script:Definition.Percent -or $memory -gt $script:Definition.Memory) { return $false }
    $wide = 0
    $sizes = @()
    foreach ($one in $claims) {
        if ($one.Processors -eq $free.Count) { $wide += $one.Reserve } else { $sizes += @($one.Reserve) * $one.Processors }
    }
    for ($at = 0; $at -lt $free.Count; $at++) { $free[$at] -= $wide }
    foreach ($size in @($sizes | Sort-Object -Descending)) {
        $at = 0
        while ($at -lt $free.Count -and $free[$at] -lt $size) { $at++ }
        if ($at -eq $free.Count) { return $false }
        $free[$at] -= $size
    }
    $wide -le 100
}

# Machines ---------------------------------------------------------------------------------------

function ConvertTo-RunState {
    param($State)
    $name = [string] $State
    if ($name -clike '*Critical') { return 'critical' }
    if (@('Off', 'Running', 'Paused', 'Saved') -ccontains $name) { return $name.ToLowerInvariant() }
    'busy'
}

function ConvertTo-Word {
    # An enumeration's name as plans write it: TurnOff becomes turn_off.
    param($Value)
    ([string] $Value -creplace '(?<=[a-z])(?=[A-Z])', '_').ToLowerInvariant()
}

function Get-Mark {
    # Our line in a machine's notes. One that names another machine's id was copied and is none; so are two of them.
    param($Vm)
    $none = @{ Application = ''; Name = ''; Set = '' }
    $found = @()
    foreach ($line in @([string] $Vm.Notes -split '\n')) {
        if (-not ($line -cmatch $script:MarkForm)) { continue }
        $found += @{ Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set']; Machine = $Matches['vm'] }
    }
    if ($found.Count -eq 1 -and ([string] $Vm.Id).ToLowerInvariant().Substring(0, 8) -ceq $found[0]['Machine']) { return $found[0] }
    $none
}

function Find-Machine {
    # By id where the plan knew it; otherwise what carries our mark, or the pending name of this plan. Never by name.
    param([string] $Name, [string] $Machine)
    $pending = '{0}.rarms-{1}' -f $Name, $script:Definition.Plan
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if ($Machine) {
            if (([string] $vm.Id).ToLowerInvariant() -ceq $Machine) { $vm }
            continue
        }
        $mark = Get-Mark -Vm $vm
        $ours = $mark.Name -ceq $Name -and $mark.Application -ceq $script:Definition.Application
        if ($ours -or (Test-Same -Left $vm.Name -Right $pending)) { $vm }
    }
}

function Get-Machine {
    # The one machine that a step changes.
    param([string] $Name, [string] $Machine = '')
    $found = @(Find-Machine -Name $Name -Machine $Machine)
    if ($found.Count -ne 1) {
        Exit-Refused -Address ('partition/' + $Name) -Detail ('{0} machines answer to {1}' -f $found.Count, $Name)
    }
    $found[0]
}

function Test-Stranger {
    # Whether a machine of this name is somebody else's: it carries no mark of our application.
    param([string] $Name)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if (-not (Test-Same -Left $vm.Name -Right $Name)) { continue }
        if ((Get-Mark -Vm $vm).Application -cne $script:Definition.Application) { return $true }
    }
    $false
}

function Read-Partition {
    param([string] $Name, [string] $Machine = '')
    $taken = Test-Stranger -Name $Name
    if (-not @(Find-Machine -Name $Name -Machine $Machine).Count) { return @{ exists = $false; taken = $taken } }
    $vm = Get-Machine -Name $Name -Machine $Machine
    $cpu = Hyper-V\Get-VMProcessor -VM $vm
    $memory = Hyper-V\Get-VMMemory -VM $vm
    $mark = Get-Mark -Vm $vm
    $owner = if ($mark.Name) { '{0}/{1}' -f $mark.Application, $mark.Name } else { '' }
    $state = ConvertTo-RunState -State $vm.State
    @{
        exists = $true; machine = ([string] $vm.Id).ToLowerInvariant(); name = [string] $vm.Name
        generation = [long] $vm.Generation; processors = [long] $cpu.Count
        reserve = [long] $cpu.Reserve; limit = [long] $cpu.Maximum; weight = [long] $cpu.RelativeWeight
        memory = [long] $memory.Startup; dynamic_memory = [bool] $memory.DynamicMemoryEnabled
        start_action = ConvertTo-Word -Value $vm.AutomaticStartAction
        stop_action = ConvertTo-Word -Value $vm.AutomaticStopAction
        checkpoints = ConvertTo-Word -Value $vm.CheckpointType
        running = $state -ceq 'running'; state = $state; mark = $owner; set = $mark.Set; taken = $taken
        adapters = @(Hyper-V\Get-VMNetworkAdapter -VM $vm).Count
        disks = @(Hyper-V\Get-VMHardDiskDrive -VM $vm).Count
        snapshots = @(Hyper-V\Get-VMSnapshot -VM $vm).Count
    }
}

function Write-Mark {
    # The only text that is built around what a host says. The user's lines of the notes stay.
    param([string] $Name, [string] $Machine = '', [string] $Application, [string] $Partition, [string] $Digest)
    $vm = Get-Machine -Name $Name -Machine $Machine
    $id = ([string] $vm.Id).ToLowerInvariant().Substring(0, 8)
    $line = 'rarms/1 {0}/{1} vm={2} set={3}' -f $Application, $Partition, $id, $Digest
    $other = Get-OtherNote -Vm $vm
    if ($other) { $line = $line + [char] 13 + [char] 10 + $other }
    Hyper-V\Set-VM -VM $vm -Notes $line
}

function Clear-Mark {
    param([string] $Name, [string] $Machine = '')
    $vm = Get-Machine -Name $Name -Machine $Machine
    Hyper-V\Set-VM -VM $vm -Notes (Get-OtherNote -Vm $vm)
}

function Get-OtherNote {
    # The user's lines of the notes.
    param($Vm)
    $lines = @([string] $Vm.Notes -split '\n')
    @(foreach ($line in $lines) { if (-not ($line -cmatch $script:MarkForm)) { $line } }) -join [string] [char] 10
}

function Invoke-PartitionStop {
    # Asks a running guest to shut down; after the grace, or where there is nobody to ask, the machine is turned off.
    param([string] $Name, [string] $Machine = '', [long] $GraceMs)
    $vm = Get-Machine -Name $Name -Machine $Machine
    $until = [DateTime]::UtcNow.AddMilliseconds($GraceMs)
    if ($GraceMs -and [string] $vm.State -ceq 'Running') { [void] (Hyper-V\Stop-VM -VM $vm -Force -AsJob) }
    $waiting = @('running', 'busy')
    while ([DateTime]::UtcNow -lt $until -and $waiting -ccontains (ConvertTo-RunState -State (Hyper-V\Get-VM -Id $vm.Id).State)) {
        Start-Sleep -Milliseconds 500
    }
    if ([string] (Hyper-V\Get-VM -Id $vm.Id).State -cne 'Off') { Hyper-V\Stop-VM -VM $vm -TurnOff -Force }
}

# Disks ------------------------------------------------------------------------------------------

function Get-DiskPath {
    # Where a new disk goes: the plan's folder, or the host's own.
    param([string] $Folder, [string] $File)
    if (-not $Folder) { $Folder = (Hyper-V\Get-VMHost).VirtualHardDiskPath }
    # Not Join-Path, which wants the drive to be there while the steps are still compared.
    '{0}\{1}' -f ($Folder -creplace '\\$', ''), $File
}

function Read-Disk {
    # Whether it is there and grows out of this image; with -Everywhere also whether any machine has it.
    param([string] $Path, [string] $Parent, [switch] $Everywhere)
    if (-not (Test-Path -LiteralPath $Path)) { return @{ exists = $false } }
    $disk = Hyper-V\Get-VHD -Path $Path
    $child = [string] $disk.VhdType -ceq 'Differencing' -and (Test-SamePath -Left $disk.ParentPath -Right $Parent)
    $live = @{ exists = $true; child = $child }
    if ($Everywhere) { $live['used'] = Test-DiskUse -Path $Path }
    $live
}

function Test-DiskUse {
    # Whether a machine or one of its checkpoints has this disk, or one that grows out of it.
    param([string] $Path)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        $drives = @(Hyper-V\Get-VMHardDiskDrive -VM $vm)
        foreach ($one in @(Hyper-V\Get-VMSnapshot -VM $vm)) { $drives += @(Hyper-V\Get-VMHardDiskDrive -VMSnapshot $one) }
        foreach ($drive in $drives) {
            $at = [string] $drive.Path
            while ($at) {
                if (Test-SamePath -Left $at -Right $Path) { return $true }
                $at = if (Test-Path -LiteralPath $at) { [string] (Hyper-V\Get-VHD -Path $at).ParentPath } else { '' }
            }
        }
    }
    $false
}

function Test-SamePath {
    # Windows tells paths apart neither by case nor by the direction of a slash.
    param([string] $Left, [string] $Right)
    $Left.Replace('/', '\') -eq $Right.Replace('/', '\')
}

function Clear-DiskFile {
    param([string] $Path)
    Remove-Item -LiteralPath $Path
}

# Registry ---------------------------------------------------------------------------------------

function Get-TaskPath {
    # SystemResponsiveness is one value of the key above the task classes; our record of it lies among theirs.
    param([string] $Task)
    if ($Task -ceq 'SystemResponsiveness') { return $script:ProfileRoot }
    '{0}\Tasks\{1}' -f $script:ProfileRoot, $Task
}

function Get-RecordPath {
    # Ours, never below the multimedia keys.
    param([string] $Task, [string] $Application)
    '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
}

function Get-TaskValueName {
    # The names of a task class's values; of the key above the classes only the one that is meant.
    param([string] $Task)
    $path = Get-TaskPath -Task $Task
    if (-not (Test-Path -LiteralPath $path)) { return }
    foreach ($name in @((Get-Item -LiteralPath $path).GetValueNames())) {
        if ($path -cne $script:ProfileRoot -or $name -eq $Task) { $name }
    }
}

function Read-TaskClass {
    # Values with their types, and our record: whose it is and what was last written.
    param([string] $Task)
    $live = @{ exists = $false; values = ''; record = ''; set = '' }
    [string[]] $names = @(foreach ($name in @(Get-TaskValueName -Task $Task)) { $name.ToLowerInvariant() })
    [Array]::Sort($names, [System.StringComparer]::Ordinal)
    foreach ($name in $names) {
        $key = Get-Item -LiteralPath (Get-TaskPath -Task $Task)
        $kind = ([string] $key.GetValueKind($name)).ToLowerInvariant()
        $data = $key.GetValue($name)
        if ($kind -ceq 'dword') { $data = [long] $data -band 4294967295 }
        $live['value:' + $name] = '{0}:{1}' -f ($kind -creplace '^string$', 'sz'), $data
        $live['exists'] = $true
        # Windows does not tell the case of a value's name apart.
        $live['values'] = $names -join ', '
    }
    if (-not (Test-Path -LiteralPath $script:RecordRoot)) { return $live }
    foreach ($application in @(Get-ChildItem -LiteralPath $script:RecordRoot)) {
        $path = Get-RecordPath -Task $Task -Application $application.PSChildName
        if (-not (Test-Path -LiteralPath $path)) { continue }
        $set = [string] (Get-Item -LiteralPath $path).GetValue('set')
        if ($set) {
            $live['record'] = [string] $application.PSChildName
            $live['set'] = $set
        }
    }
    $live
}

function Add-Key {
    # Never with -Force, which would empty a key that is there.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { [void] (New-Item -Path $Path) }
}

function Write-TaskValue {
    param([string] $Task, [string] $Name, [string] $Type, $Value)
    $path = Get-TaskPath -Task $Task
    Add-Key -Path $path
    [void] (New-ItemProperty -LiteralPath $path -Name $Name -PropertyType $Type -Value $Value -Force)
}

function Clear-TaskValue {
    # Takes one value away; with -Keep every value but these, whose names are joined as readings join them.
    param([string] $Task, [string] $Name = '', [string] $Keep = '')
    foreach ($one in @(Get-TaskValueName -Task $Task)) {
        $goes = if ($Keep) { @($Keep -split ', ') -notcontains $one } else { $one -eq $Name }
        if ($goes) { Remove-ItemProperty -LiteralPath (Get-TaskPath -Task $Task) -Name $one }
    }
}

function Clear-Key {
    param([string] $Path)
    if (Test-Path -LiteralPath $Path) { Remove-Item -LiteralPath $Path }
}

function Clear-TaskClass {
    param([string] $Task)
    Clear-Key -Path (Get-TaskPath -Task $Task)
}

function Write-TaskRecord {
    # What was there before comes first, the digest last: without it the record does not count.
    param([string] $Task, [string] $Application, [string] $Digest, [string] $Before)
    $path = Get-RecordPath -Task $Task -Application $Application
    Add-Key -Path $script:RecordRoot
    Add-Key -Path ('{0}\{1}' -f $script:RecordRoot, $Application)
    Add-Key -Path $path
    [void] (New-ItemProperty -LiteralPath $path -Name 'before' -PropertyType String -Value $Before -Force)
    [void] (New-ItemProperty -LiteralPath $path -Name 'set' -PropertyType String -Value $Digest -Force)
}

function Clear-TaskRecord {
    param([string] $Task, [string] $Application)
    Clear-Key -Path (Get-RecordPath -Task $Task -Application $Application)
}

# Guests: nobody could look into them, so that their own record decides --------------------------

function Read-GuestTaskClass {
    # As Read-TaskClass, and whether the class is somebody else's: another application's, or there before rarms.
    param([string] $Task, [string] $Application, [bool] $Replace)
    $live = Read-TaskClass -Task $Task
    $live['taken'] = [bool] ($live['exists'] -and -not $Replace)
    if ($live['record']) { $live['taken'] = $live['record'] -cne $Application }
    $live
}

function Save-TaskRecord {
    # What was there before rarms is kept once; a record that is ours already knows it.
    param([string] $Task, [string] $Application, [string] $Digest)
    $live = Read-TaskClass -Task $Task
    $before = 'null'
    if ($live['record']) {
        $path = Get-RecordPath -Task $Task -Application $Application
        $before = [string] (Get-Item -LiteralPath $path).GetValue('before')
    } elseif ($live['exists']) {
        $values = [ordered] @{}
        foreach ($name in @(Get-TaskValueName -Task $Task)) {
            $kind, $data = $live['value:' + $name] -split ':', 2
            if ($kind -ceq 'dword') { $data = [long] $data }
            $values[$name] = [ordered] @{ kind = $kind; data = $data }
        }
        $before = ConvertTo-AsciiJson -Value $values
    }
    Write-TaskRecord -Task $Task -Application $Application -Digest $Digest -Before $before
}

function Restore-TaskClass {
    # Brings back what the record says was there before rarms: no class, or exactly these values.
    param([string] $Task, [string] $Application)
    $path = Get-RecordPath -Task $Task -Application $Application
    $before = ConvertFrom-Json -InputObject ([string] (Get-Item -LiteralPath $path).GetValue('before'))
    if ($null -eq $before) {
        Clear-TaskClass -Task $Task
        return
    }
    foreach ($name in @(Get-TaskValueName -Task $Task)) { Clear-TaskValue -Task $Task -Name $name }
    foreach ($one in $before.PSObject.Properties) {
        $type = $one.Value.kind -creplace '^sz$', 'string'
        Write-TaskValue -Task $Task -Name $one.Name -Type $type -Value $one.Value.data
    }
}

# Steps ------------------------------------------------------------------------------------------

function Test-Same {
    # -ceq alone takes no notice of characters without width, such as a soft hyphen.
    param($Left, $Right)
    $Left -ceq $Right -and ([string] $Left).Length -eq ([string] $Right).Length
}

function Compare-Reading {
    # The names whose live value is not the expected one.
    param([System.Collections.IDictionary] $Live, [System.Collections.IDictionary] $Expected)
    foreach ($name in $Expected.Keys) {
        if (-not $Live.Contains($name) -or -not (Test-Same -Left $Live[$name] -Right $Expected[$name])) { $name }
    }
}

function Test-HalfDone {
    # A step that was begun and killed: every value is still the old one, absent as before, or already the new one.
    param([System.Collections.IDictionary] $Live, [System.Collections.IDictionary] $Step)
    foreach ($name in @($Step.Before.Keys) + @($Step.After.Keys) + @(@($Live.Keys) -clike 'value:*')) {
        # Names of values come and go one by one; a machine may be on its way to be off.
        if ($name -ceq 'values' -or ($name -ceq 'state' -and $Live[$name] -ceq 'busy')) { continue }
        if (-not ($Step.Before.Contains($name) -or $Step.After.Contains($name))) { return $false }
        $old = $Step.Before.Contains($name) -and $Live.Contains($name) -and (Test-Same -Left $Live[$name] -Right $Step.Before[$name])
        $new = $Step.After.Contains($name) -and $Live.Contains($name) -and (Test-Same -Left $Live[$name] -Right $Step.After[$name])
        $none = -not $Live.Contains($name) -and -not ($Step.Before.Contains($name) -and $Step.After.Contains($name))
        if (-not ($old -or $new -or $none)) { return $false }
    }
    $true
}

function Get-Leave {
    # Why an undo leaves a step alone; nothing where it does not.
    param([System.Collections.IDictionary] $Step)
    if ($Step.Contains('Undoes') -and -not $script:Touched.Contains([string] $Step.Undoes)) { return 'was not done' }
    $read = $Step.Read
    if ($Step.Contains('Lost') -and $script:Touched.Contains([string] $Step.Lost) -and -not (& $read)['exists']) {
        return 'went with its machine'
    }
}

function Compare-Step {
    # The names in which the host is neither as wanted, nor as planned before, nor on the way from one to the other.
    param([System.Collections.IDictionary] $Step, [System.Collections.IDictionary] $Live)
    if (-not @(Compare-Reading -Live $Live -Expected $Step.After).Count) { return }
    # What an undo takes back may have been killed half-way as well.
    $half = $script:Begun.Contains([string] $Step.Number) -or $Step.Contains('Undoes')
    if ($half -and (Test-HalfDone -Live $Live -Step $Step)) { return }
    Compare-Reading -Live $Live -Expected $Step.Before
}

function Add-StepRecord {
    param([int] $Number, [string] $Status)
    if ($WhatIfPreference) { return }
    Add-Record -Record ([ordered] @{ number = $Number; status = $Status; kind = 'step_recorded' })
}

function Add-Skip {
    param([System.Collections.IDictionary] $Step, [string] $Detail)
    $script:Skipped[$Step.Address] = $true
    Write-StepEvent -Step $Step -Status 'skipped' -Detail $Detail
}

function Add-Expectation {
    param([System.Collections.IDictionary] $Step)
    $fresh = -not $script:Expected.Contains($Step.Address)
    if ($fresh -or $Step.After['exists'] -ceq $false) { $script:Expected[$Step.Address] = @{} }
    foreach ($name in $Step.After.Keys) { $script:Expected[$Step.Address][$name] = $Step.After[$name] }
    $script:Reader[$Step.Address] = $Step.Read
}

function Invoke-Step {
    # Read, compare, set, read again. As wanted: nothing. Neither as planned before nor as wanted: stop.
    param([System.Collections.IDictionary] $Step)
    $leave = Get-Leave -Step $Step
    if ($leave) {
        Write-StepEvent -Step $Step -Status 'unchanged' -Detail $leave
        return
    }
    Add-Expectation -Step $Step
    if ($script:Ended -or $script:Done.Contains([string] $Step.Number)) {
        Write-StepEvent -Step $Step -Status 'unchanged' -Detail 'done before'
        return
    }
    if (Test-Path -LiteralPath ($PSCommandPath + '.stop')) {
        # Whoever made that file beside the script wants it to end before the next step.
        Write-RunEvent -Kind 'run' -Address 'host' -Status 'stopped' -Detail 'asked to stop; run it again to go on'
        exit 1
    }
    $read = $Step.Read
    $set = $Step.Set
    $live = & $read
    if (-not @(Compare-Reading -Live $live -Expected $Step.After).Count) {
        $status = if ($script:Begun.Contains([string] $Step.Number)) { 'changed' } else { 'unchanged' }
        Add-StepRecord -Number $Step.Number -Status $status
        Write-StepEvent -Step $Step -Status $status
        return
    }
    $moved = @(Compare-Step -Step $Step -Live $live)
    $builds = @($Step.Needs | Where-Object -FilterScript { $script:Skipped.Contains($_) })
    $inside = @($builds | Where-Object -FilterScript { $_ -cne $Step.Address })
    if ($inside.Count -or ($moved.Count -and $builds.Count)) {
        Add-Skip -Step $Step -Detail ('needs ' + ($builds -join ', '))
        return
    }
    if ($moved.Count) {
        $detail = 'changed since the plan: ' + ($moved -join ', ')
        Exit-Refused -Address $Step.Address -Number $Step.Number -Detail $detail
    }
    if ($Step.Contains('Claim') -and -not (Test-Capacity -Machine ([string] $live['machine']) -Claim $Step.Claim)) {
        if (-not $script:Skipped.Count) { throw ($Step.Address + ': the host cannot keep this promise beside the others') }
        Add-Skip -Step $Step -Detail 'needs room that skipped steps would have made'
        return
    }
    if (-not $script:Cmdlet.ShouldProcess($Step.Address, $Step.Action)) {
        Add-Skip -Step $Step -Detail ''
        return
    }
    $ConfirmPreference = 'None'
    Add-StepRecord -Number $Step.Number -Status 'begun'
    if ($script:Json) { Write-StepEvent -Step $Step -Status 'begun' -Detail $Step.Action }
    [void] (& $set)
    $missed = @(Compare-Reading -Live (& $read) -Expected $Step.After)
    if ($missed.Count) { throw ($Step.Address + ': set, but the host still shows another value: ' + ($missed -join ', ')) }
    Add-StepRecord -Number $Step.Number -Status 'changed'
    Write-StepEvent -Step $Step -Status 'changed' -Detail $Step.Action
}

# The run ----------------------------------------------------------------------------------------

function Open-Run {
    # Lock, guards, journal. A run of this plan that was killed goes on; one that ended is only looked at.
    param([System.Collections.IDictionary] $Definition)
    $script:Definition = $Definition
    Enter-Host
    if (-not $Abandon) { Assert-Host }
    $serials = @{}
    $last = $null
    $open = $false
    foreach ($record in Read-Journal) {
        if ($record.kind -ceq 'run_started') {
            $last = $record
            $open = $true
            foreach ($one in @($record.touched)) { $script:Touched[[string] $one] = $true }
            foreach ($one in $record.serials.PSObject.Properties) { $serials[$one.Name] = [long] $one.Value }
        } elseif ($record.kind -ceq 'run_closed') {
            $open = $false
            $script:Ended = $record.closing -ceq 'done'
        } else {
            if ($record.status -ceq 'begun') { $script:Begun[[string] $record.number] = $true }
            else { $script:Done[[string] $record.number] = $true }
            if ($record.status -cne 'unchanged' -and $last.run -ceq 'apply') { $script:Touched[[string] $record.number] = $true }
        }
    }
    $same = $null -ne $last -and $last.plan -ceq $Definition.Plan
    if ($Abandon) { Exit-Abandoned -Open $open -Last $last }
    if ($same -and $last.run -ceq $Definition.Run -and ($open -or $script:Ended)) { return }
    if ($Definition.Run -ceq 'undo') {
        if (-not $same -or $last.run -cne 'apply') {
            Exit-Refused -Address 'host' -Detail 'the last run here was not the one this undoes'
        }
    } elseif ($open) {
        Exit-Refused -Address 'host' -Detail ('plan {0} is unfinished here: finish or undo it' -f $last.plan)
    } elseif (-not $Definition.Guest -and [long] $serials[$Definition.Application] -ne $Definition.Serial) {
        Exit-Refused -Address 'host' -Detail 'this plan was used, or another was applied since it was made'
    } else {
        # What an earlier plan touched is not this one's to take back.
        $script:Touched = @{}
    }
    $script:Begun = @{}
    $script:Done = @{}
    $script:Ended = $false
    $serials[$Definition.Application] = [long] $serials[$Definition.Application] + 1
    $script:Serials = $serials
}

function Exit-Abandoned {
    # Leaves the host as it is; the run no longer stands in another's way.
    param([bool] $Open, $Last)
    if (-not $Open) {
        Write-RunEvent -Kind 'run' -Address 'host' -Status 'unchanged' -Detail 'nothing is unfinished here'
        exit 0
    }
    if ($Last.plan -cne $script:Definition.Plan) {
        Exit-Refused -Address 'host' -Detail ('plan {0} is unfinished here, not this one' -f $Last.plan)
    }
    if (-not $WhatIfPreference) { Add-Record -Record ([ordered] @{ closing = 'abandoned'; kind = 'run_closed' }) }
    Write-RunEvent -Kind 'run' -Address 'host' -Status 'abandoned'
    exit 0
}

function Add-Step {
    param([System.Collections.IDictionary] $Definition)
    $script:Steps += $Definition
}

function Assert-Unmoved {
    # Reads everything before anything is done: what was done is still so, and each step finds what was planned before
    # it, unless an earlier step is to make it so.
    $ahead = @{}
    foreach ($step in $script:Steps) {
        if (Get-Leave -Step $step) { continue }
        if ($script:Ended -or $script:Done.Contains([string] $step.Number)) {
            Add-Expectation -Step $step
            continue
        }
        $made = @($step.Needs | Where-Object -FilterScript { $ahead.Contains($_ + ' exists') })
        $read = $step.Read
        if (-not $made.Count) {
            foreach ($name in @(Compare-Step -Step $step -Live (& $read))) {
                if ($ahead.Contains($step.Address + ' ' + $name)) { continue }
                Exit-Refused -Address $step.Address -Number $step.Number -Detail ('changed since the plan: ' + $name)
            }
        }
        foreach ($name in $step.After.Keys) {
            if ($name -cne 'exists' -or $step.Before['exists'] -cne $step.After['exists']) { $ahead[$step.Address + ' ' + $name] = $true }
        }
    }
    Assert-Expectation -Ahead $ahead -First $true
}

function Assert-Expectation {
    # Everything that was done is still so, but for what is to be done yet.
    param([System.Collections.IDictionary] $Ahead, [bool] $First)
    foreach ($address in @($script:Expected.Keys | Sort-Object)) {
        if ($Ahead.Contains($address + ' exists')) { continue }
        $read = $script:Reader[$address]
        foreach ($name in @(Compare-Reading -Live (& $read) -Expected $script:Expected[$address])) {
            if ($Ahead.Contains($address + ' ' + $name)) { continue }
            if ($First) { Exit-Refused -Address $address -Detail ('is not as wanted: ' + $name) }
            throw ($address + ' is not as wanted: ' + $name)
        }
    }
}

function Complete-Run {
    # Look at everything, do the steps, look once more at everything together, and only then close the journal.
    Assert-Unmoved
    if ($null -ne $script:Serials -and -not $WhatIfPreference) { Write-FirstRecord }
    foreach ($step in $script:Steps) { Invoke-Step -Step $step }
    if ($script:Skipped.Count) { return }
    if (-not $script:Ended) {
        Assert-Expectation -Ahead @{} -First $false
        if (-not $WhatIfPreference) { Add-Record -Record ([ordered] @{ closing = 'done'; kind = 'run_closed' }) }
    }
    Write-RunEvent -Kind 'run' -Address 'host' -Status 'done'
}

# --- end of the runtime ---------------------------------------------------------------------
try {
    Open-Run -Definition @{
        Run = 'undo'
        Plan = '369034ed8833'
        Application = 'robot'
        Serial = 0
        Total = 2
        Undo = ''
        UndoDigest = ''
        Guest = $false
        Computer = 'ONBOARD'
        LogicalProcessors = 4
        Percent = 360
        Memory = 7516192768
        AcceptScheduler = $false
    }

    # 1/2  undo: set BackgroundPriority 4, Priority 2 -> 4
    # why: the manifest replaces it; threads see it when their Windows starts again
    # at:  rarms.yaml:12:50
    Add-Step -Definition @{
        Number = 0
        Address = 'task/Games'
        Action = 'undo: set BackgroundPriority 4, Priority 2 -> 4'
        Needs = @('task/Games')
        Undoes = 1
        Read = { Read-TaskClass -Task 'Games' }
        Before = @{ 'exists' = $true; 'value:Affinity' = 'dword:0'; 'value:Background Only' = 'sz:False'; 'value:BackgroundPriority' = 'dword:4'; 'value:Clock Rate' = 'dword:10000'; 'value:GPU Priority' = 'dword:8'; 'value:Priority' = 'dword:4'; 'value:SFIO Priority' = 'sz:Normal'; 'value:Scheduling Category' = 'sz:Medium'; 'values' = 'affinity, background only, backgroundpriority, clock rate, gpu priority, priority, scheduling category, sfio priority' }
        After = @{ 'exists' = $true; 'value:Affinity' = 'dword:0'; 'value:Background Only' = 'sz:False'; 'value:Clock Rate' = 'dword:10000'; 'value:GPU Priority' = 'dword:8'; 'value:Priority' = 'dword:2'; 'value:SFIO Priority' = 'sz:Normal'; 'value:Scheduling Category' = 'sz:Medium'; 'values' = 'affinity, background only, clock rate, gpu priority, priority, scheduling category, sfio priority' }
        Set = {
            Write-TaskValue -Task 'Games' -Name 'Affinity' -Type 'DWord' -Value 0
            Write-TaskValue -Task 'Games' -Name 'Background Only' -Type 'String' -Value 'False'
            Write-TaskValue -Task 'Games' -Name 'Clock Rate' -Type 'DWord' -Value 10000
            Write-TaskValue -Task 'Games' -Name 'GPU Priority' -Type 'DWord' -Value 8
            Write-TaskValue -Task 'Games' -Name 'Priority' -Type 'DWord' -Value 2
            Write-TaskValue -Task 'Games' -Name 'SFIO Priority' -Type 'String' -Value 'Normal'
            Write-TaskValue -Task 'Games' -Name 'Scheduling Category' -Type 'String' -Value 'Medium'
            Clear-TaskValue -Task 'Games' -Name 'BackgroundPriority'
        }
    }

    # 2/2  undo: record that it is ours, and what was there
    # why: the manifest replaces it; first, so that what was there before can be brought back
    # at:  rarms.yaml:12:50
    Add-Step -Definition @{
        Number = 1
        Address = 'task/Games'
        Action = 'undo: record that it is ours, and what was there'
        Needs = @('task/Games')
        Undoes = 0
        Read = { Read-TaskClass -Task 'Games' }
        Before = @{ 'record' = 'robot'; 'set' = '87f85213b779' }
        After = @{ 'record' = ''; 'set' = '' }
        Set = {
            Clear-TaskRecord -Task 'Games' -Application 'robot'
        }
    }

    Complete-Run
} catch {
    Write-RunEvent -Kind 'failed' -Address 'script' -Status 'failed' -Detail $_.Exception.Message
    exit 1
} finally {
    Exit-Host
}
exit 0
