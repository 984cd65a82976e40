# --- part machines: the same bytes in every script that carries it -----------------------------
# How virtual machines are found, read and marked: never by their names alone.

$name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
$form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12}(?: stopped| measuring)?)\r*$'
$script:MarkForm = $form.Replace('NAME', $name)

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

function Get-Machine {
    # The one machine that a step changes.
    param([string] $Name, [string] $Machine = '')
    $found = @(Find-Machine -Name $Name -Machine $Machine)
    if ($found.Count -ne 1) {
        $detail = '{0} machines answer to {1}' -f $found.Count, $Name
        Exit-Refused -Step @{ Address = 'partition/' + $Name; Number = 0 } -Detail $detail
    }
    $found[0]
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
        if ($ours -or (Test-SameName -Left $vm.Name -Right $pending)) { $vm }
    }
}

function Test-Stranger {
    # Whether a machine of this name is somebody else's: it carries no mark of our application.
    param([string] $Name)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        if (-not (Test-SameName -Left $vm.Name -Right $Name)) { continue }
        if ((Get-Mark -Vm $vm).Application -cne $script:Definition.Application) { return $true }
    }
    $false
}

function Test-SameName {
    # -ceq takes no notice of characters without width, such as a soft hyphen.
    param([string] $Left, [string] $Right)
    [string]::Equals($Left, $Right, [System.StringComparison]::Ordinal)
}

function Get-Mark {
    # Our line in a machine's notes. One that names another machine's id was copied and is none; so are two of them.
    param($Vm)
    $found = @()
    foreach ($line in @([string] $Vm.Notes -split '\n')) {
        if (-not ($line -cmatch $script:MarkForm)) { continue }
        $found += @{
            Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set']; Machine = $Matches['vm']
        }
    }
    $id = ([string] $Vm.Id).ToLowerInvariant().Substring(0, 8)
    if ($found.Count -eq 1 -and $id -ceq $found[0]['Machine']) { return $found[0] }
    @{ Application = ''; Name = ''; Set = '' }
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
# --- end of the part machines ------------------------------------------------------------------
