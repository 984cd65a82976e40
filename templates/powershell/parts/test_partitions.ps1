# Test partitions: machines for a measurement, which are removed with their disks at its end.

function Add-TestPartition {
    param(
        [string] $Name, [long] $Processors, [long] $Memory, [long] $Limit, [long] $Weight, [long] $Generation,
        [string] $Image, [string] $Type, [string] $Folder, [string] $SecureBoot
    )
    $script:Tests += @{
        Name = $Name; Processors = $Processors; Memory = $Memory; Limit = $Limit; Weight = $Weight; Image = $Image
        Generation = $Generation; Type = $Type; Folder = $Folder; SecureBoot = $SecureBoot; Machine = ''
    }
}

function Add-TestMachine {
    # Write the mark first and the name last. So Remove-TestPartition finds what a killed run left.
    param([System.Collections.IDictionary] $Test)
    Write-Progressed -Partition $Test.Name -Status 'begun' -Detail 'make it'
    $name = Get-PendingName -Name $Test.Name
    $generation = $Test.Generation
    $bytes = $Test.Memory
    if ($Test.Folder) {
        $vm = Hyper-V\New-VM -Name $name -Generation $generation -MemoryStartupBytes $bytes -NoVHD -Path $Test.Folder
    } else {
        $vm = Hyper-V\New-VM -Name $name -Generation $generation -MemoryStartupBytes $bytes -NoVHD
    }
    $script:Vm = $vm
    Write-Mark
    $folder = if ($Test.Folder) { $Test.Folder } else { (Hyper-V\Get-VMHost).VirtualHardDiskPath }
    $folder = $folder -creplace '\\$', ''
    if ($Test.Folder) { $folder = '{0}\{1}' -f $folder, $Test.Name }
    $disk = '{0}\{1}-{2}.{3}' -f $folder, $Test.Name, $script:Plan.Plan, $Test.Type
    $old = Get-DiskReading -Path $disk -Parent $Test.Image -Everywhere
    if ($old.exists -and (-not $old.child -or $old.used)) {
        Exit-Run -Detail ('{0} is not a disk of a measurement: move it' -f $disk)
    }
    if ($old.exists) { Remove-Item -LiteralPath $disk }
    Add-Folder -Path $folder
    [void] (Hyper-V\New-VHD -Path $disk -ParentPath $Test.Image -Differencing)
    Hyper-V\Add-VMHardDiskDrive -VM $vm -Path $disk
    Hyper-V\Set-VMMemory -VM $vm -DynamicMemoryEnabled $false -StartupBytes $Test.Memory
    Hyper-V\Remove-VMNetworkAdapter -VM $vm  # Hyper-V adds one to every new machine
    Hyper-V\Set-VMProcessor -VM $vm -Count $Test.Processors -Reserve 0
    Hyper-V\Set-VMProcessor -VM $vm -Maximum $Test.Limit -RelativeWeight $Test.Weight
    Hyper-V\Set-VM -VM $vm -AutomaticStartAction 'Nothing' -AutomaticStopAction 'TurnOff' -CheckpointType 'Disabled'
    if ($Test.Generation -eq 2) {
        if ($Test.SecureBoot -ceq 'off') { Hyper-V\Set-VMFirmware -VM $vm -EnableSecureBoot 'Off' }
        elseif ($Test.SecureBoot) {
            Hyper-V\Set-VMFirmware -VM $vm -EnableSecureBoot 'On' -SecureBootTemplate $Test.SecureBoot
        }
        Hyper-V\Set-VMFirmware -VM $vm -FirstBootDevice (Hyper-V\Get-VMHardDiskDrive -VM $vm)
    }
    Hyper-V\Rename-VM -VM $vm -NewName $Test.Name
    Hyper-V\Start-VM -VM $vm
    $Test.Machine = [string] $vm.Id
    Write-Progressed -Partition $Test.Name -Status 'changed' -Detail 'it runs'
}

function Remove-TestPartition {
    # Remove every test partition with its disk, from any run. This script holds the lock, so no other run measures.
    param([switch] $Tell)
    foreach ($vm in @(Hyper-V\Get-VM)) {
        $mark = Get-Mark -Vm $vm
        $called = if ($mark.Name) { $mark.Name + '.rarms-000000000000' } else { [string] $vm.Name }
        if (-not ($called -cmatch '^rarms-p(?:1|2[bc]?)\.rarms-0{12}$')) { continue }
        if (Get-Tie -Vm $vm) { continue }
        $disks = @(@(Hyper-V\Get-VMHardDiskDrive -VM $vm) | Microsoft.PowerShell.Core\Where-Object -FilterScript {
            [string] $_.Path -cmatch $script:TestDisk
        })
        if (@('off', 'saved') -cnotcontains (ConvertTo-RunState -State $vm.State)) {
            Hyper-V\Stop-VM -VM $vm -TurnOff -Force
        }
        $folders = @([string] $vm.Path)
        Hyper-V\Remove-VM -VM $vm -Force
        foreach ($disk in $disks) {
            Remove-Item -LiteralPath $disk.Path
            $folders += [System.IO.Path]::GetDirectoryName($disk.Path)
        }
        $folders = @(foreach ($one in $folders) { if ($one -cmatch $script:TestFolder) { $one } })
        foreach ($one in @(Get-EmptyFolder -Path $folders)) { [System.IO.Directory]::Delete($one) }
        if ($Tell) { Write-Progressed -Partition ($called -creplace '\..*$', '') -Status 'changed' -Detail 'removed' }
    }
}
