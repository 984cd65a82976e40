# --- part making: the same bytes in every script that carries it -------------------------------
# The machine that this plan makes: it carries our mark, or before that the plan's pending name.

$script:Machines = [hashtable]::new($script:Ordinal)  # by partition: the id of its machine

function Get-NewPartitionReading {
    param([string] $Name)
    $live = Get-Known
    if (-not $live.Count) {
        $id = $script:Machines[$Name]
        $found = @(if ($id) { Find-Machine -Machine $id } else { Find-NewMachine -Name $Name })
        Add-MachineReading -Live $live -Found $found
        if ($live['exists']) { $script:Machines[$Name] = $live['machine'] }
    }
    Add-ProcessorReading -Live $live
    if (Test-Unread -Live $live -Name 'taken') { $live['taken'] = Test-Stranger -Name $Name }
    $script:Vm = $live['vm']
    Add-DeviceReading -Live $live
}

function Find-NewMachine {
    param([string] $Name)
    $pending = Get-PendingName -Name $Name
    foreach ($vm in @(Get-MachineList)) {
        $mark = Get-Mark -Vm $vm
        $ours = $mark.Name -ceq $Name -and $mark.Application -ceq $script:Plan.Application
        # -ceq takes no notice of characters without width, such as a soft hyphen.
        if ($ours -or [string]::Equals($vm.Name, $pending, [System.StringComparison]::Ordinal)) { $vm }
    }
}

function Get-PendingName {
    # What a partition is called while this plan makes it; a dot cannot occur in a manifest's name.
    param([string] $Name)
    '{0}.rarms-{1}' -f $Name, $script:Plan.Plan
}

function Test-Stranger {
    # Whether a machine of this name is foreign: it carries no mark of our application.
    param([string] $Name)
    foreach ($vm in @(Get-MachineList)) {
        if (-not [string]::Equals($vm.Name, $Name, [System.StringComparison]::Ordinal)) { continue }
        if ((Get-Mark -Vm $vm).Application -cne $script:Plan.Application) { return $true }
    }
    $false
}

function Add-PartitionDisk {
    # A run may have been killed right behind it.
    param([string] $Path)
    if (@(Hyper-V\Get-VMHardDiskDrive -VM $script:Vm).Count) { return }
    Hyper-V\Add-VMHardDiskDrive -VM $script:Vm -Path $Path
}

function Move-NewPartition {
    # Hyper-V made a folder of the pending name, and a new name would leave it so. What is there already is not moved again.
    param([string] $Folder, [string] $Name)
    $path = Get-PartitionFolder -Folder $Folder -Name $Name
    if ([string] $script:Vm.Path -ne $path) {
        Hyper-V\Move-VMStorage -VM $script:Vm -VirtualMachinePath $path -SnapshotFilePath $path -SmartPagingFilePath $path
    }
    Remove-EmptyFolder -Path (Get-PartitionFolder -Folder $Folder -Name (Get-PendingName -Name $Name))
}

function Get-PartitionFolder {
    param([string] $Folder, [string] $Name)
    '{0}\{1}' -f ($Folder -creplace '\\$', ''), $Name
}

function Get-FolderReading {
    # How many folders are left empty where this plan made a machine: of its pending name, and of its final one.
    param([string] $Folder, [string] $Name)
    $count = 0
    foreach ($one in @((Get-PendingName -Name $Name), $Name)) {
        if (Test-EmptyFolder -Path (Get-PartitionFolder -Folder $Folder -Name $one)) { $count += 1 }
    }
    @{ folders = $count }
}

function Remove-PartitionFolder {
    param([string] $Folder, [string] $Name)
    foreach ($one in @((Get-PendingName -Name $Name), $Name)) {
        Remove-EmptyFolder -Path (Get-PartitionFolder -Folder $Folder -Name $one)
    }
}

function Remove-EmptyFolder {
    # Never with what lies in it.
    param([string] $Path)
    if (Test-EmptyFolder -Path $Path) { [System.IO.Directory]::Delete($Path) }
}

function Test-EmptyFolder {
    param([string] $Path)
    if (-not (Test-Path -LiteralPath $Path)) { return $false }
    $link = [System.IO.File]::GetAttributes($Path) -band [System.IO.FileAttributes]::ReparsePoint
    -not $link -and -not @(Get-ChildItem -LiteralPath $Path -Force).Count
}

function Remove-NetworkAdapter {
    # Hyper-V gives one to every new machine.
    if (@(Hyper-V\Get-VMNetworkAdapter -VM $script:Vm).Count) { Hyper-V\Remove-VMNetworkAdapter -VM $script:Vm }
}
# --- end of the part making --------------------------------------------------------------------
