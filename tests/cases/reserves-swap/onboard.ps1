#Requires -Version 5.1
#Requires -Modules Hyper-V
#Requires -RunAsAdministrator
# rarms apply script. Read the steps at its end; everything between the two runtime lines is the same in every script.
# Application  robot, host onboard: the host itself
# Plan         435e437e3780, manifest 964de3a17dd7, rarms 0.1.0
# Steps        4
# --- runtime: the same bytes in every script --------------------------------------------------
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
$script:TaskRoot = $script:ProfileRoot + '\Tasks'
$script:RecordRoot = 'HKLM:\SOFTWARE\rarms'
$script:Definition = @{ Plan = ''; Total = 0 }
$script:Mutex = $null
$script:Sound = [long] 0        # bytes of the journal that are whole records
$script:Done = @{}              # numbers of steps that an earlier run of this plan did
$script:Begun = @{}             # numbers of steps that it began
$script:Touched = @{}           # of an undo: numbers of the steps of the apply that may have changed something
$script:Ended = $false          # that run came to its end: now only look
$script:Skipped = @{}           # addresses of steps that -WhatIf or a declined -Confirm left out
$script:Expected = @{}          # by address: what is to be read when all is done
$script:Reader = @{}            # by address: how it is read

# Telling ------------------------------------------------------------------------------------

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

function Exit-Refused {
    # The host is not as planned, busy or used: exit code 3, and nothing was touched by this step.
    param([string] $Address, [string] $Detail, [int] $Number = 0)
    Write-RunEvent -Kind 'refused' -Address $Address -Status 'refused' -Detail $Detail -Number $Number
    exit 3
}

function Exit-Locked {
    param([string] $Owner)
    Write-RunEvent -Kind 'lock' -Address 'host' -Status 'refused' -Detail ('it is held by ' + $Owner)
    exit 3
}

# Lock and journal ---------------------------------------------------------------------------

