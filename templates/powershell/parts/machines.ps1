# --- part machines: the same bytes in every script that carries it -----------------------------
# How virtual machines are found, read and marked: never by their names alone.

$name = '[a-z0-9](?:[a-z0-9-]{0,61}[a-z0-9])?'
$form = '^rarms/1 (?<app>NAME)/(?<name>NAME(?:\.moving)?) vm=(?<vm>[0-9a-f]{8}) set=(?<set>[0-9a-f]{12}(?: stopped| measuring)?)\r*$'
$script:MarkForm = $form.Replace('NAME', $name)
$script:Machines = [hashtable]::new($script:Ordinal)  # by partition: the id of the machine that answered to it

function Read-Partition {
    # What the host shows of the wanted names: one call for the machine, and one for each kind of its settings.
    param([string] $Name, [string] $Machine = '')
    $live = Get-Known
    if (-not $live.Contains('exists')) { Read-Machine -Live $live -Name $Name -Machine $Machine }
    if (Test-Unread -Live $live -Name 'taken') { $live['taken'] = Test-Stranger -Name $Name }
    $vm = $live['vm']
    $script:Vm = $vm
    if (-not $live['exists']) { return $live }
    if (Test-Unread -Live $live -Name 'processors', 'reserve', 'limit', 'weight') {
        $cpu = Hyper-V\Get-VMProcessor -VM $vm
        $live['processors'] = [long] $cpu.Count
        $live['reserve'] = [long] $cpu.Reserve
        $live['limit'] = [long] $cpu.Maximum
        $live['weight'] = [long] $cpu.RelativeWeight
    }
    if (Test-Unread -Live $live -Name 'memory', 'dynamic_memory') {
        $memory = Hyper-V\Get-VMMemory -VM $vm
        $live['memory'] = [long] $memory.Startup
        $live['dynamic_memory'] = [bool] $memory.DynamicMemoryEnabled
    }
    if (Test-Unread -Live $live -Name 'secure_boot', 'boots_from') {
        $firmware = Hyper-V\Get-VMFirmware -VM $vm
        $off = [string] $firmware.SecureBoot -ceq 'Off'
        $live['secure_boot'] = if ($off) { 'off' } else { [string] $firmware.SecureBootTemplate }
        $live['boots_from'] = ''
        foreach ($one in @($firmware.BootOrder)) {
            if (-not $live['boots_from']) { $live['boots_from'] = ConvertTo-Word -Value $one.BootType }
        }
    }
    if (Test-Unread -Live $live -Name 'adapters') { $live['adapters'] = @(Hyper-V\Get-VMNetworkAdapter -VM $vm).Count }
    if (Test-Unread -Live $live -Name 'disks') { $live['disks'] = @(Hyper-V\Get-VMHardDiskDrive -VM $vm).Count }
    if (Test-Unread -Live $live -Name 'snapshots') { $live['snapshots'] = @(Hyper-V\Get-VMSnapshot -VM $vm).Count }
    $live
}

function Read-Machine {
    # Into the reading: whether there is the machine, and what it says of itself.
    param([System.Collections.IDictionary] $Live, [string] $Name, [string] $Machine)
    $found = @(Find-Machine -Name $Name -Machine $Machine)
    if ($found.Count -gt 1) { Exit-Refused -Step $script:Current -Detail ('{0} machines answer to it' -f $found.Count) }
    $Live['exists'] = $found.Count -eq 1
    $Live['vm'] = $null
    if (-not $found.Count) { return }
    $vm = $found[0]
    $mark = Get-Mark -Vm $vm
    $state = ConvertTo-RunState -State $vm.State
    $script:Machines[$Name] = ([string] $vm.Id).ToLowerInvariant()
    $Live['vm'] = $vm
    $Live['machine'] = $script:Machines[$Name]
    $Live['name'] = [string] $vm.Name
    $Live['generation'] = [long] $vm.Generation
    $Live['start_action'] = ConvertTo-Word -Value $vm.AutomaticStartAction
    $Live['stop_action'] = ConvertTo-Word -Value $vm.AutomaticStopAction
    $Live['checkpoints'] = ConvertTo-Word -Value $vm.CheckpointType
    $Live['state'] = $state
    $Live['running'] = $state -ceq 'running'
    $Live['mark'] = if ($mark.Name) { '{0}/{1}' -f $mark.Application, $mark.Name } else { '' }
    $Live['set'] = $mark.Set
}

function Find-Machine {
    # By id where it is known; otherwise what carries our mark, or the pending name of this plan. Never by name.
    param([string] $Name, [string] $Machine)
    if (-not $Machine) { $Machine = [string] $script:Machines[$Name] }
    if ($Machine -and -not $script:Looking) {
        try { return Hyper-V\Get-VM -Id $Machine } catch { Write-Verbose -Message $_.Exception.Message }
    }
    $pending = Get-PendingName -Name $Name
    foreach ($vm in @(Get-MachineList)) {
        if ($Machine) {
            if (([string] $vm.Id).ToLowerInvariant() -ceq $Machine) { $vm }
            continue
        }
        $mark = Get-Mark -Vm $vm
        $ours = $mark.Name -ceq $Name -and $mark.Application -ceq $script:Plan.Application
        # -ceq takes no notice of characters without width, such as a soft hyphen.
        if ($ours -or [string]::Equals($vm.Name, $pending, [System.StringComparison]::Ordinal)) { $vm }
    }
}

function Get-MachineList {
    # All machines of the host, listed once for all that is read until something changes.
    if (-not $script:Known.Contains('machines')) { $script:Known['machines'] = @(Hyper-V\Get-VM) }
    $script:Known['machines']
}

function Get-PendingName {
    # What a partition is called while this plan makes it; a dot cannot occur in a manifest's name.
    param([string] $Name)
    '{0}.rarms-{1}' -f $Name, $script:Plan.Plan
}

function Test-Stranger {
    # Whether a machine of this name is somebody else's: it carries no mark of our application.
    param([string] $Name)
    foreach ($vm in @(Get-MachineList)) {
        if (-not [string]::Equals($vm.Name, $Name, [System.StringComparison]::Ordinal)) { continue }
        if ((Get-Mark -Vm $vm).Application -cne $script:Plan.Application) { return $true }
    }
    $false
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
    # The mark that the step wants, or none, above the user's lines of the notes: the only text built around what a host
    # says.
    $wanted = $script:Current.After
    $lines = @([string] $script:Vm.Notes -split '\n')
    $notes = @(foreach ($line in $lines) { if (-not ($line -cmatch $script:MarkForm)) { $line } }) -join [string] [char] 10
    if ($wanted['mark']) {
        $id = ([string] $script:Vm.Id).ToLowerInvariant().Substring(0, 8)
        $line = 'rarms/1 {0} vm={1} set={2}' -f $wanted['mark'], $id, $wanted['set']
        $notes = if ($notes) { $line + [char] 13 + [char] 10 + $notes } else { $line }
    }
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
