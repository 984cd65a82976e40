# --- part machines: the same bytes in every script that carries it -----------------------------
# How virtual machines are found, read and marked: never by their names.

$script:Vm = $null              # the one that was read last
$script:Shielded = [hashtable]::new($script:Ordinal)  # by id of a machine
$name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
$form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12}(?: stopped| measuring)?(?: robot=NAME)?(?: protected)?)\r*$'
$script:MarkForm = $form.Replace('NAME', $name)

function Get-PartitionReading {
    # What the host shows of the machine with this id.
    param([string] $Machine, [switch] $Clustered)
    Get-MachineReading -Machine $Machine -Clustered $Clustered
}

function Get-MachineReading {
    # As Get-PartitionReading, for its other callers.
    param([string] $Machine, [bool] $Clustered)
    $live = Get-Known
    if (-not $live.Count) {
        $found = @(Find-Machine -Machine $Machine)
        # Of what was done nothing is to be changed.
        if ($script:Current.Contains('Set')) { foreach ($vm in $found) { Assert-Untied -Vm $vm -Clustered $Clustered } }
        Add-MachineReading -Live $live -Found $found
    }
    Add-ProcessorReading -Live $live
    $script:Vm = $live['vm']
    $live
}

function Get-Known {
    # What was read already at the address of the current step: nothing is read twice until a step changes something.
    $at = $script:Current.Address
    if (-not $script:Known.Contains($at)) { $script:Known[$at] = [hashtable]::new($script:Ordinal) }
    $script:Known[$at]
}

function Find-Machine {
    # Where everything is looked at, all machines are listed once.
    param([string] $Machine)
    if (-not $script:Looking) {
        try { return Hyper-V\Get-VM -Id $Machine } catch { Write-Verbose -Message $_.Exception.Message }
    }
    foreach ($vm in @(Get-MachineList)) { if ([string] $vm.Id -eq $Machine) { $vm } }
}

function Get-MachineList {
    # All machines of the host, listed once for all that is read until something changes.
    if (-not $script:Known.Contains('machines')) { $script:Known['machines'] = @(Hyper-V\Get-VM) }
    $script:Known['machines']
}

function Add-MachineReading {
    # Into the reading: whether there is the machine, and what it says of itself.
    param([System.Collections.IDictionary] $Live, $Found)
    if ($Found.Count -gt 1) { Stop-Run -Detail ('{0} machines answer to it' -f $Found.Count) }
    $Live['exists'] = $Found.Count -eq 1
    $Live['vm'] = $null
    if (-not $Found.Count) { return }
    $vm = $Found[0]
    $mark = Get-Mark -Vm $vm
    $Live['vm'] = $vm
    $Live['machine'] = ([string] $vm.Id).ToLowerInvariant()
    $Live['name'] = [string] $vm.Name
    $Live['generation'] = [long] $vm.Generation
    $Live['processors'] = [long] $vm.ProcessorCount
    $Live['memory'] = [long] $vm.MemoryStartup
    $Live['dynamic_memory'] = [bool] $vm.DynamicMemoryEnabled
    $Live['start_action'] = ConvertTo-Word -Value $vm.AutomaticStartAction
    $Live['stop_action'] = ConvertTo-Word -Value $vm.AutomaticStopAction
    $Live['checkpoints'] = ConvertTo-Word -Value $vm.CheckpointType
    $Live['state'] = ConvertTo-RunState -State $vm.State
    $Live['running'] = $Live['state'] -ceq 'running'
    $Live['mark'] = if ($mark.Name) { '{0}/{1}' -f $mark.Application, $mark.Name } else { '' }
    $Live['set'] = $mark.Set
}

function Add-ProcessorReading {
    # Only where one of these is asked for: a machine that is stopped or removed needs none of them.
    param([System.Collections.IDictionary] $Live)
    if (-not $Live['exists'] -or -not (Test-Unread -Live $Live -Name 'reserve', 'limit', 'weight')) { return }
    $cpu = Hyper-V\Get-VMProcessor -VM $Live['vm']
    $Live['reserve'] = [long] $cpu.Reserve
    $Live['limit'] = [long] $cpu.Maximum
    $Live['weight'] = [long] $cpu.RelativeWeight
}

function Test-Unread {
    param([System.Collections.IDictionary] $Live, [string[]] $Name)
    foreach ($one in $Name) { if ($script:Wanted -ccontains $one -and -not $Live.Contains($one)) { return $true } }
    $false
}

function Get-Mark {
    # Our line in a machine's notes. One that names another machine's id was copied and is none; so are two of them.
    param($Vm)
    if (Test-Replica -Vm $Vm) { return @{ Application = ''; Name = ''; Set = '' } }
    $found = @(@([string] $Vm.Notes -split '\n') | Where-Object -FilterScript { $_ -cmatch $script:MarkForm })
    if ($found.Count -eq 1 -and $found[0] -cmatch $script:MarkForm -and $Matches['vm'] -ceq (Get-ShortId -Vm $Vm)) {
        return @{ Application = $Matches['app']; Name = $Matches['name']; Set = $Matches['set'] }
    }
    @{ Application = ''; Name = ''; Set = '' }
}

function Assert-Untied {
    # A replica, a shielded machine and one of a cluster are not the host's alone; a plan may accept the last.
    param($Vm, [bool] $Clustered)
    $tie = Get-Tie -Vm $Vm
    if ($tie -ceq 'of a failover cluster' -and $Clustered) { $tie = '' }
    if (-not $tie -and (Test-Shielded -Vm $Vm)) { $tie = 'shielded' }
    if ($tie) { Stop-Run -Detail ('machine {0} ({1}) is {2}, and not changed here' -f $Vm.Name, $Vm.Id, $tie) }
}

function Get-Tie {
    # What a machine says itself of who else decides over it; nothing of one that is the host's alone.
    param($Vm)
    if (Test-Replica -Vm $Vm) { return 'a replica of one on another host' }
    $clustered = $Vm.PSObject.Properties['IsClustered']
    if ($null -ne $clustered -and $clustered.Value) { return 'of a failover cluster' }
    ''
}

function Test-Replica {
    # A replica has the id and the notes of its primary, so that our mark on it says nothing.
    param($Vm)
    @('Replica', 'TestReplica', 'ExtendedReplica') -ccontains [string] $Vm.ReplicationMode
}

function Test-Shielded {
    # Asked once a run of each machine.
    param($Vm)
    $id = [string] $Vm.Id
    if (-not $script:Shielded.Contains($id)) { $script:Shielded[$id] = [bool] (Hyper-V\Get-VMSecurity -VM $Vm).Shielded }
    $script:Shielded[$id]
}

function Get-ShortId {
    param($Vm)
    ([string] $Vm.Id).ToLowerInvariant().Substring(0, 8)
}

function Write-Mark {
    # The mark that the step wants, or none, above the user's lines: the only text built around what a host says.
    $wanted = $script:Current.After
    $notes = [string] $script:Vm.Notes -creplace ('(?m)' + $script:MarkForm + '\n?'), ''
    $line = 'rarms/1 {0} vm={1} set={2}' -f $wanted['mark'], (Get-ShortId -Vm $script:Vm), $wanted['set']
    if ($wanted['mark']) { $notes = if ($notes) { $line + [char] 13 + [char] 10 + $notes } else { $line } }
    Hyper-V\Set-VM -VM $script:Vm -Notes $notes
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