function Enter-Host {
    # One run at a time on this computer. Windows hands over what a dead process held.
    $owner = Join-Path -Path $script:Folder -ChildPath 'owner.txt'
    $before = 'somebody'
    if (Test-Path -LiteralPath $owner) { $before = [System.IO.File]::ReadAllText($owner) }
    $held = $false
    try {
        $script:Mutex = [System.Threading.Mutex]::new($false, 'Global\rarms')
    } catch [System.UnauthorizedAccessException] {
        # Made by an account that lets nobody else open it, so it is alive.
        Exit-Locked -Owner $before
    }
    try {
        $held = $script:Mutex.WaitOne(1000 * $LockTimeout)
    } catch [System.Threading.AbandonedMutexException] {
        $held = $true
        Write-RunEvent -Kind 'lock' -Address 'host' -Status 'taken over' -Detail ('it was held by ' + $before)
    }
    if (-not $held) {
        $script:Mutex.Dispose()
        $script:Mutex = $null
        Exit-Locked -Owner $before
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

function Get-Sha256 {
    param([byte[]] $Data)
    $hash = [System.Security.Cryptography.SHA256]::Create()
    ([System.BitConverter]::ToString($hash.ComputeHash($Data)) -replace '-', '').ToLowerInvariant()
}

function Get-RecordData {
    # A record as the bytes of its line: its JSON, sealed by length and checksum.
    param([System.Collections.IDictionary] $Record)
    $text = ConvertTo-AsciiJson -Value $Record
    $digest = Get-Sha256 -Data ([System.Text.Encoding]::ASCII.GetBytes($text))
    $open = $text.Substring(0, $text.Length - 1)
    $line = '{0},"length":{1},"checksum":"{2}"}}{3}' -f $open, $text.Length, $digest, [char] 10
    [System.Text.Encoding]::ASCII.GetBytes($line)
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
    # On the disk when this returns. What follows the last whole record is cut off first.
    param([System.Collections.IDictionary] $Record)
    [byte[]] $data = Get-RecordData -Record $Record
    $mode = [System.IO.FileMode]::OpenOrCreate
    $stream = [System.IO.FileStream]::new($script:Journal, $mode, [System.IO.FileAccess]::Write)
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
    param([System.Collections.IDictionary] $Serial)
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
        serials = $Serial; touched = @($script:Touched.Keys | Sort-Object); kind = 'run_started'
    }
    $fresh = $script:Journal + '.new'
    $script:Sound = [long] 0
    $kept = $script:Journal
    $script:Journal = $fresh
    Add-Record -Record $record
    $script:Journal = $kept
    Protect-Path -Path $fresh -Descriptor 'O:BAG:SYD:P(A;;FA;;;BA)(A;;FA;;;SY)'
    if (Test-Path -LiteralPath $kept) { [System.IO.File]::Replace($fresh, $kept, $kept + '.old') }
    else { [System.IO.File]::Move($fresh, $kept) }
}

function Open-Run {
    # Lock, guards, journal. A run of this plan that was killed goes on; one that ended is only looked at.
    param([System.Collections.IDictionary] $Definition)
    $script:Definition = $Definition
    Enter-Host
    if (-not $Abandon) { if ($Definition.Guest) { Assert-Guest } else { Assert-Host } }
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
    if ($Abandon) { Exit-Abandoned -Open $open -Last $last }
    $same = $null -ne $last -and $last.plan -ceq $Definition.Plan -and $last.run -ceq $Definition.Run
    if ($same -and ($open -or $script:Ended)) { return }
    $script:Begun = @{}
    $script:Done = @{}
    $script:Ended = $false
    # What an earlier plan touched is not this one's to take back.
    if ($Definition.Run -ceq 'apply') { $script:Touched = @{} }
    $undone = $null -ne $last -and $last.plan -ceq $Definition.Plan -and $last.run -ceq 'apply'
    if ($Definition.Run -ceq 'undo') {
        if (-not $undone) { Exit-Refused -Address 'host' -Detail 'the last run here was not the one this undoes' }
    } elseif ($open) {
        Exit-Refused -Address 'host' -Detail ('plan {0} is unfinished here: finish or undo it' -f $last.plan)
    } elseif (-not $Definition.Guest -and [long] $serials[$Definition.Application] -ne $Definition.Serial) {
        Exit-Refused -Address 'host' -Detail 'this plan was used, or another was applied since it was made'
    }
    $serials[$Definition.Application] = [long] $serials[$Definition.Application] + 1
    if (-not $WhatIfPreference) { Write-FirstRecord -Serial $serials }
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

# Guards -------------------------------------------------------------------------------------

function Assert-Guest {
    # Which guest it is, is told by the person who starts the script there; it must not be the host by mistake.
    if ([Environment]::MachineName -eq $script:Definition.Computer) {
        Exit-Refused -Address 'host' -Detail 'this script is for a guest, and this is its host'
    }
}

function Assert-Host {
    # Is it this host, may we, and does a reserve have any effect here?
    $vmHost = Hyper-V\Get-VMHost
    if ($vmHost.Name -ne $script:Definition.Computer) {
        Exit-Refused -Address 'host' -Detail ('this is {0}, the plan is for {1}' -f $vmHost.Name, $script:Definition.Computer)
    }
    if ($vmHost.LogicalProcessorCount -ne $script:Definition.LogicalProcessors) {
        Exit-Refused -Address 'host' -Detail ('it has {0} logical processors now' -f $vmHost.LogicalProcessorCount)
    }
    if ($script:Definition.AcceptScheduler) { return }
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
        $mark = Get-Mark -Vm $vm
        $ours = $null -ne $mark -and $mark.Application -ceq $script:Definition.Application
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

# Machines -----------------------------------------------------------------------------------

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
    # Our line in a machine's notes; one that names another machine's id was copied and is none.
    param($Vm)
    $id = ([string] $Vm.Id).ToLowerInvariant()
    $form = '(?m)^rarms/1 (?<app>[a-z0-9-]+)/(?<name>[a-z0-9-]+(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12})\r?$'
    if ([string] $Vm.Notes -cmatch $form -and $Matches['vm'] -ceq $id.Substring(0, 8)) {
        @{ Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set'] }
    }
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
        $ours = $null -ne $mark -and $mark.Name -ceq $Name -and $mark.Application -ceq $script:Definition.Application
        if ($ours -or (Test-Same -Left $vm.Name -Right $pending)) { $vm }
    }
}

function Get-Machine {
    # The one machine that a step changes.
    param([string] $Name, [string] $Machine = '')
    $found = @(Find-Machine -Name $Name -Machine $Machine)
    if ($found.Count -ne 1) { throw ('{0} machines answer to {1}' -f $found.Count, $Name) }
    $found[0]
}

function Test-Stranger {
    # Whether a machine of this name is somebody else's: it carries no mark of our application.
    param([string] $Name)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if (-not (Test-Same -Left $vm.Name -Right $Name)) { continue }
        $mark = Get-Mark -Vm $vm
        if ($null -eq $mark -or $mark.Application -cne $script:Definition.Application) { return $true }
    }
    $false
}

function Read-Partition {
    param([string] $Name, [string] $Machine = '')
    $found = @(Find-Machine -Name $Name -Machine $Machine)
    $taken = Test-Stranger -Name $Name
    if (-not $found.Count) { return @{ exists = $false; taken = $taken } }
    if ($found.Count -gt 1) { return @{ exists = $true; machines = $found.Count } }
    $vm = $found[0]
    $cpu = Hyper-V\Get-VMProcessor -VM $vm
    $memory = Hyper-V\Get-VMMemory -VM $vm
    $mark = Get-Mark -Vm $vm
    $state = ConvertTo-RunState -State $vm.State
    $owner = ''
    $set = ''
    if ($null -ne $mark) {
        $owner = '{0}/{1}' -f $mark.Application, $mark.Name
        $set = $mark.Set
    }
    @{
        exists = $true; machine = ([string] $vm.Id).ToLowerInvariant(); name = [string] $vm.Name
        generation = [long] $vm.Generation; processors = [long] $cpu.Count
        reserve = [long] $cpu.Reserve; limit = [long] $cpu.Maximum; weight = [long] $cpu.RelativeWeight
        memory = [long] $memory.Startup; dynamic_memory = [bool] $memory.DynamicMemoryEnabled
        start_action = ConvertTo-Word -Value $vm.AutomaticStartAction
        stop_action = ConvertTo-Word -Value $vm.AutomaticStopAction
        checkpoints = ConvertTo-Word -Value $vm.CheckpointType
        running = $state -ceq 'running'; state = $state; mark = $owner; set = $set; taken = $taken
        adapters = @(Hyper-V\Get-VMNetworkAdapter -VM $vm).Count
        disks = @(Hyper-V\Get-VMHardDiskDrive -VM $vm).Count
        snapshots = @(Hyper-V\Get-VMSnapshot -VM $vm).Count
    }
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

function Get-DiskPath {
    # Where a new disk goes: the plan's folder, or the host's own.
    param([string] $Folder, [string] $File)
    if (-not $Folder) { $Folder = (Hyper-V\Get-VMHost).VirtualHardDiskPath }
    # Not Join-Path, which wants the drive to be there while the steps are still compared.
    '{0}\{1}' -f ($Folder -creplace '\\$', ''), $File
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
    param($Vm)
    $form = '(?m)^rarms/1 [a-z0-9-]+/[a-z0-9-]+(?:\.moving)? vm=[0-9a-f]{8} set=[0-9a-f]{12}\r?(?:\n|\z)'
    [string] $Vm.Notes -creplace $form, ''
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

# Task classes -------------------------------------------------------------------------------

function Read-TaskClass {
    # Values with their types, and our record: whose it is and what was last written.
    param([string] $Task)
    $live = @{ exists = $false; values = ''; record = ''; set = '' }
    $path = '{0}\{1}' -f $script:TaskRoot, $Task
    if (Test-Path -LiteralPath $path) {
        $key = Get-Item -LiteralPath $path
        [string[]] $names = @($key.GetValueNames())
        [Array]::Sort($names, [System.StringComparer]::Ordinal)
        $live['values'] = $names -join ', '
        foreach ($name in $names) {
            $live['value:' + $name] = Get-ValueText -Key $key -Name $name
            $live['exists'] = $true
        }
    }
    Add-RecordReading -Live $live -Task $Task
    $live
}

function Get-ValueText {
    # A registry value with its type, as plans write it: dword:20.
    param($Key, [string] $Name)
    $kind = ([string] $Key.GetValueKind($Name)).ToLowerInvariant()
    $data = $Key.GetValue($Name)
    if ($kind -ceq 'dword') { $data = [long] $data -band 4294967295 }
    '{0}:{1}' -f ($kind -creplace '^string$', 'sz'), $data
}

function Add-RecordReading {
    # Whose record of this name counts, and what was last written.
    param([System.Collections.IDictionary] $Live, [string] $Task)
    if (Test-Path -LiteralPath $script:RecordRoot) {
        foreach ($application in @(Get-ChildItem -LiteralPath $script:RecordRoot)) {
            $path = '{0}\{1}\{2}' -f $script:RecordRoot, $application.PSChildName, $Task
            if (-not (Test-Path -LiteralPath $path)) { continue }
            $set = [string] (Get-Item -LiteralPath $path).GetValue('set')
            if ($set) {
                $Live['record'] = [string] $application.PSChildName
                $Live['set'] = $set
            }
        }
    }
}

function Add-Key {
    # Never with -Force, which would empty a key that is there.
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { [void] (New-Item -Path $Path) }
}

function Write-TaskValue {
    param([string] $Task, [string] $Name, [string] $Type, $Value)
    $path = '{0}\{1}' -f $script:TaskRoot, $Task
    Add-Key -Path $path
    [void] (New-ItemProperty -LiteralPath $path -Name $Name -PropertyType $Type -Value $Value -Force)
}

function Clear-TaskValue {
    param([string] $Task, [string] $Name)
    $path = '{0}\{1}' -f $script:TaskRoot, $Task
    $key = Get-Item -LiteralPath $path
    if (@($key.GetValueNames()) -ccontains $Name) { Remove-ItemProperty -LiteralPath $path -Name $Name }
}

function Clear-TaskClass {
    param([string] $Task)
    $path = '{0}\{1}' -f $script:TaskRoot, $Task
    if (Test-Path -LiteralPath $path) { Remove-Item -LiteralPath $path }
}

function Write-TaskRecord {
    # What was there before comes first, the digest last: without it the record does not count.
    param([string] $Task, [string] $Application, [string] $Digest, [string] $Before)
    $path = '{0}\{1}' -f $script:RecordRoot, $Application
    Add-Key -Path $script:RecordRoot
    Add-Key -Path $path
    $path = '{0}\{1}' -f $path, $Task
    Add-Key -Path $path
    [void] (New-ItemProperty -LiteralPath $path -Name 'before' -PropertyType String -Value $Before -Force)
    [void] (New-ItemProperty -LiteralPath $path -Name 'set' -PropertyType String -Value $Digest -Force)
}

function Clear-TaskRecord {
    param([string] $Task, [string] $Application)
    $path = '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
    if (Test-Path -LiteralPath $path) { Remove-Item -LiteralPath $path }
}

# SystemResponsiveness of the host: one value beside the task classes, its record among theirs -----

function Read-Responsiveness {
    # As Read-TaskClass, of the one value.
    $live = @{ exists = $false; values = ''; record = ''; set = '' }
    if (Test-Path -LiteralPath $script:ProfileRoot) {
        $key = Get-Item -LiteralPath $script:ProfileRoot
        if ($null -ne $key.GetValue('SystemResponsiveness')) {
            $live['exists'] = $true
            $live['values'] = 'SystemResponsiveness'
            $live['value:SystemResponsiveness'] = Get-ValueText -Key $key -Name 'SystemResponsiveness'
        }
    }
    Add-RecordReading -Live $live -Task 'SystemResponsiveness'
    $live
}

function Write-Responsiveness {
    param([string] $Type, $Value)
    Add-Key -Path $script:ProfileRoot
    $name = 'SystemResponsiveness'
    [void] (New-ItemProperty -LiteralPath $script:ProfileRoot -Name $name -PropertyType $Type -Value $Value -Force)
}

function Clear-Responsiveness {
    $key = Get-Item -LiteralPath $script:ProfileRoot
    if ($null -eq $key.GetValue('SystemResponsiveness')) { return }
    Remove-ItemProperty -LiteralPath $script:ProfileRoot -Name 'SystemResponsiveness'
}

# Task classes of a guest that nobody could look into: its own record decides -------------------

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
        $path = '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
        $before = [string] (Get-Item -LiteralPath $path).GetValue('before')
    } elseif ($live['exists']) {
        $values = [ordered] @{}
        foreach ($name in @($live['values'] -split ', ')) {
            $kind, $data = $live['value:' + $name] -split ':', 2
            if ($kind -ceq 'dword') { $data = [long] $data }
            $values[$name] = [ordered] @{ kind = $kind; data = $data }
        }
        $before = ConvertTo-AsciiJson -Value $values
    }
    Write-TaskRecord -Task $Task -Application $Application -Digest $Digest -Before $before
}

function Clear-OtherTaskValue {
    # Takes away every value but these, whose names are joined as readings join them.
    param([string] $Task, [string] $Keep)
    $path = '{0}\{1}' -f $script:TaskRoot, $Task
    foreach ($name in @((Get-Item -LiteralPath $path).GetValueNames())) {
        if (@($Keep -split ', ') -cnotcontains $name) { Remove-ItemProperty -LiteralPath $path -Name $name }
    }
}

function Restore-TaskClass {
    # Brings back what the record says was there before rarms: no class, or exactly these values.
    param([string] $Task, [string] $Application)
    $path = '{0}\{1}\{2}' -f $script:RecordRoot, $Application, $Task
    $before = ConvertFrom-Json -InputObject ([string] (Get-Item -LiteralPath $path).GetValue('before'))
    if ($null -eq $before) {
        Clear-TaskClass -Task $Task
        return
    }
    $names = @()
    foreach ($one in $before.PSObject.Properties) {
        $type = $one.Value.kind -creplace '^sz$', 'string'
        Write-TaskValue -Task $Task -Name $one.Name -Type $type -Value $one.Value.data
        $names += $one.Name
    }
    Clear-OtherTaskValue -Task $Task -Keep ($names -join ', ')
}

# Steps --------------------------------------------------------------------------------------

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

function Add-StepRecord {
    param([int] $Number, [string] $Status)
    if ($WhatIfPreference) { return }
    Add-Record -Record ([ordered] @{ number = $Number; status = $Status; kind = 'step_recorded' })
}

function Invoke-Step {
    # Read, compare, set, read again. As wanted: nothing. Neither as planned before nor as wanted: stop.
    param([System.Collections.IDictionary] $Definition)
    $step = $Definition
    if ($step.Contains('Undoes') -and -not $script:Touched.Contains([string] $step.Undoes)) {
        Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status 'unchanged' -Detail 'was not done'
        return
    }
    $read = $step.Read
    if ($step.Contains('Lost') -and $script:Touched.Contains([string] $step.Lost) -and -not (& $read)['exists']) {
        Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status 'unchanged' -Detail 'went with its machine'
        return
    }
    Add-Expectation -Step $step
    if ($script:Ended -or $script:Done.Contains([string] $step.Number)) {
        Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status 'unchanged' -Detail 'done before'
        return
    }
    if (Test-Path -LiteralPath ($PSCommandPath + '.stop')) {
        # Whoever made that file beside the script wants it to end before the next step.
        Write-RunEvent -Kind 'run' -Address 'host' -Status 'stopped' -Detail 'asked to stop; run it again to go on'
        exit 1
    }
    $begun = $script:Begun.Contains([string] $step.Number)
    $set = $step.Set
    $live = & $read
    if (-not @(Compare-Reading -Live $live -Expected $step.After).Count) {
        $status = if ($begun) { 'changed' } else { 'unchanged' }
        Add-StepRecord -Number $step.Number -Status $status
        Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status $status
        return
    }
    $moved = @(Compare-Reading -Live $live -Expected $step.Before)
    # What an undo takes back may have been killed half-way as well.
    $half = $begun -or $step.Contains('Undoes')
    if ($half -and (Test-HalfDone -Live $live -Step $step)) { $moved = @() }
    $builds = @($step.Needs | Where-Object -FilterScript { $script:Skipped.Contains($_) })
    $inside = @($builds | Where-Object -FilterScript { $_ -cne $step.Address })
    if ($inside.Count -or ($moved.Count -and $builds.Count)) {
        Add-Skip -Step $step -Detail ('needs ' + ($builds -join ', '))
        return
    }
    if ($moved.Count) {
        $detail = 'changed since the plan: ' + ($moved -join ', ')
        Exit-Refused -Address $step.Address -Number $step.Number -Detail $detail
    }
    if ($step.Contains('Claim') -and -not (Test-Capacity -Machine ([string] $live['machine']) -Claim $step.Claim)) {
        if (-not $script:Skipped.Count) { throw ($step.Address + ': the host cannot keep this promise beside the others') }
        Add-Skip -Step $step -Detail 'needs room that skipped steps would have made'
        return
    }
    if (-not $script:Cmdlet.ShouldProcess($step.Address, $step.Action)) {
        Add-Skip -Step $step -Detail ''
        return
    }
    $ConfirmPreference = 'None'
    Add-StepRecord -Number $step.Number -Status 'begun'
    if ($script:Json) { Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status 'begun' -Detail $step.Action }
    [void] (& $set)
    $missed = @(Compare-Reading -Live (& $read) -Expected $step.After)
    if ($missed.Count) { throw ($step.Address + ': set, but the host still shows another value: ' + ($missed -join ', ')) }
    Add-StepRecord -Number $step.Number -Status 'changed'
    Write-RunEvent -Kind 'step' -Address $step.Address -Number $step.Number -Status 'changed' -Detail $step.Action
}

function Add-Skip {
    param([System.Collections.IDictionary] $Step, [string] $Detail)
    $script:Skipped[$Step.Address] = $true
    Write-RunEvent -Kind 'step' -Address $Step.Address -Number $Step.Number -Status 'skipped' -Detail $Detail
}

function Add-Expectation {
    param([System.Collections.IDictionary] $Step)
    $fresh = -not $script:Expected.Contains($Step.Address)
    if ($fresh -or $Step.After['exists'] -ceq $false) { $script:Expected[$Step.Address] = @{} }
    foreach ($name in $Step.After.Keys) { $script:Expected[$Step.Address][$name] = $Step.After[$name] }
    $script:Reader[$Step.Address] = $Step.Read
}

function Complete-Run {
    # Close the journal, then look once more at everything together.
    if ($script:Skipped.Count) { return }
    if (-not $script:Ended -and -not $WhatIfPreference) {
        Add-Record -Record ([ordered] @{ closing = 'done'; kind = 'run_closed' })
    }
    foreach ($address in @($script:Expected.Keys | Sort-Object)) {
        $read = $script:Reader[$address]
        $live = & $read
        $missed = @(Compare-Reading -Live $live -Expected $script:Expected[$address])
        if (-not $missed.Count) { continue }
        $detail = 'is not as wanted: ' + ($missed -join ', ')
        if (-not $script:Ended) { throw ($address + ' ' + $detail) }
        Exit-Refused -Address $address -Detail $detail
    }
    Write-RunEvent -Kind 'run' -Address 'host' -Status 'done'
}

# --- end of the runtime ---------------------------------------------------------------------
try {
    Open-Run -Definition @{
        Run = 'apply'
        Plan = '435e437e3780'
        Application = 'robot'
        Serial = 1
        Total = 4
        Undo = 'onboard.undo.ps1'
        UndoDigest = '6f4b599d75fe016fe784436442a3da166e3791381b9ef3ee92bd42aa193053ab'
        Guest = $false
        Computer = 'ONBOARD'
        LogicalProcessors = 4
        Percent = 360
        Memory = 7516192768
        AcceptScheduler = $false
    }

    # 1/4  reserve 60 -> 20 %
    # why: not as wanted: reserve, limit or weight; what is given back comes before what is taken
    # at:  rarms.yaml:12:3
    Invoke-Step -Definition @{
        Number = 0
        Address = 'partition/vision'
        Action = 'reserve 60 -> 20 %'
        Needs = @('partition/vision')
        Read = { Read-Partition -Name 'vision' -Machine '00000002-5ade-4000-8000-000000000002' }
        Before = @{ 'exists' = $true; 'limit' = 100; 'reserve' = 60; 'weight' = 100 }
        After = @{ 'exists' = $true; 'limit' = 100; 'reserve' = 20; 'weight' = 100 }
        Set = {
            $vm = Get-Machine -Name 'vision' -Machine '00000002-5ade-4000-8000-000000000002'
            Hyper-V\Set-VMProcessor -VM $vm -Reserve 20 -Maximum 100 -RelativeWeight 100
        }
    }

    # 2/4  mark it as robot/vision, set 846e6d0b17bd
    # why: not as wanted: reserve, limit or weight; the mark says what was last written
    # at:  rarms.yaml:12:3
    Invoke-Step -Definition @{
        Number = 1
        Address = 'partition/vision'
        Action = 'mark it as robot/vision, set 846e6d0b17bd'
        Needs = @('partition/vision')
        Read = { Read-Partition -Name 'vision' -Machine '00000002-5ade-4000-8000-000000000002' }
        Before = @{ 'exists' = $true; 'mark' = 'robot/vision'; 'set' = '46c38a6e16e6' }
        After = @{ 'exists' = $true; 'mark' = 'robot/vision'; 'set' = '846e6d0b17bd' }
        Set = {
            Write-Mark -Name 'vision' -Machine '00000002-5ade-4000-8000-000000000002' -Application 'robot' -Partition 'vision' -Digest '846e6d0b17bd'
        }
    }

    # 3/4  reserve 20 -> 60 %
    # why: not as wanted: reserve, limit or weight; after the others gave back
    # at:  rarms.yaml:13:3
    Invoke-Step -Definition @{
        Number = 2
        Address = 'partition/speech'
        Action = 'reserve 20 -> 60 %'
        Needs = @('partition/speech')
        Claim = @{ Processors = 4; Reserve = 60; Memory = 536870912 }
        Read = { Read-Partition -Name 'speech' -Machine '00000001-5ade-4000-8000-000000000001' }
        Before = @{ 'exists' = $true; 'limit' = 100; 'reserve' = 20; 'weight' = 100 }
        After = @{ 'exists' = $true; 'limit' = 100; 'reserve' = 60; 'weight' = 100 }
        Set = {
            $vm = Get-Machine -Name 'speech' -Machine '00000001-5ade-4000-8000-000000000001'
            Hyper-V\Set-VMProcessor -VM $vm -Reserve 60 -Maximum 100 -RelativeWeight 100
        }
    }

    # 4/4  mark it as robot/speech, set 74f4c70798be
    # why: not as wanted: reserve, limit or weight; the mark says what was last written
    # at:  rarms.yaml:13:3
    Invoke-Step -Definition @{
        Number = 3
        Address = 'partition/speech'
        Action = 'mark it as robot/speech, set 74f4c70798be'
        Needs = @('partition/speech')
        Read = { Read-Partition -Name 'speech' -Machine '00000001-5ade-4000-8000-000000000001' }
        Before = @{ 'exists' = $true; 'mark' = 'robot/speech'; 'set' = 'ebd07b94427f' }
        After = @{ 'exists' = $true; 'mark' = 'robot/speech'; 'set' = '74f4c70798be' }
        Set = {
            Write-Mark -Name 'speech' -Machine '00000001-5ade-4000-8000-000000000001' -Application 'robot' -Partition 'speech' -Digest '74f4c70798be'
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
