# --- part disks: the same bytes in every script that carries it --------------------------------
# How virtual disks are read and removed.

function Get-DiskReading {
    # Whether it is there and grows out of this image; with -Everywhere also whether any machine has it.
    param([string] $Path, [string] $Parent, [switch] $Everywhere)
    if (-not (Test-Path -LiteralPath $Path)) { return @{ exists = $false } }
    $disk = Hyper-V\Get-VHD -Path $Path
    $child = [string] $disk.VhdType -ceq 'Differencing' -and (Test-SamePath -Left $disk.ParentPath -Right $Parent)
    $live = @{ exists = $true; child = $child }
    if ($Everywhere) { $live['used'] = Test-DiskUse -Path $Path }
    $live
}

function Get-MadePartitionReading {
    # As Get-NewPartitionReading, and what the machine was given since: an undo must not take it away with that.
    param([string] $Name, [string] $Disk = '')
    $live = Get-NewPartitionReading -Name $Name
    if (-not $live['exists'] -or -not (Test-Unread -Live $live -Name 'added')) { return $live }
    $added = @(foreach ($drive in @(Hyper-V\Get-VMHardDiskDrive -VM $script:Vm)) {
        if (-not (Test-SamePath -Left $drive.Path -Right $Disk)) { 'disk ' + $drive.Path }
    })
    if (@($Name, (Get-PendingName -Name $Name)) -cnotcontains $live['name']) { $added += 'name ' + $live['name'] }
    if (@(Hyper-V\Get-VMSnapshot -VM $script:Vm).Count) { $added += 'a checkpoint' }
    $live['added'] = $added -join ', '
    $live
}

function Test-DiskUse {
    # Whether a machine or one of its checkpoints has this disk, or one that grows out of it.
    param([string] $Path)
    $all = @(Get-MachineList)
    if (-not $all.Count) { return $false }
    $drives = @(Hyper-V\Get-VMHardDiskDrive -VM $all)
    foreach ($one in @(Hyper-V\Get-VMSnapshot -VM $all)) { $drives += @(Hyper-V\Get-VMHardDiskDrive -VMSnapshot $one) }
    foreach ($drive in $drives) {
        $at = [string] $drive.Path
        while ($at) {
            if (Test-SamePath -Left $at -Right $Path) { return $true }
            $at = if (Test-Path -LiteralPath $at) { [string] (Hyper-V\Get-VHD -Path $at).ParentPath } else { '' }
        }
    }
    $false
}

function Test-SamePath {
    # Windows tells paths apart neither by case nor by the direction of a slash.
    param([string] $Left, [string] $Right)
    $Left.Replace('/', '\') -eq $Right.Replace('/', '\')
}

function Get-DiskPath {
    # Where this plan puts a new disk of a partition: in its folder, or in the host's own.
    param([string] $Folder, [string] $Name, [string] $Type)
    if (-not $Folder) { $Folder = (Hyper-V\Get-VMHost).VirtualHardDiskPath }
    # Not Join-Path, which wants the drive to be there while the steps are still compared.
    '{0}\{1}-{2}.{3}' -f ($Folder -creplace '\\$', ''), $Name, $script:Plan.Plan, $Type
}

function Remove-DiskFile {
    param([string] $Path)
    Remove-Item -LiteralPath $Path
}
# --- end of the part disks ---------------------------------------------------------------------
